"""What clients may ask of vehicles and replays."""

from __future__ import annotations

import pytest
from pydantic import BaseModel, ValidationError

from backend.schemas.vehicles import CommandBody, NavigationBody, RecordingRequest, ReplayChange, ReplayRequest


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
