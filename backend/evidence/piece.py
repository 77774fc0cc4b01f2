"""The piece of the map, and of the ground, that registering a picture looked at: what a repetition needs of them.

Each is a cut-out of the station's grid on that grid's own lattice, so that the same arithmetic on it gives the same to
the last bit.
"""

from __future__ import annotations

import hashlib
import math
from collections.abc import Mapping
from dataclasses import dataclass

import cv2
import numpy as np

from backend.errors import BundleError
from backend.evidence.ground import GroundStrip
from backend.evidence.schema import FilePart, GridPart, PieceName
from estimator.ports import GroundModel, MapWindow, ReferenceMap
from estimator.types import Float
from geodata.elevation import ElevationGrid, FlatGround
from geodata.imagery import ImageryGrid

MOST_MAP_PIXELS, MOST_GROUND_CELLS = 6_000_000, 1_000_000
MAP_FILE: PieceName = "map.png"
VALID_FILE: PieceName = "map_valid.png"
GROUND_FILE: PieceName = "ground.f64"


class _Asked:
    """The rectangle that holds all places asked for: north and east, least and greatest."""

    def __init__(self) -> None:
        self.low_ne_m, self.high_ne_m = np.full(2, np.inf), np.full(2, -np.inf)

    def add(self, low_ne_m: Float, high_ne_m: Float) -> None:
        self.low_ne_m = np.fmin(self.low_ne_m, low_ne_m)
        self.high_ne_m = np.fmax(self.high_ne_m, high_ne_m)


class WatchedMap:
    """A reference map that remembers what of it was looked at."""

    def __init__(self, reference: ReferenceMap) -> None:
        self.reference = reference
        self.asked = _Asked()

    @property
    def gsd_m(self) -> float:
        """The map's own."""
        return self.reference.gsd_m

    @property
    def bounds_ne_m(self) -> tuple[float, float, float, float]:
        """The map's own."""
        return self.reference.bounds_ne_m

    def window(self, north_min_m: float, east_min_m: float, north_max_m: float, east_max_m: float) -> MapWindow:
        """As the map says."""
        self.asked.add(np.array([north_min_m, east_min_m]), np.array([north_max_m, east_max_m]))
        return self.reference.window(north_min_m, east_min_m, north_max_m, east_max_m)


class BoundedGround:
    """A ground model that remembers the rectangle in which it was asked."""

    def __init__(self, ground: GroundModel) -> None:
        self.ground = ground
        self.asked = _Asked()

    def alt_amsl_m(self, north_m: Float, east_m: Float) -> Float:
        """As the model says."""
        north, east = np.broadcast_arrays(np.asarray(north_m, dtype=np.float64), np.asarray(east_m, dtype=np.float64))
        known = np.isfinite(north) & np.isfinite(east)
        if known.any():
            ne_m = np.stack((north[known], east[known]), axis=-1)
            self.asked.add(ne_m.min(axis=0), ne_m.max(axis=0))
        return self.ground.alt_amsl_m(north_m, east_m)


@dataclass(frozen=True, slots=True, eq=False)
class Piece:
    """A cut-out: lattice, and files (name to bytes) with its cells; ``part.problem`` says why there are none."""

    part: GridPart
    files: Mapping[PieceName, bytes]


def map_piece(watched: WatchedMap) -> Piece:
    """What was looked at of a map.

    Raises
    ------
    TypeError
        There is no way to keep a piece of such a map.
    """
    grid = watched.reference
    if not isinstance(grid, ImageryGrid):
        raise TypeError(f"no evidence can be kept of a map of type {type(grid).__name__}")
    top, left, bottom, right = _span(watched.asked, grid.north_max_m, grid.east_min_m, grid.gsd_m, grid.image.shape)
    image, valid = grid.image[top:bottom, left:right], grid.valid[top:bottom, left:right]
    files: dict[PieceName, bytes] = {}
    problem = _too_large(image.size, MOST_MAP_PIXELS, "pixels of the map")
    if problem is None and image.size:
        files[MAP_FILE] = _png(image)
        if not valid.all():
            files[VALID_FILE] = _png(valid.astype(np.uint8) * 255)
    return _piece(grid.north_max_m, grid.east_min_m, grid.gsd_m, grid.image.shape, (top, left), image.shape, files,
                  problem)  # fmt: skip


def ground_piece(watched: BoundedGround) -> Piece | None:
    """What was looked at of an elevation grid; None of ground at one altitude. TypeError as for `map_piece`."""
    match watched.ground:
        case FlatGround():
            return None
        case ElevationGrid() as grid:
            pass
        case other:
            raise TypeError(f"no evidence can be kept of a ground model of type {type(other).__name__}")
    shape = grid.alt_amsl_grid_m.shape
    top, left, bottom, right = _span(watched.asked, grid.north_max_m, grid.east_min_m, grid.gsd_m, shape)
    cells = grid.alt_amsl_grid_m[top:bottom, left:right]
    problem = _too_large(cells.size, MOST_GROUND_CELLS, "cells of the elevation")
    files: dict[PieceName, bytes] = (
        {} if problem is not None or not cells.size else {GROUND_FILE: cells.astype("<f8").tobytes()}
    )
    return _piece(grid.north_max_m, grid.east_min_m, grid.gsd_m, shape, (top, left), cells.shape, files, problem)


def map_of(part: GridPart, files: Mapping[PieceName, bytes], name: str) -> ImageryGrid | None:
    """The map that a piece holds, invalid beside it; None where the piece was not kept.

    Raises
    ------
    BundleError
        The files are not what the part says. ``name`` says in it which bundle.
    """
    if MAP_FILE not in files:
        return None
    shape = part.piece_rows, part.piece_cols
    cells = _grey(files[MAP_FILE], shape, MAP_FILE, name)
    known = np.full(shape, 255, np.uint8) if VALID_FILE not in files else _grey(files[VALID_FILE], shape, VALID_FILE,
                                                                               name)  # fmt: skip
    # Untouched zeros take no memory: only the piece is ever written.
    image, valid = np.zeros((part.rows, part.cols), np.uint8), np.zeros((part.rows, part.cols), np.bool_)
    where = slice(part.first_row, part.first_row + shape[0]), slice(part.first_col, part.first_col + shape[1])
    image[where], valid[where] = cells, known > 0
    return ImageryGrid(image, valid, part.north_max_m, part.east_min_m, part.gsd_m)


def ground_of(part: GridPart, files: Mapping[PieceName, bytes], name: str) -> GroundStrip | None:
    """The ground that a piece holds, unknown beside it; None where it was not kept. BundleError as for `map_of`."""
    data = files.get(GROUND_FILE)
    if data is None:
        return None
    rows, cols = part.piece_rows, part.piece_cols
    if len(data) != 8 * rows * cols:
        raise BundleError(name, f"{GROUND_FILE} has {len(data)} bytes, not 8 for each of {rows} x {cols} cells")
    cells = np.frombuffer(data, "<f8").reshape(rows, cols).astype(np.float64)
    if np.isinf(cells).any():
        raise BundleError(name, f"{GROUND_FILE} holds an infinite height")
    firsts = np.full(rows, part.first_col, dtype=np.intp)
    return GroundStrip(cells, part.first_row, firsts, part.north_max_m, part.east_min_m, part.gsd_m)


def same_map(part: GridPart, piece: ImageryGrid, whole: ReferenceMap) -> str | None:
    """How a piece differs from the map it should be of, in words; None where it does not."""
    if not isinstance(whole, ImageryGrid):
        return f"the map is a {type(whole).__name__}"
    if piece.image.shape != whole.image.shape or not np.allclose(
        (piece.north_max_m, piece.east_min_m, piece.gsd_m), (whole.north_max_m, whole.east_min_m, whole.gsd_m),
        rtol=1e-9, atol=1e-6,
    ):  # fmt: skip
        return "its lattice is another"
    where = (
        slice(part.first_row, part.first_row + part.piece_rows),
        slice(part.first_col, part.first_col + part.piece_cols),
    )
    differ = int(np.count_nonzero(
        (piece.image[where] != whole.image[where]) | (piece.valid[where] != whole.valid[where])
    ))  # fmt: skip
    return None if differ == 0 else f"{differ} of its {part.piece_rows * part.piece_cols} pixels differ"


def _span(
    asked: _Asked, north_max_m: float, east_min_m: float, gsd_m: float, shape: tuple[int, ...]
) -> tuple[int, int, int, int]:
    """Rows and columns, first and past the last, of what was asked for and the neighbours that it is read between."""
    rows, cols = shape
    if not np.all(asked.low_ne_m <= asked.high_ne_m):
        return 0, 0, 0, 0
    top = math.floor((north_max_m - float(asked.high_ne_m[0])) / gsd_m) - 1
    bottom = math.ceil((north_max_m - float(asked.low_ne_m[0])) / gsd_m) + 3
    left = math.floor((float(asked.low_ne_m[1]) - east_min_m) / gsd_m) - 1
    right = math.ceil((float(asked.high_ne_m[1]) - east_min_m) / gsd_m) + 3
    top, bottom = (min(max(row, 0), rows) for row in (top, bottom))
    left, right = (min(max(col, 0), cols) for col in (left, right))
    return top, left, bottom, right


def _piece(
    north_max_m: float, east_min_m: float, gsd_m: float, shape: tuple[int, ...], first: tuple[int, int],
    size: tuple[int, ...], files: Mapping[PieceName, bytes], problem: str | None,
) -> Piece:  # fmt: skip
    parts = [FilePart(file=file, sha256=hashlib.sha256(data).hexdigest()) for file, data in files.items()]
    return Piece(
        GridPart(
            north_max_m=north_max_m, east_min_m=east_min_m, gsd_m=gsd_m, rows=shape[0], cols=shape[1],
            first_row=first[0], first_col=first[1], piece_rows=size[0], piece_cols=size[1], files=parts,
            problem=problem if files or problem is not None else "nothing of it was looked at",
        ),
        files,
    )  # fmt: skip


def _too_large(size: int, most: int, what: str) -> str | None:
    return None if size <= most else f"{size} {what} were looked at, and a bundle keeps {most} at most"


def _png(image: np.ndarray) -> bytes:
    done, data = cv2.imencode(".png", image)
    if not done:
        message = "a piece of the map could not be encoded"
        raise ValueError(message)
    return data.tobytes()


def _grey(data: bytes, shape: tuple[int, int], file: str, name: str) -> np.ndarray:
    # The size is in the header: a small file must not unpack to gigabytes.
    stated = int.from_bytes(data[20:24], "big"), int.from_bytes(data[16:20], "big")
    if data[:8] != b"\x89PNG\r\n\x1a\n" or stated != shape:
        raise BundleError(name, f"{file} is no PNG of {shape[0]} x {shape[1]} pixels")
    image = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_UNCHANGED)
    if image is None or image.shape != shape or image.dtype != np.uint8:
        raise BundleError(name, f"{file} is no grey PNG of {shape[0]} x {shape[1]} pixels")
    return np.asarray(image, dtype=np.uint8)
