"""One station: everything that runs, wired together. Lives on one event loop."""

from __future__ import annotations

import asyncio
import shutil
import uuid
from collections.abc import Coroutine
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import structlog
from sqlalchemy.exc import SQLAlchemyError

from backend.aiding.service import PositionAiding
from backend.alarms import Alarm, AlarmBoard
from backend.clicks import clicked_target, typed_target
from backend.clock import mono_us, unix_us
from backend.errors import (
    CommandRefusedError,
    ConflictError,
    InvalidRequestError,
    TargetNotKeptError,
    UnknownReplayError,
    UnknownSourceError,
    UnknownVehicleError,
)
from backend.evidence.collect import Sighting
from backend.evidence.keeper import EvidenceKeeper
from backend.exports.sender import CotSender
from backend.fleet.cameras import LiveCamera
from backend.fleet.commands import send_command
from backend.fleet.feed import FrameIdentity, VideoFeed
from backend.fleet.fleet import Fleet
from backend.fleet.history import Histories
from backend.fleet.links import LinkEndpoint
from backend.fleet.messages import fix_fields
from backend.fleet.placing import Placing
from backend.fleet.vehicle import LiveVehicle, VehicleView
from backend.flights import FlightShelf
from backend.following.service import Following
from backend.guided.service import Guided
from backend.homing.service import Homings
from backend.hub import Hub
from backend.landing.service import Landings
from backend.mapping import StationMaps
from backend.metrics import Metrics
from backend.missions.service import Missions
from backend.navigation.setup import CameraProfile, NavigationSetup, read_camera_profile
from backend.navigation.worker import StateUpdate
from backend.playback.replays import Replays
from backend.recorder.folder import ClickRow
from backend.recorder.plan import plan_of
from backend.recorder.recorder import Recorder
from backend.refining.later import LaterFixes, LiveFixes
from backend.refining.refiner import Refiner
from backend.schemas.geometry import NewTarget, collection_of_targets, feature_of_target
from backend.schemas.vehicles import CommandBody, MapBody, ReplayBody
from backend.settings import Settings
from backend.store.database import Database
from backend.store.lock import DataDirLock
from backend.store.targets import SEEN, Target, TargetChange, TargetStore
from backend.ticker import Ticker
from backend.version import package_version
from estimator.types import FixReport, FrameSample
from geodata.errors import GeodataError
from geodata.maps import MapKind

_log = structlog.get_logger(__name__)


class Station:
    """Owns the links, the camera, the vehicles, the store, the recorder and the replays."""

    def __init__(self, settings: Settings) -> None:
        self.settings = settings
        self.version = package_version()
        self.running = False
        self.has_console = False
        self.hub = Hub()
        self.histories = Histories(unix_us)
        self.hub.tap(self.histories.take)
        self.alarms = AlarmBoard()
        self.metrics = Metrics()
        self.maps = StationMaps(settings.data_dir / "maps")
        self.flights = FlightShelf(settings.data_dir / "flights", settings.flights)
        self.evidence = EvidenceKeeper(settings.data_dir / "evidence", self.maps, self.version)
        self.recorder = Recorder(settings.data_dir / "flights")
        self.guided = Guided(lambda: self.fleet.vehicles, self._link_of, self.hub.publish, self._send_command)
        self.aidings = PositionAiding(lambda: self.fleet.vehicles, self._link_of, self.hub.publish, self.guided)
        self.landings = Landings(
            settings.data_dir, lambda: self.fleet.vehicles, self._link_of, self.hub.publish, self.guided,
            settings.gear_height_m,
        )  # fmt: skip
        self.missions = Missions(settings.data_dir / "plans", self._link_of, self.hub.publish)
        self.homings = Homings(
            lambda: self.fleet.vehicles, self.hub.publish, self.guided, self.landings, self.missions.fence_of
        )
        self.placing = Placing(
            self.maps, settings.time_offset_s, lambda: self.profile,
            lambda: None if self.camera is None else self.camera.size_px, lambda: self.landings.pads.pad,
            self._on_placed,
        )  # fmt: skip
        self.fleet = Fleet(
            settings.estimator_delay_ms * 1000, self.hub.publish,
            on_heard=self._on_heard, on_place=self.placing.place, on_state=self._on_state,
            on_reports=self._on_reports, on_transfer=self.missions.on_transfer,
            on_parameter=self.aidings.parameters.on_news,
        )  # fmt: skip
        self.replays = Replays(self.flights, settings.data_dir / "cache", self.hub)
        self.refiner = Refiner(lambda: self.targets, self.evidence, self.metrics, self._tell_changed)
        self.cot = CotSender(settings.cot, self._all_targets, self.metrics)
        self.following = Following(
            lambda: self.targets, self.vehicle, lambda: self.camera, self.hub, self.recorder, self.metrics,
            self._tell_changed,
        )  # fmt: skip
        self.links: list[LinkEndpoint] = []
        self.camera: LiveCamera | None = None
        self.profile: CameraProfile | None = None
        self._lock = DataDirLock(settings.data_dir)
        self._database: Database | None = None
        self._targets: TargetStore | None = None
        self._ticker = Ticker(self)
        self._tasks: set[asyncio.Task[None]] = set()
        self._target_names = 0

    @property
    def targets(self) -> TargetStore:
        """The kept targets."""
        if self._targets is None:
            raise ConflictError("the station is not running")
        return self._targets

    def _all_targets(self) -> list[Target]:
        return self.targets.all()

    @property
    def maps_inbox(self) -> Path:
        """Where uploads wait until they are imported."""
        return self.settings.data_dir / "inbox"

    async def start(self) -> None:
        """Start everything; StartError when something the operator asked for cannot be had."""
        self._lock.acquire()
        try:
            if self.settings.camera is not None:
                self.profile = read_camera_profile(self.settings.camera)
            self.landings.pads.load(self.settings.pad, self.settings.camera)
            self._database = await Database.open(self.settings.data_dir / "station.db")
            self._targets = await TargetStore.load(self._database)
            self._target_names = len(self._targets.all())
            await self.evidence.tidy({target.id: target.version for target in self._targets.all()})
            await self.following.start()
            await self.refiner.start()
            await self.maps.choose(self.settings.map)
            self.links = [
                LinkEndpoint(text, self.fleet, self.metrics, self.recorder.packet) for text in self.settings.mavlink
            ]
            if self.settings.video is not None:
                self.camera = LiveCamera(
                    self.settings.video, self._time_offset_s(), self.profile, self.metrics, self.recorder,
                    self._on_picture, self._map_vehicle_time,
                )  # fmt: skip
            for link in self.links:
                await link.start()
            if self.camera is not None:
                self.camera.start()
            self.cot.start()
        except BaseException:
            await self.stop()
            raise
        self._ticker.start()
        self.running = True
        if self.settings.record:
            await self.start_recording(None)

    async def stop(self) -> None:
        """End everything; the recording is closed first, so that nothing can keep it from that."""
        self.running = False
        self.aidings.close()
        self.landings.close()
        await self.guided.close()
        await self.missions.close()
        await self._ticker.stop()
        await self.placing.close()
        if self.recorder.status.active:
            await asyncio.to_thread(self.recorder.stop)
        for task in list(self._tasks):
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        if self._targets is not None:
            await self.following.close()
        await self.refiner.close()
        await self.replays.close()
        await self.cot.close()
        for link in self.links:
            await link.close()
        if self.camera is not None:
            self.camera.close_audience()
            await asyncio.to_thread(self.camera.close)
        await asyncio.to_thread(self.fleet.close)
        self.maps.close()
        if self._database is not None:
            await self._database.close()
            self._database = None
        self._lock.release()

    def waiting_for(self) -> list[str]:
        """What does not come yet, in the operator's words."""
        waits = [wait for link in self.links if (wait := link.waiting_for()) is not None]
        if self.camera is not None:
            wait = self.camera.waiting_for()
            if wait is not None:
                waits.append(wait)
            if self.profile is None:
                waits.append("camera parameters, to navigate by the video: start with --camera CAM.json")
        for vehicle in self.fleet.vehicles.values():
            waits += self.placing.waiting_for(vehicle)
        return waits + self.cot.waiting_for()

    async def hello(self) -> dict[str, Any]:
        """Fields of the ``hello`` message: everything a newcomer has to know."""
        await self.maps.refresh(older_than_s=2.0)
        return {
            "station": {
                "name": "Pilotage", "version": self.version, "data_dir_free_bytes": self.disk_free_bytes(),
            },
            "vehicles": [vehicle.summary() for vehicle in self.vehicles()],
            "maps": [body.model_dump() for body in self.maps.bodies()],
            "targets": collection_of_targets(self.targets.all()).model_dump(),
            "alarms": [asdict(alarm) for alarm in self.alarms.active],
            "recording": asdict(self.recorder.status),
            "waiting_for": self.waiting_for(),
            "replays": [body.model_dump() for body in self.replays.bodies()],
            "pad": None if self.landings.pads.pad is None else self.landings.pads.pad.name,
        }  # fmt: skip

    def disk_free_bytes(self) -> int:
        """Space left where the station writes."""
        try:
            return shutil.disk_usage(self.settings.data_dir).free
        except OSError:
            return 0

    def vehicles(self) -> list[VehicleView]:
        """Live vehicles and replays."""
        return [*self.fleet.vehicles.values(), *self.replays.vehicles()]

    def vehicle(self, vehicle_id: str) -> VehicleView:
        """One vehicle or replay, or UnknownVehicleError."""
        for vehicle in self.vehicles():
            if vehicle.id == vehicle_id:
                return vehicle
        raise UnknownVehicleError(vehicle_id)

    def live_vehicle(self, vehicle_id: str) -> LiveVehicle:
        """One live vehicle; a replay refuses what only a vehicle can do."""
        vehicle = self.vehicle(vehicle_id)
        if not isinstance(vehicle, LiveVehicle):
            raise CommandRefusedError(f"vehicle '{vehicle_id}' is a replay: what happened cannot be changed")
        return vehicle

    async def history(self, vehicle_id: str, since_us: int, step_us: int) -> dict[str, Any]:
        """Fields of `HistoryBody`: the last hour of a vehicle, all of a replayed flight; UnknownVehicleError."""
        vehicle = self.vehicle(vehicle_id)
        if isinstance(vehicle, LiveVehicle):
            return self.histories.body(vehicle_id, since_us, step_us)
        return await self.replays.history(vehicle_id, since_us, step_us)

    def feed(self, source: str) -> VideoFeed:
        """A video source, or UnknownSourceError."""
        if self.camera is not None and self.camera.answers_to(source):
            return self.camera
        for replay in self.replays.feeds():
            if replay.source == source:
                return replay
        raise UnknownSourceError(source)

    def frame_of(self, vehicle: VehicleView, frame_id: int) -> FrameIdentity:
        """A frame of a vehicle's video; its errors are those of ``feed`` and ``VideoFeed.identify``."""
        return self.feed(vehicle.video_source or "").identify(frame_id)

    def deny_gps(self, vehicle_id: str, denied: bool) -> None:
        """Keep GPS from a vehicle's estimator, or give it back."""
        vehicle = self.live_vehicle(vehicle_id)
        if vehicle.gps_denied != denied:
            vehicle.deny_gps(denied)
            self.recorder.gps_denied(any(v.gps_denied for v in self.fleet.vehicles.values()))
            self.hub.publish("vehicle", action="updated", vehicle=vehicle.summary())

    def command(self, vehicle_id: str, body: CommandBody) -> str:
        """Send a command; returns the id under which its acknowledgement will come."""
        vehicle = self.live_vehicle(vehicle_id)
        command_id = self._send_command(vehicle, body)
        self.guided.pilot.overrule(vehicle, body.command)
        return command_id

    def _send_command(self, vehicle: LiveVehicle, body: CommandBody) -> str:
        link = self._link_of(vehicle)
        if link is None or not vehicle.connected:
            raise CommandRefusedError(f"vehicle '{vehicle.id}' is not connected")
        command_id = str(uuid.uuid4())
        frame = None if body.frame_id is None else self.frame_of(vehicle, body.frame_id)
        link_id = send_command(link.link, vehicle, body, frame)
        self.fleet.note_command(link.name, link_id, command_id, body.command)
        link.send_soon()
        return command_id

    async def create_target(self, body: NewTarget) -> Target:
        """Locate a click, or take coordinates, and keep the target; when this returns it is on the disk."""
        started_us = mono_us()
        sighting: Sighting | None = None
        picture: bytes | None = None
        if body.frame_id is None and body.u_px is None and body.v_px is None:
            target = typed_target(body)
        else:
            if body.vehicle_id is None:
                raise ConflictError("a click needs the vehicle_id whose video was clicked")
            if body.frame_id is None:
                raise InvalidRequestError("a click needs frame_id, u_px and v_px")
            vehicle = self.vehicle(body.vehicle_id)
            sighting = await clicked_target(body, vehicle, self.frame_of(vehicle, body.frame_id))
            registration = None if body.track else self.refiner.prospect(sighting)
            target = replace(sighting.target, registration=registration)
        async with self.following.starting(target.id, sighting, bool(body.track)) as begin:
            if sighting is not None:
                picture = await self.evidence.keep(sighting, self.feed(vehicle.video_source or ""))
            self._target_names += 1
            name = target.name or f"Target {self._target_names}"
            target = replace(target, name=name, track_status=SEEN if body.track else None)
            await self._keep_row(target)
            begin()
        self.metrics.stage.labels("click_to_target").observe((mono_us() - started_us) / 1e6)
        if sighting is not None and target.vehicle_id in self.fleet.vehicles:
            self.recorder.click(ClickRow(
                sighting.frame.t_us, target.u_px or 0.0, target.v_px or 0.0, target.name,
                sighting.height_above_ground_m, target.ground or "terrain",
            ))  # fmt: skip
        self.cot.changed(target)
        self.hub.publish("target", action="created", target=feature_of_target(target).model_dump())
        if sighting is not None and not body.track:  # where one that is followed goes, its tracker says
            later = self._later_fixes(vehicle.id)
            self.refiner.take(replace(sighting, target=target), vehicle.video_source or "", picture, later)
        return target

    def _later_fixes(self, vehicle_id: str) -> LaterFixes | None:
        """Who will know more of the states of a vehicle's clicks: its estimator, or the rest of the flight."""
        live = self.fleet.vehicles.get(vehicle_id)
        if live is not None:
            return None if live.worker is None else LiveFixes(live.worker)
        try:
            return self.replays.look_ahead(vehicle_id)
        except UnknownReplayError:  # ended meanwhile
            return None

    async def _keep_row(self, target: Target) -> None:
        try:
            await self.targets.add(target)
        except SQLAlchemyError as error:
            await self.evidence.discard(target.id)
            raise TargetNotKeptError(f"database: {getattr(error, 'orig', None) or error}") from None
        await self.evidence.confirm(target.id)

    async def change_target(self, target_id: str, change: TargetChange, version: int | None) -> Target:
        """Change a target and tell everybody. One that is moved is followed no longer."""
        if change.position_deg is not None and self.targets.expected(target_id, version).followed:
            await self.following.stop(target_id, "moved by hand")
            version = None
        target = await self.targets.change(target_id, change, version, unix_us())
        self._tell_changed(target)
        return target

    def _tell_changed(self, target: Target) -> None:
        self.cot.changed(target)
        self.hub.publish("target", action="updated", target=feature_of_target(target).model_dump())

    async def delete_target(self, target_id: str, version: int | None) -> None:
        """Remove a target and tell everybody."""
        async with self.evidence.changing:
            self.targets.get(target_id)
            await self.evidence.before_deletion(target_id)
            try:
                gone = await self.targets.delete(target_id, version)
            except BaseException:
                await self.evidence.not_deleted(target_id)
                raise
            self.following.drop(target_id)
            await self.evidence.deleted(target_id)
        self.cot.deleted(gone)
        self.hub.publish("target", action="deleted", target=target_id)

    async def import_map(self, path: Path, name: str, kind: MapKind | None) -> MapBody:
        """Import a map, tell everybody, and have vehicles without one use it."""
        record = await self.maps.import_file(path, name, kind)
        body = self.maps.body(record.id)
        self.hub.publish("map", action="created", map=body.model_dump())
        for vehicle in self.fleet.vehicles.values():
            here = vehicle.here()
            lacks = vehicle.setup is None or vehicle.setup.reference is None
            if here is not None and lacks:
                self.placing.place(vehicle, here)
        return body

    async def delete_map(self, map_id: str) -> None:
        """Remove a map and tell everybody."""
        await self.maps.delete(map_id)
        self.hub.publish("map", action="deleted", map=map_id)

    async def start_recording(self, name: str | None) -> str:
        """Begin to record; returns the flight's id."""
        vehicle = next(iter(self.fleet.vehicles.values()), None)
        here = None if vehicle is None else vehicle.here()
        files = None if here is None else self.maps.files_for(here)
        denied = any(v.gps_denied for v in self.fleet.vehicles.values())
        plan = plan_of(vehicle, self.profile, files, denied, self.settings.time_offset_s, self.landings.pads.pad)
        flight_id = await asyncio.to_thread(self.recorder.start, plan, name)
        self.hub.publish("recording", **asdict(self.recorder.status))
        return flight_id

    async def stop_recording(self) -> None:
        """End the recording; it is complete on the disk when this returns."""
        await asyncio.to_thread(self.recorder.stop)
        self.hub.publish("recording", **asdict(self.recorder.status))

    async def start_replay(self, flight_id: str, speed: float, start_s: float) -> ReplayBody:
        """Begin to replay a flight; its reference map, if it brings one, becomes a map layer."""
        body = await self.replays.start(flight_id, speed, start_s)
        self._in_background(self._show_reference(flight_id))
        return body

    def tell_alarm(self, alarm: Alarm | None) -> None:
        """Tell everybody about a raised or cleared alarm."""
        if alarm is not None:
            _log.info("alarm", code=alarm.code, vehicle=alarm.vehicle_id, active=alarm.active, text=alarm.text)
            self.hub.publish("alarm", **asdict(alarm))

    def _on_heard(self, vehicle: LiveVehicle) -> None:
        if self.camera is not None:
            self.camera.belongs_to(vehicle.id)
        self.hub.publish("vehicle", action="created", vehicle=vehicle.summary())

    def _in_background(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.add(task)
        task.add_done_callback(self._tasks.discard)

    async def _show_reference(self, flight_id: str) -> None:
        playback = self.replays.of_flight(flight_id)
        path = None if playback is None else playback.recording.folder.reference_path
        if playback is None or path is None or await asyncio.to_thread(self.maps.holds, path):
            return
        try:
            await self.import_map(path, f"{playback.recording.folder.name} (reference)", "imagery")
        except GeodataError as error:
            _log.warning("reference of the flight not shown", flight=flight_id, error=str(error))

    def _on_placed(self, vehicle: LiveVehicle, setup: NavigationSetup) -> None:
        self._in_background(self.evidence.prepare(setup))
        self.hub.publish("vehicle", action="updated", vehicle=vehicle.summary())

    def _link_of(self, vehicle: LiveVehicle) -> LinkEndpoint | None:
        return next((link for link in self.links if link.name == vehicle.endpoint), None)

    def _camera_vehicle(self) -> LiveVehicle | None:
        return None if self.camera is None else self.fleet.vehicles.get(self.camera.vehicle_id)

    def _on_picture(self, picture: FrameSample) -> None:
        """A decoded picture, in the decoder's thread."""
        vehicle = self._camera_vehicle()
        if vehicle is not None:
            vehicle.offer(picture)
            self.landings.on_picture(picture)

    def _time_offset_s(self) -> float:
        return self.settings.time_offset_s or 0.0

    def _map_vehicle_time(self, t_vehicle_unix_us: int) -> int | None:
        """Station time of a vehicle's Unix time, None when the link does not know it (yet)."""
        vehicle = self._camera_vehicle()
        link = None if vehicle is None else self._link_of(vehicle)
        return None if link is None or vehicle is None else link.station_time_us(vehicle.system_id, t_vehicle_unix_us)

    def _on_state(self, vehicle: LiveVehicle, update: StateUpdate) -> None:
        self.guided.on_state(vehicle, update.state)
        self.aidings.on_state(vehicle, update)
        self.landings.on_state(vehicle, update)
        self.homings.on_state(vehicle)
        camera_vehicle = self._camera_vehicle()
        if camera_vehicle is None or camera_vehicle is vehicle:
            self.recorder.state(update.state)

    def _on_reports(self, vehicle: LiveVehicle, reports: list[FixReport]) -> None:
        for report in reports:
            self.metrics.fixes.labels(vehicle.id, report.kind, str(report.accepted).lower()).inc()
            self.metrics.stage.labels("registration").observe(report.elapsed_ms / 1e3)
            if vehicle.setup is not None:
                self.hub.publish("fix", vehicle_id=vehicle.id, **fix_fields(report, vehicle.setup.frame))
