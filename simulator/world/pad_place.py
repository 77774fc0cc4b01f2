"""Where a landing pad lies in a world: on open ground that hardly slopes, near the middle."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.rotation import matrix_from_euler
from estimator.landing.pad import CirclePad
from estimator.types import Float
from simulator.errors import SimulatorError
from simulator.random_streams import rng_for
from simulator.world.world import RAISED_UNIT_M, World

_REACH_M = 100.0
_OPEN_M, _FREE_M = 6.0, 16.0
_TALLEST_NEAR_M = 8.0
_STEP_M = 2.0
# A lake is level to the millimetre, and nobody lands there.
_SLOPES = (0.003, 0.05)


@dataclass(frozen=True, slots=True, eq=False)
class PadPlace:
    """A pad, its centre (3,) in the world's frame and its attitude ``ned_from_pad`` (3, 3), flat on the ground."""

    pad: CirclePad
    pos_ned_m: Float
    ned_from_pad: Float


def place_pad(world: World, pad: CirclePad, seed: int) -> PadPlace:
    """Put a pad down; SimulatorError where the world has no open ground near its middle."""
    rng = rng_for(seed, "pad")
    north, east = _open_ground(world, rng)
    tilt_n, tilt_e = _slope(world, north, east)
    # Down on the plane of the ground leans as the ground rises.
    down = np.array((tilt_n, tilt_e, 1.0))
    down /= np.linalg.norm(down)
    turned = matrix_from_euler(0.0, 0.0, float(rng.uniform(-np.pi, np.pi)))
    forward = turned[:, 0] - float(turned[:, 0] @ down) * down
    forward /= np.linalg.norm(forward)
    ned_from_pad = np.column_stack((forward, np.cross(down, forward), down))
    return PadPlace(pad, np.array((north, east, -float(world.terrain.at(north, east)))), ned_from_pad)


def open_ground(world: World, places_ne_m: Float) -> NDArray[np.bool_]:
    """Which of some places (n, 2) inside the world are open, dry and level enough to land on."""
    patch = world.raised_patch
    tall = world.raised.astype(np.float32) * np.float32(RAISED_UNIT_M)
    near = cv2.dilate(tall, _disc(_OPEN_M / patch.gsd_m))
    around = cv2.dilate(tall, _disc(_FREE_M / patch.gsd_m))
    row, col = np.round(patch.row_col(places_ne_m)).astype(int).T
    slope = np.array([np.hypot(*_slope(world, n, e)) for n, e in places_ne_m.tolist()])
    good = (near[row, col] <= 0.0) & (around[row, col] < _TALLEST_NEAR_M)
    found: NDArray[np.bool_] = good & (slope > _SLOPES[0]) & (slope < _SLOPES[1])
    return found


def _open_ground(world: World, rng: np.random.Generator) -> tuple[float, float]:
    reach = min(_REACH_M, 0.5 * world.spec.half_size_m)
    places = np.arange(-reach, reach + _STEP_M, _STEP_M)
    grid = np.stack(np.meshgrid(places, places, indexing="ij"), axis=-1).reshape(-1, 2)
    good = open_ground(world, grid)
    if not good.any():
        message = f"world {world.spec.seed} has no open, level ground for a pad near its middle: take another seed"
        raise SimulatorError(message)
    distance = np.linalg.norm(grid, axis=1) + rng.uniform(0.0, 30.0, len(grid))
    north, east = grid[int(np.argmin(np.where(good, distance, np.inf)))].tolist()
    return north, east


def _slope(world: World, north_m: float, east_m: float) -> tuple[float, float]:
    """Rise of the ground by metre north and east, over the width of a pad."""
    half = 1.5
    rise_n = float(world.terrain.at(north_m + half, east_m)) - float(world.terrain.at(north_m - half, east_m))
    rise_e = float(world.terrain.at(north_m, east_m + half)) - float(world.terrain.at(north_m, east_m - half))
    return rise_n / (2 * half), rise_e / (2 * half)


def _disc(radius_px: float) -> cv2.typing.MatLike:
    size = 2 * round(radius_px) + 1
    return cv2.getStructuringElement(cv2.MORPH_ELLIPSE, (size, size))
