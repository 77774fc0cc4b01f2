"""The landing pad that the station looks for: given at the start or by the page, and kept over a restart."""

from __future__ import annotations

import json
from pathlib import Path

from backend.errors import StartError
from estimator.landing.pad import Pad
from geodata.errors import PadFileError
from geodata.pad_file import as_description, pad_from, read_pad

FILE_NAME = "pad.json"
UPLOADED = Path("the pad's description")


class Pads:
    """At most one pad. What the page gives is kept in the data folder; a pad given at the start goes before it."""

    def __init__(self, data_dir: Path) -> None:
        self._kept = data_dir / FILE_NAME
        self.pad: Pad | None = None

    def load(self, given: Path | None) -> None:
        """The pad to begin with; StartError when its description cannot be used."""
        path = given if given is not None else (self._kept if self._kept.exists() else None)
        if path is None:
            return
        try:
            self.pad = read_pad(path)
        except PadFileError as error:
            remedy = "" if given is not None else f"; remove '{path}' to start without"
            raise StartError(f"landing pad: {error}{remedy}") from None

    def give(self, description: object) -> Pad:
        """Take a description and keep it. PadFileError says what is wrong with it, OSError that it cannot be kept."""
        pad = pad_from(description, UPLOADED)
        self._kept.parent.mkdir(parents=True, exist_ok=True)
        unfinished = self._kept.with_suffix(".part")
        unfinished.write_text(json.dumps(as_description(pad), indent=1) + "\n", encoding="utf-8")
        unfinished.replace(self._kept)
        self.pad = pad
        return pad

    def remove(self) -> None:
        """Look for none any more."""
        self._kept.unlink(missing_ok=True)
        self.pad = None
