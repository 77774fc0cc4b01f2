"""What an operator says by dragging a frame onto the map: a measurement of the vehicle's position."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from backend.clicks import FrameView, view_of
from backend.errors import AlignmentRefusedError
from backend.fleet.feed import FrameIdentity
from backend.fleet.vehicle import VehicleView
from backend.pointing import AT_THE_GROUND, cut, ground_for
from estimator.errors import GeometryError
from estimator.geometry.ground import ray_ground_jacobian
from estimator.geometry.rotation import matrix_from_q
from estimator.types import AlignmentSample, Float

OLDEST_S = 30.0
# A frame shows about as much ground as the vehicle is high: who drags it by more than this has not adjusted it.
MOST_HEIGHTS = 3.0
MOST_SIGMAS = 3.0


@dataclass(frozen=True, slots=True)
class Shift:
    """How far the frame was dragged, and how well (one sigma on each axis)."""

    north_m: float
    east_m: float
    std_m: float


async def alignment_of(vehicle: VehicleView, frame: FrameIdentity, shift: Shift, now_us: int) -> AlignmentSample:
    """The measurement, to be fused at ``now_us``.

    Raises
    ------
    NoStateForFrameError
        Nobody knows where the vehicle was then, or how its camera looks.
    AlignmentRefusedError
        The frame is too old or shows no ground in its middle, or was dragged absurdly far.
    """
    view = await view_of(vehicle, frame)
    age_s = (now_us - view.t_us) / 1e6
    if age_s > OLDEST_S:
        raise AlignmentRefusedError(
            f"frame {frame.frame_id} is {age_s:.0f} s old: align one of the last {OLDEST_S:.0f} s"
        )
    size_m = math.hypot(shift.north_m, shift.east_m)
    cov = view.state.cov_pos_ned_m2
    most_m = MOST_HEIGHTS * max(view.state.alt_agl_m, 0.0) + MOST_SIGMAS * math.sqrt(float(cov[0, 0] + cov[1, 1]))
    if not size_m <= most_m:
        raise AlignmentRefusedError(
            f"the frame was dragged by {size_m:.0f} m, and what it shows allows {most_m:.0f} m: is it the right place?"
        )
    dragged = view.state.pos_ned_m[:2] + np.array([shift.north_m, shift.east_m])
    cov_ne_m2 = shift.std_m**2 * np.eye(2) + tilt_covariance(view)
    return AlignmentSample(max(now_us, view.t_us), view.t_us, frame.frame_id, dragged, cov_ne_m2)


def tilt_covariance(view: FrameView) -> Float:
    """What the camera's attitude errors move the frame's middle on the ground (2, 2).

    A frame lies beside its place for want of position or of attitude: the operator sees the sum.
    """
    state, camera = view.state, view.setup.camera
    middle = (camera.width_px - 1) / 2.0, (camera.height_px - 1) / 2.0
    try:
        ground = ground_for(view.setup, AT_THE_GROUND, state)
        point = cut(state, view.setup, middle, AT_THE_GROUND, ground).found.pos_ned_m
    except GeometryError as error:
        raise AlignmentRefusedError(f"the frame's middle shows no known ground: {error}") from None
    ray = matrix_from_q(state.q_ned_from_camera) @ camera.rays(np.array(middle))
    turns = ray_ground_jacobian(state.lens_ned_m, ray, point)[:, 3:]
    cov: Float = turns @ state.cov_camera_pose[3:, 3:] @ turns.T
    return cov
