"""The finished world: what the camera sees, what the map shows, where things are. Made once per seed, then cached."""

from __future__ import annotations

import hashlib
import json
import shutil
import tempfile
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.geometry.local import LocalFrame
from estimator.types import Float, Image
from simulator.world.cars import place_cars
from simulator.world.epoch import CURRENT, REFERENCE
from simulator.world.landmarks import Landmark, find_landmarks
from simulator.world.paint import Painter
from simulator.world.patch import Patch
from simulator.world.reference import ReferenceRaster, elevation_raster, reference_raster
from simulator.world.settle import base_layout, later_layout
from simulator.world.terrain import Terrain, make_terrain

# Raise it whenever the same seed gives another world, so that no stale cache is used.
GENERATION = 4

_TILE_PX = 1500
_RAISED_FACTOR = 2
RAISED_UNIT_M = 0.1


@dataclass(frozen=True, slots=True)
class WorldSpec:
    """What a world is made from; equal specifications give equal worlds."""

    seed: int
    lat_deg: float = 58.49
    lon_deg: float = 15.62
    alt_amsl_m: float = 84.0
    half_size_m: float = 600.0
    gsd_m: float = 0.2
    relief_m: float = 26.0
    changed_share: float = 0.08
    reference_gsd_m: float = 0.5

    @property
    def frame(self) -> LocalFrame:
        """The world's local frame; its origin is on the datum from which heights count."""
        return LocalFrame(float(np.radians(self.lat_deg)), float(np.radians(self.lon_deg)), self.alt_amsl_m)


@dataclass(frozen=True, slots=True, eq=False)
class World:
    """The ground in the current epoch, its relief, and the reference map of the older epoch.

    ``ground_bgr`` (rows, cols, 3) lies on ``ground_patch``; ``raised`` (rows, cols) holds heights above ground in
    steps of 0.1 m on ``raised_patch``.
    """

    spec: WorldSpec
    frame: LocalFrame
    ground_bgr: Image
    ground_patch: Patch
    raised: NDArray[np.uint8]
    raised_patch: Patch
    terrain: Terrain
    reference: ReferenceRaster
    elevation: ReferenceRaster
    landmarks: tuple[Landmark, ...]

    def ground_down_m(self, north_m: Float, east_m: Float) -> Float:
        """Down coordinate of the bare ground."""
        return -self.terrain.at(north_m, east_m)


def world_for(spec: WorldSpec, cache: Path | None = None) -> World:
    """The world of a specification, from the cache folder when it is there."""
    if cache is None:
        return make_world(spec)
    text = json.dumps([GENERATION, asdict(spec)])
    folder = cache / f"world-{spec.seed}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    if not (folder / "complete").exists():
        _store(make_world(spec), folder)
    return _load(spec, folder)


def make_world(spec: WorldSpec) -> World:
    """Make a world from nothing: some ten seconds on one core."""
    before = base_layout(spec.seed, spec.half_size_m)
    now = later_layout(before, spec.seed, spec.changed_share)
    terrain = make_terrain(spec.seed, before, spec.relief_m)
    frame = spec.frame
    old_cars = place_cars(before, spec.seed, REFERENCE.name)
    older = Painter(before, old_cars, terrain, REFERENCE, spec.seed)
    reference = reference_raster(older, frame, spec.half_size_m, spec.reference_gsd_m, spec.seed)
    del older
    cars = place_cars(now, spec.seed, CURRENT.name)
    patch = _world_patch(spec)
    ground, raised = _paint_current(Painter(now, cars, terrain, CURRENT, spec.seed), patch)
    raised_patch = patch.coarser(_RAISED_FACTOR)
    return World(
        spec=spec,
        frame=frame,
        ground_bgr=ground,
        ground_patch=patch,
        raised=raised,
        raised_patch=raised_patch,
        terrain=terrain,
        reference=reference,
        elevation=elevation_raster(terrain, frame, spec.half_size_m, spec.seed),
        landmarks=find_landmarks(now, cars, terrain, raised, raised_patch),
    )


def _world_patch(spec: WorldSpec) -> Patch:
    size = round(2 * spec.half_size_m / spec.gsd_m / _RAISED_FACTOR) * _RAISED_FACTOR
    half = (size - 1) * spec.gsd_m / 2
    return Patch(half, -half, size, size, spec.gsd_m)


def _paint_current(painter: Painter, patch: Patch) -> tuple[Image, NDArray[np.uint8]]:
    ground = np.empty((patch.rows, patch.cols, 3), np.uint8)
    raised = np.empty((patch.rows // _RAISED_FACTOR, patch.cols // _RAISED_FACTOR), np.uint8)
    for row in range(0, patch.rows, _TILE_PX):
        for col in range(0, patch.cols, _TILE_PX):
            rows = slice(row, min(row + _TILE_PX, patch.rows))
            cols = slice(col, min(col + _TILE_PX, patch.cols))
            painted = painter.paint(patch.cut(rows, cols))
            ground[rows, cols] = painted.colour_bgr
            height, width = painted.raised_m.shape
            small = cv2.resize(
                painted.raised_m, (width // _RAISED_FACTOR, height // _RAISED_FACTOR), interpolation=cv2.INTER_AREA
            )
            raised[
                rows.start // _RAISED_FACTOR : rows.stop // _RAISED_FACTOR,
                cols.start // _RAISED_FACTOR : cols.stop // _RAISED_FACTOR,
            ] = np.clip(np.round(small / RAISED_UNIT_M), 0, 255).astype(np.uint8)
    return ground, raised


_ARRAYS = ("ground", "raised", "terrain", "reference", "elevation")


def _store(world: World, folder: Path) -> None:
    """Under a temporary name first: two simulators may start at once, and either may be killed."""
    folder.parent.mkdir(parents=True, exist_ok=True)
    partial = Path(tempfile.mkdtemp(prefix=f".{folder.name}-", dir=folder.parent))
    try:
        arrays: tuple[NDArray[Any], ...] = (
            *(world.ground_bgr, world.raised, world.terrain.height_m),
            *(world.reference.bands, world.elevation.bands),
        )
        for name, array in zip(_ARRAYS, arrays, strict=True):
            np.save(partial / f"{name}.npy", array)
        about = {
            "reference": [world.reference.transform, world.reference.crs],
            "elevation": [world.elevation.transform, world.elevation.crs],
            "terrain": asdict(world.terrain.patch),
            "landmarks": [asdict(landmark) for landmark in world.landmarks],
        }
        (partial / "about.json").write_text(json.dumps(about))
        (partial / "complete").touch()
        try:
            partial.replace(folder)
        except OSError:
            # Somebody else was faster, or a broken folder is in the way.
            if not (folder / "complete").exists():
                shutil.rmtree(folder, ignore_errors=True)
                partial.replace(folder)
    finally:
        shutil.rmtree(partial, ignore_errors=True)


def _load(spec: WorldSpec, folder: Path) -> World:
    about = json.loads((folder / "about.json").read_text())
    arrays = {name: np.load(folder / f"{name}.npy") for name in _ARRAYS}
    patch = _world_patch(spec)
    return World(
        spec=spec,
        frame=spec.frame,
        ground_bgr=arrays["ground"],
        ground_patch=patch,
        raised=arrays["raised"],
        raised_patch=patch.coarser(_RAISED_FACTOR),
        terrain=Terrain(Patch(**about["terrain"]), arrays["terrain"]),
        reference=_raster(arrays["reference"], about["reference"]),
        elevation=_raster(arrays["elevation"], about["elevation"]),
        landmarks=tuple(Landmark(**landmark) for landmark in about["landmarks"]),
    )


def _raster(bands: NDArray[np.generic], about: list[object]) -> ReferenceRaster:
    transform, crs = about
    if not isinstance(transform, list) or not isinstance(crs, str):
        message = "the cached world's about.json is damaged; delete the folder"
        raise ValueError(message)
    a, b, c, d, e, f = (float(value) for value in transform)
    return ReferenceRaster(bands, (a, b, c, d, e, f), crs)
