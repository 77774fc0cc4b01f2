"""From a click on a frame to a point on the ground."""

from __future__ import annotations

import asyncio
import math
import uuid
from dataclasses import dataclass

from backend.clock import unix_us
from backend.errors import InvalidRequestError, NoGroundError, NoStateForFrameError
from backend.evidence.collect import Sighting
from backend.evidence.ground import WatchedGround
from backend.fleet.feed import FrameIdentity
from backend.fleet.vehicle import VehicleView
from backend.navigation.setup import NavigationSetup
from backend.pointing import AT_THE_GROUND, CLICK_STD_PX, CutRay, Pointing, cut, ground_for
from backend.schemas.geometry import NewTarget
from backend.store.targets import Target
from estimator.errors import GeometryError
from estimator.types import Mode, NavigationState

ASPECT_TOLERANCE = 0.01


def typed_target(body: NewTarget) -> Target:
    """A target of typed-in coordinates; its uncertainty is unknown."""
    if body.height_above_ground_m is not None or body.ground is not None:
        raise InvalidRequestError(
            "height_above_ground_m and ground say how a pixel is located; typed-in coordinates have alt_amsl_m"
        )
    if body.lat_deg is None or body.lon_deg is None:
        raise InvalidRequestError("a target needs vehicle_id, frame_id, u_px and v_px, or lat_deg and lon_deg")
    now_us = unix_us()
    return Target(
        id=str(uuid.uuid4()), name=body.name or "", lat_deg=body.lat_deg, lon_deg=body.lon_deg,
        alt_amsl_m=body.alt_amsl_m, method="manual", created_unix_us=now_us, updated_unix_us=now_us,
        vehicle_id=body.vehicle_id,
    )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class PixelPlace:
    """Where a pixel of a frame lies, and all that went into it. ``t_us`` is the exposure on the states' clock."""

    t_us: int
    state: NavigationState
    setup: NavigationSetup
    camera_uv_px: tuple[float, float]
    pointing: Pointing
    ground: WatchedGround
    cut: CutRay
    assumption: str | None

    @property
    def method(self) -> str:
        """How the place was found, with what was assumed."""
        return self.cut.method if self.assumption is None else f"{self.cut.method}, {self.assumption}"


@dataclass(frozen=True, slots=True, eq=False)
class FrameView:
    """The vehicle at a frame's exposure, ``t_us`` on the states' clock."""

    t_us: int
    state: NavigationState
    setup: NavigationSetup


async def view_of(vehicle: VehicleView, frame: FrameIdentity) -> FrameView:
    """The vehicle and its camera when a frame was exposed.

    Raises
    ------
    NoStateForFrameError
        Nobody knows where the vehicle was then, or how its camera looks.
    """
    setup = vehicle.setup
    if setup is None or not setup.has_camera:
        reason = "the estimator has no camera parameters: start the station with --camera CAM.json"
        raise NoStateForFrameError(vehicle.id, frame.frame_id, reason)
    t_us = vehicle.exposure_us(frame)
    state = await vehicle.state_at(t_us)
    if state is None:
        raise NoStateForFrameError(vehicle.id, frame.frame_id, "it is outside the time that the estimator knows")
    if state.mode is Mode.LOST:
        raise NoStateForFrameError(vehicle.id, frame.frame_id, "the estimator was lost then")
    return FrameView(t_us, state, setup)


async def place_of_pixel(
    vehicle: VehicleView, frame: FrameIdentity, u_px: float, v_px: float, pointing: Pointing = AT_THE_GROUND
) -> PixelPlace:
    """What a pixel of a frame shows, with the state at that frame's exposure.

    Raises
    ------
    InvalidRequestError
        The pixel lies outside the frame.
    NoStateForFrameError
        Nobody knows where the vehicle was then, or how its camera looks.
    NoGroundError
        The pixel shows no known ground.
    """
    if vehicle.setup is not None and vehicle.setup.has_camera:
        camera_pixel(u_px, v_px, frame, vehicle.setup)  # a click beside the picture is that first of all
    view = await view_of(vehicle, frame)
    setup, state = view.setup, view.state
    uv_px = camera_pixel(u_px, v_px, frame, setup)
    try:
        ground = WatchedGround(ground_for(setup, pointing, state))
        found = await asyncio.to_thread(cut, state, setup, uv_px, pointing, ground)
    except GeometryError as error:
        raise NoGroundError(u_px, v_px, str(error)) from None
    return PixelPlace(view.t_us, state, setup, uv_px, pointing, ground, found, vehicle.assumption_at(view.t_us))


async def clicked_target(body: NewTarget, vehicle: VehicleView, frame: FrameIdentity) -> Sighting:
    """What a pixel of a frame shows: the target and what it comes from. Errors as for `place_of_pixel`."""
    if body.u_px is None or body.v_px is None:
        raise InvalidRequestError("a click needs frame_id, u_px and v_px")
    pointing = Pointing(body.height_above_ground_m or 0.0, body.ground or "terrain")
    place = await place_of_pixel(vehicle, frame, body.u_px, body.v_px, pointing)
    found = place.cut.found
    now_us = unix_us()
    cov = found.cov_ned_m2
    target = Target(
        id=str(uuid.uuid4()), name=body.name or "", lat_deg=math.degrees(found.lat_rad),
        lon_deg=math.degrees(found.lon_rad), alt_amsl_m=float(found.alt_amsl_m), method=place.method,
        created_unix_us=now_us, updated_unix_us=now_us, vehicle_id=vehicle.id, frame_id=frame.frame_id,
        t_unix_us=place.t_us, u_px=body.u_px, v_px=body.v_px, var_n_m2=float(cov[0, 0]), var_e_m2=float(cov[1, 1]),
        var_d_m2=float(cov[2, 2]), cov_ne_m2=float(cov[0, 1]),
        height_above_ground_m=pointing.height_above_ground_m, ground=pointing.ground,
    )  # fmt: skip
    return Sighting(
        target, frame, place.state, place.setup, place.camera_uv_px, CLICK_STD_PX, place.ground, found,
        place.assumption, pointing.height_above_ground_m, place.cut.ground_std_m, place.cut.slope_std,
        place.cut.method,
    )  # fmt: skip


def camera_pixel(u_px: float, v_px: float, frame: FrameIdentity, setup: NavigationSetup) -> tuple[float, float]:
    """The pixel of the calibrated camera for a pixel of the video, which may be scaled but not cut."""
    frame.check_shows(u_px, v_px)
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
