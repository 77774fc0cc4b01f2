"""Records a flight: the event loop hands in, a thread of its own writes.

A slow disk makes the thread late and, beyond a bound, loses records, which is counted and alarms; it never makes the
link, the estimator or a viewer wait.
"""

from __future__ import annotations

import queue
import re
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import structlog

from backend.clock import mono_us, unix_us
from backend.errors import ConflictError
from backend.recorder.alignments import AlignmentRow
from backend.recorder.folder import ClickRow, FlightWriter, RecordingPlan
from backend.recorder.followed import FollowedRow
from backend.video.frames import EncodedFrame
from estimator.types import NavigationState

MAX_WAITING = 20_000
MAX_WAITING_BYTES = 128_000_000
SYNC_EVERY_US = 1_000_000

_log = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class _Packet:
    t_unix_us: int
    data: bytes


@dataclass(frozen=True, slots=True)
class _Denied:
    t_unix_us: int
    denied: bool


@dataclass(frozen=True, slots=True)
class _End:
    pass


_Record = _Packet | EncodedFrame | NavigationState | ClickRow | FollowedRow | AlignmentRow | _Denied | _End


@dataclass(frozen=True, slots=True)
class RecordingStatus:
    """What the recorder does now."""

    active: bool
    flight_id: str | None
    duration_s: float
    bytes: int


class Recorder:
    """At most one recording at a time, in a folder of its own under ``flights_dir``."""

    def __init__(self, flights_dir: Path) -> None:
        self._flights_dir = flights_dir
        self._session: _Session | None = None

    @property
    def flight_id(self) -> str | None:
        """The id of the flight that is being recorded."""
        return None if self._session is None else self._session.folder.name

    @property
    def status(self) -> RecordingStatus:
        """What the recorder does now."""
        session = self._session
        if session is None:
            return RecordingStatus(False, None, 0.0, 0)
        return RecordingStatus(
            True, session.folder.name, (mono_us() - session.started_mono_us) / 1e6, session.bytes_written
        )

    @property
    def dropped(self) -> int:
        """Records that the disk was too slow for, of the running recording."""
        return 0 if self._session is None else self._session.dropped

    @property
    def failure(self) -> str | None:
        """Why the running recording cannot write, None when it can."""
        return None if self._session is None else self._session.failure

    def start(self, plan: RecordingPlan, name: str | None = None) -> str:
        """Begin to record; returns the flight's id. Copies the map, so not for the event loop.

        Raises
        ------
        ConflictError
            A recording runs already, or its folder cannot be made.
        """
        if self._session is not None:
            raise ConflictError(f"flight '{self.flight_id}' is being recorded already: stop it first")
        folder = _new_folder(self._flights_dir, name)
        try:
            writer = FlightWriter(folder, plan, name or folder.name)
        except OSError as error:
            raise ConflictError(f"cannot record into '{folder}': {error.strerror or error}") from None
        self._session = _Session(folder, writer)
        return folder.name

    def stop(self) -> str | None:
        """End the recording with everything handed in so far on the disk; returns its id, None when none ran."""
        session, self._session = self._session, None
        if session is None:
            return None
        session.finish()
        return session.folder.name

    def packet(self, t_unix_us: int, data: bytes) -> None:
        """Record a MAVLink packet as received."""
        self._put(_Packet(t_unix_us, data), len(data))

    def frame(self, frame: EncodedFrame) -> None:
        """Record a video frame as received; from any thread."""
        self._put(frame, len(frame.payload))

    def state(self, state: NavigationState) -> None:
        """Record what the estimator said."""
        self._put(state, 1000)

    def click(self, row: ClickRow) -> None:
        """Record an operator's click."""
        self._put(row, 100)

    def followed(self, row: FollowedRow) -> None:
        """Record what a picture showed of a followed target."""
        self._put(row, 200)

    def alignment(self, row: AlignmentRow) -> None:
        """Record how an operator laid a picture on the map."""
        self._put(row, 200)

    def gps_denied(self, denied: bool) -> None:
        """Record that GPS is kept from the estimator from now on, or no longer."""
        self._put(_Denied(unix_us(), denied), 20)

    def _put(self, record: _Record, size: int) -> None:
        session = self._session  # one look: a stop in another thread may take it away
        if session is not None:
            session.put(record, size)


class _Session:
    """One running recording and its thread."""

    def __init__(self, folder: Path, writer: FlightWriter) -> None:
        self.folder = folder
        self.started_mono_us = mono_us()
        self.dropped = 0
        self.failure: str | None = None
        self._writer = writer
        self._waiting_bytes = 0
        self._records: queue.Queue[tuple[_Record, int]] = queue.Queue()
        self._lock = threading.Lock()
        self._thread = threading.Thread(target=self._run, name=f"recorder-{folder.name}", daemon=True)
        self._thread.start()

    @property
    def bytes_written(self) -> int:
        return self._writer.bytes_written

    def put(self, record: _Record, size: int) -> None:
        with self._lock:
            if self._records.qsize() >= MAX_WAITING or self._waiting_bytes + size > MAX_WAITING_BYTES:
                self.dropped += 1
                return
            self._waiting_bytes += size
        self._records.put((record, size))

    def finish(self, timeout_s: float = 2.0) -> None:
        self._records.put((_End(), 0))
        self._thread.join(timeout_s)
        if self._thread.is_alive():
            _log.warning("recording not written to its end: the disk is too slow", folder=str(self.folder))

    def _run(self) -> None:
        next_sync_us = mono_us() + SYNC_EVERY_US
        while True:
            try:
                record, size = self._records.get(timeout=max(next_sync_us - mono_us(), 0) / 1e6)
            except queue.Empty:
                record, size = None, 0
            with self._lock:
                self._waiting_bytes -= size
            if isinstance(record, _End):
                break
            self._try(lambda record=record: self._write(record))  # type: ignore[misc]
            if mono_us() >= next_sync_us:
                next_sync_us = mono_us() + SYNC_EVERY_US
                self._try(self._writer.flush)
        self._try(self._writer.close)

    def _try(self, write: Callable[[], None]) -> None:
        try:
            write()
        except (OSError, ValueError) as error:
            # A full or broken disk must not end the flight: the alarm says so, and writing goes on when it can.
            if self.failure is None:
                _log.error("recording cannot write", folder=str(self.folder), error=str(error))
            self.failure = str(error)

    def _write(self, record: _Record | None) -> None:
        match record:
            case _Packet(t_unix_us, data):
                self._writer.packet(t_unix_us, data)
            case EncodedFrame():
                self._writer.frame(record)
            case NavigationState():
                self._writer.state(record)
            case ClickRow():
                self._writer.click(record)
            case FollowedRow():
                self._writer.followed(record)
            case AlignmentRow():
                self._writer.alignment(record)
            case _Denied(t_unix_us, denied):
                self._writer.gps_denied(t_unix_us, denied)
            case _:
                pass


def _new_folder(flights_dir: Path, name: str | None) -> Path:
    stamp = time.strftime("%Y%m%d-%H%M%S", time.gmtime(unix_us() // 1_000_000))
    slug = re.sub(r"[^a-z0-9]+", "-", (name or "").lower()).strip("-")[:40]
    base = f"{stamp}-{slug}" if slug else stamp
    for suffix in ("", *(f"-{n}" for n in range(2, 100))):
        folder = flights_dir / (base + suffix)
        try:
            folder.mkdir(parents=True)
        except FileExistsError:
            continue
        except OSError as error:
            raise ConflictError(f"cannot make the folder '{folder}': {error.strerror or error}") from None
        return folder
    raise ConflictError(f"a hundred flights are named '{base}' already")
