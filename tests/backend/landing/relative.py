"""States over a pad for the tests: where, which way, how sure."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from estimator.geometry.rotation import matrix_from_q, q_from_euler
from estimator.landing.pad import circle_pad
from estimator.types import Mode, NavigationState, PadMode, PadRelative, PadSeen
from tests.backend.flight_maker import state

PAD = circle_pad("test pad", 1.5, 0.3)


def over_pad(
    t_us: int, pos_ned_m: tuple[float, float, float] = (0.6, -0.4, -8.0), *, mode: PadMode = PadMode.TRACKING,
    heading_deg: float = 0.0, pad_heading_deg: float = 0.0, age_s: float = 0.02, reason: str = "",
    std_m: tuple[float, float, float] = (0.03, 0.05, 0.02), frame_id: int | None = None,
) -> NavigationState:  # fmt: skip
    """A vehicle with its camera straight down, that sinks at 0.5 m/s and goes north at 0.3 m/s."""
    place = np.array(pos_ned_m)
    q_ned_from_pad = q_from_euler(0.0, 0.0, math.radians(pad_heading_deg))
    heading = math.radians(heading_deg)
    flown = state(t_us, mode=Mode.VISION, yaw_rad=heading)
    # The picture's right is the vehicle's right, its top is ahead.
    ned_from_camera = matrix_from_q(q_from_euler(0.0, 0.0, heading)) @ np.array(
        ((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))
    )
    seen = None
    if frame_id is not None:
        camera_from_pad = ned_from_camera.T @ matrix_from_q(q_ned_from_pad)
        seen = PadSeen(t_us, frame_id, camera_from_pad, -ned_from_camera.T @ place, 0, 0.9)
    pad = PadRelative(
        mode, place, np.array((0.3, 0.0, 0.5)), np.diag(np.square(std_m)), np.diag((0.04**2, 0.02**2, 0.01**2)),
        q_ned_from_pad, age_s, reason, seen,
    )  # fmt: skip
    return replace(flown, pad=pad)
