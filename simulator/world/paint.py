"""Paints a patch of the world as it looks in one epoch, straight from above."""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np

from estimator.types import Image
from simulator.random_streams import rng_for
from simulator.world.epoch import Crop, Epoch
from simulator.world.layout import Layout, Parcel
from simulator.world.light import TALLEST_M, sunlight
from simulator.world.noise import FractalNoise
from simulator.world.patch import Float32, Patch
from simulator.world.raised import Car, Crowns, raise_buildings, raise_cars
from simulator.world.regions import FIRST_PARCEL, Labels, Material, label_ground, look_of
from simulator.world.terrain import Terrain

_PROFILE_STEP_M = 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Painted:
    """Colour (rows, cols, 3) in blue, green, red, and height above ground (rows, cols) in metres."""

    colour_bgr: Image
    raised_m: Float32


class Painter:
    """Everything that stays the same between the patches of one epoch."""

    def __init__(self, layout: Layout, cars: tuple[Car, ...], terrain: Terrain, epoch: Epoch, seed: int) -> None:
        self.layout, self.cars, self.terrain, self.epoch, self.seed = layout, cars, terrain, epoch, seed
        self._look = look_of(layout, epoch, seed)
        self._noise = {
            name: FractalNoise(rng_for(seed, "world", epoch.name, name)) for name in ("patches", "grain", "hue")
        }
        self._crowns = Crowns(rng_for(seed, "world", "crowns"))
        rng = rng_for(seed, "world", epoch.name, "leaves")
        count = len(layout.trees.radius_m)
        broadleaf = np.array(epoch.broadleaf, np.float32)[rng.integers(len(epoch.broadleaf), size=count)]
        conifer = np.array(epoch.conifer, np.float32)[rng.integers(len(epoch.conifer), size=count)]
        leaf_rgb = np.where(layout.trees.conifer[:, None], conifer, broadleaf)
        leaf_rgb = leaf_rgb * rng.normal(1.0, 0.07, (count, 1)).astype(np.float32)
        self._leaf_bgr = np.vstack([np.zeros((1, 3), np.float32), leaf_rgb[:, ::-1]])

    def paint(self, patch: Patch) -> Painted:
        """The patch; a margin wide enough for the longest shadow is painted with it and cut off again."""
        reach_m = TALLEST_M / np.tan(np.radians(self.epoch.sun_elevation_deg))
        margin = 2 * int(np.ceil(reach_m / patch.gsd_m / 2))
        wide = patch.grown(margin)
        raised = np.zeros((wide.rows, wide.cols), np.float32)
        owner = np.zeros((wide.rows, wide.cols), np.uint16)
        labels = label_ground(self.layout, wide)
        colour = self._ground(labels, wide)
        raise_buildings(self.layout.buildings, wide, raised, colour, 1.0)
        raise_cars(self.cars, wide, raised, colour)
        self._crowns.raise_trees(self.layout.trees, wide, raised, owner)
        crowned = owner > 0
        colour[crowned] = self._leaf_bgr[owner[crowned]]
        del labels, owner
        facing, shadow = sunlight(
            self.terrain.on(wide), raised, wide, self.epoch.sun_azimuth_deg, self.epoch.sun_elevation_deg
        )
        inner = (slice(margin, margin + patch.rows), slice(margin, margin + patch.cols))
        leafy = crowned[inner].astype(np.float32)
        lit = self._lit(colour[inner], facing[inner], shadow[inner], leafy, patch)
        return Painted(lit, np.ascontiguousarray(raised[inner]))

    def _ground(self, labels: Labels, patch: Patch) -> Float32:
        look = self._look
        factor = look.patchiness.take(labels) * self._noise["patches"].sample(patch, 55.0, 6, 0.68)
        factor += look.grain.take(labels) * self._noise["grain"].sample(patch, 1.8, 4, 0.9)
        factor += 1
        for index, parcel in enumerate(self.layout.parcels):
            crop = self._look.crops[FIRST_PARCEL + index]
            if crop.row_contrast > 0 and patch.touches(parcel.outline_ne_m):
                self._rows(factor, labels, patch, parcel, crop, FIRST_PARCEL + index)
        hue = np.float32(0.014) * self._noise["hue"].sample(patch, 30.0, 3, 0.7)
        dry = (labels != Material.ASPHALT) & (labels != Material.PAINT)
        hue *= dry
        # Plane by plane: broadcasting over three channels costs numpy five times as much.
        blue, green, red = (look.colour_bgr[:, channel].take(labels) * factor for channel in range(3))
        green *= 1 - np.float32(0.5) * hue
        red *= 1 + hue
        return np.asarray(cv2.merge([blue, green, red]), np.float32)

    def _rows(self, factor: Float32, labels: Labels, patch: Patch, parcel: Parcel, crop: Crop, label: int) -> None:
        rows, cols = patch.box(parcel.outline_ne_m)
        if rows.start >= rows.stop or cols.start >= cols.stop:
            return
        part = patch.cut(rows, cols)
        azimuth = parcel.row_azimuth_rad
        outline = parcel.outline_ne_m
        across = -np.sin(azimuth) * outline[:, 0] + np.cos(azimuth) * outline[:, 1]
        start = float(across.min()) - 1.0
        rng = rng_for(self.seed, "world", self.epoch.name, "rows", str(parcel.key))
        profile = _row_profile(rng, crop, float(np.ptp(across)) + 2.0)
        index = part.norths_m() * np.float32(-np.sin(azimuth) / _PROFILE_STEP_M)
        index = index + part.easts_m() * np.float32(np.cos(azimuth) / _PROFILE_STEP_M)
        index -= np.float32(start / _PROFILE_STEP_M)
        rows_here = profile.take(index.astype(np.int32), mode="clip")
        factor[rows, cols] += rows_here * (labels[rows, cols] == label)

    def _lit(self, colour: Float32, facing: Float32, shadow: Float32, leafy: Float32, patch: Patch) -> Image:
        leaves = self._noise["grain"].sample(patch, 0.9, 3, 1.0)
        leafage = 1 + np.float32(0.13) * leaves * leafy
        ambient = np.float32(self.epoch.shadow)
        # Crowns let light through: their own slopes darken less than a wall's would.
        facing = np.where(leafy > 0, 0.25 + 0.75 * facing, facing)
        direct = (1 - ambient) * facing * (1 - shadow) * leafage
        leafage *= ambient
        sky = np.array([1.14, 1.0, 0.92], np.float32)
        light = [direct + leafage * (1 + (tint - 1) * shadow) for tint in sky]
        # Saturates and rounds; nothing in it is negative.
        return np.asarray(cv2.convertScaleAbs(cv2.multiply(colour, cv2.merge(light))), np.uint8)


def _row_profile(rng: np.random.Generator, crop: Crop, width_m: float) -> Float32:
    """Relative brightness across a field, every 0.1 m: rows or strips, and the wheel tracks of tramlines."""
    across = np.arange(0.0, width_m, _PROFILE_STEP_M)
    fine = np.repeat(rng.standard_normal(len(across) // 4 + 1), 4)[: len(across)]
    fine = cv2.GaussianBlur(fine.astype(np.float32)[None], (5, 1), 1.2)[0]
    if crop.row_spacing_m < 1.5:
        wave = np.sin(2 * np.pi * across / max(crop.row_spacing_m, 0.75))
        profile = crop.row_contrast * (wave + 0.6 * fine)
    else:
        strips = rng.standard_normal(int(width_m / crop.row_spacing_m) + 2) * 0.6
        alternate = np.where(np.arange(len(strips)) % 2 == 0, 0.6, -0.6)
        index = (across / crop.row_spacing_m).astype(int)
        profile = crop.row_contrast * ((strips + alternate)[index] + 0.7 * fine)
    if crop.tramlines:
        spacing = max(crop.row_spacing_m, 18.0)
        phase = (across + rng.uniform(0, spacing)) % spacing
        for wheel in (-0.9, 0.9):
            profile = np.where(np.abs(phase - spacing / 2 - wheel) < 0.25, profile - 0.14, profile)
    return np.asarray(profile, np.float32)
