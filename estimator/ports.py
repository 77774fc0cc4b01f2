"""What the navigator asks of the world outside the estimator, as protocols."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from estimator.types import Float, Image


class MapWindow(Protocol):
    """A piece of reference imagery on a north-up grid of the local frame.

    The centre of pixel (row r, column c) lies at north = ``north_max_m`` - r ``gsd_m``, east = ``east_min_m`` +
    c ``gsd_m``. ``image`` is grey (rows, cols) uint8; ``valid`` marks the pixels that hold imagery.
    """

    @property
    def image(self) -> Image:
        """Grey picture (rows, cols)."""

    @property
    def valid(self) -> NDArray[np.bool_]:
        """Which pixels hold imagery (rows, cols)."""

    @property
    def north_max_m(self) -> float:
        """North of the first row's centres."""

    @property
    def east_min_m(self) -> float:
        """East of the first column's centres."""

    @property
    def gsd_m(self) -> float:
        """Ground sample distance, metres per pixel."""


class ReferenceMap(Protocol):
    """Reference imagery in the local frame."""

    @property
    def gsd_m(self) -> float:
        """Ground sample distance, metres per pixel."""

    @property
    def bounds_ne_m(self) -> tuple[float, float, float, float]:
        """The rectangle that holds all imagery: least north, least east, greatest north, greatest east."""

    def window(self, north_min_m: float, east_min_m: float, north_max_m: float, east_max_m: float) -> MapWindow:
        """The imagery of a rectangle; what lies off the map is invalid."""


class GroundModel(Protocol):
    """Height of the ground."""

    def alt_amsl_m(self, north_m: Float, east_m: Float) -> Float:
        """Ground altitude at points of the local frame, NaN where it is unknown."""


@dataclass(frozen=True, slots=True, eq=False)
class Correlation:
    """A similarity surface over displacements.

    ``surface`` (rows, cols) holds the similarity in [-1, 1], NaN where too little of the map is known; entry (i, j) is
    for a displacement north of ``north_max_m`` - i ``step_m`` and east of ``east_min_m`` + j ``step_m``.
    ``pixels`` is the number of template pixels that took part.
    """

    surface: NDArray[np.float32]
    north_max_m: float
    east_min_m: float
    step_m: float
    pixels: int
