"""What is known of a photo before it is located: options, then a table of priors, then the photo's own file."""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from pathlib import Path

from backend.errors import StationError
from geodata.flight_tables import Table, TableRow, parse_number, read_table
from geodata.photo import PhotoMeta

DEFAULT_RADIUS_M = 100.0
EXIF_GPS_STD_M = 15.0


class HintError(StationError):
    """What was said of a photo makes no sense, or is not enough."""


@dataclass(frozen=True, slots=True)
class Hints:
    """None is not known. ``radius_m`` is a bound, ``sigma_m`` a standard deviation on each axis; one of them counts.

    Angles are the gimbal's: pitch -90 degrees looks straight down, and then the heading is where the picture's top
    points, otherwise where the optical axis does.
    """

    lat_deg: float | None = None
    lon_deg: float | None = None
    radius_m: float | None = None
    sigma_m: float | None = None
    agl_m: float | None = None
    alt_amsl_m: float | None = None
    heading_deg: float | None = None
    pitch_deg: float | None = None
    roll_deg: float | None = None
    hfov_deg: float | None = None
    height_std_m: float | None = None

    def __post_init__(self) -> None:
        for name, low, high in _LIMITS:
            value = getattr(self, name)
            if value is not None and not (low <= value <= high):
                raise HintError(f"{name} is {low:g} to {high:g}, not {value:g}")
        if (self.lat_deg is None) != (self.lon_deg is None):
            raise HintError("a position needs latitude and longitude")

    def over(self, other: Hints) -> Hints:
        """These hints, with what they leave open taken from others."""
        own = {f.name: getattr(self, f.name) for f in fields(self) if getattr(self, f.name) is not None}
        if self.radius_m is not None or self.sigma_m is not None:
            other = replace(other, radius_m=None, sigma_m=None)
        if self.agl_m is not None or self.alt_amsl_m is not None:
            other = replace(other, agl_m=None, alt_amsl_m=None, height_std_m=None)
        return replace(other, **own)

    @property
    def attitude_is_known(self) -> bool:
        """Whether somebody measured the tilt; straight down is what one says who did not."""
        tilt = (self.pitch_deg if self.pitch_deg is not None else -90.0) + 90.0, self.roll_deg or 0.0
        return max(map(abs, tilt)) > 1e-6


_LIMITS = (
    ("lat_deg", -90.0, 90.0), ("lon_deg", -180.0, 180.0), ("radius_m", 1.0, 5000.0), ("sigma_m", 0.5, 1500.0),
    ("agl_m", 2.0, 5000.0), ("alt_amsl_m", -1000.0, 12000.0), ("heading_deg", -360.0, 720.0),
    ("pitch_deg", -90.0, -15.0), ("roll_deg", -60.0, 60.0), ("hfov_deg", 2.0, 170.0),
)  # fmt: skip


def hints_of_photo(meta: PhotoMeta, use_gps: bool) -> Hints:
    """What a photo's file says; its position only where it is to be used."""
    pitch = meta.pitch_deg
    if pitch is not None and not -90.0 <= pitch <= -15.0:
        # a hand's breadth past straight down is what gimbals report; what looks at the horizon is refused later
        pitch = -90.0 if pitch < -90.0 else None
    hfov = None if meta.focal_px is None else math.degrees(2.0 * math.atan(0.5 * meta.width_px / meta.focal_px))
    agl = meta.rel_alt_m if meta.rel_alt_m is not None and meta.rel_alt_m >= 2.0 else None
    return Hints(
        lat_deg=meta.lat_deg if use_gps else None,
        lon_deg=meta.lon_deg if use_gps else None,
        sigma_m=EXIF_GPS_STD_M if use_gps and meta.lat_deg is not None else None,
        agl_m=agl,
        alt_amsl_m=meta.alt_amsl_m if agl is None else None,
        heading_deg=meta.heading_deg,
        pitch_deg=pitch,
        roll_deg=meta.roll_deg if meta.roll_deg is not None and abs(meta.roll_deg) <= 60.0 else None,
        hfov_deg=hfov if hfov is not None and 2.0 <= hfov <= 170.0 else None,
        height_std_m=5.0 if agl is not None else 15.0,
    )


_COLUMNS = ("lat_deg", "lon_deg", "radius_m", "sigma_m", "agl_m", "alt_amsl_m", "heading_deg", "pitch_deg", "roll_deg")


def read_priors(path: Path) -> dict[str, Hints]:
    """``PRIORS.csv`` (design, section 5): hints by photo name; raises FlightFolderError or HintError."""
    table = read_table(path, ("photo",))
    found: dict[str, Hints] = {}
    for row in table.rows:
        try:
            found[Path(row.cells["photo"]).name] = _row(table, row)
        except HintError as error:
            raise HintError(f"{path}: line {row.line}: {error}") from None
    return found


def _row(table: Table, row: TableRow) -> Hints:
    known = {c: parse_number(table, row, c) for c in _COLUMNS if row.cells.get(c, "") not in ("", "nan", "NaN")}
    return Hints(**known)
