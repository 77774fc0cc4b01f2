"""What the test's aircraft sees: ground that stays where it is, and a red car that drives round in a circle on it."""

from __future__ import annotations

import asyncio
import math
from typing import Any

import cv2
import numpy as np

from estimator.types import Image
from tests.backend.aircraft import Aircraft, frame_header
from tests.backend.flight_maker import CAMERA, GROUND_M, SIZE
from tests.backend.station_runner import RunningStation, next_of

M_PER_PX = (500.0 - GROUND_M) / CAMERA.fx_px
RADIUS_PX = 60.0
SPEED_M_S = 6.0
CENTRE_PX = (160.0, 120.0)


class CircuitScene:
    """Pictures by the aircraft's own time. ``hidden`` takes the car away, ``still`` parks it where it is."""

    def __init__(self, speed_m_s: float = SPEED_M_S) -> None:
        rng = np.random.default_rng(4)
        ground = np.full((SIZE[1], SIZE[0]), 110.0, np.float32)
        for cells, strength in ((8, 16.0), (40, 12.0), (120, 8.0)):
            blotches = rng.standard_normal((cells, cells)).astype(np.float32)
            ground += strength * cv2.resize(blotches, SIZE, interpolation=cv2.INTER_CUBIC)
        self._ground = np.clip(np.stack((0.85 * ground, ground, 0.95 * ground), axis=-1), 0, 255).astype(np.uint8)
        self._rate = speed_m_s / (RADIUS_PX * M_PER_PX)
        self.hidden = False

    def angle(self, t_us: int) -> float:
        """Of the car on its circle, clockwise in the picture."""
        return self._rate * (t_us % 1_000_000_000_000) / 1e6

    def pixel(self, t_us: int) -> tuple[float, float]:
        """The car's middle."""
        angle = self.angle(t_us)
        return CENTRE_PX[0] + RADIUS_PX * math.cos(angle), CENTRE_PX[1] + RADIUS_PX * math.sin(angle)

    def picture(self, t_us: int) -> Image:
        """(rows, columns, 3) BGR."""
        image = self._ground.copy()
        if self.hidden:
            return image
        u, v = self.pixel(t_us)
        heading = math.degrees(self.angle(t_us)) + 90.0
        for along, size, colour in ((0.0, (15.0, 7.0), (40, 40, 190)), (2.5, (3.0, 6.0), (45, 40, 38))):
            at = (
                u + along * math.cos(math.radians(heading)), v + along * math.sin(math.radians(heading))
            )  # fmt: skip
            corners = cv2.boxPoints((at, size, heading))
            cv2.fillConvexPoly(image, np.round(corners * 16).astype(np.int32), colour, cv2.LINE_AA, 4)
        return image


def show(aircraft: Aircraft, scene: CircuitScene) -> None:
    """Have the aircraft see the scene from now on."""
    aircraft.picture = lambda _count: scene.picture(aircraft.unix_us())


async def click(running: RunningStation, stream: Any, scene: CircuitScene, **more: Any) -> dict[str, Any]:
    """Click the car with ``track``, on a picture that the estimator covers."""
    answer: dict[str, Any] = {}
    for _ in range(120):
        async with running.video("cam-1") as pictures:
            frame = await frame_header(pictures)
        u_px, v_px = scene.pixel(frame["t_unix_us"])
        body = {"vehicle_id": "1", "frame_id": frame["frame_id"], "u_px": u_px, "v_px": v_px, "track": True, **more}
        made = await running.client.post("/api/v1/targets", json=body)
        answer = made.json()
        if made.status_code == 201:
            return answer
        await next_of(stream, "state", "telemetry")
        await asyncio.sleep(0.2)
    raise AssertionError(f"never followed: {answer}")
