"""Bodies of a vehicle's last hour: columns of equal length, one entry a row, ascending in time."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel

Numbers = list[float | None]


class StateColumns(BaseModel):
    """States; ``t_unix_us`` is what the state is for, ``age_ms`` how old it was when it was said."""

    t_unix_us: list[int]
    epoch: list[int]
    mode: list[Literal["gps", "vision", "dead_reckoning", "lost"]]
    gps_denied: list[bool]
    lat_deg: Numbers
    lon_deg: Numbers
    alt_amsl_m: Numbers
    alt_agl_m: Numbers
    std_n_m: Numbers
    std_e_m: Numbers
    std_d_m: Numbers
    cov_ne_m2: Numbers
    vn_m_s: Numbers
    ve_m_s: Numbers
    vd_m_s: Numbers
    roll_deg: Numbers
    pitch_deg: Numbers
    heading_deg: Numbers
    last_fix_age_s: Numbers
    age_ms: Numbers
    video_offset_ms: Numbers


class GpsColumns(BaseModel):
    """What the receiver reported, by its own time; only with a fix."""

    t_unix_us: list[int]
    lat_deg: Numbers
    lon_deg: Numbers
    alt_amsl_m: Numbers
    std_horizontal_m: Numbers
    used: list[bool]


class FixColumns(BaseModel):
    """Attempts at a fix by vision, by the time of their picture; no position where none was found."""

    t_unix_us: list[int]
    kind: list[str]
    accepted: list[bool]
    reason: list[str]
    lat_deg: Numbers
    lon_deg: Numbers
    var_n_m2: Numbers
    var_e_m2: Numbers
    cov_ne_m2: Numbers
    score: Numbers
    elapsed_ms: Numbers


class VideoColumns(BaseModel):
    """How long pictures took to the station's door and through it."""

    t_unix_us: list[int]
    latency_ms: Numbers


class HistoryEvent(BaseModel):
    """Something that happened at a time; ``vehicle_id`` is None where it concerns the station."""

    t_unix_us: int
    kind: Literal["alarm_raised", "alarm_cleared", "said", "landing"]
    vehicle_id: str | None
    severity: Literal["info", "caution", "warning"]
    text: str
    id: str


class HistoryBody(BaseModel):
    """What the stream said of a vehicle in the last hour, or all that a replayed flight holds."""

    vehicle_id: str
    states: StateColumns
    gps: GpsColumns
    fixes: FixColumns
    video: VideoColumns
    events: list[HistoryEvent]
