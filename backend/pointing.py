"""What an operator points at: at which height above which ground, and whether there is such ground at all."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal
from weakref import WeakKeyDictionary

import numpy as np

from backend.navigation.setup import UNKNOWN_SLOPE_STD, NavigationSetup
from estimator.errors import GeometryError
from estimator.geometry.rotation import matrix_from_q
from estimator.ports import GroundModel
from estimator.targets.ray import MAX_RANGE_M, RayTarget, locate_ray, no_ground, pixel_ray
from estimator.types import Float, NavigationState
from geodata.elevation import ElevationGrid, FlatGround

GroundKind = Literal["terrain", "flat"]

# Of a hand's click, on each axis: what the recorded clicks of docs/results/targets.md are off by in the picture.
CLICK_STD_PX = 1.5
# What people say of a height by looking at it is off by a tenth.
STATED_HEIGHT_SHARE = 0.1
LOWEST_HEIGHT_M, HIGHEST_HEIGHT_M = -100.0, 500.0
# A lens beside the vehicle's centre, and what a filter takes the ground to be off by.
MARGIN_M = 50.0
BEYOND_TERRAIN = (
    "what it shows lies beyond the elevation model, which knows no height there: choose flat ground if level land at "
    "the height below the vehicle will do"
)
_ALTITUDES_M: WeakKeyDictionary[ElevationGrid, tuple[float, float]] = WeakKeyDictionary()


@dataclass(frozen=True, slots=True)
class Pointing:
    """How far the thing pointed at stands above the ground, and what is taken for that.

    ``terrain`` is the ground that the station knows, ``flat`` level ground at the height that is below the vehicle.
    """

    height_above_ground_m: float = 0.0
    ground: GroundKind = "terrain"


AT_THE_GROUND = Pointing()


@dataclass(frozen=True, slots=True, eq=False)
class CutRay:
    """Where a pixel's ray was cut, and how in a target's words.

    ``ground_std_m`` and ``slope_std`` are the errors (one sigma) of the ground's height there and of its slope.
    """

    found: RayTarget
    ground_std_m: float
    slope_std: float
    method: str


def ground_for(setup: NavigationSetup, pointing: Pointing, state: NavigationState) -> GroundModel:
    """The ground that rays are cut with.

    Raises
    ------
    GeometryError
        Level ground is asked for, and nobody knows how high the ground below the vehicle is.
    """
    if pointing.ground == "terrain":
        return setup.ground
    north, east, down = state.pos_ned_m
    alt_amsl_m = float(setup.ground.alt_amsl_m(np.array([north]), np.array([east]))[0])
    if not math.isfinite(alt_amsl_m):
        # Beside the elevation model the estimator may still know its height above what is below.
        alt_amsl_m = setup.frame.alt_m - float(down) - state.alt_agl_m + state.ground_bias_m
    if not math.isfinite(alt_amsl_m):
        raise GeometryError("how high the ground below the vehicle is is not known, so level ground has no height")
    return FlatGround(alt_amsl_m)


def cut(
    state: NavigationState, setup: NavigationSetup, uv_px: tuple[float, float], pointing: Pointing, ground: GroundModel
) -> CutRay:
    """Where a pixel's ray meets what is pointed at; ``ground`` is that of ``ground_for``, or watches over it.

    Raises
    ------
    GeometryError
        The pixel lies outside picture or lens, its ray meets no ground, or meets it where nobody knows its height.
    """
    ground_std_m, slope_std = setup.ground_errors(state)
    std_m = math.hypot(ground_std_m, STATED_HEIGHT_SHARE * pointing.height_above_ground_m)
    if pointing.ground == "flat":
        if not isinstance(setup.ground, FlatGround):
            slope_std = UNKNOWN_SLOPE_STD
        found = _cut(state, setup, uv_px, pointing, ground, (std_m, slope_std), MAX_RANGE_M)
        return CutRay(found, std_m, slope_std, "ray_flat")
    ray = matrix_from_q(state.q_ned_from_camera) @ pixel_ray(setup.camera, uv_px)
    reach_m = float(reaches_m(state, setup, ray[np.newaxis], pointing)[0])
    try:
        found = _cut(state, setup, uv_px, pointing, ground, (std_m, slope_std), reach_m)
    except GeometryError:
        # A shorter reach than the longest is where the ray is below all that is known.
        raise GeometryError(BEYOND_TERRAIN if 0.0 < reach_m < MAX_RANGE_M else no_ground(MAX_RANGE_M)) from None
    if found.method != "ray_terrain":
        raise GeometryError(BEYOND_TERRAIN)
    return CutRay(found, std_m, slope_std, found.method)


def reaches_m(state: NavigationState, setup: NavigationSetup, rays_ned: Float, pointing: Pointing) -> Float:
    """How far unit rays (n, 3) are worth following over the terrain (n,): until they are below all of it; 0 for those
    that never come down to it.

    A march through the unknown beside an elevation model goes by small steps: over kilometres it takes a second.
    """
    if not isinstance(setup.ground, ElevationGrid):
        return np.full(len(rays_ned), MAX_RANGE_M)
    lowest_m, highest_m = _altitudes_m(setup.ground)
    alt_m = setup.frame.alt_m - float(state.lens_ned_m[2]) + state.ground_bias_m - pointing.height_above_ground_m
    down = rays_ned[:, 2]
    reach_m = np.where(down > 0.0, (alt_m - lowest_m + MARGIN_M) / np.where(down > 0.0, down, 1.0), MAX_RANGE_M)
    reach_m = np.where((down <= 0.0) & (alt_m > highest_m), 0.0, reach_m)
    clipped: Float = np.clip(reach_m, 0.0, MAX_RANGE_M)
    return clipped


def _altitudes_m(grid: ElevationGrid) -> tuple[float, float]:
    known = _ALTITUDES_M.get(grid)
    if known is None:
        heights = grid.alt_amsl_grid_m[np.isfinite(grid.alt_amsl_grid_m)]
        known = (float(heights.min()), float(heights.max())) if heights.size else (math.inf, -math.inf)
        _ALTITUDES_M[grid] = known
    return known


def _cut(
    state: NavigationState, setup: NavigationSetup, uv_px: tuple[float, float], pointing: Pointing,
    ground: GroundModel, ground_errors: tuple[float, float], max_range_m: float,
) -> RayTarget:  # fmt: skip
    if max_range_m <= 0.0:
        raise GeometryError(no_ground(MAX_RANGE_M))
    ground_std_m, slope_std = ground_errors
    return locate_ray(
        state, setup.camera, uv_px, ground, setup.frame, ground_std_m=ground_std_m, pixel_std_px=CLICK_STD_PX,
        height_above_ground_m=pointing.height_above_ground_m, max_range_m=max_range_m, slope_std=slope_std,
    )  # fmt: skip
