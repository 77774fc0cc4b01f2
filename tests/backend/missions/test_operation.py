"""Sending and fetching as rows of transfers, and what a recorded ArduPilot makes of what it was sent."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import pytest

from backend.link.events import Autopilot, CommandStatus, TransferAction, TransferNews
from backend.link.framing import MavlinkFramer, RawPacket
from backend.link.mission_items import home_of_vehicle, item_of_message, items_of_vehicle
from backend.missions.compare import compare, told
from backend.missions.operation import Downloaded, End, Fetching, Sending, Step
from backend.missions.parts import fence_items, fence_of_items, items_of_part, rally_items, rally_of_items
from backend.missions.plan_file import plan_of
from guidance.mission import MissionItem, MissionType
from tests.backend.missions.plans import plan_document

RECORDED = Path(__file__).parents[4] / "shared/data/telemetry/plane_mission.tlog"
PLAN = plan_of(plan_document())
MISSION, FENCE, RALLY = MissionType
UPLOAD, DOWNLOAD, CLEAR = TransferAction.UPLOAD, TransferAction.DOWNLOAD, TransferAction.CLEAR


def news(
    step: Step, items: tuple[MissionItem, ...] = (), status: CommandStatus = CommandStatus.ACCEPTED,
    unconfirmed: bool = False,
) -> TransferNews:  # fmt: skip
    return TransferNews(1, 1, 1, step.action, step.kind, status, "said", items=items, unconfirmed=unconfirmed)


def next_step(found: Step | End | Downloaded) -> Step:
    assert isinstance(found, Step)
    return found


def sending(*kinds: MissionType, autopilot: Autopilot = Autopilot.ARDUPILOT) -> Sending:
    return Sending([(kind, items_of_part(PLAN, kind, autopilot)) for kind in kinds], autopilot)


@pytest.mark.parametrize("autopilot", list(Autopilot))
def test_each_part_is_sent_and_read_back(autopilot: Autopilot) -> None:
    work = sending(MISSION, FENCE, RALLY, autopilot=autopilot)
    step: Step | End = work.begin()
    seen: list[tuple[TransferAction, MissionType]] = []
    held: tuple[MissionItem, ...] = ()
    while isinstance(step, Step):
        seen.append((step.action, step.kind))
        held = step.items if step.action is UPLOAD else held
        step = work.take(news(step, held if step.action is DOWNLOAD else ()))
    assert seen == [(action, kind) for kind in MissionType for action in (UPLOAD, DOWNLOAD)]
    assert step.status is CommandStatus.ACCEPTED
    assert "mission of 5 items, fence of 6 items, rally points of 1 items" in step.text


def test_an_upload_without_a_last_word_is_decided_by_reading_back() -> None:
    for same, status in ((True, CommandStatus.ACCEPTED), (False, CommandStatus.FAILED)):
        work = sending(MISSION)
        begin = work.begin()
        back = next_step(work.take(news(begin, status=CommandStatus.TIMEOUT, unconfirmed=True)))
        end = work.take(news(back, begin.items if same else begin.items[:-1]))
        assert isinstance(end, End)
        assert end.status is status
    assert "4 items instead of 5" in end.text


def test_a_refusal_names_what_is_on_the_vehicle_already() -> None:
    work = sending(MISSION, FENCE)
    begin = work.begin()
    fence = next_step(work.take(news(next_step(work.take(news(begin))), begin.items)))
    end = work.take(news(fence, status=CommandStatus.UNSUPPORTED))
    assert end == End(CommandStatus.UNSUPPORTED, "said; on the vehicle already: mission of 5 items")


def test_home_may_differ_and_nothing_else() -> None:
    work = sending(MISSION)
    begin = work.begin()
    moved = replace(begin.items[0], params=(0.0, 0.0, 0.0, 0.0, 47.0, 8.0, 400.0))
    end = work.take(news(next_step(work.take(news(begin))), (moved, *begin.items[1:])))
    assert isinstance(end, End)
    assert end.status is CommandStatus.ACCEPTED


def test_clearing_is_read_back_too() -> None:
    work = Sending([(MISSION, ())], Autopilot.ARDUPILOT)
    begin = work.begin()
    assert (begin.action, begin.items) == (CLEAR, ())
    home = MissionItem(16, 0, (0.0,) * 7)
    end = work.take(news(next_step(work.take(news(begin))), (home,)))
    assert isinstance(end, End)
    assert (end.status, "mission cleared" in end.text) == (CommandStatus.ACCEPTED, True)

    work = Sending([(MISSION, ())], Autopilot.ARDUPILOT)
    left = work.take(news(next_step(work.take(news(work.begin()))), (home, home)))
    assert isinstance(left, End)
    assert left.status is CommandStatus.FAILED


def test_fetching_takes_all_three_and_does_without_what_is_not_supported() -> None:
    held = {kind: items_of_part(PLAN, kind, Autopilot.ARDUPILOT) for kind in MissionType}
    for supported in (True, False):
        work = Fetching(Autopilot.ARDUPILOT)
        found: Step | End | Downloaded = work.begin()
        while isinstance(found, Step):
            refuses = not supported and found.kind is not MISSION
            status = CommandStatus.UNSUPPORTED if refuses else CommandStatus.ACCEPTED
            found = work.take(news(found, () if refuses else held[found.kind], status))
        assert isinstance(found, Downloaded)
        assert len(found.mission.items) == 5
        assert found.mission.home == PLAN.mission.home
        assert (found.fence == PLAN.fence, found.rally == PLAN.rally) == (supported, supported)
        assert found.unsupported == (() if supported else ("fence", "rally points"))


def test_what_makes_no_plan_is_told() -> None:
    work = Fetching(Autopilot.PX4)
    fence = next_step(work.take(news(work.begin(), ())))
    rally = next_step(work.take(news(fence, fence_items(PLAN.fence)[:3])))
    end = work.take(news(rally, ()))
    assert isinstance(end, End)
    assert (end.status, "polygon of 4 vertices" in end.text) == (CommandStatus.FAILED, True)


def test_fence_and_rally_points_as_items() -> None:
    assert fence_of_items(fence_items(PLAN.fence)) == PLAN.fence
    assert rally_of_items(rally_items(PLAN.rally)) == PLAN.rally
    assert [(i.command, i.params[0]) for i in fence_items(PLAN.fence)] == [(5000, 0), *[(5001, 4)] * 4, (5004, 60.5)]
    stranger = MissionItem(16, 0, (0.0, 0.0, 0.0, 0.0, 47.0, 8.0, 0.0))
    for read in (fence_of_items, rally_of_items):
        with pytest.raises(ValueError, match="item 0: NAV_WAYPOINT"):
            read([stranger])
    endless = MissionItem(5001, 0, (math.nan, 0.0, 0.0, 0.0, 47.0, 8.0, 0.0))
    with pytest.raises(ValueError, match="do not follow"):
        fence_of_items([endless])


def waypoint(**change: float) -> MissionItem:
    values = {"p1": 2.0, "p2": 5.0, "p3": 0.0, "p4": 90.0, "x": 47.0, "y": 8.0, "z": 50.0, **change}
    p1, p2, p3, p4, x, y, z = values.values()
    return MissionItem(16, 3, (p1, p2, p3, p4, x, y, z))


@pytest.mark.parametrize(
    ("sent", "held", "wrong", "dropped"),
    [
        (waypoint(z=50.123), waypoint(z=50.12), 0, 0), (waypoint(x=47.00000001), waypoint(), 0, 0),
        (waypoint(p1=0.1), waypoint(p1=0.10000000149), 0, 0), (waypoint(p4=math.nan), waypoint(p4=0.0), 0, 0),
        (waypoint(), waypoint(p2=0.0), 0, 1), (waypoint(p1=2.5), waypoint(p1=2.0), 1, 0),
        (waypoint(), waypoint(z=50.1), 1, 0), (waypoint(), waypoint(x=47.000001), 1, 0),
        (waypoint(), waypoint(z=0.0), 1, 0), (waypoint(), waypoint(p4=math.nan), 1, 0),
        (waypoint(), replace(waypoint(), frame=0), 1, 0), (waypoint(), replace(waypoint(), command=19), 1, 0),
        (replace(waypoint(), frame=6), waypoint(), 0, 0),
    ],
)  # fmt: skip
def test_what_counts_as_the_same(sent: MissionItem, held: MissionItem, wrong: int, dropped: int) -> None:
    found = compare([sent], [held])
    assert (len(found.wrong), len(found.dropped), found.same) == (wrong, dropped, wrong == 0)
    assert told(["a", "b", "c", "d", "e"]) == "a; b; c; and 2 more"


@pytest.mark.skipif(not RECORDED.exists(), reason="the recorded flights are not part of the repository")
def test_a_recorded_ardupilot_holds_what_it_was_sent() -> None:
    """What a plane's ArduPilot 4.7 was sent by another program, and what it gave back."""
    up: list[MissionItem] = []
    down: list[MissionItem] = []
    for packet in MavlinkFramer().feed(RECORDED.read_bytes()):
        if isinstance(packet, RawPacket) and packet.msg_id == 73:
            (up if packet.system_id == 255 else down).append(item_of_message(packet.decode()))
    assert (len(up), len(down)) == (7, 7)

    sent, held = (items_of_vehicle(items, Autopilot.ARDUPILOT) for items in (up, down))
    assert [item.command for item in sent] == [22, 16, 16, 16, 16, 177]
    assert (sent[5].frame, held[5].frame) == (2, 0)
    assert compare(sent, held).wrong == compare(sent, held).dropped == ()
    assert home_of_vehicle(up, Autopilot.ARDUPILOT) is not None
    assert home_of_vehicle(down, Autopilot.ARDUPILOT) is None  # it had no home yet
