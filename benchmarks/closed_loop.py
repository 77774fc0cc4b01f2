"""A simulated vehicle flown in a closed loop: link, video, estimator and guidance, as fast as the machine allows.

Everything meets on the wire as in flight: MAVLink packets through ``backend.link``, pictures through H.264 and late by
``VIDEO_DELAY_US``; set-points and gimbal commands go back as packets ``UPLINK_DELAY_US`` later. Only the clocks are the
simulation's, so that the same seed gives the same flight.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections import deque
from dataclasses import replace
from fractions import Fraction
from pathlib import Path
from typing import Any

import av
import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from backend.fleet.telemetry import Telemetry
from backend.link.events import LinkEvent, SampleEvent, TelemetryHeartbeat
from backend.link.link import VehicleLink
from backend.navigation.setup import MapFiles, NavigationSetup, Place, build_setup, profile_of_flight
from estimator.types import Float, FrameSample, Image
from simulator.recording import flight_meta, write_map
from simulator.scenario import Scenario
from simulator.sensors.camera import CameraView
from simulator.simulation import Exposure, Simulation
from simulator.world.world import World, world_for

START_US = 1_760_000_000_000_000
VIDEO_DELAY_US, DOWNLINK_DELAY_US, UPLINK_DELAY_US = 100_000, 5_000, 10_000
GUIDANCE_US, TICK_US = 50_000, 100_000
PICTURES_FROM_S = 6.0
STATION, AUTOPILOT = (255, 190), 1


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


class ClosedLoop(ABC):
    """A vehicle in its world, and a station's estimator on the wire; what is decided is a kind of flight's."""

    def __init__(self, seed: int, scenario: Scenario, folder: Path, cache: Path | None) -> None:
        self.seed, self.scenario = seed, scenario
        self.world = world_for(self.scenario.world.spec(seed), cache)
        self.simulation = Simulation(self.scenario, self.world, seed, START_US)
        section = self.scenario.camera
        self._view = CameraView(
            self.world, section.intrinsics(), seed, section.noise_std, section.vignetting, self.simulation.pad
        )
        self._coded = Coded(section.width_px, section.height_px, section.frames_per_s, section.bitrate)
        self.setup = setup_of(self.scenario, self.world, self.simulation.home_ned_m, folder)
        self.navigator = self.setup.navigator()
        self._link = VehicleLink(system_id=STATION[0], component_id=STATION[1])
        self._packer = mavlink.MAVLink(None, srcSystem=STATION[0], srcComponent=STATION[1])
        self._pictures: deque[tuple[int, int, Image]] = deque()
        self._down: deque[tuple[int, bytes]] = deque()
        self._up: deque[tuple[int, bytes]] = deque()
        self._frames = 0
        self.said = Telemetry()

    @property
    def now_us(self) -> int:
        """The simulation's time, Unix microseconds."""
        return START_US + self.simulation.elapsed_us

    @abstractmethod
    def _decide(self) -> None:
        """What the station does, every ``GUIDANCE_US``."""

    def _step(self) -> None:
        output, now_us = self.simulation.step(), self.now_us
        while self._up and self._up[0][0] <= now_us:
            self.simulation.receive(self._up.popleft()[1])
        self._down += [(now_us + DOWNLINK_DELAY_US, packet) for packet in output.packets]
        while self._down and self._down[0][0] <= now_us:
            for event in self._link.receive(self._down.popleft()[1], now_us):
                self._hear(event)
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

    def _hear(self, event: LinkEvent) -> None:
        if isinstance(event, SampleEvent):
            self.navigator.offer(event.sample)
        elif isinstance(event, TelemetryHeartbeat):
            self.said = replace(self.said, armed=event.armed, flight_mode=event.mode)

    def _take(self, exposure: Exposure, now_us: int) -> None:
        picture = self._coded.through(self._view.render(exposure.camera_pos_ned_m, exposure.ned_from_camera))
        if picture is not None:
            self._pictures.append((now_us + VIDEO_DELAY_US, exposure.t_unix_us, picture))

    def _send(self, message: Any) -> None:
        self._up.append((self.now_us + UPLINK_DELAY_US, bytes(message.pack(self._packer))))

    def _order(self, command: int, *parameters: float) -> None:
        padded = [*parameters, *([0.0] * (7 - len(parameters)))]
        self._send(mavlink.MAVLink_command_long_message(self.scenario.system_id, AUTOPILOT, command, 0, *padded))


def setup_of(scenario: Scenario, world: World, home_ned_m: Float, folder: Path) -> NavigationSetup:
    """What a station is given: camera, map, elevation and the pad's description, not where it lies."""
    write_map(folder, scenario, world, home_ned_m, START_US)
    meta = flight_meta(scenario, world, home_ned_m, START_US)
    lat, lon, alt = (float(part) for part in world.frame.geodetic_from_ned(home_ned_m))
    files = MapFiles(None, folder / "reference.tif", folder / "elevation.tif", None)
    setup = build_setup(profile_of_flight(meta), files, Place(lat, lon, alt))
    return replace(setup, pad=None if scenario.pad is None else scenario.pad.pad())
