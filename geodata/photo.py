"""What a photo's file says of how it was taken: EXIF, and the attitude that drones write as XMP.

Nothing here is trusted: values out of range, not numbers or damaged are left out, and the XMP packet is searched for
single numbers instead of being parsed as XML, so that no entity in it is ever expanded.
"""

from __future__ import annotations

import math
import re
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import cv2
import numpy as np
from PIL import ExifTags, Image, UnidentifiedImageError

from estimator.types import Image as Pixels
from geodata.errors import PhotoError

SUFFIXES = (".jpg", ".jpeg", ".png", ".tif", ".tiff", ".bmp", ".webp")
MAX_PHOTO_PIXELS = 250_000_000

_DIAGONAL_35MM = math.hypot(36.0, 24.0)
_MAX_XMP_BYTES = 1 << 18
_NUMBER = rb"[\s]*([-+]?[0-9]{1,12}(?:\.[0-9]{1,12})?)[\s]*"
_WIDE = 1.55


@dataclass(frozen=True, slots=True)
class PhotoMeta:
    """What a file says; None where it does not. Angles are the gimbal's, pitch -90 degrees is straight down.

    ``focal_px`` is for the picture's own width. ``rel_alt_m`` is above the place of take-off. ``taken`` is the
    camera's clock as written, without a zone.
    """

    width_px: int
    height_px: int
    lat_deg: float | None = None
    lon_deg: float | None = None
    alt_amsl_m: float | None = None
    rel_alt_m: float | None = None
    heading_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    focal_px: float | None = None
    taken: str | None = None


def read_photo(path: Path) -> tuple[Pixels, PhotoMeta]:
    """A photo in grey (rows, cols), its pixels as stored, and what its file says.

    Raises
    ------
    PhotoError
        There is no such file, it is no picture, is damaged or is far too large.
    """
    meta = read_meta(path)
    pixels = cv2.imdecode(
        np.frombuffer(path.read_bytes(), dtype=np.uint8), cv2.IMREAD_GRAYSCALE | cv2.IMREAD_IGNORE_ORIENTATION
    )
    if pixels is None:
        raise PhotoError(path, "cannot be decoded", "copy it again from the camera")
    return np.asarray(pixels, dtype=np.uint8), meta


def read_meta(path: Path) -> PhotoMeta:
    """What a photo's file says; raises as ``read_photo``."""
    if not path.is_file():
        what = "is a folder" if path.is_dir() else "no such file"
        raise PhotoError(path, what, "give the path of a picture")
    try:
        with Image.open(path) as picture:
            width, height = picture.size
            if width * height > MAX_PHOTO_PIXELS:
                raise PhotoError(path, f"holds {width} x {height} pixels", "reduce it to 250 million or fewer")
            exif, xmp = picture.getexif(), picture.info.get("xmp", b"")
            photo, gps = _directory(exif, ExifTags.IFD.Exif), _directory(exif, ExifTags.IFD.GPSInfo)
    except (UnidentifiedImageError, Image.DecompressionBombError) as error:
        raise PhotoError(path, "is not a picture", "give a JPEG, PNG or TIFF") from error
    except (OSError, SyntaxError, ValueError) as error:
        raise PhotoError(path, f"is damaged ({error})", "copy it again from the camera") from error
    attitude = _attitude(xmp if isinstance(xmp, bytes) else b"")
    lat, lon = _position(gps)
    heading = attitude.get("Yaw")
    if heading is None:
        heading = _bounded(gps.get(ExifTags.GPS.GPSImgDirection), 0.0, 360.0)
    taken = photo.get(ExifTags.Base.DateTimeOriginal)
    return PhotoMeta(
        width, height, lat, lon, _altitude(gps), attitude.get("RelativeAltitude"), heading, attitude.get("Pitch"),
        attitude.get("Roll"), _focal_px(photo, width, height), taken if isinstance(taken, str) else None,
    )  # fmt: skip


def photos_in(paths: list[Path]) -> list[Path]:
    """The files named, and the pictures in the folders named, by name; raises PhotoError for an empty folder."""
    found: list[Path] = []
    for path in paths:
        if not path.is_dir():
            found.append(path)
            continue
        inside = sorted(p for p in path.iterdir() if p.suffix.lower() in SUFFIXES and p.is_file())
        if not inside:
            raise PhotoError(path, "holds no pictures", f"pictures end in {', '.join(SUFFIXES)}")
        found += inside
    return found


def _directory(exif: Image.Exif, which: int) -> Mapping[int, Any]:
    try:
        return exif.get_ifd(which)
    except (OSError, SyntaxError, ValueError, TypeError, KeyError):
        # a damaged directory says nothing; the pixels may be good
        return {}


def _position(gps: Mapping[int, Any]) -> tuple[float | None, float | None]:
    lat = _degrees(gps.get(ExifTags.GPS.GPSLatitude), gps.get(ExifTags.GPS.GPSLatitudeRef), "S", 90.0)
    lon = _degrees(gps.get(ExifTags.GPS.GPSLongitude), gps.get(ExifTags.GPS.GPSLongitudeRef), "W", 180.0)
    # receivers without a fix write zeros
    if lat is None or lon is None or (lat == 0.0 and lon == 0.0):
        return None, None
    return lat, lon


def _degrees(parts: object, side: object, negative: str, limit: float) -> float | None:
    if not isinstance(parts, tuple) or len(parts) != 3:
        return None
    numbers = [_number(part) for part in parts]
    if any(number is None for number in numbers):
        return None
    degrees, minutes, seconds = (number or 0.0 for number in numbers)
    value = degrees + minutes / 60.0 + seconds / 3600.0
    if not 0.0 <= value <= limit:
        return None
    return -value if str(side).strip("\x00 ").upper() == negative else value


def _altitude(gps: Mapping[int, Any]) -> float | None:
    alt = _bounded(gps.get(ExifTags.GPS.GPSAltitude), 0.0, 20_000.0)
    below = gps.get(ExifTags.GPS.GPSAltitudeRef) in (1, b"\x01")
    return -alt if alt is not None and below else alt


def _attitude(xmp: bytes) -> dict[str, float]:
    """Gimbal angles and height above take-off, of whichever vendor, from an XMP packet."""
    packet = xmp[:_MAX_XMP_BYTES]
    found: dict[str, float] = {}
    for name, limit in (("Yaw", 360.0), ("Pitch", 180.0), ("Roll", 180.0)):
        value = _xmp_number(packet, f"Gimbal{name}Degree", limit)
        if value is None:
            value = _xmp_number(packet, f"Camera{name}Degree", limit)
        if value is not None:
            found[name] = value % 360.0 if name == "Yaw" else value
    height = _xmp_number(packet, "RelativeAltitude", 20_000.0)
    if height is not None:
        found["RelativeAltitude"] = height
    return found


def _xmp_number(packet: bytes, name: str, limit: float) -> float | None:
    word = name.encode()
    match = re.search(rb"[\w-]+:" + word + rb"(?:=\"" + _NUMBER + rb"\"|>" + _NUMBER + rb"<)", packet)
    if match is None:
        return None
    value = float(match.group(1) or match.group(2))
    return value if abs(value) <= limit else None


def _focal_px(photo: Mapping[int, Any], width_px: int, height_px: int) -> float | None:
    """Focal length from its 35 mm equivalent, which compares diagonals (CIPA DCG-001).

    A wide picture is taken for a crop of a 4:3 sensor, as drones make them; the equivalent is the whole sensor's.
    """
    equivalent_mm = _bounded(photo.get(ExifTags.Base.FocalLengthIn35mmFilm), 1.0, 2000.0)
    if equivalent_mm is None:
        return None
    long_px, short_px = max(width_px, height_px), min(width_px, height_px)
    diagonal_px = 1.25 * long_px if long_px > _WIDE * short_px else math.hypot(long_px, short_px)
    return equivalent_mm * diagonal_px / _DIAGONAL_35MM


def _bounded(value: object, low: float, high: float) -> float | None:
    number = _number(value)
    return number if number is not None and low <= number <= high else None


def _number(value: Any) -> float | None:
    try:
        number = float(value)
    except (TypeError, ValueError, ZeroDivisionError, OverflowError):
        return None
    return number if math.isfinite(number) else None
