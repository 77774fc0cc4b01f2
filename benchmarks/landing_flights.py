"""One landing in a closed loop: simulated vehicle, link, video, estimator and guidance, as fast as the machine allows.

Everything meets on the wire as in flight: MAVLink packets through ``backend.link``, pictures through H.264 and late by
``VIDEO_DELAY_US``; set-points and gimbal commands go back as packets ``UPLINK_DELAY_US`` later. Only the clocks are the
simulation's, so that the same seed gives the same landing.
"""

from __future__ import annotations

import math
import time
from collections import deque
from collections.abc import Callable
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from backend.link.events import SampleEvent
from backend.link.gimbals import pitch_yaw
from backend.link.landing_target import velocity_set_point
from backend.link.link import VehicleLink
from backend.navigation.setup import MapFiles, NavigationSetup, Place, build_setup, profile_of_flight
from estimator.geometry.rotation import euler_from_q, matrix_from_q
from estimator.types import Float, FrameSample, Image, NavigationState, PadMode
from guidance.landing import LandingCommand, LandingGuidance, LandingPhase
from guidance.pan_tilt import PanTilt
from simulator.random_streams import rng_for
from simulator.recording import flight_meta, write_map
from simulator.scenario import SCENARIOS, Scenario
from simulator.sensors.camera import CameraView
from simulator.simulation import Exposure, Simulation
from simulator.vehicles.pilot import FlightMode
from simulator.vehicles.state import VehicleState
from simulator.world.world import World, world_for

START_US = 1_760_000_000_000_000
VIDEO_DELAY_US, DOWNLINK_DELAY_US, UPLINK_DELAY_US = 100_000, 5_000, 10_000
GUIDANCE_US, TICK_US = 50_000, 100_000
PICTURES_PER_S = 20.0
PICTURES_FROM_S, GIVE_UP_S = 6.0, 240.0
FOLLOWED_S = 1.5
"""So long must the pad be followed before the landing is begun."""
STATION, AUTOPILOT = (255, 190), 1
WIND_M_S, GUST_SHARE = 6.0, 0.35


@dataclass(frozen=True, slots=True)
class Landing:
    """How one landing ended. Lengths are horizontal, from the pad's centre to the vehicle's reference point.

    ``touch_m`` is where the skids first touched, ``rest_m`` where the vehicle then stood, NaN without touchdown;
    ``estimate_m`` how far off the estimate was at touchdown, ``away_m`` how far beside the pad the landing began.
    """

    seed: int
    wind_m_s: float
    outcome: str
    reason: str
    touch_m: float
    rest_m: float
    sink_m_s: float
    drift_m_s: float
    estimate_m: float
    away_m: float
    landing_s: float
    blind_s: float
    drift_of_autopilot_m_s: float
    times_real_time: float


def scenario_for(seed: int, gimbal: str) -> Scenario:
    """The scenario ``pad`` in a wind of this seed, from calm to ``WIND_M_S``."""
    pad = SCENARIOS["pad"]
    wind_m_s = float(rng_for(seed, "landings", "wind").uniform(0.0, WIND_M_S))
    flight = pad.flight.model_copy(update={"wind_m_s": wind_m_s, "gust_std_m_s": max(0.3, GUST_SHARE * wind_m_s)})
    camera = pad.camera.model_copy(update={"gimbal": gimbal, "frames_per_s": PICTURES_PER_S})
    return pad.model_copy(update={"flight": flight, "camera": camera, "start_unix_us": START_US})


class Coded:
    """Pictures through H.264 and back, one by one, as a small transmitter sends them."""

    def __init__(self, width_px: int, height_px: int, rate: float, bitrate: int) -> None:
        self._encoder: Any = av.CodecContext.create("libx264", "w")
        self._encoder.width, self._encoder.height, self._encoder.pix_fmt = width_px, height_px, "yuv420p"
        self._encoder.bit_rate, self._encoder.time_base = bitrate, Fraction(1, round(rate))
        self._encoder.options = {"preset": "ultrafast", "tune": "zerolatency", "threads": "1"}
        self._decoder: Any = av.CodecContext.create("h264", "r")
        self._decoder.thread_count = 1

    def through(self, picture: Image) -> Image | None:
        """The grey picture (rows, cols) that comes out, None where the decoder still waits."""
        frame = av.VideoFrame.from_ndarray(picture, format="bgr24").reformat(format="yuv420p")
        decoded = [out for packet in self._encoder.encode(frame) for out in self._decoder.decode(packet)]
        return np.asarray(decoded[-1].to_ndarray(format="gray"), np.uint8) if decoded else None


class ClosedLoop:
    """A vehicle that comes to the pad, and a station that lands it there."""

    def __init__(self, seed: int, gimbal: str, folder: Path, cache: Path | None) -> None:
        self.seed, self.scenario = seed, scenario_for(seed, gimbal)
        world = world_for(self.scenario.world.spec(seed), cache)
        self.simulation = Simulation(self.scenario, world, seed, START_US)
        section, pad = self.scenario.camera, self.simulation.pad
        if pad is None:
            message = f"scenario '{self.scenario.name}' has no pad"
            raise ValueError(message)
        self.pad = pad
        self._view = CameraView(world, section.intrinsics(), seed, section.noise_std, section.vignetting, pad)
        self._coded = Coded(section.width_px, section.height_px, section.frames_per_s, section.bitrate)
        self.navigator = _setup(self.scenario, world, self.simulation.home_ned_m, folder).navigator()
        self._link = VehicleLink(system_id=STATION[0], component_id=STATION[1])
        self._packer = mavlink.MAVLink(None, srcSystem=STATION[0], srcComponent=STATION[1])
        self._pictures: deque[tuple[int, int, Image]] = deque()
        self._down: deque[tuple[int, bytes]] = deque()
        self._up: deque[tuple[int, bytes]] = deque()
        self._lever = self.scenario.camera.mount().lever_arm_frd_m
        self._pan_tilt = PanTilt() if gimbal == "pan_tilt" else None
        self.guidance: LandingGuidance | None = None
        self.command: LandingCommand | None = None
        self._followed_us = 0
        self._frames = 0
        self.began: VehicleState | None = None
        self.began_us = 0
        self.at_touchdown: NavigationState | None = None

    @property
    def now_us(self) -> int:
        """The simulation's time, Unix microseconds."""
        return START_US + self.simulation.elapsed_us

    def fly(self, watch: Callable[[ClosedLoop], None] = lambda _: None) -> Landing:
        """Until the vehicle stands, the landing is given up, or nothing comes of it; ``watch`` is called at 20 Hz."""
        started = time.perf_counter()
        standing_us = 0
        while self.simulation.elapsed_us < GIVE_UP_S * 1e6:
            self._step()
            if self.simulation.elapsed_us % GUIDANCE_US == 0:
                self._decide()
                watch(self)
            if self.simulation.touchdown is not None and self.at_touchdown is None:
                self.at_touchdown = self.navigator.predict(self.now_us)
            if self.guidance is not None and self.guidance.over:
                standing_us += 5_000
                if standing_us > 1_000_000:
                    break
        return self._told(time.perf_counter() - started)

    def _step(self) -> None:
        output, now_us = self.simulation.step(), self.now_us
        while self._up and self._up[0][0] <= now_us:
            self.simulation.receive(self._up.popleft()[1])
        self._down += [(now_us + DOWNLINK_DELAY_US, packet) for packet in output.packets]
        while self._down and self._down[0][0] <= now_us:
            for event in self._link.receive(self._down.popleft()[1], now_us):
                if isinstance(event, SampleEvent):
                    self.navigator.offer(event.sample)
        if self.simulation.elapsed_us % TICK_US == 0:
            self._link.tick(now_us)
            self._up += [(now_us + UPLINK_DELAY_US, data) for data in self._link.data_to_send()]
        if output.exposure is not None and self.simulation.elapsed_us > PICTURES_FROM_S * 1e6:
            self._take(output.exposure, now_us)
        while self._pictures and self._pictures[0][0] <= now_us:
            _, t_us, image = self._pictures.popleft()
            self._frames += 1
            self.navigator.offer(FrameSample(t_us, self._frames, image, stamped=True))
            self.navigator.advance(t_us)
        if not self._frames and self.simulation.elapsed_us % GUIDANCE_US == 0:
            self.navigator.advance(now_us - VIDEO_DELAY_US)
        if any(start <= self.simulation.elapsed_us / 1e6 < end for start, end in self.scenario.gps_denied_s):
            self.navigator.gps_denied = True

    def _take(self, exposure: Exposure, now_us: int) -> None:
        picture = self._coded.through(self._view.render(exposure.camera_pos_ned_m, exposure.ned_from_camera))
        if picture is not None:
            self._pictures.append((now_us + VIDEO_DELAY_US, exposure.t_unix_us, picture))

    def _send(self, message: Any) -> None:
        self._up.append((self.now_us + UPLINK_DELAY_US, bytes(message.pack(self._packer))))

    def _decide(self) -> None:
        state = self.navigator.predict(self.now_us)
        pad = None if state is None else state.pad
        if self._pan_tilt is not None:
            self._point(self._pan_tilt, state)
        if self.guidance is None:
            followed = pad is not None and pad.mode is PadMode.TRACKING and self.navigator.gps_denied
            self._followed_us = self._followed_us + GUIDANCE_US if followed else 0
            if self._followed_us < FOLLOWED_S * 1e6:
                return
            self.guidance, self.began, self.began_us = LandingGuidance(), self.simulation.state, self.now_us
            self._order(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(FlightMode.GUIDED))
        self.command = self.guidance.step(self.now_us, pad)
        self._send(velocity_set_point(self.scenario.system_id, AUTOPILOT, self.command.vel_ned_m_s))

    def _order(self, command: int, *parameters: float) -> None:
        padded = [*parameters, *([0.0] * (7 - len(parameters)))]
        self._send(mavlink.MAVLink_command_long_message(self.scenario.system_id, AUTOPILOT, command, 0, *padded))

    def _point(self, pan_tilt: PanTilt, state: NavigationState | None) -> None:
        if self.simulation.elapsed_us == GUIDANCE_US:
            self._order(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, float(STATION[0]), float(STATION[1]), -1.0, -1.0)
        if state is None:
            return
        target: Float | None = None
        if state.pad is not None and state.pad.mode is not PadMode.SEARCHING:
            target = -state.pad.pos_ned_m - matrix_from_q(state.q_ned_from_body) @ self._lever
        heading = float(euler_from_q(state.q_ned_from_body)[2])
        angles = pan_tilt.step(self.now_us, heading, target)
        self._send(pitch_yaw(self.scenario.system_id, AUTOPILOT, angles.pitch_rad, angles.yaw_rad))

    def off_m(self, state: VehicleState) -> float:
        """How far beside the pad's centre the vehicle is."""
        return float(np.hypot(*(state.pos_ned_m - self.pad.pos_ned_m)[:2]))

    def _told(self, elapsed_s: float) -> Landing:
        touched, now, at = self.simulation.touchdown, self.simulation.state, self.at_touchdown
        estimate_m = math.nan
        if touched is not None and at is not None and at.pad is not None:
            estimate_m = float(np.hypot(*(at.pad.pos_ned_m - touched.pos_ned_m + self.pad.pos_ned_m)[:2]))
        guidance = self.guidance
        outcome, reason = "not begun", "the pad was not followed with GPS off"
        if guidance is not None:
            outcome, reason = str(guidance.phase), guidance.reason
        if touched is not None and outcome == LandingPhase.ABORT:
            outcome = "aborted on the ground"
        return Landing(
            seed=self.seed, wind_m_s=self.scenario.flight.wind_m_s, outcome=outcome, reason=reason,
            touch_m=math.nan if touched is None else self.off_m(touched),
            rest_m=math.nan if touched is None or now is None else self.off_m(now),
            sink_m_s=math.nan if touched is None else float(touched.vel_ned_m_s[2]),
            drift_m_s=math.nan if touched is None else float(np.hypot(*touched.vel_ned_m_s[:2])),
            estimate_m=estimate_m,
            away_m=math.nan if self.began is None else self.off_m(self.began),
            landing_s=math.nan if touched is None else (START_US + touched.t_us - self.began_us) / 1e6,
            blind_s=math.nan if at is None or at.pad is None else at.pad.age_s,
            drift_of_autopilot_m_s=float(np.hypot(*self.simulation.believed_vel_error_ned_m_s[:2])),
            times_real_time=self.simulation.elapsed_us / 1e6 / elapsed_s,
        )  # fmt: skip


def _setup(scenario: Scenario, world: World, home_ned_m: Float, folder: Path) -> NavigationSetup:
    """What a station is given: camera, map, elevation and the pad's description, not where it lies."""
    write_map(folder, scenario, world, home_ned_m, START_US)
    meta = flight_meta(scenario, world, home_ned_m, START_US)
    lat, lon, alt = (float(part) for part in world.frame.geodetic_from_ned(home_ned_m))
    files = MapFiles(None, folder / "reference.tif", folder / "elevation.tif", None)
    setup = build_setup(profile_of_flight(meta), files, Place(lat, lon, alt))
    return replace(setup, pad=None if scenario.pad is None else scenario.pad.pad())
