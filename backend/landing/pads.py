"""The landing pad that the station looks for: given at the start or by the page, and kept over a restart."""

from __future__ import annotations

import json
from pathlib import Path

from backend.errors import StartError
from estimator.landing.pad import Pad
from geodata.errors import PadFileError
from geodata.flight_pad import pad_of_section
from geodata.pad_file import pad_from, read_pad, write_pad

FILE_NAME = "pad.json"
UPLOADED = Path("the pad's description")


class Pads:
    """At most one pad: the one given at the start, else what the page gave last, which is kept, else the camera file's.

    The last is the ``pad`` of a ``flight.json``. Where a survey has that pad is not used: a flight finds it by itself.
    """

    def __init__(self, data_dir: Path) -> None:
        self._kept = data_dir / FILE_NAME
        self.pad: Pad | None = None

    def load(self, given: Path | None, camera_file: Path | None = None) -> None:
        """The pad to begin with; StartError when its description cannot be used."""
        remedy = ""
        try:
            if given is not None:
                self.pad = read_pad(given)
            elif self._kept.exists():
                remedy = f"; remove '{self._kept}' to start without"
                self.pad = read_pad(self._kept)
            elif camera_file is not None:
                self.pad = _of_camera_file(camera_file)
        except PadFileError as error:
            raise StartError(f"landing pad: {error}{remedy}") from None

    def give(self, description: object) -> Pad:
        """Take a description and keep it. PadFileError says what is wrong with it, OSError that it cannot be kept."""
        pad = pad_from(description, UPLOADED)
        self._kept.parent.mkdir(parents=True, exist_ok=True)
        write_pad(self._kept, pad)
        self.pad = pad
        return pad

    def remove(self) -> None:
        """Look for none any more."""
        self._kept.unlink(missing_ok=True)
        self.pad = None


def _of_camera_file(path: Path) -> Pad | None:
    """The pad of a camera file, which is known to be an object, None where it has none."""
    section = json.loads(path.read_text(encoding="utf-8")).get("pad")
    if not section:
        return None
    if not isinstance(section, dict):
        raise PadFileError(path, f"is no object: {section!r:.60}", "leave it out, or describe a pad", field="pad")
    return pad_of_section(section, path, lambda name: path.parent / name)
