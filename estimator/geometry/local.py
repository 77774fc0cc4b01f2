"""A north-east-down frame tied to a place on the Earth."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from estimator.geometry.earth import (
    WGS84_A_M,
    Float,
    ecef_from_geodetic,
    ecef_from_ned_matrix,
    geodetic_from_ecef,
)

_SAME_HEIGHT_M: Final = 1e-6
_HEIGHT_STEPS: Final = 30


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """The tangent frame at an origin: x north, y east, z down, metres. Exact, by way of ECEF.

    ``alt_m`` is on whatever vertical datum the caller uses throughout (above mean sea level in the station) and is
    taken as ellipsoidal here. The geoid's height, at most 107 m, then changes horizontal distances by less than 2e-5.

    The frame is a plane: 10 km from the origin the surface of equal height lies 8 m below it. Heights of far points
    come from ``geodetic_from_ned``, not from the origin's height minus down.
    """

    lat_rad: float
    lon_rad: float
    alt_m: float
    _origin_ecef_m: Float = field(init=False, repr=False, compare=False)
    _ecef_from_ned: Float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        if not (math.isfinite(self.lat_rad) and math.isfinite(self.lon_rad) and math.isfinite(self.alt_m)):
            message = f"a local frame's origin must be finite, not {self.lat_rad}, {self.lon_rad}, {self.alt_m}"
            raise ValueError(message)
        if abs(self.lat_rad) > math.pi / 2:
            message = f"a local frame's latitude is at most pi/2 rad, not {self.lat_rad} (were degrees given?)"
            raise ValueError(message)
        object.__setattr__(self, "_origin_ecef_m", ecef_from_geodetic(self.lat_rad, self.lon_rad, self.alt_m))
        object.__setattr__(self, "_ecef_from_ned", ecef_from_ned_matrix(self.lat_rad, self.lon_rad))

    def ned_from_geodetic(self, lat_rad: ArrayLike, lon_rad: ArrayLike, alt_m: ArrayLike) -> Float:
        """Position (..., 3) in this frame of geodetic coordinates (...)."""
        offset = ecef_from_geodetic(lat_rad, lon_rad, alt_m) - self._origin_ecef_m
        # Row vectors: v @ M is M.T @ v, and ned_from_ecef is the transpose.
        ned: Float = offset @ self._ecef_from_ned
        return ned

    def geodetic_from_ned(self, pos_ned_m: ArrayLike) -> tuple[Float, Float, Float]:
        """Latitude, longitude and altitude (...) of positions (..., 3) in this frame."""
        ned = np.asarray(pos_ned_m, dtype=np.float64)
        return geodetic_from_ecef(ned @ self._ecef_from_ned.T + self._origin_ecef_m)

    def ne_from_geodetic(self, lat_rad: ArrayLike, lon_rad: ArrayLike) -> Float:
        """North and east (..., 2) of a place (...) at the origin's altitude."""
        return self.ned_from_geodetic(lat_rad, lon_rad, self.alt_m)[..., :2]

    def geodetic_from_ne(self, pos_ne_m: ArrayLike) -> tuple[Float, Float]:
        """Latitude and longitude (...) of the place at the origin's altitude with this north and east (..., 2).

        The inverse of ``ne_from_geodetic`` within 3000 km of the origin.
        """
        ne = np.asarray(pos_ne_m, dtype=np.float64)
        # The surface of equal altitude falls away from the plane by about d^2 / 2R; then by what is still too high.
        down = np.sum(ne * ne, axis=-1) / (2.0 * WGS84_A_M)
        for _ in range(_HEIGHT_STEPS):
            lat_rad, lon_rad, alt_m = self.geodetic_from_ned(np.concatenate((ne, down[..., np.newaxis]), axis=-1))
            excess_m = alt_m - self.alt_m
            # What is left of the excess moves the place by it times the slope d / R, one tenth at 600 km.
            if not np.any(np.abs(excess_m) * np.abs(ne).max(axis=-1) > _SAME_HEIGHT_M * WGS84_A_M):
                break
            down = down + excess_m
        return lat_rad, lon_rad
