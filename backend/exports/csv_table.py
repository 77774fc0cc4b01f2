"""Targets as a CSV table (RFC 4180, UTF-8): one line each, units in the header."""

from __future__ import annotations

import csv
import io
import math
from collections.abc import Sequence

from backend.coordinates import mgrs_of
from backend.exports.text import clean, decimal, iso_utc, position_unix_us
from backend.schemas.geometry import TargetProperties, TrackBody, feature_of_target
from backend.store.targets import Target
from estimator.evaluate import CHI2_95_2DOF

COLUMNS = (
    "id", "name", "lat_deg", "lon_deg", "alt_amsl_m", "time_utc", "dms", "mgrs", "utm", "method",
    "std_n_m", "std_e_m", "std_d_m", "cov_ne_m2", "ce90_m",
    "ellipse95_semi_major_m", "ellipse95_semi_minor_m", "ellipse95_azimuth_deg",
    "vehicle_id", "frame_id", "u_px", "v_px",
    "track", "moving", "speed_m_s", "course_deg", "vel_n_m_s", "vel_e_m_s", "std_vel_n_m_s", "std_vel_e_m_s",
    "created_utc", "updated_utc", "version",
)  # fmt: skip
# What a spreadsheet takes for the beginning of a formula, full-width forms included.
_FORMULA_SIGNS = ("=", "+", "-", "@", "\t", "\r", "\n", "＝", "＋", "－", "＠")


def csv_of_targets(targets: Sequence[Target]) -> bytes:
    """The table, with a header even when there is no target; an empty cell is not known.

    ``mgrs`` has no more digits than the larger horizontal sigma supports, and all where none is known. Before a text
    that a spreadsheet would compute stands an apostrophe.
    """
    text = io.StringIO()
    table = csv.DictWriter(text, COLUMNS, lineterminator="\r\n")
    table.writeheader()
    table.writerows(_row(target) for target in targets)
    return text.getvalue().encode()


def _row(target: Target) -> dict[str, str]:
    about = feature_of_target(target).properties
    ellipse = about.ellipse95
    return {
        "id": _text(target.id), "name": _text(about.name),
        "lat_deg": decimal(about.lat_deg, 7), "lon_deg": decimal(about.lon_deg, 7),
        "alt_amsl_m": _number(about.alt_amsl_m, 2), "time_utc": iso_utc(position_unix_us(about)),
        "dms": about.dms, "mgrs": mgrs_of(about.lat_deg, about.lon_deg, _largest_std_m(about)) or "",
        "utm": about.utm or "", "method": _text(about.method),
        "std_n_m": _number(about.std_n_m, 3), "std_e_m": _number(about.std_e_m, 3),
        "std_d_m": _number(about.std_d_m, 3), "cov_ne_m2": _number(about.cov_ne_m2, 4),
        "ce90_m": _number(about.ce90_m, 3),
        "ellipse95_semi_major_m": "" if ellipse is None else decimal(ellipse.semi_major_m, 3),
        "ellipse95_semi_minor_m": "" if ellipse is None else decimal(ellipse.semi_minor_m, 3),
        "ellipse95_azimuth_deg": "" if ellipse is None else decimal(ellipse.azimuth_deg, 1),
        "vehicle_id": _text(about.vehicle_id or ""), "frame_id": "" if about.frame_id is None else str(about.frame_id),
        "u_px": _number(about.u_px, 2), "v_px": _number(about.v_px, 2),
        **_track(about.track),
        "created_utc": iso_utc(about.created_unix_us), "updated_utc": iso_utc(about.updated_unix_us),
        "version": str(about.version),
    }  # fmt: skip


def _track(track: TrackBody | None) -> dict[str, str]:
    if track is None:
        return {}
    return {
        "track": track.status, "moving": "" if track.moving is None else str(track.moving).lower(),
        "speed_m_s": _number(track.speed_m_s, 2), "course_deg": _number(track.course_deg, 1),
        "vel_n_m_s": _number(track.vel_n_m_s, 2), "vel_e_m_s": _number(track.vel_e_m_s, 2),
        "std_vel_n_m_s": _number(track.std_vel_n_m_s, 2), "std_vel_e_m_s": _number(track.std_vel_e_m_s, 2),
    }  # fmt: skip


def _largest_std_m(about: TargetProperties) -> float | None:
    if about.ellipse95 is not None:
        return about.ellipse95.semi_major_m / math.sqrt(CHI2_95_2DOF)
    known = [std for std in (about.std_n_m, about.std_e_m) if std is not None]
    return max(known, default=None)


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else decimal(value, digits)


def _text(text: str) -> str:
    safe = clean(text)
    is_formula = safe.startswith(_FORMULA_SIGNS) or safe.lstrip().startswith(_FORMULA_SIGNS)
    return f"'{safe}" if is_formula else safe
