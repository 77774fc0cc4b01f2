"""What clients may ask of vehicles and replays."""

from __future__ import annotations

import pytest
from pydantic import BaseModel, ValidationError

from backend.fleet.messages import state_fields
from backend.schemas.vehicles import (
    CommandBody,
    NavigationBody,
    RecordingRequest,
    ReplayChange,
    ReplayRequest,
    StateBody,
    VideoClockBody,
)
from tests.backend.flight_maker import T0_US, state


@pytest.mark.parametrize(
    ("kind", "body"),
    [
        (ReplayRequest, {"speed": 0.0}), (ReplayRequest, {"speed": 16.1}), (ReplayRequest, {"speed": float("nan")}),
        (ReplayRequest, {"start_s": -0.1}), (ReplayRequest, {"start_s": float("nan")}),
        (ReplayRequest, {"start_s": float("inf")}), (ReplayChange, {"seek_unix_us": -1}),
        (ReplayChange, {"seek_unix_us": 1.5}), (ReplayChange, {"stop": True}), (NavigationBody, {}),
        (RecordingRequest, {"active": "perhaps"}), (CommandBody, {"command": "goto", "alt_rel_m": float("inf")}),
    ],
)  # fmt: skip
def test_what_makes_no_sense_is_refused(kind: type[BaseModel], body: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        kind(**body)


def test_the_least_that_can_be_asked() -> None:
    assert (ReplayRequest().speed, ReplayRequest().start_s) == (1.0, 0.0)
    assert ReplayChange() == ReplayChange(paused=None, speed=None, seek_unix_us=None)
    assert ReplayChange(speed=0.1).speed == 0.1
    assert ReplayChange(speed=16).speed == 16


CLOCK = {"source": "found", "time_offset_s": -0.121, "std_s": 0.004, "reason": ""}


@pytest.mark.parametrize(
    "change",
    [
        {"video_clock": {**CLOCK, "source": "guessed"}}, {"video_clock": {**CLOCK, "std_s": -0.1}},
        {"video_clock": {"source": "found"}}, {"video_clock": {**CLOCK, "time_offset_ms": 121}},
        {"boresight_deg": [0.1, 0.2]}, {"boresight_std_deg": [0.1, 0.2, 0.3, 0.4]}, {"mode": "hopeful"},
    ],
)  # fmt: skip
def test_a_state_that_is_not_as_described_is_noticed(change: dict[str, object]) -> None:
    fields = {"vehicle_id": "1", **state_fields(state(T0_US), 1, False, None), "video_clock": CLOCK}
    StateBody(**fields)
    with pytest.raises(ValidationError):
        StateBody(**{**fields, **change})


def test_a_state_keeps_all_its_fields() -> None:
    """What is described and what is not go through as they are."""
    fields = {"vehicle_id": "1", **state_fields(state(T0_US), 1, False, None)}
    unknown = {"source": "searching", "time_offset_s": None, "std_s": None, "reason": "too few pairs of pictures"}

    assert StateBody(**fields).model_dump() == fields
    assert VideoClockBody(**unknown).model_dump() == unknown
