"""From a click on a frame to a point on the ground."""

from __future__ import annotations

import asyncio
import math
import uuid

from backend.clock import unix_us
from backend.errors import InvalidRequestError, NoGroundError, NoStateForFrameError
from backend.evidence.collect import Sighting
from backend.evidence.ground import WatchedGround
from backend.fleet.feed import FrameIdentity
from backend.fleet.vehicle import VehicleView
from backend.navigation.setup import NavigationSetup
from backend.schemas.geometry import NewTarget
from backend.store.targets import Target
from estimator.errors import GeometryError
from estimator.targets.ray import RayTarget, locate_ray
from estimator.types import Mode, NavigationState

CLICK_STD_PX = 2.0
ASPECT_TOLERANCE = 0.01


def typed_target(body: NewTarget) -> Target:
    """A target of typed-in coordinates; its uncertainty is unknown."""
    if body.lat_deg is None or body.lon_deg is None:
        raise InvalidRequestError("a target needs vehicle_id, frame_id, u_px and v_px, or lat_deg and lon_deg")
    now_us = unix_us()
    return Target(
        id=str(uuid.uuid4()), name=body.name or "", lat_deg=body.lat_deg, lon_deg=body.lon_deg,
        alt_amsl_m=body.alt_amsl_m, method="manual", created_unix_us=now_us, updated_unix_us=now_us,
        vehicle_id=body.vehicle_id,
    )  # fmt: skip


async def clicked_target(body: NewTarget, vehicle: VehicleView, frame: FrameIdentity) -> Sighting:
    """What a pixel of a frame shows, with the state at that frame's exposure: the target and what it comes from.

    Raises
    ------
    NoStateForFrameError
        Nobody knows where the vehicle was then, or how its camera looks.
    NoGroundError
        The pixel shows no known ground.
    """
    if body.u_px is None or body.v_px is None:
        raise InvalidRequestError("a click needs frame_id, u_px and v_px")
    setup = vehicle.setup
    if setup is None or not setup.has_camera:
        reason = "the estimator has no camera parameters: start the station with --camera CAM.json"
        raise NoStateForFrameError(vehicle.id, frame.frame_id, reason)
    uv_px = camera_pixel(body.u_px, body.v_px, frame, setup)
    t_us = vehicle.exposure_us(frame)
    state = await vehicle.state_at(t_us)
    if state is None:
        raise NoStateForFrameError(vehicle.id, frame.frame_id, "it is outside the time that the estimator knows")
    if state.mode is Mode.LOST:
        raise NoStateForFrameError(vehicle.id, frame.frame_id, "the estimator was lost then")
    try:
        found, ground = await asyncio.to_thread(_locate, state, setup, uv_px)
    except GeometryError as error:
        raise NoGroundError(body.u_px, body.v_px, str(error)) from None
    now_us = unix_us()
    cov = found.cov_ned_m2
    assumption = vehicle.assumption_at(t_us)
    method = found.method if assumption is None else f"{found.method}, {assumption}"
    target = Target(
        id=str(uuid.uuid4()), name=body.name or "", lat_deg=math.degrees(found.lat_rad),
        lon_deg=math.degrees(found.lon_rad), alt_amsl_m=float(found.alt_amsl_m), method=method,
        created_unix_us=now_us, updated_unix_us=now_us, vehicle_id=vehicle.id, frame_id=frame.frame_id,
        t_unix_us=t_us, u_px=body.u_px, v_px=body.v_px, var_n_m2=float(cov[0, 0]), var_e_m2=float(cov[1, 1]),
        var_d_m2=float(cov[2, 2]), cov_ne_m2=float(cov[0, 1]),
    )  # fmt: skip
    return Sighting(target, frame, state, setup, uv_px, CLICK_STD_PX, ground, found, assumption)


def camera_pixel(u_px: float, v_px: float, frame: FrameIdentity, setup: NavigationSetup) -> tuple[float, float]:
    """The pixel of the calibrated camera for a pixel of the video, which may be scaled but not cut."""
    if not (-0.5 <= u_px <= frame.width_px - 0.5 and -0.5 <= v_px <= frame.height_px - 0.5):
        raise InvalidRequestError(
            f"pixel ({u_px}, {v_px}) lies outside the frame of {frame.width_px} x {frame.height_px}"
        )
    camera = setup.camera
    scale_u, scale_v = camera.width_px / frame.width_px, camera.height_px / frame.height_px
    if abs(scale_u / scale_v - 1.0) > ASPECT_TOLERANCE:
        raise NoStateForFrameError(
            "", frame.frame_id,
            f"the video's {frame.width_px} x {frame.height_px} contradicts the camera file's "
            f"{camera.width_px} x {camera.height_px}",
        )  # fmt: skip
    # Pixel centres are whole numbers, so the edge lies at -0.5.
    return (u_px + 0.5) * scale_u - 0.5, (v_px + 0.5) * scale_v - 0.5


def _locate(
    state: NavigationState, setup: NavigationSetup, uv_px: tuple[float, float]
) -> tuple[RayTarget, WatchedGround]:
    ground = WatchedGround(setup.ground)
    ground_std_m, slope_std = setup.ground_errors(state)
    found = locate_ray(
        state, setup.camera, uv_px, ground, setup.frame,
        ground_std_m=ground_std_m, pixel_std_px=CLICK_STD_PX, slope_std=slope_std,
    )  # fmt: skip
    return found, ground
