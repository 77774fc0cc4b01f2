"""Reads the outside answers that are stored in this folder."""

import json
from pathlib import Path
from typing import Any


def stored(name: str) -> dict[str, Any]:
    """The answers of ``NAME.json``."""
    return json.loads((Path(__file__).parent / f"{name}.json").read_text())
