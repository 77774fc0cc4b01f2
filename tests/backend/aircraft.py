"""An aircraft on real sockets, in the test's event loop."""

from __future__ import annotations

import asyncio
import contextlib
import json
import socket
import struct
import time
from collections.abc import AsyncIterator
from pathlib import Path
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as dialect

from backend.demo import free_udp_ports
from simulator.video_out import H264TsSender
from tests.backend.flight_maker import CAMERA, LAT_DEG, LON_DEG, SIZE
from tests.backend.link.wire import Sender, parsed
from tests.backend.station_runner import PATIENCE_S, RunningStation, next_of, running_station
from tests.backend.video.pictures_with_numbers import picture_with_number


class Aircraft:
    """Sends heartbeats, attitude, pressure, GPS and pictures of rising numbers, and answers commands.

    Its clock is its own: what happens to the station's is nothing to it.
    """

    def __init__(self, mavlink_port: int, video_port: int) -> None:
        self.wire = Sender()
        self.picture = lambda count: picture_with_number(count % 100, SIZE)
        self.video: H264TsSender | None = H264TsSender("127.0.0.1", video_port, *SIZE, fps=25.0)
        self.received: list[Any] = []
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        self._target = ("127.0.0.1", mavlink_port)
        self.count = 0
        self._unix_minus_mono_ns = time.time_ns() - time.monotonic_ns()

    def unix_us(self) -> int:
        """Its own time."""
        return (time.monotonic_ns() + self._unix_minus_mono_ns) // 1000

    def send(self, data: bytes) -> None:
        self._socket.sendto(data, self._target)

    def step(self) -> None:
        self.count += 1
        t_boot_ms = self.count * 20
        if self.count % 10 == 1:
            self.send(self.wire.heartbeat(base_mode=0x81 | 32))
            home = dialect.MAVLink_home_position_message(
                round(LAT_DEG * 1e7), round(LON_DEG * 1e7), 400_000, 0, 0, 0, [1, 0, 0, 0], 0, 0, 0
            )
            self.send(self.wire.pack(home))
            gps = dialect.MAVLink_gps_raw_int_message(
                t_boot_ms * 1000, 3, round(LAT_DEG * 1e7), round(LON_DEG * 1e7), 500_000, 80, 80, 0, 0, 12
            )
            self.send(self.wire.pack(gps))
        self.send(self.wire.attitude(t_boot_ms))
        if self.count % 5 == 1:
            # 500 m in the standard atmosphere
            self.send(self.wire.pack(dialect.MAVLink_scaled_pressure_message(t_boot_ms, 954.6, 0.0, 1500)))
        if self.video is not None:
            self.video.send(self.picture(self.count), self.unix_us())
        with contextlib.suppress(BlockingIOError):
            while True:
                for message in parsed([self._socket.recv(2048)]):
                    self.received.append(message)
                    if message.get_type() in ("COMMAND_LONG", "COMMAND_INT"):
                        self.send(self.wire.ack(message.command, 0))

    def close(self) -> None:
        self._socket.close()
        if self.video is not None:
            self.video.close()


@contextlib.asynccontextmanager
async def flying(tmp_path: Path) -> AsyncIterator[tuple[RunningStation, Aircraft, Any]]:
    """A station, an aircraft that sends to it until the end, and a stream that was open before the aircraft came."""
    mavlink_port, video_port = free_udp_ports(2)
    camera = tmp_path / "camera.json"
    camera.write_text(json.dumps({"camera": CAMERA.model_dump(), "map": {"ground_alt_amsl_m": 400.0}}))
    aircraft = Aircraft(mavlink_port, video_port)

    async def fly() -> None:
        while True:
            aircraft.step()
            await asyncio.sleep(0.02)

    async with running_station(
        tmp_path / "data", mavlink=(f"udpin:127.0.0.1:{mavlink_port}",), video=f"udp://127.0.0.1:{video_port}",
        camera=camera,
    ) as running, running.stream() as stream:  # fmt: skip
        await next_of(stream, "hello")
        task = asyncio.create_task(fly())
        try:
            yield running, aircraft, stream
        finally:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)
            aircraft.close()


async def frame_header(video: Any) -> dict[str, Any]:
    packet = await asyncio.wait_for(video.recv(), PATIENCE_S)
    (length,) = struct.unpack(">I", packet[:4])
    return dict(json.loads(packet[4 : 4 + length]))
