"""A local north-east-down frame tied to a place on the ellipsoid."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike

from estimator.geometry.earth import Float, ecef_from_geodetic, ecef_from_ned_matrix, geodetic_from_ecef


@dataclass(frozen=True, slots=True)
class LocalFrame:
    """Tangent frame with its origin at a latitude, longitude (radians) and height (metres).

    The height is in whatever vertical datum the caller uses, mean sea level in the station; it is taken as ellipsoidal
    inside, which scales horizontal distances by the geoid's height over the Earth's radius: less than 2e-5.
    """

    lat_rad: float
    lon_rad: float
    alt_m: float
    _origin_ecef_m: Float = field(init=False, repr=False, compare=False)
    _ecef_from_ned: Float = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "_origin_ecef_m", ecef_from_geodetic(self.lat_rad, self.lon_rad, self.alt_m))
        object.__setattr__(self, "_ecef_from_ned", ecef_from_ned_matrix(self.lat_rad, self.lon_rad))

    def ned_from_geodetic(self, lat_rad: ArrayLike, lon_rad: ArrayLike, alt_m: ArrayLike) -> Float:
        """Position (..., 3) in metres of geodetic coordinates."""
        out: Float = (ecef_from_geodetic(lat_rad, lon_rad, alt_m) - self._origin_ecef_m) @ self._ecef_from_ned
        return out

    def geodetic_from_ned(self, pos_ned_m: ArrayLike) -> tuple[Float, Float, Float]:
        """Latitude, longitude (radians) and height of positions (..., 3)."""
        pos = np.asarray(pos_ned_m, dtype=np.float64)
        return geodetic_from_ecef(pos @ self._ecef_from_ned.T + self._origin_ecef_m)

    def ne_from_geodetic(self, lat_rad: ArrayLike, lon_rad: ArrayLike) -> Float:
        """North and east (..., 2) of places at the origin's height."""
        return self.ned_from_geodetic(lat_rad, lon_rad, self.alt_m)[..., :2]

    def geodetic_from_ne(self, pos_ne_m: ArrayLike) -> tuple[Float, Float]:
        """Latitude and longitude (radians) of points (..., 2) at the origin's height."""
        pos = np.asarray(pos_ne_m, dtype=np.float64)
        # a point of equal height lies below the tangent plane by the square of its distance over twice the radius
        down = (pos**2).sum(axis=-1) / (2.0 * np.linalg.norm(self._origin_ecef_m))
        lat, lon, _ = self.geodetic_from_ned(np.concatenate((pos, down[..., None]), axis=-1))
        return lat, lon
