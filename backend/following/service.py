"""The followed targets of a station: who is followed, what became of each, and who is told. Lives on the event loop."""

from __future__ import annotations

import asyncio
from collections.abc import AsyncIterator, Callable
from contextlib import asynccontextmanager
from dataclasses import dataclass
from functools import partial

import structlog
from sqlalchemy.exc import SQLAlchemyError

from backend.clicks import clicked_target
from backend.clock import mono_us, unix_us
from backend.errors import CannotFollowTargetError, ConflictError, FrameGoneError, StationError
from backend.event_loop import call_from_thread
from backend.evidence.collect import Sighting
from backend.fleet.cameras import LiveCamera
from backend.fleet.tracks import TrackPoint, TrackRing
from backend.fleet.vehicle import VehicleView
from backend.following.follower import Follower, Look
from backend.following.messages import row_of, sighting_fields, update_of
from backend.following.sources import FollowSource, source_of
from backend.following.worker import STEP_US, FollowWorker
from backend.hub import Hub
from backend.metrics import Metrics
from backend.pointing import GroundKind
from backend.recorder.recorder import Recorder
from backend.schemas.geometry import NewTarget
from backend.store.targets import LOST, SEEN, STOPPED, Target, TargetStore

MOST_FOLLOWED = 3
KEEP_EVERY_US = 1_000_000
WATCH_S = 1.0
NO_PICTURE_US = 5_000_000
GIVE_UP_US = 300_000_000
# Frames are numbered anew with each start of the station; a clock of the video that was found later moves them less.
SAME_FRAME_US = 500_000
NO_VIDEO = "no video"
STATION_ENDED = "the station ended"

_log = structlog.get_logger(__name__)


@dataclass(slots=True, eq=False)
class _Followed:
    """One target: its newest ``look``, None until there is one; when it was heard of and kept, by a steady clock."""

    source: FollowSource
    look: Look | None = None
    heard_us: int = 0
    kept_us: int = 0
    told: tuple[str, str | None, int] = (SEEN, None, 0)
    keeping: asyncio.Task[None] | None = None


class Following:
    """Starts, stops and tells. ``changed(target)`` is called with every change of a target that was kept."""

    def __init__(
        self, targets: Callable[[], TargetStore], vehicle_of: Callable[[str], VehicleView],
        camera: Callable[[], LiveCamera | None], hub: Hub, recorder: Recorder, metrics: Metrics,
        changed: Callable[[Target], None],
    ) -> None:  # fmt: skip
        self._targets = targets
        self._vehicle_of = vehicle_of
        self._camera = camera
        self._hub = hub
        self._recorder = recorder
        self._metrics = metrics
        self._changed = changed
        self._followed: dict[str, _Followed] = {}
        self._starting: dict[str, str] = {}  # target to vehicle
        self._workers: dict[str, FollowWorker] = {}
        self._tracks: dict[str, TrackRing] = {}
        self._ending: dict[str, asyncio.Task[None]] = {}
        self._watching: asyncio.Task[None] | None = None

    async def start(self) -> None:
        """Begin; what a station that was killed still followed is stopped."""
        for target in self._targets().all():
            if target.followed:
                await self._targets().set_track(target.id, STOPPED, STATION_ENDED, unix_us())
        self._watching = asyncio.create_task(self._watch())

    async def close(self) -> None:
        """Stop all; when this returns that is on the disk, and no thread is left."""
        task, self._watching = self._watching, None
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
        await asyncio.gather(*self._ending.values(), return_exceptions=True)
        for target_id in list(self._followed):
            await self._stop_by_itself(target_id, STATION_ENDED)
        for worker in self._workers.values():
            await asyncio.to_thread(worker.close)
        self._workers.clear()

    @asynccontextmanager
    async def starting(self, target_id: str, click: Sighting | None, track: bool) -> AsyncIterator[Callable[[], None]]:
        """Make ready to follow a located click; what it gives is to be called when the target is kept, as one seen.

        Until the end of the block a place among those followed is kept for it. Without ``track`` nothing happens.

        Raises
        ------
        CannotFollowTargetError
            There is no click, its picture does not show what could be followed, or there is no video.
        FrameGoneError
            The picture is no longer held.
        ConflictError
            As many targets of the vehicle as are followed at a time are followed already.
        """
        if not track:
            yield lambda: None
            return
        if click is None:
            raise CannotFollowTargetError("it is typed in, and nothing shows how it looks: click it in the video")
        source = self._source(click.target.vehicle_id or "")
        vehicle = source.vehicle
        names = [name for name, one in self._followed.items() if one.source.vehicle is vehicle]
        names += [name for name, vehicle_id in self._starting.items() if vehicle_id == vehicle.id]
        if len(names) >= MOST_FOLLOWED:
            raise ConflictError(
                f"{MOST_FOLLOWED} targets of vehicle '{vehicle.id}' are followed already, and more would take the "
                "estimator's time: stop following one of them first"
            )
        self._starting[target_id] = vehicle.id
        try:
            picture = await source.picture(click.frame.frame_id)
            follower = await asyncio.to_thread(Follower.start, target_id, click, picture)
            yield lambda: self._begin(follower, source)
        finally:
            del self._starting[target_id]

    async def change(self, target_id: str, track: bool, version: int | None) -> Target:
        """Follow a clicked target from its picture on, or no longer, and tell everybody.

        Raises CannotFollowTargetError for one that was typed in or moved by hand, FrameGoneError where its picture is
        not held any more, else as `starting` and a click.
        """
        target = self._targets().expected(target_id, version)
        if not track:
            return await self.stop(target_id, None) or target
        if target_id in self._followed or target_id in self._starting:
            return target
        if target.frame_id is None or target.u_px is None or target.v_px is None or target.method == "manual":
            raise CannotFollowTargetError("it was typed in or moved by hand: click it in the video")
        source = self._source(target.vehicle_id or "")
        vehicle, frame = source.vehicle, source.identify(target.frame_id)
        if abs(source.exposure_us(frame) - (target.t_unix_us or 0)) > SAME_FRAME_US:
            raise FrameGoneError(vehicle.video_source or "", frame.frame_id)
        ground: GroundKind = "flat" if target.ground == "flat" else "terrain"
        body = NewTarget(
            vehicle_id=vehicle.id, frame_id=target.frame_id, u_px=target.u_px, v_px=target.v_px,
            height_above_ground_m=target.height_above_ground_m, ground=ground,
        )  # fmt: skip
        click = await clicked_target(body, vehicle, frame)
        async with self.starting(target_id, click, track) as begin:
            target = await self._targets().set_track(target_id, SEEN, None, unix_us())
            begin()
        self._changed(target)
        return target

    def _source(self, vehicle_id: str) -> FollowSource:
        return source_of(self._vehicle_of(vehicle_id), self._camera())

    @staticmethod
    def _worker_name(source: FollowSource, target_id: str) -> str:
        """Live targets share a thread and its pictures; on a replay each has one and goes through the flight alone."""
        return source.vehicle.id if source.is_live else target_id

    def _begin(self, follower: Follower, source: FollowSource) -> None:
        self._followed[follower.target_id] = _Followed(source, heard_us=mono_us(), kept_us=mono_us())
        self._tracks[follower.target_id] = TrackRing()
        name = self._worker_name(source, follower.target_id)
        worker = self._workers.get(name)
        if worker is None:
            loop = asyncio.get_running_loop()
            worker = FollowWorker(
                source, partial(call_from_thread, loop, self._take), partial(call_from_thread, loop, self._ended)
            )
            self._workers[name] = worker
            worker.start()
            source.watch(worker)
        worker.add(follower, source.pictures_after(follower.frame.frame_id, STEP_US))

    async def stop(self, target_id: str, reason: str | None) -> Target | None:
        """Follow a target no longer, and keep where it was seen last; None where it is not followed."""
        one = self._forget(target_id)
        if one is None:
            return None
        if one.keeping is not None:
            await asyncio.gather(one.keeping, return_exceptions=True)
        await self._keep(target_id, one)
        target = await self._targets().set_track(target_id, STOPPED, reason, unix_us())
        self._changed(target)
        return target

    def drop(self, target_id: str) -> None:
        """The target is deleted: forget it."""
        self._forget(target_id)
        self._tracks.pop(target_id, None)

    def track(self, target_id: str) -> list[list[TrackPoint]]:
        """Where it was seen since it is followed, in pieces without a gap; empty for one that never was."""
        ring = self._tracks.get(target_id)
        return [] if ring is None else ring.pieces()

    def _forget(self, target_id: str) -> _Followed | None:
        one = self._followed.pop(target_id, None)
        if one is None:
            return None
        name = self._worker_name(one.source, target_id)
        worker = self._workers.get(name)
        if worker is not None:
            worker.remove(target_id)
            if not one.source.is_live:
                del self._workers[name]
                worker.close(0.0)
        return one

    def _take(self, look: Look) -> None:
        one = self._followed.get(look.target_id)
        if one is None:
            return  # the last words of one that was stopped
        one.look, one.heard_us = look, mono_us()
        if look.reason is None:
            motion = look.motion
            self._tracks[look.target_id].add(TrackPoint(motion.t_us, 1, look.lat_deg, look.lon_deg, look.alt_amsl_m))
        target = self._targets().get(look.target_id)
        self._hub.publish("sighting", vehicle_id=one.source.vehicle.id, **sighting_fields(look))
        if one.source.is_live:
            self._recorder.followed(row_of(look, target.name))
        told = (SEEN if look.reason is None else LOST, look.reason, look.motion.t_us)
        # while it is lost there is nothing new to keep
        due = told != one.told and (told[0] != one.told[0] or mono_us() - one.kept_us >= KEEP_EVERY_US)
        if due and one.keeping is None:
            one.told, one.kept_us = told, mono_us()
            one.keeping = asyncio.create_task(self._keep_and_tell(look.target_id, one))

    def _ended(self, end: tuple[str, str]) -> None:
        target_id, reason = end
        one = self._followed.get(target_id)
        if one is not None and target_id not in self._ending:
            self._ending[target_id] = asyncio.create_task(self._stop_by_itself(target_id, reason))
            self._ending[target_id].add_done_callback(lambda _: self._ending.pop(target_id, None))

    async def _stop_by_itself(self, target_id: str, reason: str) -> None:
        try:
            await self.stop(target_id, reason)
        except (StationError, SQLAlchemyError) as error:  # the next start marks it as stopped
            _log.warning("end of following not kept", target=target_id, error=str(error))

    async def _keep_and_tell(self, target_id: str, one: _Followed) -> None:
        try:
            target = await self._keep(target_id, one)
            if target is not None:
                self._changed(target)
        except (StationError, SQLAlchemyError) as error:  # a full disk: the next one tries again
            _log.warning("sighting not kept", target=target_id, error=str(error))
        finally:
            one.keeping = None

    async def _keep(self, target_id: str, one: _Followed) -> Target | None:
        if one.look is None:
            return None
        return await self._targets().track(target_id, update_of(one.look), unix_us())

    async def _watch(self) -> None:
        while True:
            await asyncio.sleep(WATCH_S)
            for worker in self._workers.values():
                vehicle_id = worker.vehicle_id
                self._metrics.following_dropped.labels(vehicle_id).set(worker.counts.dropped)
                while worker.counts.look_ms:
                    self._metrics.following.labels(vehicle_id).observe(worker.counts.look_ms.popleft() / 1e3)
            for target_id, one in list(self._followed.items()):
                if one.source.is_waiting:
                    one.heard_us = mono_us()
                reason = self._end_of(one)
                if reason is not None:
                    await self._stop_by_itself(target_id, reason)
                elif mono_us() - one.heard_us > NO_PICTURE_US and one.told[1] != NO_VIDEO:
                    await self._say_no_video(target_id, one)

    @staticmethod
    def _end_of(one: _Followed) -> str | None:
        if one.source.over is not None:
            return one.source.over
        look = one.look
        if look is not None and look.t_us - look.last_seen_us > GIVE_UP_US:
            return f"not seen for {GIVE_UP_US // 60_000_000} minutes"
        if mono_us() - one.heard_us > GIVE_UP_US:
            return "the video has stopped"
        return None

    async def _say_no_video(self, target_id: str, one: _Followed) -> None:
        one.told = (LOST, NO_VIDEO, one.told[2])
        try:
            self._changed(await self._targets().set_track(target_id, LOST, NO_VIDEO, unix_us()))
        except (StationError, SQLAlchemyError) as error:
            _log.warning("loss of video not kept", target=target_id, error=str(error))
