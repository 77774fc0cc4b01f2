"""SHA-256 of the files that a coordinate leans on, each read once."""

from __future__ import annotations

import threading
from dataclasses import dataclass

from backend.navigation.setup import FileUsed
from geodata.maps import sha256_of_file


@dataclass(frozen=True, slots=True)
class FileHash:
    """A file's SHA-256 in hexadecimal, or None and the problem with it."""

    sha256: str | None
    problem: str | None = None


class FileHashes:
    """Hashes by file, size and time. Any thread; two that want the same file wait for one reading of it."""

    def __init__(self) -> None:
        self._known: dict[FileUsed, FileHash] = {}
        self._lock = threading.Lock()

    def of(self, file: FileUsed) -> FileHash:
        """Hash of a file as it was when it was put in use; takes seconds for gigabytes, the first time."""
        with self._lock:
            found = self._known.get(file)
            if found is None:
                found = _hash(file)
                if found.problem is None:
                    self._known[file] = found
            return found


def _hash(file: FileUsed) -> FileHash:
    changed = FileHash(None, "the file has changed since the station read it")
    try:
        if FileUsed.of(file.role, file.path) != file:
            return changed
        found = sha256_of_file(file.path)
        return FileHash(found) if FileUsed.of(file.role, file.path) == file else changed
    except OSError as error:
        return FileHash(None, f"the file cannot be read any more: {error.strerror or error}")
