"""Evidence on the disk, one bundle a target, and one more for each version that was located better (``ID@VERSION``).

A bundle is there before its target's row and goes after it, under a name that says which of the two steps it is in, so
that a start after a crash can tell: ``.new`` without a row was never acknowledged, ``.deleting`` without a row has been
deleted. A ``.zip`` without a row is left alone: somebody has put another database beside it.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Mapping
from pathlib import Path

import structlog

from backend.errors import BundleError, FrameGoneError, NoEvidenceError, TargetNotKeptError
from backend.evidence.bundle import Bundle, pack, unpack
from backend.evidence.collect import Sighting, evidence_of
from backend.evidence.files import FileHashes
from backend.evidence.schema import FileUsedPart, document_of
from backend.fleet.feed import VideoFeed
from backend.mapping import StationMaps
from backend.navigation.setup import FileUsed, NavigationSetup
from backend.store.targets import FOLLOWED, Target
from geodata.flight_write import write_atomically

KEPT, NEW, DELETING = ".zip", ".new", ".deleting"
FIRST_VERSION = 1  # of the click, which is located before anything else happens to a target
AGAIN = "@"
_log = structlog.get_logger(__name__)


class EvidenceKeeper:
    """The evidence of a station's targets. Lives on the event loop; files are handled in worker threads."""

    def __init__(self, folder: Path, maps: StationMaps, version: str) -> None:
        self.folder = folder
        self.changing = asyncio.Lock()
        self._maps = maps
        self._version = version
        self._hashes = FileHashes()

    async def prepare(self, setup: NavigationSetup) -> None:
        """Hash the files of a set-up, so that the first click need not wait for that."""
        for file in setup.files:
            await asyncio.to_thread(self._hashes.of, file)

    async def keep(self, sighting: Sighting, feed: VideoFeed) -> bytes | None:
        """Write the evidence of a target whose row comes next; `confirm` follows when that is kept.

        Returns the picture, a JPEG, None where it is no longer held.

        Raises
        ------
        TargetNotKeptError
            The folder cannot be written. Nothing of the bundle is left.
        """
        picture = await _picture(feed, sighting.frame.frame_id)
        await self.keep_again(sighting, feed.source, picture)
        return picture

    async def keep_again(self, sighting: Sighting, source: str, picture: bytes | None) -> None:
        """The same for the next version of a target, whose ``picture`` is at hand; what is kept of others stays."""
        files = await asyncio.gather(*(self._described(file) for file in sighting.setup.files))
        await asyncio.to_thread(self._write, sighting, source, files, picture)

    async def confirm(self, target_id: str, version: int = FIRST_VERSION) -> None:
        """The target's row is kept."""
        with contextlib.suppress(OSError):  # the name of before is found as well
            await asyncio.to_thread(self._path(target_id, NEW, version).rename, self._path(target_id, KEPT, version))

    async def discard(self, target_id: str, version: int = FIRST_VERSION) -> None:
        """The target's row could not be kept."""
        await asyncio.to_thread(self._remove, self._path(target_id, NEW, version))

    async def before_deletion(self, target_id: str) -> None:
        """The target's row is to be deleted; `deleted` or `not_deleted` follows. TargetNotKeptError: cannot be done."""
        try:
            await asyncio.to_thread(self._rename, target_id, (KEPT, NEW), DELETING)
        except OSError as error:
            raise TargetNotKeptError(_words(error)) from None

    async def deleted(self, target_id: str) -> None:
        """The target's row is deleted."""
        for path in await asyncio.to_thread(self._paths, target_id, DELETING):
            await asyncio.to_thread(self._remove, path)

    async def not_deleted(self, target_id: str) -> None:
        """The target's row is still there."""
        with contextlib.suppress(OSError):
            await asyncio.to_thread(self._rename, target_id, (DELETING,), KEPT)

    async def bundle(self, target: Target, version: int | None) -> Bundle:
        """The evidence of a target's coordinate, or of the coordinate that it had in a ``version``.

        Raises
        ------
        NoEvidenceError
            It was typed in or moved, or nothing was kept.
        BundleError
            The file on the disk is damaged.
        """
        if target.frame_id is None:
            raise NoEvidenceError(target.id, "it was typed in; only what is clicked on a picture is computed")
        every = await asyncio.to_thread(self._read, target.id)
        kept = {number: data for number, data in every.items() if number <= target.version}
        if not kept:
            raise NoEvidenceError(target.id, "none was kept: it was located by an older version, or the file is gone")
        newest = max(kept)
        proven = version if version in kept and version is not None else newest
        name = f"evidence of target '{target.id}' (kept by the station)"
        bundle = await asyncio.to_thread(unpack, kept[proven], name)
        if version is not None and version not in (proven, target.version):
            which = f"version {newest} only" if len(kept) == 1 else f"versions {', '.join(map(str, sorted(kept)))} only"
            raise NoEvidenceError(target.id, f"there is evidence of {which}, not of version {version}")
        moved = _moved(target, bundle, proven == newest)
        if moved is None:
            return bundle
        if version != proven:
            raise NoEvidenceError(
                target.id, f"{moved}; the evidence of version {proven} is kept, under ?version={proven}"
            )
        return Bundle(bundle.evidence, bundle.document, bundle.picture, moved, bundle.pieces)

    @staticmethod
    def click_version(target: Target) -> int | None:
        """The version that a target's click had, where following has moved it since; None for others."""
        return FIRST_VERSION if target.method == FOLLOWED else None

    async def tidy(self, versions: Mapping[str, int]) -> None:
        """At the start: finish what a crash cut off; ``versions`` are those of the targets that have a row."""
        try:
            await asyncio.to_thread(self._tidy, versions)
        except OSError as error:
            _log.warning("evidence not tidied", folder=str(self.folder), error=str(error))

    async def _described(self, file: FileUsed) -> FileUsedPart:
        found = await asyncio.to_thread(self._hashes.of, file)
        record = self._maps.record_of(file.path)
        return FileUsedPart(
            role=file.role, file=file.path.name, size_bytes=file.size_bytes, sha256=found.sha256,
            map_id=None if record is None else record.id,
            source_file=None if record is None else record.source_file,
            source_sha256=None if record is None else record.sha256, problem=found.problem,
        )  # fmt: skip

    def _path(self, target_id: str, step: str, version: int = FIRST_VERSION) -> Path:
        again = "" if version == FIRST_VERSION else f"{AGAIN}{version}"
        return self.folder / f"{target_id}{again}{step}"

    def _paths(self, target_id: str, step: str) -> list[Path]:
        """What there is of a target in a step, of all its versions."""
        first = self._path(target_id, step)
        return [*([first] if first.exists() else []), *sorted(self.folder.glob(f"{target_id}{AGAIN}*{step}"))]

    def _write(self, sighting: Sighting, source: str, files: list[FileUsedPart], picture: bytes | None) -> None:
        evidence, pieces = evidence_of(sighting, source, files, picture, self._version)
        data = pack(document_of(evidence), picture, None, pieces)
        path = self._path(sighting.target.id, NEW, sighting.target.version)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_atomically(path, data)
            _sync_folder(self.folder)
        except OSError as error:
            self._remove(path)
            raise TargetNotKeptError(f"evidence: {_words(error)}") from None

    def _read(self, target_id: str) -> dict[int, bytes]:
        """The bytes of each version that is kept."""
        found: dict[int, bytes] = {}
        for step in (NEW, KEPT):
            for path in self._paths(target_id, step):
                try:
                    found[_version_of(path)] = path.read_bytes()
                except (FileNotFoundError, NotADirectoryError):
                    continue
                except OSError as error:
                    name = f"evidence of target '{target_id}'"
                    raise BundleError(name, f"cannot be read: {_words(error)}") from None
        return found

    def _rename(self, target_id: str, steps: tuple[str, ...], to: str) -> None:
        for step in steps:
            for path in self._paths(target_id, step):
                with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                    path.rename(path.with_suffix(to))

    def _remove(self, path: Path) -> None:
        try:
            path.unlink(missing_ok=True)
        except NotADirectoryError:
            return
        except OSError as error:  # the next start tries again
            _log.warning("evidence not removed", file=str(path), error=str(error))

    def _tidy(self, versions: Mapping[str, int]) -> None:
        if not self.folder.is_dir():
            return
        for path in self.folder.iterdir():
            if path.name.startswith(".") and path.suffix == ".partial":
                path.unlink()
            elif path.suffix in (NEW, DELETING):
                if versions.get(_target_of(path), 0) >= _version_of(path):
                    path.rename(path.with_suffix(KEPT))
                else:
                    path.unlink()
            elif path.suffix == KEPT and _target_of(path) not in versions:
                _log.warning("evidence of a target that the database does not have", file=str(path))


async def _picture(feed: VideoFeed, frame_id: int) -> bytes | None:
    try:
        return await feed.jpeg(frame_id)
    except FrameGoneError:
        return None


def _target_of(path: Path) -> str:
    return path.stem.partition(AGAIN)[0]


def _version_of(path: Path) -> int:
    number = path.stem.partition(AGAIN)[2]
    return int(number) if number.isascii() and number.isdigit() else FIRST_VERSION


def _moved(target: Target, bundle: Bundle, is_newest: bool) -> str | None:
    """Why the evidence does not prove the coordinate that the target has; None where it does."""
    result = bundle.evidence.result
    proven = (result.lat_deg, result.lon_deg, result.alt_amsl_m, result.method)
    if (target.lat_deg, target.lon_deg, target.alt_amsl_m, target.method) == proven:
        return None
    since = f"version {bundle.evidence.target.version} (it has version {target.version} now)"
    if target.method == FOLLOWED:
        return f"it was followed after {since}, and the evidence of the click does not prove where it was seen later"
    if not is_newest:
        return f"it has been located better since version {bundle.evidence.target.version}"
    return f"it was moved by hand after {since}, and nothing proves where it was moved to"


def _sync_folder(folder: Path) -> None:
    """Have the folder's names on the disk: a row must not survive a power cut that its evidence does not."""
    handle = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(handle)
    finally:
        os.close(handle)


def _words(error: OSError) -> str:
    return f"{error.strerror or error}" + (f" ('{error.filename}')" if error.filename else "")
