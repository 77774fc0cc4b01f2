"""Running replays: starts them, finds or computes their estimates, ends them."""

from __future__ import annotations

import asyncio
import hashlib
import json
import shutil
import sys
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import structlog

from backend.errors import ConflictError, UnknownReplayError
from backend.event_loop import call_from_thread
from backend.flights import FlightEntry, FlightShelf
from backend.hub import Hub
from backend.playback.estimate import EstimateTable
from backend.playback.playback import Playback
from backend.playback.recording import read_recording
from backend.playback.report import page_of_flight
from backend.replay.hindsight import SMOOTHED_FILE
from backend.schemas.vehicles import ReplayBody, ReplayChange
from backend.store.targets import Target

MAX_REPLAYS = 4
ESTIMATE_FILE, FIXES_FILE, REPORT_FILE = "estimate.csv", "fixes.csv", "report.json"

_log = structlog.get_logger(__name__)


class Replays:
    """All replays of a station, each under the vehicle id ``replay-<flight id>``."""

    def __init__(self, flights: FlightShelf, cache_dir: Path, hub: Hub) -> None:
        self._flights = flights
        self._cache_dir = cache_dir
        self._hub = hub
        self._running: dict[str, Playback] = {}
        self._entries: dict[str, FlightEntry] = {}
        self._estimating: dict[str, asyncio.Task[None]] = {}
        self._looking_ahead: dict[str, asyncio.Task[None]] = {}
        self._one_at_a_time = asyncio.Lock()
        self._one_computation = asyncio.Lock()

    async def start(self, flight_id: str, speed: float, start_s: float) -> ReplayBody:
        """Begin to replay a flight, anew if it is being replayed.

        Raises
        ------
        UnknownFlightError, ConflictError, FlightFolderError, VideoError
            There is no such flight, it is broken, or too many replays run.
        """
        entry = await asyncio.to_thread(self._flights.get, flight_id)
        if entry.problem is not None:
            raise ConflictError(f"flight '{flight_id}' cannot be replayed: {entry.problem}")
        async with self._one_at_a_time:
            old = self._running.get(f"replay-{flight_id}")
            if old is not None:
                await self.end(old.id)
            if len(self._running) >= MAX_REPLAYS:
                raise ConflictError(f"{MAX_REPLAYS} replays run already: end one first")
            loop = asyncio.get_running_loop()
            body = {"vehicle_id": f"replay-{flight_id}", "flight_id": flight_id}

            def progress(done: float) -> None:
                call_from_thread(loop, lambda done: self._hub.publish("replay_preparing", **body, progress=done), done)

            recording = await asyncio.to_thread(read_recording, entry.path, progress)
            playback = Playback(flight_id, recording, self._hub, speed, start_s)
            self._running[playback.id] = playback
            self._entries[playback.id] = entry
        self._hub.publish("vehicle", action="created", vehicle=playback.summary())
        self._estimating[playback.id] = asyncio.create_task(self._estimate(playback, entry))
        playback.start()
        return playback.body()

    def change(self, vehicle_id: str, change: ReplayChange) -> ReplayBody:
        """Pause, go on, change speed or seek."""
        playback = self._get(vehicle_id)
        playback.change(change.paused, change.speed, change.seek_unix_us)
        return playback.body()

    async def end(self, vehicle_id: str) -> None:
        """End a replay."""
        playback = self._get(vehicle_id)
        del self._running[vehicle_id], self._entries[vehicle_id]
        tasks = [tasks.pop(vehicle_id, None) for tasks in (self._looking_ahead, self._estimating)]
        for task in tasks:
            if task is not None:
                task.cancel()
                await asyncio.gather(task, return_exceptions=True)
        await playback.close()
        self._hub.publish("vehicle", action="deleted", vehicle=vehicle_id)

    async def history(self, vehicle_id: str, since_us: int, step_us: int) -> dict[str, Any]:
        """Fields of `HistoryBody` of the whole flight, as far as its estimate is known yet."""
        playback, entry = self._get(vehicle_id), self._entries[vehicle_id]
        files = (entry.path / FIXES_FILE, self._cached(entry) / FIXES_FILE)
        fixes = next((path for path in files if path.exists()), None)
        return await asyncio.to_thread(playback.history_body, fixes, since_us, step_us)

    async def report(self, flight_id: str, targets: Sequence[Target]) -> str:
        """The page of a flight with the estimate that was recorded or has been computed for a replay.

        Raises
        ------
        UnknownFlightError, ConflictError, FlightFolderError, VideoError
            There is no such flight, it is broken, or nothing has been estimated of it yet.
        """
        entry = await asyncio.to_thread(self._flights.get, flight_id)
        if entry.problem is not None:
            raise ConflictError(f"flight '{flight_id}' cannot be read: {entry.problem}")
        for folder in (entry.path, self._cached(entry)):
            table = await asyncio.to_thread(_read_if_useful, folder / ESTIMATE_FILE)
            if table is not None:
                return await asyncio.to_thread(page_of_flight, entry.path, table, folder / FIXES_FILE, targets)
        raise ConflictError(f"flight '{flight_id}' has no estimate yet: replay it once, which computes one")

    async def close(self) -> None:
        """End all replays."""
        for vehicle_id in list(self._running):
            await self.end(vehicle_id)

    def of_flight(self, flight_id: str) -> Playback | None:
        """The replay of a flight, None when it is not being replayed."""
        return self._running.get(f"replay-{flight_id}")

    def vehicles(self) -> list[Playback]:
        """Replays as vehicles."""
        return list(self._running.values())

    def feeds(self) -> list[Playback]:
        """Replays as video sources."""
        return [playback for playback in self._running.values() if playback.recording.video is not None]

    def bodies(self) -> list[ReplayBody]:
        """Where all replays stand."""
        return [playback.body() for playback in self._running.values()]

    def look_ahead(self, vehicle_id: str) -> Playback:
        """Find out, if that is not begun, what later fixes of the flight make of its states: a target was clicked.

        Returns the replay, which will know.
        """
        playback = self._get(vehicle_id)
        if vehicle_id not in self._looking_ahead:
            self._looking_ahead[vehicle_id] = asyncio.create_task(self._hindsight(playback, self._entries[vehicle_id]))
        return playback

    async def _hindsight(self, playback: Playback, entry: FlightEntry) -> None:
        """Read what a computation of the flight's estimate has left, else compute it; the recorded one stays shown."""
        table: EstimateTable | None = None
        offset_us = 0
        try:
            estimating = self._estimating.get(playback.id)
            if estimating is not None:
                await asyncio.gather(estimating, return_exceptions=True)
            cached = self._cached(entry)
            async with self._one_computation:
                table = await asyncio.to_thread(_read_if_useful, cached / SMOOTHED_FILE)
                if table is None:
                    await self._compute(entry, cached, lambda _: None)
                    table = await asyncio.to_thread(_read_if_useful, cached / SMOOTHED_FILE)
            offset_us = await asyncio.to_thread(_found_offset_us, cached / REPORT_FILE)
        except (OSError, ConflictError) as error:
            _log.warning("clicks on a replay stay as located", flight=entry.id, error=str(error))
        finally:
            playback.use_hindsight(table, offset_us)

    def _cached(self, entry: FlightEntry) -> Path:
        return self._cache_dir / "estimates" / _cache_key(entry)

    def _get(self, vehicle_id: str) -> Playback:
        if vehicle_id not in self._running:
            raise UnknownReplayError(vehicle_id)
        return self._running[vehicle_id]

    async def _estimate(self, playback: Playback, entry: FlightEntry) -> None:
        """Give a replay its recorded estimate, else a cached one, else compute it in a process of its own."""
        try:
            table = await asyncio.to_thread(_read_if_useful, entry.path / ESTIMATE_FILE)
            offset_us = 0
            if table is None:
                cached = self._cached(entry)
                table = await asyncio.to_thread(_read_if_useful, cached / ESTIMATE_FILE)
                if table is None:
                    await self._compute(entry, cached, playback.tell_estimate_progress)
                    table = await asyncio.to_thread(EstimateTable.read, cached / ESTIMATE_FILE)
                offset_us = await asyncio.to_thread(_found_offset_us, cached / REPORT_FILE)
            playback.use_estimate(table, offset_us)
        except (OSError, ConflictError) as error:
            playback.estimate_progress = None
            playback.estimate_problem = str(error)
            _log.warning("no estimate for replay", flight=entry.id, error=str(error))
        self._hub.publish("vehicle", action="updated", vehicle=playback.summary())

    async def _compute(self, entry: FlightEntry, target: Path, progress: Callable[[float], None]) -> None:
        # A process of its own: the estimator's arithmetic must not slow the live one in this process.
        partial = target.with_name(target.name + ".partial")
        await asyncio.to_thread(shutil.rmtree, partial, ignore_errors=True)
        partial.mkdir(parents=True)
        process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "backend.playback.compute", str(entry.path), str(partial),
            stdin=asyncio.subprocess.DEVNULL, stdout=asyncio.subprocess.PIPE, stderr=asyncio.subprocess.PIPE,
        )  # fmt: skip
        try:
            said = await _follow(process, progress)
        finally:
            if process.returncode is None:
                process.kill()
                await process.wait()
        if process.returncode != 0:
            raise ConflictError(said or f"the computation ended with status {process.returncode}")
        await asyncio.to_thread(shutil.rmtree, target, ignore_errors=True)
        partial.rename(target)


async def _follow(process: asyncio.subprocess.Process, progress: Callable[[float], None]) -> str:
    """Tell a computation's progress, 0 to 1; returns its last words on failure."""
    if process.stdout is None or process.stderr is None:
        return ""
    errors = asyncio.create_task(process.stderr.read())
    try:
        async for line in process.stdout:
            try:
                progress(min(max(float(line), 0.0), 1.0))
            except ValueError:
                continue
        await process.wait()
        lines = (await errors).decode(errors="replace").strip().splitlines()
        return lines[-1] if lines else ""
    finally:
        errors.cancel()


def _read_if_useful(path: Path) -> EstimateTable | None:
    try:
        table = EstimateTable.read(path)
    except OSError:
        return None
    return table if len(table.t_us) else None


def _found_offset_us(path: Path) -> int:
    """What the computation added to frame times because it found it, 0 where it was told or found nothing."""
    try:
        clock = json.loads(path.read_text(encoding="utf-8"))["video_clock"]
        return 0 if clock is None else round((clock["time_offset_s"] or 0.0) * 1e6)
    except (OSError, ValueError, TypeError, KeyError):
        return 0


def _cache_key(entry: FlightEntry) -> str:
    facts = f"{entry.path} {entry.start_unix_us} {entry.bytes}"
    return f"{entry.id}-{hashlib.sha256(facts.encode()).hexdigest()[:12]}"
