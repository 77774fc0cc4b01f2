"""Flies a scenario on the wall clock: telemetry and pictures each in a thread of their own."""

from __future__ import annotations

import queue
import threading
import time
from dataclasses import dataclass, field
from pathlib import Path

from simulator.datagrams import DatagramLink
from simulator.recording import FlightRecorder
from simulator.scenario import Scenario
from simulator.sensors.camera import CameraView
from simulator.simulation import STEP_US, Exposure, Simulation
from simulator.video_out import H264TsSender
from simulator.world.world import World

# A machine that slept must not fly hours in a burst when it wakes.
_MAX_LAG_US = 2_000_000
_WAITING_PICTURES = 2


@dataclass(slots=True)
class RunStatistics:
    """What a run did."""

    packets: int = 0
    pictures: int = 0
    pictures_skipped: int = 0
    steps_skipped_us: int = 0
    render_ms: float = 0.0
    failures: list[str] = field(default_factory=list)


class RealTimeRun:
    """One flight against the clock. The pictures' thread never holds up telemetry: it skips what it cannot make."""

    def __init__(
        self,
        scenario: Scenario,
        world: World,
        seed: int,
        mavlink: DatagramLink | None,
        video_address: tuple[str, int] | None,
        record: Path | None,
    ) -> None:
        self._scenario, self._mavlink = scenario, mavlink
        section = scenario.camera
        self._sender: H264TsSender | None = None
        if video_address is not None:
            self._sender = H264TsSender(
                *video_address, section.width_px, section.height_px, section.frames_per_s, section.bitrate
            )
        self.simulation = Simulation(scenario, world, seed, time.time_ns() // 1000)
        pad = self.simulation.pad
        self._view = CameraView(world, section.intrinsics(), seed, section.noise_std, section.vignetting, pad)
        self._recorder = (
            FlightRecorder(record, scenario, world, self.simulation.home_ned_m, seed, pad)
            if record is not None
            else None
        )
        self._exposures: queue.Queue[Exposure] = queue.Queue(_WAITING_PICTURES)
        self.statistics = RunStatistics()

    def run(self, stop: threading.Event, duration_s: float | None) -> RunStatistics:
        """Fly until the duration is over or ``stop`` is set, then close everything."""
        pictures = threading.Thread(target=self._take_pictures, args=(stop,), name="pictures", daemon=True)
        pictures.start()
        try:
            self._fly(stop, duration_s)
        finally:
            stop.set()
            pictures.join()
            if self._recorder is not None:
                self._recorder.close()
            if self._sender is not None:
                self._sender.close()
        return self.statistics

    def _fly(self, stop: threading.Event, duration_s: float | None) -> None:
        # Opening files and sockets took its time; the flight begins now.
        self.simulation.begin(time.time_ns() // 1000)
        origin_us = time.monotonic_ns() // 1000
        limit_us = None if duration_s is None else round(duration_s * 1e6)
        while not stop.is_set():
            due_us = time.monotonic_ns() // 1000 - origin_us
            if due_us - self.simulation.elapsed_us > _MAX_LAG_US:
                lost_us = due_us - self.simulation.elapsed_us
                origin_us += lost_us
                due_us -= lost_us
                self.statistics.steps_skipped_us += lost_us
            while self.simulation.elapsed_us + STEP_US <= due_us:
                self._step()
            if limit_us is not None and self.simulation.elapsed_us >= limit_us:
                return
            self._listen()
            next_us = origin_us + self.simulation.elapsed_us + STEP_US
            stop.wait(max(0, next_us - time.monotonic_ns() // 1000) / 1e6)

    def _step(self) -> None:
        output = self.simulation.step()
        for packet in output.packets:
            self.statistics.packets += 1
            if self._mavlink is not None:
                self._mavlink.send(packet)
            if self._recorder is not None:
                self._recorder.write_packet(time.time_ns() // 1000, packet)
        if output.exposure is not None:
            try:
                self._exposures.put_nowait(output.exposure)
            except queue.Full:
                self.statistics.pictures_skipped += 1

    def _listen(self) -> None:
        if self._mavlink is not None:
            for datagram in self._mavlink.received():
                self.simulation.receive(datagram)

    def _take_pictures(self, stop: threading.Event) -> None:
        try:
            self._picture_loop(stop)
        except Exception as error:
            self.statistics.failures.append(f"no more pictures: {error}")

    def _picture_loop(self, stop: threading.Event) -> None:
        while not stop.is_set():
            try:
                exposure = self._exposures.get(timeout=0.1)
            except queue.Empty:
                continue
            begin = time.perf_counter()
            picture = self._view.render(exposure.camera_pos_ned_m, exposure.ned_from_camera)
            elapsed_ms = 1e3 * (time.perf_counter() - begin)
            self.statistics.render_ms += 0.05 * (elapsed_ms - self.statistics.render_ms)
            if self._sender is not None:
                self._sender.send(picture, exposure.t_unix_us)
            if self._recorder is not None:
                self._recorder.write_picture(exposure, picture)
            self.statistics.pictures += 1
