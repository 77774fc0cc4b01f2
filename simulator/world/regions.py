"""Which material every pixel of ground is made of, and how each looks."""

from __future__ import annotations

from dataclasses import dataclass
from enum import IntEnum

import numpy as np
from numpy.typing import NDArray

from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.world.epoch import Colour, Crop, Epoch
from simulator.world.layout import BorderKind, Layout, Parcel, ParkingLot, Use, Way, WayKind, rectangle
from simulator.world.patch import Patch

Labels = NDArray[np.uint16]


class Material(IntEnum):
    """Labels of ground that is no parcel; parcels follow from FIRST_PARCEL on."""

    WILD = 0
    ASPHALT = 1
    GRAVEL = 2
    VERGE = 3
    KERB = 4
    PAINT = 5
    WATER = 6
    REED = 7
    BANK = 8
    RUT = 9
    TURF = 10
    STREAM = 11
    YARD = 12
    TRACK_GRASS = 13


FIRST_PARCEL = 32
_ROAD_LINE_M = 0.2


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """Per label: display colour (n, 3) in blue, green, red; relative strength of patches and of grain."""

    colour_bgr: NDArray[np.float32]
    patchiness: NDArray[np.float32]
    grain: NDArray[np.float32]
    crops: dict[int, Crop]


def look_of(layout: Layout, epoch: Epoch, seed: int) -> Look:
    """Colours of all materials and parcels; crops rotate, so they are drawn anew for every epoch."""
    count = FIRST_PARCEL + len(layout.parcels)
    rgb = np.zeros((count, 3), np.float32)
    patchiness = np.full(count, 0.06, np.float32)
    grain = np.full(count, 0.05, np.float32)
    materials: dict[Material, tuple[Colour, float, float]] = {
        Material.WILD: (epoch.meadow, 0.14, 0.08),
        Material.ASPHALT: (epoch.asphalt, 0.05, 0.025),
        Material.GRAVEL: (epoch.gravel, 0.07, 0.06),
        Material.VERGE: (epoch.verge, 0.10, 0.08),
        Material.KERB: ((186, 184, 178), 0.03, 0.04),
        Material.PAINT: ((226, 226, 222), 0.05, 0.05),
        Material.WATER: (epoch.water, 0.06, 0.035),
        Material.REED: (epoch.reed, 0.12, 0.12),
        Material.BANK: (epoch.verge, 0.16, 0.12),
        Material.RUT: (epoch.gravel, 0.10, 0.06),
        Material.TURF: (epoch.lawn, 0.05, 0.04),
        Material.STREAM: (epoch.water, 0.10, 0.08),
        Material.YARD: (epoch.bare, 0.09, 0.05),
        Material.TRACK_GRASS: (epoch.verge, 0.10, 0.10),
    }
    for material, (colour, patches, fine) in materials.items():
        rgb[material], patchiness[material], grain[material] = colour, patches, fine
    crops: dict[int, Crop] = {}
    for index, parcel in enumerate(layout.parcels):
        label = FIRST_PARCEL + index
        rng = rng_for(seed, "world", epoch.name, "crop", str(parcel.key))
        crop = _crop_of(parcel, epoch, rng)
        rgb[label] = np.array(crop.colour) * (1 + rng.normal(0, 0.05)) + rng.normal(0, 4.0, 3)
        patchiness[label], grain[label] = crop.patchiness, crop.grain
        crops[label] = crop
    return Look(rgb[:, ::-1].copy(), patchiness, grain, crops)


def _crop_of(parcel: Parcel, epoch: Epoch, rng: np.random.Generator) -> Crop:
    if parcel.use is Use.FIELD:
        shares = np.array([crop.share for crop in epoch.crops])
        return epoch.crops[rng.choice(len(epoch.crops), p=shares / shares.sum())]
    if parcel.use is Use.MEADOW:
        mown = rng.random() < 0.4
        return Crop(epoch.meadow, 1.0, 5.0, 0.06 if mown else 0.0, False, 0.13, 0.06)
    if parcel.use is Use.WOOD:
        return Crop(epoch.wood_floor, 1.0, 0.0, 0.0, False, 0.20, 0.12)
    if parcel.use is Use.YARD:
        return Crop(epoch.bare, 1.0, 0.0, 0.0, False, 0.10, 0.05)
    return Crop(epoch.lawn, 1.0, 1.0, 0.02, False, 0.12, 0.06)


def label_ground(layout: Layout, patch: Patch) -> Labels:
    """Draw the whole layout, without what stands on it, as labels (rows, cols)."""
    labels = np.zeros((patch.rows, patch.cols), np.uint16)
    for index, parcel in enumerate(layout.parcels):
        patch.fill(labels, parcel.outline_ne_m, FIRST_PARCEL + index)
    for border in layout.borders:
        width = {BorderKind.FENCE: 0.4, BorderKind.BALK: 1.0, BorderKind.DITCH: 3.0}.get(border.kind, 2.4)
        patch.stroke(labels, border.line_ne_m, width, Material.VERGE)
        if border.kind is BorderKind.DITCH:
            patch.stroke(labels, border.line_ne_m, 1.0, Material.BANK)
    for kind in (WayKind.DRIVE, WayKind.TRACK):
        _draw_ways(labels, patch, layout.ways, kind)
    _draw_water(labels, patch, layout)
    for lot in layout.parking:
        _draw_parking(labels, patch, lot)
    for kind in (WayKind.STREET, WayKind.MAIN):
        _draw_ways(labels, patch, layout.ways, kind)
    for pitch in layout.pitches:
        _draw_pitch(labels, patch, pitch)
    return labels


# Drawn one after another: how much wider than the way (or how wide, when negative), and what.
_WAY_LAYERS: dict[WayKind, tuple[tuple[float, Material], ...]] = {
    WayKind.DRIVE: ((0.0, Material.GRAVEL),),
    WayKind.TRACK: ((2.0, Material.VERGE), (0.0, Material.GRAVEL), (-0.8, Material.TRACK_GRASS)),
    WayKind.STREET: ((3.0, Material.GRAVEL), (0.5, Material.KERB), (0.0, Material.ASPHALT)),
    WayKind.MAIN: ((4.0, Material.VERGE), (0.0, Material.ASPHALT)),
}


def _draw_ways(labels: Labels, patch: Patch, ways: tuple[Way, ...], kind: WayKind) -> None:
    """Layer by layer over all ways of a kind, so that crossings come out clean."""
    chosen = [way for way in ways if way.kind is kind and patch.touches(way.line_ne_m, 12.0)]
    for extra_m, material in _WAY_LAYERS[kind]:
        for way in chosen:
            patch.stroke(labels, way.line_ne_m, way.width_m + extra_m if extra_m >= 0 else -extra_m, material)
    if kind is WayKind.MAIN:
        for way in chosen:
            _draw_markings(labels, patch, way)


def _draw_markings(labels: Labels, patch: Patch, way: Way) -> None:
    for side in (-1.0, 1.0):
        patch.stroke(labels, _parallel(way.line_ne_m, side * (way.width_m / 2 - 0.35)), _ROAD_LINE_M, Material.PAINT)
    steps = np.concatenate([[0.0], np.cumsum(np.linalg.norm(np.diff(way.line_ne_m, axis=0), axis=1))])
    for start in np.arange(4.0, steps[-1] - 4.0, 9.0):
        span = np.array([start, start + 3.0])
        dash = np.stack([np.interp(span, steps, way.line_ne_m[:, axis]) for axis in (0, 1)], axis=1)
        patch.stroke(labels, dash, _ROAD_LINE_M, Material.PAINT)


def _parallel(line_ne_m: Float, offset_m: float) -> Float:
    along = np.gradient(line_ne_m, axis=0)
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    return line_ne_m + offset_m * np.stack([-along[:, 1], along[:, 0]], axis=1)


def _draw_water(labels: Labels, patch: Patch, layout: Layout) -> None:
    patch.stroke(labels, layout.stream_ne_m, 7.0, Material.BANK)
    patch.stroke(labels, layout.stream_ne_m, 2.8, Material.STREAM)
    centre = layout.lake_ne_m.mean(axis=0)
    outward = layout.lake_ne_m - centre
    distance = np.linalg.norm(outward, axis=1, keepdims=True)
    patch.fill(labels, centre + outward * (1 + 5.0 / distance), Material.BANK)
    ragged = 2.5 + 2.5 * np.sin(np.arange(len(outward)) * 1.9)[:, None]
    patch.fill(labels, centre + outward * (1 + ragged / distance), Material.REED)
    patch.fill(labels, layout.lake_ne_m, Material.WATER)


def _draw_parking(labels: Labels, patch: Patch, lot: ParkingLot) -> None:
    patch.fill(labels, rectangle(lot.centre_ne_m, lot.length_m, lot.width_m, lot.azimuth_rad), Material.ASPHALT)
    for stall in parking_stalls_ne_m(lot):
        across = np.array([-np.sin(lot.azimuth_rad), np.cos(lot.azimuth_rad)])
        along = np.array([np.cos(lot.azimuth_rad), np.sin(lot.azimuth_rad)])
        edge = stall + 1.3 * across
        patch.stroke(labels, np.array([edge - 2.4 * along, edge + 2.4 * along]), 0.12, Material.PAINT)


def parking_stalls_ne_m(lot: ParkingLot) -> Float:
    """Centres (n, 2) of the stalls; cars stand along the lot's azimuth."""
    along = np.array([np.cos(lot.azimuth_rad), np.sin(lot.azimuth_rad)])
    across = np.array([-np.sin(lot.azimuth_rad), np.cos(lot.azimuth_rad)])
    rows = np.arange(-lot.length_m / 2 + 4.0, lot.length_m / 2 - 3.0, 9.5)
    places = np.arange(-lot.width_m / 2 + 3.0, lot.width_m / 2 - 2.0, 2.6)
    return np.asarray([lot.centre_ne_m + r * along + p * across for r in rows for p in places])


def _draw_pitch(labels: Labels, patch: Patch, pitch: ParkingLot) -> None:
    outer = rectangle(pitch.centre_ne_m, pitch.length_m + 7, pitch.width_m + 7, pitch.azimuth_rad)
    patch.fill(labels, outer, Material.TURF)
    for line in pitch_lines_ne_m(pitch):
        patch.stroke(labels, line, 0.2, Material.PAINT)


def pitch_lines_ne_m(pitch: ParkingLot) -> list[Float]:
    """The white lines of a sports ground; the first is the outer one, closed, starting at a corner."""
    a, L, W = pitch.azimuth_rad, pitch.length_m, pitch.width_m
    axis = np.array([np.cos(a), np.sin(a)])
    across = np.array([-np.sin(a), np.cos(a)])
    corners = rectangle(pitch.centre_ne_m, L, W, a)
    angle = np.linspace(0, 2 * np.pi, 40)[:, None]
    circle = pitch.centre_ne_m + 8.0 * (np.cos(angle) * axis + np.sin(angle) * across)
    halfway = pitch.centre_ne_m + np.outer([-W / 2, W / 2], across)
    boxes = []
    for side in (-1.0, 1.0):
        box = rectangle(pitch.centre_ne_m + side * (L / 2 - 7.0) * axis, 14.0, 34.0, a)
        boxes.append(np.vstack([box, box[:1]]))
    return [np.vstack([corners, corners[:1]]), circle, halfway, *boxes]
