"""The last hour of a vehicle: what was said comes back in columns, bounded, ascending, thinned on request."""

from __future__ import annotations

import math
from typing import Any

from backend.fleet.history import EVENTS_KEPT, STATES_KEPT, ColumnRing, Histories
from backend.schemas.history import HistoryBody

T0_US = 1_760_000_000_000_000


def state(t_us: int, **changed: Any) -> dict[str, Any]:
    numbers = dict.fromkeys(
        ("alt_amsl_m", "alt_agl_m", "std_n_m", "std_e_m", "std_d_m", "cov_ne_m2", "vn_m_s", "ve_m_s", "vd_m_s",
         "roll_deg", "pitch_deg", "heading_deg", "last_fix_age_s"), 1.5,
    )  # fmt: skip
    return {
        "vehicle_id": "1", "t_state_unix_us": t_us, "epoch": 3, "mode": "vision", "gps_denied": True,
        "lat_deg": 47.123456789, "lon_deg": 8.0, "video_clock": None, **numbers, **changed,
    }  # fmt: skip


def fix(t_us: int, accepted: bool, place: bool = True) -> dict[str, Any]:
    return {
        "vehicle_id": "1", "t_fix_unix_us": t_us, "kind": "match", "accepted": accepted,
        "reason": "" if accepted else "ambiguous", "lat_deg": 47.0 if place else None,
        "lon_deg": 8.0 if place else None,
        "cov_ne_m2": [[4.0, 0.5], [0.5, 9.0]] if place else None, "score": 0.4, "elapsed_ms": 12.0, "frame_id": 7,
    }  # fmt: skip


def alarm(t_us: int, active: bool, vehicle_id: str | None = "1") -> dict[str, Any]:
    return {
        "id": "gps_lost:1", "vehicle_id": vehicle_id, "severity": "warning", "code": "gps_lost", "text": "no fix",
        "active": active, "since_unix_us": t_us,
    }  # fmt: skip


class Clock:
    def __init__(self) -> None:
        self.t_us = T0_US

    def __call__(self) -> int:
        return self.t_us


def body(histories: Histories, since_us: int = 0, step_us: int = 0, vehicle_id: str = "1") -> dict[str, Any]:
    said = histories.body(vehicle_id, since_us, step_us)
    HistoryBody.model_validate(said)
    return said


def test_states_come_back_as_they_were_said_five_times_a_second() -> None:
    clock = Clock()
    histories = Histories(clock)
    for n in range(100):
        clock.t_us = T0_US + n * 50_000 + 30_000
        histories.take("state", state(T0_US + n * 50_000, std_n_m=0.1 * n, std_e_m=math.nan))

    states = body(histories)["states"]

    assert len({len(column) for column in states.values()}) == 1
    assert states["t_unix_us"] == [T0_US + n * 200_000 for n in range(25)]
    assert states["std_n_m"][:3] == [0.0, 0.4, 0.8]
    assert set(states["std_e_m"]) == {None}
    assert states["lat_deg"][0] == 47.12345679
    assert (states["mode"][0], states["gps_denied"][0], states["epoch"][0]) == ("vision", True, 3)
    assert states["age_ms"][0] == 30.0
    assert states["video_offset_ms"][0] is None


def test_what_is_known_is_left_out_and_the_rest_is_thinned() -> None:
    histories = Histories(Clock())
    for n in range(600):
        histories.take("state", state(T0_US + n * 200_000))

    states = body(histories, since_us=T0_US + 60_000_000, step_us=2_000_000)["states"]

    assert states["t_unix_us"][0] > T0_US + 60_000_000
    assert {b - a for a, b in zip(states["t_unix_us"][1:], states["t_unix_us"][2:], strict=False)} == {2_000_000}


def test_the_oldest_rows_give_way() -> None:
    ring = ColumnRing(("a",), 100)
    for n in range(1, 251):
        ring.add(n, {"a": float(n)})

    t_us, values = ring.since(0)

    assert t_us.tolist() == list(range(151, 251))
    assert values[:, 0].tolist() == [float(t) for t in t_us]
    assert STATES_KEPT * 200_000 >= 3_600_000_000


def test_fixes_keep_their_words_and_what_was_refused_without_a_place() -> None:
    histories = Histories(Clock())
    histories.take("fix", fix(T0_US, True))
    histories.take("fix", fix(T0_US + 1, False, place=False))

    fixes = body(histories)["fixes"]

    assert fixes["accepted"] == [True, False]
    assert fixes["reason"] == ["", "ambiguous"]
    assert fixes["lat_deg"] == [47.0, None]
    assert (fixes["var_n_m2"][0], fixes["var_e_m2"][0], fixes["cov_ne_m2"][0]) == (4.0, 9.0, 0.5)
    assert body(histories, since_us=T0_US)["fixes"]["reason"] == ["ambiguous"]


def test_alarms_are_told_where_they_were_raised_and_cleared() -> None:
    clock = Clock()
    histories = Histories(clock)
    clock.t_us = T0_US + 2_000_000
    histories.take("alarm", alarm(T0_US, True))
    clock.t_us = T0_US + 9_000_000
    histories.take("alarm", alarm(T0_US, False))
    histories.take("alarm", alarm(T0_US, True, vehicle_id="2"))
    histories.take("alarm", alarm(T0_US, True, vehicle_id=None))

    events = body(histories)["events"]

    assert [(event["kind"], event["t_unix_us"] - T0_US) for event in events] == [
        ("alarm_raised", 0), ("alarm_cleared", 9_000_000), ("alarm_raised", 0),
    ]  # fmt: skip
    for _ in range(EVENTS_KEPT + 10):
        histories.take("alarm", alarm(T0_US, True))
    assert len(body(histories)["events"]) == EVENTS_KEPT


def test_a_landing_is_told_once_for_each_of_its_phases() -> None:
    histories = Histories(Clock())
    for phase in (None, "descend", "descend", "landed"):
        descent = None if phase is None else {"phase": phase, "reason": "touched" if phase == "landed" else None}
        histories.take("landing", {"vehicle_id": "1", "descent": descent})

    assert [event["text"] for event in body(histories)["events"]] == ["landing: descend", "landing: landed (touched)"]


def test_gps_without_a_fix_is_no_row_and_replays_are_not_kept() -> None:
    histories = Histories(Clock())
    reading = {"vehicle_id": "1", "fix_type": 3, "lat_deg": 47.0, "lon_deg": 8.0, "alt_amsl_m": 1.0, "used": True}
    histories.take("gps", {**reading, "t_gps_unix_us": T0_US, "std_horizontal_m": None})
    histories.take("gps", {**reading, "t_gps_unix_us": T0_US + 1_000_000, "fix_type": 0})
    histories.take("state", state(T0_US, vehicle_id="replay-a"))

    assert body(histories)["gps"]["t_unix_us"] == [T0_US]
    assert body(histories, vehicle_id="replay-a")["states"]["t_unix_us"] == []


def test_a_clock_that_is_set_back_begins_a_new_history() -> None:
    histories = Histories(Clock())
    histories.take("state", state(T0_US))
    histories.take("fix", fix(T0_US, True))
    histories.take("state", state(T0_US - 3_600_000_000))

    assert body(histories)["states"]["t_unix_us"] == [T0_US - 3_600_000_000]
    assert body(histories)["fixes"]["t_unix_us"] == []
