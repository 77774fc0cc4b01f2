"""Writes what a simulated flight was: a complete flight folder, with its truth."""

from __future__ import annotations

from pathlib import Path
from types import TracebackType

import numpy as np

from estimator.types import Float, Image
from geodata.flight_meta import CameraMeta, FlightMeta, HomeMeta, MapMeta, MountMeta, VehicleMeta, VideoMeta
from geodata.flight_tables import CLICK_COLUMNS, FRAME_COLUMNS, TRUTH_COLUMNS, TargetTruth
from geodata.flight_write import CsvAppender, write_flight_json, write_targets_truth_csv
from geodata.pad_file import as_description
from geodata.tlog import TlogWriter
from simulator.errors import SimulatorError
from simulator.random_streams import rng_for
from simulator.scenario import Scenario
from simulator.simulation import Exposure
from simulator.vehicles.kinds import VEHICLES
from simulator.video_out import H264FileWriter
from simulator.visibility import Sight
from simulator.world.pad_place import PadPlace
from simulator.world.world import World

_CLICK_INTERVAL_US = 1_500_000
_CLICK_STD_PX = 1.0
_BITRATE = 4_000_000
PAD_TARGET = "pad"
"""Under this name the centre of a landing pad stands among the targets' true places; nobody clicks it."""


def write_map(folder: Path, scenario: Scenario, world: World, home_ned_m: Float, start_unix_us: int | None) -> None:
    """Write the parts that a station needs before the flight: map, elevation, and what camera and vehicle are.

    Without ``start_unix_us`` there is no flight in the folder, only its set-up.
    """
    world.reference.write(folder / "reference.tif")
    world.elevation.write(folder / "elevation.tif")
    write_flight_json(folder, flight_meta(scenario, world, home_ned_m, start_unix_us))


def flight_meta(scenario: Scenario, world: World, home_ned_m: Float, start_unix_us: int | None) -> FlightMeta:
    """What ``flight.json`` says about a scenario."""
    camera, section = scenario.camera.intrinsics(), scenario.camera
    roll, pitch, yaw = section.mount_rpy_deg
    lat, lon, alt = world.frame.geodetic_from_ned(home_ned_m)
    denied: tuple[tuple[int, int], ...] = ()
    if start_unix_us is not None:
        denied = tuple(
            (start_unix_us + round(start * 1e6), start_unix_us + round(end * 1e6))
            for start, end in scenario.gps_denied_s
        )
    clock_offset_us = round(scenario.vehicle_clock_offset_s * 1e6)
    return FlightMeta(
        schema="pilotage.flight/1",
        name=scenario.name,
        vehicle=VehicleMeta(type=VEHICLES[scenario.vehicle.type].flight_type, system_id=scenario.system_id),
        camera=CameraMeta(
            width_px=camera.width_px,
            height_px=camera.height_px,
            fx_px=camera.fx_px,
            fy_px=camera.fy_px,
            cx_px=camera.cx_px,
            cy_px=camera.cy_px,
            distortion=section.distortion,
            mount=MountMeta(roll_deg=roll, pitch_deg=pitch, yaw_deg=yaw, lever_arm_frd_m=section.lever_arm_frd_m),
            gimbal=section.gimbal,
        ),
        video=VideoMeta(
            file=None if start_unix_us is None else "video.mp4",
            start_time_us=None if start_unix_us is None else start_unix_us + clock_offset_us,
            time_offset_s=-scenario.vehicle_clock_offset_s,
        ),
        map=MapMeta(reference="reference.tif", elevation="elevation.tif"),
        gps_denied=denied,
        home=HomeMeta(
            lat_deg=float(np.degrees(float(lat))), lon_deg=float(np.degrees(float(lon))), alt_amsl_m=float(alt)
        ),
        pad=None if scenario.pad is None else as_description(scenario.pad.pad()),
    )


class FlightRecorder:
    """Grows a flight folder; telemetry and pictures may come from two threads, one each."""

    def __init__(
        self, folder: Path, scenario: Scenario, world: World, home_ned_m: Float, seed: int,
        pad: PadPlace | None = None,
    ) -> None:  # fmt: skip
        if folder.exists() and any(folder.iterdir()):
            message = f"folder {str(folder)!r} is not empty; name a new one, recordings are never overwritten"
            raise SimulatorError(message)
        folder.mkdir(parents=True, exist_ok=True)
        self._folder, self._scenario, self._world, self._home = folder, scenario, world, home_ned_m
        self._pad = pad
        camera = scenario.camera
        self._sight = Sight(world, camera.intrinsics())
        self._tlog = TlogWriter(folder / "telemetry.tlog")
        self._truth = CsvAppender(folder / "truth.csv", TRUTH_COLUMNS)
        self._frames = CsvAppender(folder / "frames.csv", FRAME_COLUMNS)
        self._clicks = CsvAppender(folder / "clicks.csv", CLICK_COLUMNS)
        self._video = H264FileWriter(
            folder / "video.mp4", camera.width_px, camera.height_px, camera.frames_per_s, _BITRATE
        )
        world.reference.write(folder / "reference.tif")
        world.elevation.write(folder / "elevation.tif")
        self._rng = rng_for(seed, "clicks")
        self._clock_offset_us = round(scenario.vehicle_clock_offset_s * 1e6)
        self._frame_count = 0
        self._next_click_us = 0
        write_targets_truth_csv(folder / "targets_truth.csv", self._targets())

    def write_packet(self, t_unix_us: int, packet: bytes) -> None:
        """A packet as a station receives it."""
        self._tlog.write(t_unix_us, packet)

    def write_picture(self, exposure: Exposure, picture: Image) -> None:
        """A picture with the truth at its exposure."""
        if self._frame_count == 0:
            first_us = exposure.t_unix_us - self._clock_offset_us
            meta = flight_meta(self._scenario, self._world, self._home, first_us - exposure.state.t_us)
            video = meta.video.model_copy(update={"start_time_us": exposure.t_unix_us})
            write_flight_json(self._folder, meta.model_copy(update={"video": video}))
        self._video.write(picture, exposure.t_unix_us)
        self._frames.write(self._frame_count, exposure.t_unix_us)
        self._write_truth(exposure)
        self._write_click(exposure)
        self._frame_count += 1

    def close(self) -> None:
        """Finish all files."""
        self._video.close()
        for file in (self._tlog, self._truth, self._frames, self._clicks):
            file.close()

    def __enter__(self) -> FlightRecorder:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()

    def _write_truth(self, exposure: Exposure) -> None:
        state = exposure.state
        lat, lon, alt = self._world.frame.geodetic_from_ned(state.pos_ned_m)
        angles = np.degrees([state.roll_rad, state.pitch_rad, state.yaw_rad]).tolist()
        self._truth.write(
            exposure.t_unix_us - self._clock_offset_us,
            *(f"{np.degrees(float(angle)):.10f}" for angle in (lat, lon)),
            f"{float(alt):.4f}",
            *(f"{angle:.5f}" for angle in angles),
            *(f"{v:.4f}" for v in state.vel_ned_m_s.tolist()),
        )

    def _write_click(self, exposure: Exposure) -> None:
        """Every now and then, click something that is in view."""
        if exposure.t_unix_us < self._next_click_us:
            return
        seen = self._sight.visible(exposure.camera_pos_ned_m, exposure.ned_from_camera)
        if not seen:
            return
        name, uv_px = seen[int(self._rng.integers(len(seen)))]
        u, v = (uv_px + _CLICK_STD_PX * self._rng.standard_normal(2)).tolist()
        self._clicks.write(exposure.t_unix_us, f"{u:.2f}", f"{v:.2f}", name)
        self._next_click_us = exposure.t_unix_us + _CLICK_INTERVAL_US

    def _targets(self) -> list[TargetTruth]:
        targets = []
        places = [(mark.name, np.array([mark.north_m, mark.east_m, -mark.height_m])) for mark in self._world.landmarks]
        if self._pad is not None:
            places.append((PAD_TARGET, self._pad.pos_ned_m))
        for name, place in places:
            lat, lon, alt = self._world.frame.geodetic_from_ned(place)
            targets.append(TargetTruth(name, float(lat), float(lon), float(alt)))
        return targets
