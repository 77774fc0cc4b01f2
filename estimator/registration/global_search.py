"""Search of a whole map for a mosaic of the ground, over all headings and a range of scales.

What is compared is the density of edges: the gradient's magnitude, saturated, at a metre or so, averaged over cells of
several metres and freed of its slow part. It keeps the fine structure that survives a change of season, has a peak of
a cell's width that forgives some degrees and per cent, and turns like any picture, so that a heading costs one
interpolation and two transforms. (Averaging gradients over cells is the idea of the histograms of Dalal and Triggs,
CVPR 2005, and of CFOG, Ye et al. 2019. ADR 0010 compares channels.)

A template is correlated with the whole map, one heading and scale (a slice) at a time, so that the work can be spread
over many pictures. Of each slice the highest places are kept, in units of the slice's clutter. The best of a hundred
million places owes much to chance, so the search proposes and does not judge: `near_match` and
`measurements.contenders` do, on other ground.
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray
from scipy import fft

from estimator.geometry.rotation import wrap_pi
from estimator.ports import ReferenceMap
from estimator.robust import robust_std
from estimator.types import Float, Image

Float32 = NDArray[np.float32]
Mask = NDArray[np.bool_]

MIN_KNOWN_FRACTION = 0.6
EXCLUDED_CELLS = 3
MIN_CELLS = 40.0


@dataclass(frozen=True, slots=True)
class SearchConfig:
    """Resolution of the search.

    Edges are found at ``fine_gsd_m`` and averaged over cells of ``cell_m``; ``max_cells`` bounds the map's longer side,
    whose cells are made larger beyond. ``trend_m`` is the wavelength above which edge density is taken for a trend of
    land use and exposure. ``slack_cells`` is how far a template's rim may be off half-way between two headings or
    scales; ``peaks_per_slice`` places of each are kept.
    """

    fine_gsd_m: float = 1.0
    cell_m: float = 6.0
    max_cells: int = 1400
    trend_m: float = 40.0
    slack_cells: float = 1.5
    peaks_per_slice: int = 8


def edge_magnitude(image: Image | Float32, known: Mask) -> Float32:
    """Saturated gradient magnitude m^2 / (m^2 + k) in [0, 1) of a grey picture, k five times its median where known."""
    smooth = cv2.GaussianBlur(np.asarray(image, dtype=np.float32), (0, 0), 1.0)
    gx, gy = cv2.Sobel(smooth, cv2.CV_32F, 1, 0, ksize=3), cv2.Sobel(smooth, cv2.CV_32F, 0, 1, ksize=3)
    squared = gx * gx + gy * gy
    inside = squared[known & (squared > 0.0)]
    k = 5.0 * float(np.median(inside)) if inside.size else 1.0
    return np.asarray(squared / (squared + max(k, 1e-3)), dtype=np.float32)


def edge_density(magnitude: Float32, known: Mask, cell_px: float, trend_px: float) -> Float32:
    """Edge magnitude averaged over cells and freed of its trend, still at one value a pixel; zero where not known."""
    weight = known.astype(np.float32)
    masked = magnitude * weight

    def mean(sigma: float) -> Float32:
        total = np.maximum(cv2.GaussianBlur(weight, (0, 0), sigma), 1e-3)
        return np.asarray(cv2.GaussianBlur(masked, (0, 0), sigma) / total, dtype=np.float32)

    return (mean(0.4 * cell_px) - mean(trend_px)) * weight


class EdgeMap:
    """The whole reference as edge densities on cells."""

    def __init__(self, reference: ReferenceMap, config: SearchConfig) -> None:
        south, west, north, east = reference.bounds_ne_m
        extent_m = max(north - south, east - west)
        self.fine_gsd_m = max(config.fine_gsd_m, reference.gsd_m)
        per_cell = max(round(max(config.cell_m, extent_m / config.max_cells) / self.fine_gsd_m), 1)
        self.cell_m = per_cell * self.fine_gsd_m
        window = reference.window(south, west, north, east)
        rows, cols = (int(side * window.gsd_m / self.cell_m) for side in window.image.shape)
        if min(rows, cols) < 8:
            message = f"the map holds only {rows} x {cols} cells of {self.cell_m:g} m: too small to search"
            raise ValueError(message)
        used = round(rows * self.cell_m / window.gsd_m), round(cols * self.cell_m / window.gsd_m)
        size = cols * per_cell, rows * per_cell
        image = np.asarray(
            cv2.resize(window.image[: used[0], : used[1]], size, interpolation=cv2.INTER_AREA), dtype=np.uint8
        )
        covered = window.valid[: used[0], : used[1]].astype(np.uint8)
        known = cv2.erode(cv2.resize(covered, size, interpolation=cv2.INTER_NEAREST), np.ones((5, 5), np.uint8)) > 0
        density = edge_density(edge_magnitude(image, known), known, float(per_cell), config.trend_m / self.fine_gsd_m)
        self.density: Float32 = np.asarray(cv2.resize(density, (cols, rows), interpolation=cv2.INTER_AREA))
        share = cv2.resize(known.astype(np.float32), (cols, rows), interpolation=cv2.INTER_AREA)
        self.valid: Mask = np.asarray(share > 0.7)
        self.north_max_m = window.north_max_m + 0.5 * window.gsd_m - 0.5 * self.cell_m
        self.east_min_m = window.east_min_m - 0.5 * window.gsd_m + 0.5 * self.cell_m

    @property
    def shape(self) -> tuple[int, int]:
        """Rows and columns."""
        rows, cols = self.valid.shape
        return rows, cols

    def holds(self, ne_m: complex) -> bool:
        """Whether a place, north + i east, lies on the map's cells."""
        row = (self.north_max_m - ne_m.real) / self.cell_m
        col = (ne_m.imag - self.east_min_m) / self.cell_m
        rows, cols = self.shape
        return -0.5 <= row < rows - 0.5 and -0.5 <= col < cols - 0.5

    def ne_m(self, row: float, col: float) -> Float:
        """North and east (2,) of a cell."""
        return np.array([self.north_max_m - row * self.cell_m, self.east_min_m + col * self.cell_m])


@dataclass(frozen=True, slots=True, eq=False)
class Slice:
    """One hypothesis: the heading that turns the mosaic's frame to north, and true over nominal scale."""

    heading_rad: float
    scale: float


@dataclass(frozen=True, slots=True, eq=False)
class Place:
    """One of the highest places: where the mosaic's centre lies (north, east), and its slice.

    ``height_sigmas`` is the similarity over its slice's clutter, in the clutter's standard deviations.
    """

    centre_ne_m: Float
    heading_rad: float
    scale: float
    height_sigmas: float


@dataclass(frozen=True, slots=True, eq=False)
class Template:
    """What is looked for: edge density (rows, cols) and mask on a lattice of ``gsd_m``, about ``centre_px``."""

    density: Float32
    known: Mask
    centre_px: Float
    gsd_m: float
    radius_m: float


def template_of(image: Float32, known: Mask, gsd_m: float, cell_m: float, config: SearchConfig) -> Template:
    """The template of a mosaic: grey (rows, cols) and where it is known, to be found on cells of ``cell_m``."""
    rows, cols = np.nonzero(known)
    centre = np.array([rows.mean(), cols.mean()])
    away = np.hypot(rows - centre[0], cols - centre[1])
    weight = known.astype(np.float32)
    near = cv2.GaussianBlur(image * weight, (0, 0), 4.0) / np.maximum(cv2.GaussianBlur(weight, (0, 0), 4.0), 1e-3)
    filled = np.asarray(np.where(known, image, near), dtype=np.float32)
    # gradients at the rim see what was filled in
    inner: Mask = np.asarray(cv2.erode(known.astype(np.uint8), np.ones((7, 7), np.uint8), borderValue=0) > 0)
    density = edge_density(edge_magnitude(filled, inner), inner, cell_m / gsd_m, config.trend_m / gsd_m)
    return Template(density, inner, centre, gsd_m, float(np.quantile(away, 0.9)) * gsd_m)


def slices(template: Template, cell_m: float, scales: tuple[float, float], config: SearchConfig) -> list[Slice]:
    """Headings all around and scales of a range, as finely as the template's size asks for; scales vary fastest."""
    step = 2.0 * config.slack_cells * cell_m / max(template.radius_m, 1.0)
    headings = int(np.ceil(2.0 * np.pi / min(step, 0.5)))
    low, high = scales
    count = int(np.ceil(np.log(high / low) / min(step, 0.25))) + 1
    ladder = np.geomspace(low, high, count) if count > 1 else np.array([np.sqrt(low * high)])
    around = np.arange(headings) * (2.0 * np.pi / headings)
    return [Slice(float(heading), float(scale)) for heading in around for scale in ladder]


class Sweep:
    """One search of the map, advanced slice by slice."""

    def __init__(self, coarse: EdgeMap, template: Template, todo: list[Slice], config: SearchConfig) -> None:
        self.config = config
        self.template = template
        self._map = coarse
        self._todo = todo
        self._next = 0
        largest = max(s.scale for s in todo)
        rows, cols = np.nonzero(template.known)
        away = np.hypot(rows - template.centre_px[0], cols - template.centre_px[1])
        self._half = int(np.ceil(float(away.max()) * template.gsd_m * largest / coarse.cell_m)) + 1
        padded = [side + 2 * self._half for side in coarse.shape]
        self._shape = (fft.next_fast_len(padded[0], real=True), fft.next_fast_len(padded[1], real=True))
        # entry (i, j) of a correlation has the template's corner there; turned on by half, its centre
        shift = self._half * np.fft.fftfreq(self._shape[0])[:, None] + self._half * np.fft.rfftfreq(self._shape[1])
        spectrum = fft.rfft2(coarse.density, self._shape) * np.exp(-2j * np.pi * shift)
        self._spectrum = spectrum.astype(np.complex64)
        self._energy, self._known = self._surroundings(coarse, template)
        self._weight = np.where(self._known, 1.0 / np.sqrt(self._energy), 0.0).astype(np.float32)
        self._found: list[Place] = []

    @staticmethod
    def _surroundings(coarse: EdgeMap, template: Template) -> tuple[Float32, Mask]:
        """Mean energy of the map about each cell, and where enough of it is known, over a disc as wide as the template.

        The template's own outline would cost two more transforms a slice, and change little.
        """
        sigma = max(0.6 * template.radius_m / coarse.cell_m, 1.0)
        weight = coarse.valid.astype(np.float32)
        share = cv2.GaussianBlur(weight, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
        energy = cv2.GaussianBlur(coarse.density**2 * weight, (0, 0), sigma, borderType=cv2.BORDER_CONSTANT)
        energy = energy / np.maximum(share, 1e-3)
        floor = 0.15 * float(np.median(energy[coarse.valid])) if coarse.valid.any() else 1.0
        return np.asarray(np.maximum(energy, floor), dtype=np.float32), np.asarray(share >= MIN_KNOWN_FRACTION)

    @property
    def done(self) -> bool:
        """Whether everything has been looked at."""
        return self._next >= len(self._todo)

    @property
    def progress(self) -> float:
        """Share of the slices that have been looked at."""
        return self._next / len(self._todo)

    @property
    def cells(self) -> int:
        """Size of one transform, the unit of work of one slice."""
        return self._shape[0] * self._shape[1]

    def step(self) -> None:
        """Look at one more slice."""
        what = self._todo[self._next]
        self._next += 1
        surface = self.surface(what)
        if surface is None:
            return
        # the same lattice of samples from every slice would see the map's own lines only
        sampled = surface[self._next % 7 :: 7, self._next % 5 :: 5].ravel()
        sampled = sampled[sampled > -0.999]
        if sampled.size < 50:
            return
        # in the clutter's own deviations: a smaller scale, which covers less, has more of it
        middle = float(np.median(sampled))
        clutter = max(robust_std(sampled), 1e-4)
        for value, row, col in _highest(surface, self.config.peaks_per_slice):
            centre = self._map.ne_m(row, col)
            self._found.append(Place(centre, wrap_pi(what.heading_rad), what.scale, (value - middle) / clutter))

    def surface(self, what: Slice) -> Float32 | None:
        """Similarity (rows, cols) with the mosaic's centre at each cell of the map, -1 where too little is known."""
        turned = turned_template(self.template, what, self._map.cell_m, self._half)
        if turned is None:
            return None
        density, pixels = turned.density, turned.cells
        # the rows below the template are empty: their transforms need not be made
        by_row = fft.rfft(density, self._shape[1], axis=1)
        spectrum = fft.fft(by_row, self._shape[0], axis=0, overwrite_x=True)
        np.conjugate(spectrum, out=spectrum)
        spectrum *= self._spectrum
        rows, cols = self._map.shape
        columns = fft.ifft(spectrum, axis=0, overwrite_x=True)[:rows]
        surface = fft.irfft(columns, self._shape[1], axis=1)[:, :cols]
        own = max(float((density * density).sum()), 1e-6 * pixels)
        surface *= self._weight
        surface /= np.float32(np.sqrt(pixels * own))
        surface[~self._known] = -1.0
        return np.asarray(surface, dtype=np.float32)

    def places(self, count: int) -> list[Place]:
        """The ``count`` highest places, the highest first, one for each peak that neighbouring slices share."""
        kept: list[Place] = []
        centres = np.empty((count, 2))
        slack_m = 2.0 * self.config.slack_cells * self._map.cell_m
        slack = slack_m / max(self.template.radius_m, 1.0)
        for place in sorted(self._found, key=lambda place: -place.height_sigmas):
            near = np.flatnonzero(np.hypot(*(centres[: len(kept)] - place.centre_ne_m).T) < 2.0 * slack_m)
            if any(_alike(kept[i], place, 1.5 * slack) for i in near):
                continue
            centres[len(kept)] = place.centre_ne_m
            kept.append(place)
            if len(kept) == count:
                break
        return kept


def _alike(first: Place, second: Place, slack: float) -> bool:
    turned = abs(wrap_pi(first.heading_rad - second.heading_rad))
    return turned < slack and abs(float(np.log(first.scale / second.scale))) < slack


@dataclass(frozen=True, slots=True, eq=False)
class Turned:
    """A template on the map's cells, about the middle one: density of mean zero and mask (n, n), and its cells."""

    density: Float32
    mask: Float32
    cells: float


def turned_template(template: Template, what: Slice, cell_m: float, half: int) -> Turned | None:
    """A template turned and scaled onto the map's cells, n = 2 half + 1 a side; None where it would be too small."""
    cos, sin = np.cos(what.heading_rad), np.sin(what.heading_rad)
    ratio = cell_m / (template.gsd_m * what.scale)
    # a place (north, east) of the map's lattice is Rot(-heading) of it in the mosaic; rows run against north
    turn = ratio * np.array([[cos, sin], [-sin, cos]])
    row_by, col_by = (turn[0, 0], -turn[0, 1]), (-turn[1, 0], turn[1, 1])
    matrix = np.array(
        [
            [col_by[1], col_by[0], template.centre_px[1] - half * (col_by[0] + col_by[1])],
            [row_by[1], row_by[0], template.centre_px[0] - half * (row_by[0] + row_by[1])],
        ]
    )
    side = (2 * half + 1, 2 * half + 1)
    flags = cv2.INTER_LINEAR | cv2.WARP_INVERSE_MAP
    density = cv2.warpAffine(template.density, matrix, side, flags=flags)
    mask = cv2.warpAffine(template.known.astype(np.float32), matrix, side, flags=flags)
    pixels = float(mask.sum())
    if pixels < MIN_CELLS:
        return None
    centred = np.asarray(density - mask * (float(density.sum()) / pixels), dtype=np.float32)
    return Turned(centred, np.asarray(mask, dtype=np.float32), pixels)


def _highest(surface: Float32, count: int) -> list[tuple[float, int, int]]:
    """The highest local maxima of a surface: value, row, column."""
    size = 2 * EXCLUDED_CELLS + 1
    ridge = cv2.dilate(surface, np.ones((size, size), np.uint8))
    top = (surface >= ridge) & (surface > 0.0)
    rows, cols = np.nonzero(top)
    values = surface[rows, cols]
    order = np.argsort(-values)[:count]
    return [(float(values[i]), int(rows[i]), int(cols[i])) for i in order]
