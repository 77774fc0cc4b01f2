"""Missions: what an item may hold."""

import math

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from guidance.mission import (
    MAX_ITEMS,
    PLACE_COMMANDS,
    AltitudeDatum,
    Home,
    Mission,
    MissionError,
    MissionItem,
)

PLACE = (0.0, 0.0, 0.0, math.nan, 47.0, 8.0, 50.0)


def test_commands_with_places_are_those_of_the_dialect() -> None:
    said = {number for number, entry in dialect.enums["MAV_CMD"].items() if getattr(entry, "has_location", False)}

    assert said == PLACE_COMMANDS


@pytest.mark.parametrize(
    ("frame", "datum"),
    [(0, AltitudeDatum.AMSL), (5, AltitudeDatum.AMSL), (3, AltitudeDatum.HOME), (6, AltitudeDatum.HOME),
     (10, AltitudeDatum.GROUND), (11, AltitudeDatum.GROUND)],
)  # fmt: skip
def test_the_frame_says_from_where_an_altitude_counts(frame: int, datum: AltitudeDatum) -> None:
    item = MissionItem(16, frame, PLACE)
    assert (item.datum, item.alt_m, item.place_deg, item.counts_per_unit) == (datum, 50.0, (47.0, 8.0), 1e7)


def test_what_has_no_place() -> None:
    assert MissionItem(16, 1, (0.0, 0.0, 0.0, 0.0, 200.0, -300.0, -50.0)).counts_per_unit == 1e4
    speed = MissionItem(178, 3, (1.0, 12.0, -1.0, 0.0, 0.0, 0.0, 0.0))
    assert (speed.place_deg, speed.alt_m, speed.datum, speed.counts_per_unit) == (None, None, None, 1.0)
    here = MissionItem(22, 3, (0.0, 0.0, 0.0, math.nan, 0.0, 0.0, 30.0))
    assert (here.place_deg, here.alt_m) == (None, 30.0)


@pytest.mark.parametrize(
    ("command", "frame", "change", "word"),
    [
        (-1, 3, {}, "MAV_CMD"), (65536, 3, {}, "MAV_CMD"), (16, 14, {}, "MAV_FRAME"), (16, 99, {}, "MAV_FRAME"),
        (16, 3, {4: 90.1}, "latitude 90.1"), (16, 3, {5: -180.5}, "longitude -180.5"),
        (16, 3, {6: math.inf}, "parameter 7"), (16, 3, {0: 1e39}, "parameter 1"),
        (178, 2, {4: 3e9}, "parameter 5"), (16, 1, {5: 215_000.0}, "parameter 6"),
    ],
)  # fmt: skip
def test_what_mavlink_cannot_carry_is_refused(command: int, frame: int, change: dict[int, float], word: str) -> None:
    values = [change.get(index, value) for index, value in enumerate((0.0, 0.0, 0.0, 0.0, 10.0, 20.0, 30.0))]
    with pytest.raises(ValueError, match=word):
        MissionItem(command, frame, tuple(values))  # type: ignore[arg-type]


@pytest.mark.parametrize("target", [0.0, 3.0, 1.5, math.nan])
def test_a_jump_leads_to_an_item(target: float) -> None:
    jump = MissionItem(177, 2, (target, 2.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    with pytest.raises(MissionError) as refused:
        Mission((MissionItem(16, 3, PLACE), jump))
    assert refused.value.number == 2


def test_limits_of_a_mission() -> None:
    with pytest.raises(MissionError, match="at most"):
        Mission((MissionItem(16, 3, PLACE),) * (MAX_ITEMS + 1))
    with pytest.raises(ValueError, match="home is not a place"):
        Home(math.nan, 8.0, 400.0)
