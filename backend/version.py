"""What this installation calls itself."""

from __future__ import annotations

import contextlib
from importlib.metadata import PackageNotFoundError, version


def package_version() -> str:
    """The installed version."""
    with contextlib.suppress(PackageNotFoundError):
        return version("pilotage")
    return "0+unknown"
