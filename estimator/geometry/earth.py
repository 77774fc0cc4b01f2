"""WGS-84 ellipsoid, gravity and the standard atmosphere.

NIMA TR8350.2 (WGS-84); Vermeille, An analytical method to transform geocentric into geodetic coordinates, Journal of
Geodesy 85, 2011, is what outside answers use; here Bowring's iteration reaches 1e-9 m below 1000 km.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float = NDArray[np.float64]

WGS84_A_M = 6378137.0
WGS84_F = 1.0 / 298.257223563
WGS84_E2 = WGS84_F * (2.0 - WGS84_F)
EARTH_RATE_RAD_S = 7.292115e-5
ISA_SEA_LEVEL_PA = 101325.0
ISA_SEA_LEVEL_K = 288.15
ISA_LAPSE_K_M = 0.0065
ISA_EXPONENT = 9.80665 * 0.0289644 / (8.31446261815324 * ISA_LAPSE_K_M)


def meridian_radius_m(lat_rad: ArrayLike) -> Float:
    """Radius of curvature in the meridian, north-south."""
    s2 = np.sin(np.asarray(lat_rad, dtype=np.float64)) ** 2
    out: Float = WGS84_A_M * (1.0 - WGS84_E2) / (1.0 - WGS84_E2 * s2) ** 1.5
    return out


def transverse_radius_m(lat_rad: ArrayLike) -> Float:
    """Radius of curvature in the prime vertical, east-west."""
    s2 = np.sin(np.asarray(lat_rad, dtype=np.float64)) ** 2
    out: Float = WGS84_A_M / np.sqrt(1.0 - WGS84_E2 * s2)
    return out


def ecef_from_geodetic(lat_rad: ArrayLike, lon_rad: ArrayLike, alt_hae_m: ArrayLike) -> Float:
    """Earth-centred position (..., 3) in metres from latitude, longitude and ellipsoidal height."""
    lat, lon, alt = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (lat_rad, lon_rad, alt_hae_m)))
    normal = transverse_radius_m(lat)
    horizontal = (normal + alt) * np.cos(lat)
    up = (normal * (1.0 - WGS84_E2) + alt) * np.sin(lat)
    return np.stack((horizontal * np.cos(lon), horizontal * np.sin(lon), up), axis=-1)


def geodetic_from_ecef(pos_ecef_m: ArrayLike) -> tuple[Float, Float, Float]:
    """Latitude, longitude (radians) and ellipsoidal height (metres) of earth-centred positions (..., 3)."""
    pos = np.asarray(pos_ecef_m, dtype=np.float64)
    x, y, z = pos[..., 0], pos[..., 1], pos[..., 2]
    horizontal = np.hypot(x, y)
    semi_minor = WGS84_A_M * (1.0 - WGS84_F)
    second_e2 = WGS84_E2 / (1.0 - WGS84_E2)
    beta = np.arctan2(z * WGS84_A_M, horizontal * semi_minor)
    lat = beta
    for _ in range(4):
        lat = np.arctan2(
            z + second_e2 * semi_minor * np.sin(beta) ** 3, horizontal - WGS84_E2 * WGS84_A_M * np.cos(beta) ** 3
        )
        beta = np.arctan2((1.0 - WGS84_F) * np.sin(lat), np.cos(lat))
    normal = transverse_radius_m(lat)
    # this form of the height stays exact at the poles and at the equator
    alt = horizontal * np.cos(lat) + z * np.sin(lat) - WGS84_A_M**2 / normal
    return np.asarray(lat), np.arctan2(y, x), np.asarray(alt)


def ecef_from_ned_matrix(lat_rad: ArrayLike, lon_rad: ArrayLike) -> Float:
    """Rotation (..., 3, 3) from north-east-down at a place to earth-centred axes."""
    lat, lon = np.broadcast_arrays(np.asarray(lat_rad, dtype=np.float64), np.asarray(lon_rad, dtype=np.float64))
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    north = np.stack((-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat), axis=-1)
    east = np.stack((-sin_lon, cos_lon, np.zeros_like(lon)), axis=-1)
    down = np.stack((-cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat), axis=-1)
    return np.stack((north, east, down), axis=-1)


def gravity_m_s2(lat_rad: ArrayLike, alt_m: ArrayLike) -> Float:
    """Normal gravity: Somigliana's formula with the second-order free-air term (TR8350.2, equations 4-1 and 4-3)."""
    s2 = np.sin(np.asarray(lat_rad, dtype=np.float64)) ** 2
    alt = np.asarray(alt_m, dtype=np.float64)
    surface = 9.7803253359 * (1.0 + 0.00193185265241 * s2) / np.sqrt(1.0 - WGS84_E2 * s2)
    m = 0.00344978650684
    out: Float = surface * (
        1.0 - 2.0 / WGS84_A_M * (1.0 + WGS84_F + m - 2.0 * WGS84_F * s2) * alt + 3.0 / WGS84_A_M**2 * alt**2
    )
    return out


def isa_pressure_pa(alt_m: ArrayLike) -> Float:
    """Pressure of the standard atmosphere below 11 km."""
    ratio = 1.0 - ISA_LAPSE_K_M * np.asarray(alt_m, dtype=np.float64) / ISA_SEA_LEVEL_K
    out: Float = ISA_SEA_LEVEL_PA * ratio**ISA_EXPONENT
    return out


def isa_pressure_alt_m(pressure_pa: ArrayLike) -> Float:
    """Pressure altitude in the standard atmosphere below 11 km."""
    ratio = np.asarray(pressure_pa, dtype=np.float64) / ISA_SEA_LEVEL_PA
    out: Float = ISA_SEA_LEVEL_K / ISA_LAPSE_K_M * (1.0 - ratio ** (1.0 / ISA_EXPONENT))
    return out
