"""Which flights there are: folders under the data folder, and folders the operator pointed at (read-only)."""

from __future__ import annotations

import hashlib
import re
import shutil
import threading
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from backend.errors import ConflictError, UnknownFlightError
from geodata.errors import FlightFolderError
from geodata.flight import FlightFolder


@dataclass(frozen=True, slots=True)
class FlightEntry:
    """One flight in the list. ``problem`` says why a folder cannot be used; then times are None."""

    id: str
    name: str
    path: Path
    read_only: bool
    start_unix_us: int | None
    duration_s: float | None
    bytes: int
    has_video: bool
    has_truth: bool
    warnings: tuple[str, ...]
    problem: str | None


class FlightShelf:
    """Finds and checks flight folders. Reads the disk: not for the event loop."""

    def __init__(self, own_dir: Path, other_dirs: Sequence[Path] = ()) -> None:
        self.own_dir = own_dir
        self._other_dirs = tuple(other_dirs)
        self._checked: dict[Path, tuple[tuple[int, int], FlightEntry]] = {}
        self._lock = threading.Lock()

    def all(self) -> list[FlightEntry]:
        """All flights, the newest first; broken folders last."""
        with self._lock:
            entries = [self._entry(path, name, read_only) for name, path, read_only in self._folders()]
        return sorted(entries, key=lambda entry: (entry.start_unix_us is None, -(entry.start_unix_us or 0), entry.id))

    def get(self, flight_id: str) -> FlightEntry:
        """One flight, or UnknownFlightError."""
        with self._lock:
            for name, path, read_only in self._folders():
                if name == flight_id:
                    return self._entry(path, name, read_only)
        raise UnknownFlightError(flight_id)

    def delete(self, flight_id: str) -> None:
        """Remove a flight of the data folder; ConflictError for one the operator pointed at."""
        entry = self.get(flight_id)
        if entry.read_only:
            raise ConflictError(f"flight '{flight_id}' lies in '{entry.path.parent}', which is read only here")
        shutil.rmtree(entry.path)

    def _folders(self) -> list[tuple[str, Path, bool]]:
        found: list[tuple[str, Path, bool]] = []
        taken: set[str] = set()
        for directory, read_only in [(self.own_dir, False), *((other, True) for other in self._other_dirs)]:
            for path in _flight_folders(directory, read_only):
                name = re.sub(r"[^A-Za-z0-9._-]+", "-", path.name).strip("-.") or "flight"
                if name in taken:
                    name += "-" + hashlib.sha256(str(path).encode()).hexdigest()[:8]
                taken.add(name)
                found.append((name, path, read_only))
        return found

    def _entry(self, path: Path, name: str, read_only: bool) -> FlightEntry:
        stamp = _stamp(path)
        known = self._checked.get(path)
        if known is None or known[0] != stamp:
            known = (stamp, _check(path, name, read_only))
            self._checked[path] = known
        return known[1]


def _flight_folders(directory: Path, may_be_flight: bool) -> list[Path]:
    if may_be_flight and (directory / "flight.json").exists():
        return [directory]
    try:
        return sorted(path for path in directory.iterdir() if path.is_dir() and not path.name.startswith("."))
    except OSError:
        return []


def _stamp(path: Path) -> tuple[int, int]:
    """Changes when any file of the folder does."""
    newest, size = 0, 0
    try:
        for file in path.iterdir():
            status = file.stat()
            newest, size = max(newest, status.st_mtime_ns), size + status.st_size
    except OSError:
        return 0, 0
    return newest, size


def _check(path: Path, name: str, read_only: bool) -> FlightEntry:
    size = _size(path)
    try:
        flight = FlightFolder.open(path)
        start_us, end_us = flight.telemetry_span()
    except (FlightFolderError, OSError) as error:
        return FlightEntry(name, path.name, path, read_only, None, None, size, False, False, (), str(error))
    return FlightEntry(
        name, flight.name, path, read_only, start_us, (end_us - start_us) / 1e6, size,
        flight.video_path is not None, (path / "truth.csv").exists(), tuple(flight.warnings), None,
    )  # fmt: skip


def _size(path: Path) -> int:
    try:
        return sum(file.stat().st_size for file in path.rglob("*") if file.is_file())
    except OSError:
        return 0
