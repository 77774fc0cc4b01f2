"""The mission protocol against an autopilot that follows a script: rejects, is silent, late, doubled, restarts."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink.dialects.v20 import ardupilotmega as dialect

from backend.link.events import Autopilot, CommandStatus, LinkEvent, TransferAction, TransferNews
from backend.link.link import VehicleLink
from backend.link.mission_items import home_of_vehicle, item_message, items_for_vehicle, items_of_vehicle
from backend.link.missions import MissionChannel
from guidance.mission import Home, Mission, MissionItem, MissionType
from tests.backend.link.wire import Sender, parsed

T_US = 1_760_000_000_000_000
TICK_US = 50_000
US = (255, 190)
UPLOAD, DOWNLOAD, CLEAR = TransferAction.UPLOAD, TransferAction.DOWNLOAD, TransferAction.CLEAR


def waypoint(number: int) -> MissionItem:
    return MissionItem(16, 3, (0.0, 2.0, 0.0, math.nan, 47.3977420 + number * 1e-4, 8.5455940, 50.0 + number))


ITEMS = tuple(waypoint(number) for number in range(4))


@dataclass
class ScriptedAutopilot:
    """Keeps a list of items as the protocol wants, unless a rule for a message says otherwise.

    ``rules[kind]`` are taken one for each message of that kind: each gives what is sent instead of the usual answer.
    """

    held: list[Any] = field(default_factory=list)
    rules: dict[str, list[Callable[[Any, list[Any]], list[Any]]]] = field(default_factory=dict)
    heard: list[Any] = field(default_factory=list)
    to: tuple[int, int] = US
    old_requests: bool = False
    asks_again: bool = False
    heard_us: int = 0
    coming: list[Any] = field(default_factory=list)
    expected: int | None = None

    def answer(self, m: Any) -> list[Any]:
        self.heard.append(m)
        usual = self._usual(m)
        rules = self.rules.get(m.get_type(), [])
        return rules.pop(0)(m, usual) if rules else usual

    def wait(self, t_us: int) -> list[Any]:
        """Ask again for an item that does not come for a second, as ArduPilot does."""
        if not self.asks_again or self.expected is None or t_us - self.heard_us < 1_000_000:
            return []
        self.heard_us = t_us
        return [self.request(len(self.coming))]

    def restart(self) -> None:
        self.expected, self.coming = None, []

    def request(self, seq: int) -> Any:
        if self.old_requests:
            return dialect.MAVLink_mission_request_message(*self.to, seq, 0)
        return dialect.MAVLink_mission_request_int_message(*self.to, seq, 0)

    def ack(self, result: int) -> Any:
        return dialect.MAVLink_mission_ack_message(*self.to, result, 0)

    def _usual(self, m: Any) -> list[Any]:  # noqa: PLR0911  one return for each message reads best
        match m.get_type():
            case "MISSION_COUNT":
                self.expected, self.coming = m.count, []
                return [self.request(0)]
            case "MISSION_ITEM_INT":
                if self.expected is None:
                    return [self.ack(1)]
                if m.seq != len(self.coming):
                    return [self.ack(13)]
                self.coming.append(m)
                if len(self.coming) < self.expected:
                    return [self.request(len(self.coming))]
                self.held, self.expected = self.coming, None
                return [self.ack(0)]
            case "MISSION_REQUEST_LIST":
                return [dialect.MAVLink_mission_count_message(*self.to, len(self.held), 0)]
            case "MISSION_REQUEST_INT":
                return [item_message(self._item(m.seq), m.seq, MissionType.MISSION, *self.to)]
            case "MISSION_CLEAR_ALL":
                self.held = []
                return [self.ack(0)]
        return []

    def _item(self, seq: int) -> MissionItem:
        held = self.held[seq]
        return held if isinstance(held, MissionItem) else item_of(held)


def item_of(m: Any) -> MissionItem:
    return MissionItem(m.command, m.frame, (m.param1, m.param2, m.param3, m.param4, m.x / 1e7, m.y / 1e7, m.z))


def silent(_m: Any, _usual: list[Any]) -> list[Any]:
    return []


def twice(_m: Any, usual: list[Any]) -> list[Any]:
    return usual * 2


def instead(*messages: Any) -> Callable[[Any, list[Any]], list[Any]]:
    return lambda _m, _usual: list(messages)


class Talk:
    """A channel and an autopilot on one clock; ``delay_us`` is how late its answers come."""

    def __init__(self, autopilot: ScriptedAutopilot, delay_us: int = 0) -> None:
        self.channel = MissionChannel(1, 1, US)
        self.autopilot = autopilot
        self.delay_us = delay_us
        self.t_us = T_US
        self.news: list[TransferNews] = []
        self._due: list[tuple[int, Any]] = []

    def run(self, seconds: float, until: Callable[[], bool] = lambda: False) -> Talk:
        for _ in range(round(seconds * 1e6 / TICK_US)):
            due = [m for t_us, m in self._due if t_us <= self.t_us]
            self._due = [entry for entry in self._due if entry[0] > self.t_us]
            for message in due:
                self.news += self.channel.receive(message, self.t_us)
                self._deliver()
            self.news += self.channel.tick(self.t_us)
            self._deliver()
            self._due += [(self.t_us + self.delay_us, m) for m in self.autopilot.wait(self.t_us)]
            if until():
                break
            self.t_us += TICK_US
        return self

    def _deliver(self) -> None:
        for message in self.channel.take_messages():
            self.autopilot.heard_us = self.t_us
            self._due += [(self.t_us + self.delay_us, m) for m in self.autopilot.answer(message)]

    @property
    def ended(self) -> list[TransferNews]:
        return [news for news in self.news if news.final]

    @property
    def end(self) -> TransferNews:
        (end,) = self.ended
        return end


def upload(autopilot: ScriptedAutopilot, delay_us: int = 0, items: tuple[MissionItem, ...] = ITEMS) -> Talk:
    talk = Talk(autopilot, delay_us)
    talk.channel.start(5, UPLOAD, MissionType.MISSION, items)
    return talk


def download(autopilot: ScriptedAutopilot, delay_us: int = 0) -> Talk:
    talk = Talk(autopilot, delay_us)
    talk.channel.start(6, DOWNLOAD, MissionType.MISSION)
    return talk


def same(a: MissionItem, b: MissionItem) -> bool:
    return (a.command, a.frame) == (b.command, b.frame) and a.params == pytest.approx(b.params, nan_ok=True, abs=1e-9)


@pytest.mark.parametrize("old_requests", [False, True])
def test_an_upload_arrives_whole(old_requests: bool) -> None:
    autopilot = ScriptedAutopilot(old_requests=old_requests)
    talk = upload(autopilot).run(3.0)

    assert (talk.end.status, talk.end.transfer_id, talk.end.done, talk.end.total) == (CommandStatus.ACCEPTED, 5, 4, 4)
    assert [m.seq for m in autopilot.held] == [0, 1, 2, 3]
    assert [(m.x, m.y, m.z, m.frame, m.target_system) for m in autopilot.held][1] == (473978420, 85455940, 51.0, 3, 1)
    assert math.isnan(autopilot.held[0].param4)
    assert [news.done for news in talk.news if not news.final] == [1, 2, 3]


def test_a_download_gives_what_is_held_and_is_acknowledged() -> None:
    autopilot = ScriptedAutopilot(held=list(ITEMS))
    talk = download(autopilot).run(3.0)

    assert talk.end.status is CommandStatus.ACCEPTED
    assert all(map(same, talk.end.items, ITEMS))
    assert (autopilot.heard[-1].get_type(), autopilot.heard[-1].type) == ("MISSION_ACK", 0)


def test_an_empty_vehicle_and_one_that_is_cleared() -> None:
    assert download(ScriptedAutopilot()).run(1.0).end.items == ()
    autopilot = ScriptedAutopilot(held=list(ITEMS))
    talk = Talk(autopilot)
    talk.channel.start(7, CLEAR, MissionType.MISSION)
    assert talk.run(1.0).end.status is CommandStatus.ACCEPTED
    assert autopilot.held == []


@pytest.mark.parametrize(
    ("result", "status", "word"),
    [
        (1, CommandStatus.FAILED, "busy"), (2, CommandStatus.UNSUPPORTED, "frame"),
        (3, CommandStatus.UNSUPPORTED, "support"), (4, CommandStatus.DENIED, "no space"),
        (5, CommandStatus.DENIED, "invalid"), (9, CommandStatus.DENIED, "parameter 4"),
        (12, CommandStatus.DENIED, "altitude"), (14, CommandStatus.DENIED, "takes none"),
        (15, CommandStatus.CANCELLED, "cancelled"), (77, CommandStatus.FAILED, "77"),
    ],
)  # fmt: skip
def test_a_rejection_is_told_in_words(result: int, status: CommandStatus, word: str) -> None:
    autopilot = ScriptedAutopilot()
    autopilot.rules["MISSION_ITEM_INT"] = [lambda _m, usual: usual, instead(autopilot.ack(result))]
    end = upload(autopilot).run(3.0).end

    assert end.status is status
    assert word in end.text
    assert "item 1, NAV_WAYPOINT" in end.text

    autopilot.rules["MISSION_REQUEST_LIST"] = [instead(autopilot.ack(result))]
    end = download(autopilot).run(3.0).end
    assert (end.status, word in end.text, end.items) == (status, True, ())


def test_silence_is_asked_through_five_times_and_then_told() -> None:
    for begin, kind in ((upload, "MISSION_COUNT"), (download, "MISSION_REQUEST_LIST")):
        autopilot = ScriptedAutopilot(rules={kind: [silent] * 99})
        talk = begin(autopilot).run(60.0)

        assert talk.end.status is CommandStatus.TIMEOUT
        assert "no answer" in talk.end.text
        assert [m.get_type() for m in autopilot.heard] == [kind] * 6 + ["MISSION_ACK"]
        assert autopilot.heard[-1].type == 15
        assert talk.end.t_us - T_US == pytest.approx(6 * 1_500_000, abs=6 * TICK_US)


def test_silence_in_the_middle_names_how_far_it_came() -> None:
    autopilot = ScriptedAutopilot(held=list(ITEMS))
    autopilot.rules["MISSION_REQUEST_INT"] = [lambda _m, usual: usual, *[silent] * 99]
    talk = download(autopilot).run(30.0)
    assert (talk.end.status, talk.end.done, talk.end.total) == (CommandStatus.TIMEOUT, 1, 4)
    assert "after 1 of 4" in talk.end.text
    # items are asked for every 250 ms
    assert talk.end.t_us - T_US < 2_000_000

    autopilot = ScriptedAutopilot(rules={"MISSION_ITEM_INT": [lambda _m, usual: usual, *[silent] * 99]})
    end = upload(autopilot).run(60.0).end
    assert (end.status, end.unconfirmed) == (CommandStatus.TIMEOUT, False)
    assert "after 2 of 4" in end.text


def test_lost_packets_of_every_kind_are_repeated() -> None:
    kinds = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT")
    autopilot = ScriptedAutopilot(rules={kind: [silent] for kind in kinds}, asks_again=True)
    talk = upload(autopilot).run(0.01)
    autopilot.restart()  # the count was lost on its way, not only its answer
    assert talk.run(20.0).end.status is CommandStatus.ACCEPTED
    assert download(autopilot).run(20.0).end.status is CommandStatus.ACCEPTED


def test_answers_that_come_twice_change_nothing() -> None:
    kinds = ("MISSION_COUNT", "MISSION_ITEM_INT", "MISSION_REQUEST_LIST", "MISSION_REQUEST_INT")
    autopilot = ScriptedAutopilot(rules={kind: [twice] * 99 for kind in kinds})
    talk = upload(autopilot)
    talk.channel.start(6, DOWNLOAD, MissionType.MISSION)
    talk.run(30.0)

    assert [(end.transfer_id, end.status) for end in talk.ended] == [
        (5, CommandStatus.ACCEPTED), (6, CommandStatus.ACCEPTED)
    ]  # fmt: skip
    assert [m.seq for m in autopilot.held] == [0, 1, 2, 3]
    assert all(map(same, talk.ended[1].items, ITEMS))


@pytest.mark.parametrize("delay_us", [200_000, 700_000, 1_200_000])
def test_answers_that_come_late(delay_us: int) -> None:
    autopilot = ScriptedAutopilot()
    assert upload(autopilot, delay_us).run(120.0).end.status is CommandStatus.ACCEPTED
    end = download(autopilot, delay_us).run(120.0).end
    assert end.status is CommandStatus.ACCEPTED
    assert all(map(same, end.items, ITEMS))


def test_the_echo_of_an_earlier_upload_does_not_accept_the_next() -> None:
    autopilot = ScriptedAutopilot()
    autopilot.rules["MISSION_COUNT"] = [lambda _m, usual: [autopilot.ack(0), *usual]]
    autopilot.rules["MISSION_ITEM_INT"] = [lambda _m, usual: usual, instead(autopilot.ack(0)), *[silent] * 99]

    end = upload(autopilot).run(60.0).end

    assert (end.status, end.unconfirmed) == (CommandStatus.TIMEOUT, False)


def test_a_lost_last_word_is_told_as_such() -> None:
    """What became of the items only reading back can tell: nothing was refused, and nothing acknowledged."""
    autopilot = ScriptedAutopilot()
    autopilot.rules["MISSION_ITEM_INT"] = [*[lambda _m, usual: usual] * 3, silent]

    end = upload(autopilot).run(60.0).end  # the repeat of the last item meets a vehicle that has closed the transfer

    assert (end.status, end.unconfirmed) == (CommandStatus.TIMEOUT, True)
    assert len(autopilot.held) == 4


def test_requests_out_of_order_are_served_as_asked_and_nonsense_is_not() -> None:
    autopilot = ScriptedAutopilot()
    order = [3, 0, 9, 2, 1]
    sent: list[int] = []

    def next_request(m: Any, _usual: list[Any]) -> list[Any]:
        if m.get_type() == "MISSION_ITEM_INT":
            sent.append(m.seq)
        wanted = order.pop(0) if order else None
        if wanted == 9:
            return [autopilot.request(9), autopilot.request(order.pop(0))]
        return [autopilot.ack(0)] if wanted is None else [autopilot.request(wanted)]

    autopilot.rules = {"MISSION_COUNT": [next_request], "MISSION_ITEM_INT": [next_request] * 9}
    assert upload(autopilot).run(5.0).end.status is CommandStatus.ACCEPTED
    assert sent == [3, 0, 2, 1]


def test_a_vehicle_that_asks_without_end_is_left() -> None:
    autopilot = ScriptedAutopilot()
    autopilot.rules["MISSION_ITEM_INT"] = [instead(autopilot.request(0))] * 500
    end = upload(autopilot).run(60.0).end
    assert (end.status, "again and again" in end.text) == (CommandStatus.FAILED, True)


def test_a_restart_in_mid_transfer_ends_it_and_the_next_one_begins() -> None:
    for begin in (upload, download):
        autopilot = ScriptedAutopilot(held=list(ITEMS))
        talk = begin(autopilot, 100_000)
        talk.channel.start(8, DOWNLOAD, MissionType.MISSION)
        talk.run(10.0, until=lambda heard=autopilot.heard: len(heard) >= 3)
        autopilot.restart()
        talk.news += talk.channel.restarted(talk.t_us)
        talk.run(10.0)

        assert [(end.transfer_id, end.status) for end in talk.ended[1:]] == [(8, CommandStatus.ACCEPTED)]
        assert (talk.ended[0].status, "restarted" in talk.ended[0].text) == (CommandStatus.FAILED, True)
        assert talk.channel.restarted(talk.t_us) == []


def test_a_vehicle_that_restarts_unnoticed_ends_the_upload_by_its_own_words() -> None:
    autopilot = ScriptedAutopilot()
    talk = upload(autopilot, 100_000).run(10.0, until=lambda: len(autopilot.heard) >= 3)
    autopilot.restart()
    end = talk.run(60.0).end
    assert end.status is CommandStatus.FAILED
    assert not end.unconfirmed


def test_a_vehicle_that_falls_silent_ends_all() -> None:
    talk = upload(ScriptedAutopilot(rules={"MISSION_COUNT": [silent] * 9}))
    talk.channel.start(6, DOWNLOAD, MissionType.MISSION)
    talk.run(1.0)
    ends = talk.channel.abandon(talk.t_us)
    assert [(end.transfer_id, end.status) for end in ends] == [(5, CommandStatus.TIMEOUT), (6, CommandStatus.TIMEOUT)]


@pytest.mark.parametrize("to", [(254, 190), (255, 191), (0, 0)])
def test_another_stations_transfer_is_not_ours(to: tuple[int, int]) -> None:
    stranger = ScriptedAutopilot(to=to, held=list(ITEMS))
    assert upload(stranger).run(20.0).end.status is CommandStatus.TIMEOUT
    assert {m.get_type() for m in stranger.heard} == {"MISSION_COUNT", "MISSION_ACK"}
    assert download(stranger).run(20.0).end.status is CommandStatus.TIMEOUT


def test_answers_about_another_list_are_not_ours() -> None:
    talk = download(ScriptedAutopilot(rules={"MISSION_REQUEST_LIST": [silent] * 9}))
    talk.run(0.2)
    assert talk.channel.receive(dialect.MAVLink_mission_count_message(*US, 0, 1), talk.t_us) == []
    assert talk.channel.receive(dialect.MAVLink_mission_ack_message(*US, 3, 1), talk.t_us) == []


def test_a_list_that_changes_meanwhile_or_is_too_long_is_left() -> None:
    autopilot = ScriptedAutopilot(held=list(ITEMS))
    autopilot.rules["MISSION_REQUEST_INT"] = [instead(dialect.MAVLink_mission_count_message(*US, 3, 0))]
    assert "changed from 4 to 3" in download(autopilot).run(5.0).end.text
    autopilot.rules["MISSION_REQUEST_LIST"] = [instead(dialect.MAVLink_mission_count_message(*US, 65535, 0))]
    assert "65535 items" in download(autopilot).run(5.0).end.text


def test_items_that_are_no_places_are_told_with_their_number() -> None:
    autopilot = ScriptedAutopilot(held=list(ITEMS))
    bad = dialect.MAVLink_mission_item_int_message(*US, 0, 3, 16, 0, 1, 0, 0, 0, 0, 950_000_000, 0, 10.0, 0)
    autopilot.rules["MISSION_REQUEST_INT"] = [instead(bad)]
    end = download(autopilot).run(5.0).end
    assert end.status is CommandStatus.FAILED
    assert "item 0" in end.text
    assert "latitude 95" in end.text


def test_a_clock_set_back_does_not_stop_the_repeats() -> None:
    autopilot = ScriptedAutopilot(rules={"MISSION_COUNT": [silent]})
    talk = upload(autopilot).run(0.5)
    talk.t_us -= 3_600_000_000
    talk.channel.clock_set_back(talk.t_us)
    assert talk.run(10.0).end.status is CommandStatus.ACCEPTED


def test_misuse_is_refused() -> None:
    channel = MissionChannel(1, 1, US)
    for action, items in ((UPLOAD, ()), (DOWNLOAD, ITEMS), (CLEAR, ITEMS)):
        with pytest.raises(ValueError, match="upload needs items"):
            channel.start(1, action, MissionType.MISSION, items)


@given(st.lists(st.sampled_from(["usual", "lost", "twice", "late"]), max_size=60), st.integers(1, 6))
@settings(max_examples=150, deadline=None)
def test_whatever_the_radio_does_there_is_one_end_and_no_false_success(script: list[str], count: int) -> None:
    """Each answer is lost, doubled, or comes behind the next one: it ends once; accepted means all of it arrived."""
    autopilot = ScriptedAutopilot(asks_again=True)
    late: list[Any] = []
    answer = autopilot.answer

    def disturbed(m: Any) -> list[Any]:
        usual = answer(m)
        fate = script.pop(0) if script else "usual"
        out = [*(usual if fate in ("usual", "twice") else []), *(usual if fate == "twice" else []), *late]
        late.clear()
        if fate == "late":
            late.extend(usual)
        return out

    autopilot.answer = disturbed  # type: ignore[method-assign]
    items = tuple(waypoint(number) for number in range(count))
    talk = upload(autopilot, items=items).run(400.0)
    if talk.end.status is CommandStatus.ACCEPTED or talk.end.unconfirmed:
        assert [m.seq for m in autopilot.held] == list(range(count))
    script.clear()
    late.clear()
    talk.channel.start(6, DOWNLOAD, MissionType.MISSION)
    talk.run(400.0)
    assert [end.status for end in talk.ended][1:] == [CommandStatus.ACCEPTED]
    assert len(talk.ended[1].items) == len(autopilot.held)


# --- numbering ---


def test_ardupilot_has_home_in_front_and_others_count_jumps_from_zero() -> None:
    jump = MissionItem(177, 2, (2.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0))
    mission = Mission((*ITEMS, jump), Home(47.0, 8.0, 400.0))

    ardupilot = items_for_vehicle(mission, Autopilot.ARDUPILOT)
    assert (len(ardupilot), ardupilot[0].params[4:], ardupilot[5].params[0]) == (6, (47.0, 8.0, 400.0), 2.0)
    assert items_of_vehicle(ardupilot, Autopilot.ARDUPILOT) == mission.items
    assert home_of_vehicle(ardupilot, Autopilot.ARDUPILOT) == mission.home

    px4 = items_for_vehicle(mission, Autopilot.PX4)
    assert (len(px4), px4[4].params[0]) == (5, 1.0)
    assert items_of_vehicle(px4, Autopilot.PX4)[4].params[0] == 2.0
    assert home_of_vehicle(px4, Autopilot.PX4) is None
    assert items_for_vehicle(Mission(), Autopilot.ARDUPILOT) == ()


def test_what_the_wire_would_round_is_refused() -> None:
    odd = MissionItem(178, 2, (0.0, 0.0, 0.0, 0.0, 0.5, 0.0, 0.0))
    with pytest.raises(ValueError, match=r"item 1: DO_CHANGE_SPEED: parameter 5 is 0\.5"):
        items_for_vehicle(Mission((odd,)), Autopilot.PX4)


# --- through the link ---


def test_the_link_answers_at_once_and_tells_a_restart() -> None:
    link, wire = VehicleLink(), Sender()
    link.receive(wire.heartbeat(), T_US)
    link.receive(wire.attitude(90_000), T_US)
    link.tick(T_US)
    link.data_to_send()
    transfer_id = link.transfer(1, UPLOAD, MissionType.MISSION, ITEMS)
    link.tick(T_US + 1000)
    assert "MISSION_COUNT" in [m.get_type() for m in parsed(link.data_to_send())]

    link.receive(wire.pack(dialect.MAVLink_mission_request_message(*US, 0, 0)), T_US + 2000)
    (item,) = parsed(link.data_to_send())
    assert (item.get_type(), item.seq, item.x) == ("MISSION_ITEM_INT", 0, 473977420)

    events: list[LinkEvent] = []
    for step in range(20):  # a boot clock that has begun anew, and runs
        events += link.receive(wire.attitude(step * 100), T_US + 3000 + step * 100_000)
    (news,) = [event for event in events if isinstance(event, TransferNews)]
    assert (news.transfer_id, news.status) == (transfer_id, CommandStatus.FAILED)
    assert "restarted" in news.text
