"""Where a whole frame lies on the ground: a grid of its pixels, each cut with the ground."""

from __future__ import annotations

import asyncio
import math
from dataclasses import dataclass

import numpy as np

from backend.clicks import FrameView, PixelPlace, camera_pixel, view_of
from backend.errors import NoGroundError
from backend.fleet.feed import FrameIdentity
from backend.fleet.vehicle import VehicleView
from backend.pointing import Pointing, cut, ground_for, reaches_m
from backend.uncertainty import circular_error_m
from estimator.errors import GeometryError
from estimator.evaluate import CHI2_95_2DOF
from estimator.geometry.ground import intersect_terrain
from estimator.geometry.rotation import matrix_from_q
from estimator.ports import GroundModel
from estimator.targets.ray import MAX_RANGE_M, Lowered
from estimator.types import Float

# From the centre of the outermost pixels. Their far edge itself is no longer in the picture.
EDGE_PX = 0.49
RING_POINTS = 33
# Of the march to the ground, at least: what is thinner does not show in a grid this coarse.
STEP_M = 2.0


@dataclass(frozen=True, slots=True)
class Footprint:
    """Latitude and longitude (degrees) of a grid of pixels, row by row; None where a pixel shows no known ground."""

    t_us: int
    u_px: list[float]
    v_px: list[float]
    points: list[tuple[float, float] | None]
    middle: int
    ce90_m: float | None


async def footprint_of(
    vehicle: VehicleView, frame: FrameIdentity, pointing: Pointing, columns: int, rows: int
) -> Footprint:
    """Where a frame lies, with ``columns`` x ``rows`` points from edge to edge.

    Raises
    ------
    NoStateForFrameError
        Nobody knows where the vehicle was then, or how its camera looks.
    NoGroundError
        No pixel of the grid shows known ground.
    """
    view = await view_of(vehicle, frame)
    return await asyncio.to_thread(_footprint, view, frame, pointing, columns, rows)


def ellipse_in_frame(place: PixelPlace, frame: FrameIdentity) -> list[list[float]] | None:
    """The 95 % ellipse of a place as its frame would show it, lying level there: a closed ring of pixels [u, v].

    None where the camera does not see all of it, as when it reaches below the vehicle.
    """
    found, camera = place.cut.found, place.setup.camera
    values, vectors = np.linalg.eigh(found.cov_ned_m2[:2, :2])
    angle = np.linspace(0.0, 2.0 * np.pi, RING_POINTS)
    axes = vectors * np.sqrt(np.maximum(values, 0.0) * CHI2_95_2DOF)
    ring = np.tile(found.pos_ned_m, (RING_POINTS, 1))
    ring[:, :2] += np.stack((np.cos(angle), np.sin(angle)), axis=-1) @ axes.T
    uv_px = camera.project((ring - place.state.lens_ned_m) @ matrix_from_q(place.state.q_ned_from_camera))
    if not np.all(np.isfinite(uv_px)):
        return None
    scale = np.array([frame.width_px / camera.width_px, frame.height_px / camera.height_px])
    shown: list[list[float]] = ((uv_px + 0.5) * scale - 0.5).round(2).tolist()
    return shown


def _footprint(view: FrameView, frame: FrameIdentity, pointing: Pointing, columns: int, rows: int) -> Footprint:
    u_px = np.linspace(-EDGE_PX, frame.width_px - 1 + EDGE_PX, columns)
    v_px = np.linspace(-EDGE_PX, frame.height_px - 1 + EDGE_PX, rows)
    uv_px = np.array([camera_pixel(float(u), float(v), frame, view.setup) for v in v_px for u in u_px])
    middle = (rows // 2) * columns + columns // 2
    try:
        ground = ground_for(view.setup, pointing, view.state)
    except GeometryError as error:
        raise NoGroundError(float(u_px[columns // 2]), float(v_px[rows // 2]), str(error)) from None
    places = _places_ned_m(view, uv_px, pointing, ground)
    lat, lon, _ = view.setup.frame.geodetic_from_ned(places)
    points = [
        (math.degrees(float(a)), math.degrees(float(b))) if math.isfinite(a) else None
        for a, b in zip(lat, lon, strict=True)
    ]
    try:
        at_middle = cut(view.state, view.setup, tuple(uv_px[middle]), pointing, ground)
        ce90_m = circular_error_m(at_middle.found.cov_ned_m2[:2, :2])
    except GeometryError as error:
        ce90_m = None
        if all(point is None for point in points):
            at = float(u_px[columns // 2]), float(v_px[rows // 2])
            raise NoGroundError(*at, f"{error}; nor does the rest of the frame show any") from None
    return Footprint(view.t_us, u_px.tolist(), v_px.tolist(), points, middle, ce90_m)


def _places_ned_m(view: FrameView, uv_px: Float, pointing: Pointing, ground: GroundModel) -> Float:
    """Where the rays of pixels (n, 2) meet what is pointed at, (n, 3): as `cut` for each, in a tenth of the time."""
    state, setup = view.state, view.setup
    rays = setup.camera.rays(uv_px) @ matrix_from_q(state.q_ned_from_camera).T

    seen = Lowered(ground, state.ground_bias_m)

    def down_at(north_m: Float, east_m: Float) -> Float:
        down: Float = setup.frame.alt_m - seen.alt_amsl_m(north_m, east_m) - pointing.height_above_ground_m
        return down

    reach_m = np.full(len(rays), MAX_RANGE_M)
    if pointing.ground == "terrain":
        reach_m = reaches_m(state, setup, rays, pointing)
    down = np.flatnonzero(reach_m > 0.0)
    places = np.full((len(rays), 3), np.nan)
    if down.size:
        places[down] = intersect_terrain(state.lens_ned_m, rays[down], down_at, float(reach_m.max()), STEP_M)
    return places
