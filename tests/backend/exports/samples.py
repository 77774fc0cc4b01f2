"""Targets of every kind, and a reader of CoT events that knows only their schema."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from lxml import etree

from backend.store.targets import Target

T_US = 1_777_627_800_250_000  # 2026-05-01T09:30:00.250Z
NASTY_NAMES = [
    "A & B <gate> \"north\" 'old' ]]> &amp;", "two\nlines\tand a tab", "Брод – 渡口 – معبر – 𝔐 – é", "", "   ",
    "=HYPERLINK(\"http://x\")", "+1", "-1", "@SUM(A1)", "\t=1", " =1+1", "a,b;c", "\x00 \x07 \ufffe", "x" * 200,
]  # fmt: skip

_SCHEMA = etree.XMLSchema(etree.parse(Path(__file__).parents[2] / "authorities" / "cot_event.xsd"))


def target(**changes: Any) -> Target:
    """A clicked one: 3 m to the north-east and 1 m across, 2 m in height."""
    facts: dict[str, Any] = {
        "id": "6b0f0d3e-0b1c-4a53-9d3f-1d6f3a1f8a11", "name": "Bridge", "lat_deg": 47.3769, "lon_deg": 8.5417,
        "alt_amsl_m": 408.25, "method": "ray_terrain", "created_unix_us": T_US + 900_000,
        "updated_unix_us": T_US + 900_000, "vehicle_id": "1", "frame_id": 7, "t_unix_us": T_US, "u_px": 12.5,
        "v_px": 400.0, "var_n_m2": 5.0, "var_e_m2": 5.0, "var_d_m2": 4.0, "cov_ne_m2": 4.0,
    }  # fmt: skip
    return Target(**{**facts, **changes})


def followed(**changes: Any) -> Target:
    """One that drives east at 5 m/s, seen 2 s after the click."""
    facts: dict[str, Any] = {
        "method": "followed", "track_status": "seen", "seen_unix_us": T_US + 2_000_000, "moving": True,
        "vel_n_m_s": 0.0, "vel_e_m_s": 5.0, "var_vel_n_m2_s2": 0.04, "var_vel_e_m2_s2": 0.09, "cov_vel_ne_m2_s2": 0.0,
    }  # fmt: skip
    return target(**{**facts, **changes})


def typed(**changes: Any) -> Target:
    """Coordinates that somebody typed in: nothing is known of their error."""
    unknown = dict.fromkeys(
        ("alt_amsl_m", "vehicle_id", "frame_id", "t_unix_us", "u_px", "v_px", "var_n_m2", "var_e_m2", "var_d_m2",
         "cov_ne_m2")
    )  # fmt: skip
    return target(**{**unknown, "id": "2", "name": "Typed", "method": "manual", **changes})


def valid_event(data: bytes) -> Any:
    """The event of a message; fails when it is not valid."""
    event = etree.fromstring(data, etree.XMLParser(resolve_entities=False))
    _SCHEMA.assertValid(event)
    return event
