"""Evidence on the disk, one bundle a target.

A bundle is there before its target's row and goes after it, under a name that says which of the two steps it is in, so
that a start after a crash can tell: ``.new`` without a row was never acknowledged, ``.deleting`` without a row has been
deleted. A ``.zip`` without a row is left alone: somebody has put another database beside it.
"""

from __future__ import annotations

import asyncio
import contextlib
import os
from collections.abc import Collection
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

    async def keep(self, sighting: Sighting, feed: VideoFeed) -> None:
        """Write the evidence of a target whose row comes next; `confirm` follows when that is kept.

        Raises
        ------
        TargetNotKeptError
            The folder cannot be written. Nothing of the bundle is left.
        """
        picture, files = await asyncio.gather(
            _picture(feed, sighting.frame.frame_id),
            asyncio.gather(*(self._described(file) for file in sighting.setup.files)),
        )
        await asyncio.to_thread(self._write, sighting, feed.source, files, picture)

    async def confirm(self, target_id: str) -> None:
        """The target's row is kept."""
        with contextlib.suppress(OSError):  # the name of before is found as well
            await asyncio.to_thread(self._path(target_id, NEW).rename, self._path(target_id, KEPT))

    async def discard(self, target_id: str) -> None:
        """The target's row could not be kept."""
        await asyncio.to_thread(self._remove, target_id, NEW)

    async def before_deletion(self, target_id: str) -> None:
        """The target's row is to be deleted; `deleted` or `not_deleted` follows. TargetNotKeptError: cannot be done."""
        try:
            await asyncio.to_thread(self._rename, target_id, (KEPT, NEW), DELETING)
        except OSError as error:
            raise TargetNotKeptError(_words(error)) from None

    async def deleted(self, target_id: str) -> None:
        """The target's row is deleted."""
        await asyncio.to_thread(self._remove, target_id, DELETING)

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
        data = await asyncio.to_thread(self._read, target.id)
        if data is None:
            raise NoEvidenceError(target.id, "none was kept: it was located by an older version, or the file is gone")
        bundle = await asyncio.to_thread(unpack, data, f"evidence of target '{target.id}' (kept by the station)")
        proven = bundle.evidence.target.version
        if version is not None and version not in (proven, target.version):
            raise NoEvidenceError(target.id, f"there is evidence of version {proven} only, not of version {version}")
        moved = _moved(target, bundle)
        if moved is None:
            return bundle
        if version != proven:
            raise NoEvidenceError(
                target.id, f"{moved}; the evidence of version {proven} is kept, under ?version={proven}"
            )
        return Bundle(bundle.evidence, bundle.document, bundle.picture, moved)

    @staticmethod
    def click_version(target: Target) -> int | None:
        """The version that a target's click had, where following has moved it since; None for others."""
        return FIRST_VERSION if target.method == FOLLOWED else None

    async def tidy(self, target_ids: Collection[str]) -> None:
        """At the start: finish what a crash cut off; ``target_ids`` are those that have a row."""
        try:
            await asyncio.to_thread(self._tidy, frozenset(target_ids))
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

    def _path(self, target_id: str, step: str) -> Path:
        return self.folder / f"{target_id}{step}"

    def _write(self, sighting: Sighting, source: str, files: list[FileUsedPart], picture: bytes | None) -> None:
        evidence = evidence_of(sighting, source, files, picture, self._version)
        data = pack(document_of(evidence), picture)
        path = self._path(sighting.target.id, NEW)
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            write_atomically(path, data)
            _sync_folder(self.folder)
        except OSError as error:
            self._remove(sighting.target.id, NEW)
            raise TargetNotKeptError(f"evidence: {_words(error)}") from None

    def _read(self, target_id: str) -> bytes | None:
        for step in (KEPT, NEW):
            try:
                return self._path(target_id, step).read_bytes()
            except (FileNotFoundError, NotADirectoryError):
                continue
            except OSError as error:
                raise BundleError(f"evidence of target '{target_id}'", f"cannot be read: {_words(error)}") from None
        return None

    def _rename(self, target_id: str, steps: tuple[str, ...], to: str) -> None:
        for step in steps:
            with contextlib.suppress(FileNotFoundError, NotADirectoryError):
                self._path(target_id, step).rename(self._path(target_id, to))

    def _remove(self, target_id: str, step: str) -> None:
        try:
            self._path(target_id, step).unlink(missing_ok=True)
        except NotADirectoryError:
            return
        except OSError as error:  # the next start tries again
            _log.warning("evidence not removed", target=target_id, error=str(error))

    def _tidy(self, target_ids: frozenset[str]) -> None:
        if not self.folder.is_dir():
            return
        for path in self.folder.iterdir():
            if path.name.startswith(".") and path.suffix == ".partial":
                path.unlink()
            elif path.suffix in (NEW, DELETING):
                if path.stem in target_ids:
                    path.rename(path.with_suffix(KEPT))
                else:
                    path.unlink()
            elif path.suffix == KEPT and path.stem not in target_ids:
                _log.warning("evidence of a target that the database does not have", file=str(path))


async def _picture(feed: VideoFeed, frame_id: int) -> bytes | None:
    try:
        return await feed.jpeg(frame_id)
    except FrameGoneError:
        return None


def _moved(target: Target, bundle: Bundle) -> str | None:
    """Why the evidence does not prove the coordinate that the target has; None where it does."""
    result = bundle.evidence.result
    proven = (result.lat_deg, result.lon_deg, result.alt_amsl_m, result.method)
    if (target.lat_deg, target.lon_deg, target.alt_amsl_m, target.method) == proven:
        return None
    since = f"version {bundle.evidence.target.version} (it has version {target.version} now)"
    if target.method == FOLLOWED:
        return f"it was followed after {since}, and the evidence of the click does not prove where it was seen later"
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
