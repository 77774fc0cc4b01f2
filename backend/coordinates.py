"""A place in the words of map readers: MGRS, UTM, and degrees with minutes and seconds."""

from __future__ import annotations

import math
import re
from functools import lru_cache

import mgrs
import pyproj

_BANDS = "CDEFGHJKLMNPQRSTUVWX"
_METRE_DIGITS = 5
# Svalbard's zones: (western edge, zone) of what band X has between 0 and 42 degrees east.
_SVALBARD = ((33.0, 37), (21.0, 35), (9.0, 33), (0.0, 31))


def mgrs_of(lat_deg: float, lon_deg: float, std_m: float | None = None) -> str | None:
    """The grid reference (MGRS) of a place, UPS zones at the poles included; None where there is none.

    One metre, or, with a horizontal standard deviation, the smallest cell that is not below it: 10 m for 3 m.
    """
    try:
        full = str(mgrs.MGRS().toMGRS(lat_deg, lon_deg))
    except mgrs.core.MGRSError:
        return None
    found = re.fullmatch(r"(\d{0,2}[A-Z]{3})(\d{5})(\d{5})", full)
    if std_m is None or found is None:
        return full
    digits = mgrs_digits(std_m)
    square, east, north = found.groups()
    # The grid truncates: a shorter reference names the cell that the place is in.
    return f"{square}{east[:digits]}{north[:digits]}"


def mgrs_digits(std_m: float) -> int:
    """Digits of each axis, 0 (100 km) to 5 (1 m), that a standard deviation supports."""
    if not math.isfinite(std_m):
        return 0
    return min(max(_METRE_DIGITS - math.ceil(math.log10(max(std_m, 1.0))), 0), _METRE_DIGITS)


def utm_zone(lat_deg: float, lon_deg: float) -> tuple[int, str] | None:
    """Zone and band, with the exceptions in south-west Norway and Svalbard; None beyond 80 S and 84 N."""
    if not -80.0 <= lat_deg <= 84.0 or not math.isfinite(lon_deg):
        return None
    lon = (lon_deg + 180.0) % 360.0 - 180.0
    band = _BANDS[min(math.floor((lat_deg + 80.0) / 8.0), len(_BANDS) - 1)]
    zone = min(math.floor((lon + 180.0) / 6.0) + 1, 60)
    if band == "V" and 3.0 <= lon < 12.0:
        zone = 32
    if band == "X" and 0.0 <= lon < 42.0:
        zone = next(number for west, number in _SVALBARD if lon >= west)
    return zone, band


def utm_of(lat_deg: float, lon_deg: float) -> str | None:
    """Zone with band, easting and northing in whole metres, ``32T 465412 5247139``; None near the poles."""
    where = utm_zone(lat_deg, lon_deg)
    if where is None:
        return None
    zone, band = where
    east_m, north_m = _projection(zone, band < "N").transform(lon_deg, lat_deg)
    return f"{zone}{band} {east_m:.0f} {north_m:.0f}"


def dms_of(lat_deg: float, lon_deg: float) -> str:
    """Degrees, minutes and hundredths of a second (0.3 m): ``47°22′36.84″N 008°32′30.12″E``."""
    return f"{_sexagesimal(lat_deg, 2, 'NS')} {_sexagesimal(lon_deg, 3, 'EW')}"


@lru_cache(maxsize=120)
def _projection(zone: int, south: bool) -> pyproj.Transformer:
    # Unlike a Proj a Transformer may be shared by threads.
    side = "+south " if south else ""
    return pyproj.Transformer.from_pipeline(
        f"+proj=pipeline +step +proj=unitconvert +xy_in=deg +xy_out=rad +step +proj=utm +zone={zone} {side}+ellps=WGS84"
    )


def _sexagesimal(value_deg: float, width: int, sides: str) -> str:
    hundredths = round(abs(value_deg) * 360_000)
    degrees, rest = divmod(hundredths, 360_000)
    minutes, rest = divmod(rest, 6_000)
    side = sides[1] if value_deg < 0 and hundredths else sides[0]
    return f"{degrees:0{width}d}°{minutes:02d}′{rest // 100:02d}.{rest % 100:02d}″{side}"
