"""The Earth as an ellipsoid: WGS-84, normal gravity, and the standard atmosphere.

Angles in radians, coordinates on the last axis, NaN in gives NaN out. Where a function takes several arrays they
broadcast.
"""

from __future__ import annotations

import math
from typing import Final, overload

import numpy as np
from numpy.typing import ArrayLike, NDArray

Float = NDArray[np.float64]

WGS84_A_M: Final = 6378137.0
"""Equatorial radius (NIMA TR8350.2)."""
WGS84_F: Final = 1.0 / 298.257223563
"""Flattening (NIMA TR8350.2)."""
WGS84_E2: Final = WGS84_F * (2.0 - WGS84_F)
"""First eccentricity squared."""
EARTH_RATE_RAD_S: Final = 7.292115e-5
"""Rotation rate of the Earth (NIMA TR8350.2)."""

_B_M: Final = WGS84_A_M * (1.0 - WGS84_F)
_EP2: Final = WGS84_E2 / (1.0 - WGS84_E2)
_BOWRING_STEPS: Final = 4

_GM_M3_S2: Final = 3.986004418e14
_GRAVITY_EQUATOR_M_S2: Final = 9.7803253359
_SOMIGLIANA_K: Final = 0.00193185265241
# omega^2 a^2 b / GM, the ratio of centrifugal to gravitational acceleration at the equator.
_CENTRIFUGAL_RATIO: Final = EARTH_RATE_RAD_S**2 * WGS84_A_M**2 * _B_M / _GM_M3_S2

# ISO 2533 and US Standard Atmosphere 1976, the two lowest layers.
_ISA_P0_PA: Final = 101325.0
_ISA_T0_K: Final = 288.15
_ISA_LAPSE_K_M: Final = 0.0065
_ISA_GAS_J_KG_K: Final = 287.05287
_ISA_G0_M_S2: Final = 9.80665
_ISA_TROPOPAUSE_M: Final = 11000.0
_ISA_T11_K: Final = _ISA_T0_K - _ISA_LAPSE_K_M * _ISA_TROPOPAUSE_M
_ISA_EXPONENT: Final = _ISA_G0_M_S2 / (_ISA_GAS_J_KG_K * _ISA_LAPSE_K_M)
_ISA_P11_PA: Final = _ISA_P0_PA * (_ISA_T11_K / _ISA_T0_K) ** _ISA_EXPONENT
_ISA_SCALE_HEIGHT_M: Final = _ISA_GAS_J_KG_K * _ISA_T11_K / _ISA_G0_M_S2
_ISA_LOWEST_M: Final = -5000.0
_ISA_HIGHEST_M: Final = 20000.0


def ecef_from_geodetic(lat_rad: ArrayLike, lon_rad: ArrayLike, alt_hae_m: ArrayLike) -> Float:
    """Earth-centred, Earth-fixed position (..., 3) in metres of geodetic coordinates (...)."""
    lat, lon, alt = np.broadcast_arrays(*(np.asarray(x, dtype=np.float64) for x in (lat_rad, lon_rad, alt_hae_m)))
    sin_lat = np.sin(lat)
    radius = WGS84_A_M / np.sqrt(1.0 - WGS84_E2 * sin_lat * sin_lat)
    across = (radius + alt) * np.cos(lat)
    along = (radius * (1.0 - WGS84_E2) + alt) * sin_lat
    return np.stack((across * np.cos(lon), across * np.sin(lon), along), axis=-1)


def geodetic_from_ecef(pos_ecef_m: ArrayLike) -> tuple[Float, Float, Float]:
    """Latitude, longitude and ellipsoidal height (...) of positions (..., 3).

    Bowring's iteration on the parametric latitude (Survey Review 23, 1976), exact to rounding wherever aircraft and
    satellites go. At the poles longitude is 0.
    """
    pos = np.asarray(pos_ecef_m, dtype=np.float64)
    x, y, z = pos[..., 0], pos[..., 1], pos[..., 2]
    across = np.hypot(x, y)
    # Latitudes as (cosine, sine) pairs: the poles need no special case, and no trigonometry is called for.
    cos_beta, sin_beta = _unit(across * (1.0 - WGS84_F), z)
    cos_lat, sin_lat = cos_beta, sin_beta
    for _ in range(_BOWRING_STEPS):
        cos_lat, sin_lat = _unit(across - WGS84_E2 * WGS84_A_M * cos_beta**3, z + _EP2 * _B_M * sin_beta**3)
        cos_beta, sin_beta = _unit(cos_lat, (1.0 - WGS84_F) * sin_lat)
    # Along the normal, so exact at the equator and the poles too; a^2 / N is a sqrt(1 - e^2 sin^2).
    alt = across * cos_lat + z * sin_lat - WGS84_A_M * np.sqrt(1.0 - WGS84_E2 * sin_lat * sin_lat)
    return np.arctan2(sin_lat, cos_lat), np.arctan2(y, x), np.asarray(alt)


def _unit(x: Float, y: Float) -> tuple[Float, Float]:
    """The pairs (x, y) scaled to unit length."""
    length = np.hypot(x, y)
    length = np.where(length == 0.0, 1.0, length)
    return x / length, y / length


def ecef_from_ned_matrix(lat_rad: ArrayLike, lon_rad: ArrayLike) -> Float:
    """Rotation (..., 3, 3) that takes north-east-down vectors at a place (...) to ECEF."""
    lat, lon = np.broadcast_arrays(np.asarray(lat_rad, dtype=np.float64), np.asarray(lon_rad, dtype=np.float64))
    sin_lat, cos_lat, sin_lon, cos_lon = np.sin(lat), np.cos(lat), np.sin(lon), np.cos(lon)
    north = np.stack((-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat), axis=-1)
    east = np.stack((-sin_lon, cos_lon, np.zeros_like(lon)), axis=-1)
    down = np.stack((-cos_lat * cos_lon, -cos_lat * sin_lon, -sin_lat), axis=-1)
    return np.stack((north, east, down), axis=-1)


@overload
def meridian_radius_m(lat_rad: float) -> float: ...
@overload
def meridian_radius_m(lat_rad: Float) -> Float: ...
def meridian_radius_m(lat_rad: float | Float) -> float | Float:
    """Radius of curvature in the north-south direction."""
    w2 = 1.0 - WGS84_E2 * _sin2(lat_rad)
    return WGS84_A_M * (1.0 - WGS84_E2) / w2**1.5


@overload
def transverse_radius_m(lat_rad: float) -> float: ...
@overload
def transverse_radius_m(lat_rad: Float) -> Float: ...
def transverse_radius_m(lat_rad: float | Float) -> float | Float:
    """Radius of curvature in the east-west direction, across the meridian."""
    return WGS84_A_M / (1.0 - WGS84_E2 * _sin2(lat_rad)) ** 0.5


@overload
def gravity_m_s2(lat_rad: float, alt_m: float) -> float: ...
@overload
def gravity_m_s2(lat_rad: float | Float, alt_m: Float) -> Float: ...
@overload
def gravity_m_s2(lat_rad: Float, alt_m: float | Float) -> Float: ...
def gravity_m_s2(lat_rad: float | Float, alt_m: float | Float) -> float | Float:
    """Magnitude of normal gravity: Somigliana's formula, second order in height (NIMA TR8350.2, eq. 4-1 and 4-3)."""
    sin2 = _sin2(lat_rad)
    surface = _GRAVITY_EQUATOR_M_S2 * (1.0 + _SOMIGLIANA_K * sin2) / (1.0 - WGS84_E2 * sin2) ** 0.5
    first_order = 1.0 + WGS84_F + _CENTRIFUGAL_RATIO - 2.0 * WGS84_F * sin2
    ratio = alt_m / WGS84_A_M
    return surface * (1.0 - 2.0 * first_order * ratio + 3.0 * ratio * ratio)


def _sin2(angle_rad: float | Float) -> float | Float:
    """Sine squared; plain floats stay plain, and infinity gives NaN as it does in arrays."""
    if isinstance(angle_rad, float):
        return math.sin(angle_rad) ** 2 if math.isfinite(angle_rad) else math.nan
    sine: float | Float = np.sin(angle_rad)
    return sine * sine


@overload
def isa_pressure_pa(alt_m: float) -> float: ...
@overload
def isa_pressure_pa(alt_m: Float) -> Float: ...
def isa_pressure_pa(alt_m: float | Float) -> float | Float:
    """Pressure of the standard atmosphere (ISO 2533) at a pressure altitude from -5 to 20 km; NaN outside."""
    alt = np.asarray(alt_m, dtype=np.float64)
    alt = np.where((alt >= _ISA_LOWEST_M) & (alt <= _ISA_HIGHEST_M), alt, np.nan)
    troposphere = (1.0 - np.minimum(alt, _ISA_TROPOPAUSE_M) * (_ISA_LAPSE_K_M / _ISA_T0_K)) ** _ISA_EXPONENT
    above = np.exp(-np.maximum(alt - _ISA_TROPOPAUSE_M, 0.0) / _ISA_SCALE_HEIGHT_M)
    pressure: Float = _ISA_P0_PA * troposphere * above
    return float(pressure) if isinstance(alt_m, float) else pressure


@overload
def isa_pressure_alt_m(pressure_pa: float) -> float: ...
@overload
def isa_pressure_alt_m(pressure_pa: Float) -> Float: ...
def isa_pressure_alt_m(pressure_pa: float | Float) -> float | Float:
    """Pressure altitude: where the standard atmosphere (ISO 2533) has this pressure; NaN outside -5 to 20 km."""
    pressure = np.asarray(pressure_pa, dtype=np.float64)
    pressure = np.where((pressure > 0.0) & np.isfinite(pressure), pressure, np.nan)
    below = np.maximum(pressure, _ISA_P11_PA)
    alt = (_ISA_T0_K / _ISA_LAPSE_K_M) * (1.0 - (below / _ISA_P0_PA) ** (1.0 / _ISA_EXPONENT))
    alt = alt + _ISA_SCALE_HEIGHT_M * np.log(below / pressure)
    # The margin keeps the exact limits inside after a round trip.
    alt = np.where((alt >= _ISA_LOWEST_M - 1e-6) & (alt <= _ISA_HIGHEST_M + 1e-6), alt, np.nan)
    return float(alt) if isinstance(pressure_pa, float) else alt
