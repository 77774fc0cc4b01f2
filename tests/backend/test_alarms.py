"""Alarms rise and clear with hysteresis."""

import pytest

from backend.alarms import AlarmBoard, AlarmKind, estimator_checks
from estimator.types import Doubt, Mode

KIND = AlarmKind("gps_lost", "warning", raise_after_s=2.0, clear_after_s=3.0)


def watch(board: AlarmBoard, condition: bool, t_s: float) -> bool | None:
    alarm = board.watch(KIND, "1", condition, "no fix", round(t_s * 1e6))
    return None if alarm is None else alarm.active


def test_a_short_condition_raises_nothing() -> None:
    board = AlarmBoard()

    assert [watch(board, condition, t) for t, condition in ((0, True), (1.9, True), (2.0, False), (10, False))] == [
        None, None, None, None,
    ]  # fmt: skip
    assert board.active == []


def test_a_lasting_condition_raises_once() -> None:
    board = AlarmBoard()

    assert [watch(board, True, t) for t in (0, 1, 2, 3, 4)] == [None, None, True, None, None]
    assert [alarm.code for alarm in board.active] == ["gps_lost"]


def test_it_clears_only_after_the_condition_has_been_gone_for_a_while() -> None:
    board = AlarmBoard()
    watch(board, True, 0)
    watch(board, True, 2)

    assert [watch(board, c, t) for t, c in ((3, False), (5, True), (6, False), (8.9, False), (9.0, False))] == [
        None, None, None, None, False,
    ]  # fmt: skip
    assert board.active == []


def test_raised_and_cleared_alarm_have_one_id() -> None:
    board = AlarmBoard()
    board.watch(KIND, "1", True, "no fix", 0)
    raised = board.watch(KIND, "1", True, "no fix", 2_000_000)
    board.watch(KIND, "1", False, "no fix", 3_000_000)
    cleared = board.watch(KIND, "1", False, "no fix", 6_000_000)

    assert raised is not None
    assert cleared is not None
    assert (raised.id, raised.active, cleared.active) == (cleared.id, True, False)


def test_vehicles_do_not_share_alarms() -> None:
    board = AlarmBoard()
    for name in ("1", "2"):
        board.watch(KIND, name, name == "1", "no fix", 0)
        board.watch(KIND, name, name == "1", "no fix", 2_000_000)

    assert [alarm.vehicle_id for alarm in board.active] == ["1"]
    assert [alarm.active for alarm in board.forget("1")] == [False]
    assert board.active == []


@pytest.mark.parametrize("doubt", list(Doubt))
def test_every_doubt_of_the_estimator_has_an_alarm_that_says_what_it_is(doubt: Doubt) -> None:
    raised = {kind.code: text for kind, condition, text in estimator_checks("7", Mode.VISION, (doubt,)) if condition}

    assert list(raised) == [str(doubt)]
    assert raised[str(doubt)].startswith("vehicle 7: ")


@pytest.mark.parametrize(("mode", "code"), [(Mode.LOST, "navigator_lost"), (Mode.DEAD_RECKONING, "dead_reckoning")])
def test_a_mode_without_a_position_fix_has_one_too(mode: Mode, code: str) -> None:
    assert [kind.code for kind, condition, _ in estimator_checks("7", mode, ()) if condition] == [code]


def test_before_the_first_state_nothing_is_alarming() -> None:
    assert not any(condition for _, condition, _ in estimator_checks("7", None, ()))
