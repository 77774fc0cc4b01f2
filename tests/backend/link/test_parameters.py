"""The parameter protocol against an autopilot that follows a script: late, twice, another name, never, restarts."""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from dataclasses import dataclass, field
from functools import cache
from typing import Any

import pytest
from hypothesis import given
from hypothesis import strategies as st
from pymavlink import mavutil

from backend.link.events import Autopilot, ParameterNews, ParameterStatus, VehicleRebooted
from backend.link.link import VehicleLink
from backend.link.parameters import ParameterChannel, decode_value, encode_value, spellings
from tests.backend.link.wire import ARDUPILOT, PX4, Sender, dialect, parsed
from tests.shared_data import shared_data

T_US = 1_760_000_000_000_000
TICK_US = 50_000
INT32, REAL32, INT8 = 6, 9, 2
ASKED = ("PARAM_REQUEST_READ", "PARAM_SET")


def bits(value: int) -> float:
    """The bytes of an integer as the float that has the same, as PX4 sends it."""
    return float(struct.unpack("<f", struct.pack("<i", value))[0])


@dataclass
class Script:
    """Holds parameters as wire values and types. ``rules`` are taken one for each message that is asked."""

    held: dict[str, tuple[float, int]]
    rules: list[Callable[[list[Any]], list[Any]]] = field(default_factory=list)
    heard: list[Any] = field(default_factory=list)

    def answer(self, m: Any) -> list[Any]:
        self.heard.append(m)
        usual = []
        if m.param_id in self.held:
            if m.get_type() == "PARAM_SET":
                self.held[m.param_id] = (m.param_value, self.held[m.param_id][1])
            usual = [self.value(m.param_id)]
        return self.rules.pop(0)(usual) if self.rules else usual

    def value(self, name: str) -> Any:
        return dialect.MAVLink_param_value_message(name.encode(), *self.held[name], 2, 65535)


def nothing(_: list[Any]) -> list[Any]:
    return []


def twice(usual: list[Any]) -> list[Any]:
    return usual * 2


class Talk:
    """A link and a scripted autopilot on it; time passes in ticks."""

    def __init__(self, held: dict[str, tuple[float, int]], autopilot: int = ARDUPILOT) -> None:
        self.script = Script(held)
        self.wire = Sender()
        self.link = VehicleLink(rates_hz={})
        self.t_us = T_US
        self.kind = autopilot
        self.late: list[tuple[int, bytes]] = []
        self.delay_us = 0
        self.news: list[ParameterNews] = []
        self.link.receive(self.wire.heartbeat(autopilot=autopilot), self.t_us)

    def run(self, seconds: float, *, heartbeats: bool = True) -> list[ParameterNews]:
        before = len(self.news)
        for number in range(round(seconds * 1e6 / TICK_US)):
            self.t_us += TICK_US
            if heartbeats and number % 20 == 0:
                self.take(self.wire.heartbeat(autopilot=self.kind))
            self.keep(self.link.tick(self.t_us))
            for message in parsed(self.link.data_to_send()):
                if message.get_type() in ASKED:
                    answers = [self.wire.pack(answer) for answer in self.script.answer(message)]
                    self.late += [(self.t_us + self.delay_us, answer) for answer in answers]
            while self.late and self.late[0][0] <= self.t_us:
                self.take(self.late.pop(0)[1])
        return self.news[before:]

    def take(self, data: bytes) -> None:
        self.keep(self.link.receive(data, self.t_us))

    def keep(self, events: list[Any]) -> None:
        self.news += [event for event in events if isinstance(event, ParameterNews)]

    def asked(self, kind: str) -> list[str]:
        return [m.param_id for m in self.script.heard if m.get_type() == kind]


def copter() -> Talk:
    return Talk({"GPS1_TYPE": (1.0, INT8), "VISO_DELAY_MS": (10.0, INT32), "VISO_POS_M_NSE": (0.25, REAL32)})


def test_several_are_read_and_told_by_the_names_asked() -> None:
    talk = copter()
    request_id = talk.link.read_parameters(1, ["GPS1_TYPE", "VISO_POS_M_NSE", "GPS1_TYPE"])
    news = talk.run(1.0)

    assert [(n.asked, n.value, n.status) for n in news] == [
        ("GPS1_TYPE", 1.0, ParameterStatus.KNOWN), ("VISO_POS_M_NSE", 0.25, ParameterStatus.KNOWN),
    ]  # fmt: skip
    assert {n.request_id for n in news} == {request_id}
    assert all(m.param_index == -1 and m.target_system == 1 for m in talk.script.heard)


def test_a_lost_question_is_repeated_and_an_answer_that_comes_twice_is_told_once() -> None:
    talk = copter()
    talk.script.rules = [nothing, twice]
    talk.link.read_parameters(1, ["VISO_DELAY_MS"])
    news = talk.run(3.0)

    assert [(n.value, n.status) for n in news] == [(10.0, ParameterStatus.KNOWN)]
    assert talk.asked("PARAM_REQUEST_READ") == ["VISO_DELAY_MS"] * 2


def test_a_late_answer_is_taken_and_the_one_after_it_means_nothing() -> None:
    talk = copter()
    talk.delay_us = 1_400_000
    talk.link.read_parameters(1, ["VISO_DELAY_MS"])
    news = talk.run(4.0)

    assert [n.value for n in news] == [10.0]


def test_the_value_of_another_name_answers_nothing() -> None:
    talk = copter()
    talk.script.rules = [lambda _: [talk.script.value("GPS1_TYPE")]] * 3
    talk.link.read_parameters(1, ["VISO_DELAY_MS"])
    news = talk.run(5.0)

    assert [(n.status, n.value) for n in news] == [(ParameterStatus.UNKNOWN, None)]


def test_a_name_that_is_not_there_is_unknown_after_three_questions() -> None:
    talk = copter()
    talk.link.read_parameters(1, ["NO_SUCH"])
    assert talk.run(2.5) == []
    (news,) = talk.run(1.5)

    assert (news.status, news.value) == (ParameterStatus.UNKNOWN, None)
    assert talk.asked("PARAM_REQUEST_READ") == ["NO_SUCH"] * 3


@pytest.mark.parametrize(("asked", "held"), [("GPS1_TYPE", "GPS_TYPE"), ("GPS_TYPE", "GPS1_TYPE")])
def test_the_other_spelling_is_tried(asked: str, held: str) -> None:
    talk = Talk({held: (14.0, INT8)})
    talk.link.read_parameters(1, [asked])
    (news,) = talk.run(6.0)

    assert (news.asked, news.name, news.value) == (asked, held, 14.0)


def test_what_was_written_is_what_came_back() -> None:
    talk = copter()
    talk.script.rules = [twice]  # the second reading's old value comes after the write was sent
    talk.link.write_parameter(1, "GPS1_TYPE", 14)
    (news,) = talk.run(3.0)

    assert (news.status, news.value, news.text) == (ParameterStatus.WRITTEN, 14.0, "was 1, is 14")
    assert talk.script.held["GPS1_TYPE"] == (14.0, INT8)
    (sent,) = [m for m in talk.script.heard if m.get_type() == "PARAM_SET"]
    assert (sent.param_value, sent.param_type) == (14.0, INT8)


def test_a_lost_write_is_repeated() -> None:
    talk = copter()
    talk.script.rules = [lambda usual: usual, nothing]
    talk.link.write_parameter(1, "VISO_POS_M_NSE", 0.1)
    (news,) = talk.run(3.0)

    assert (news.status, news.value) == (ParameterStatus.WRITTEN, pytest.approx(0.1, rel=1e-7))
    assert len(talk.asked("PARAM_SET")) == 2


def test_a_value_that_the_vehicle_does_not_keep_is_refused() -> None:
    talk = copter()
    stubborn = dialect.MAVLink_param_value_message(b"GPS1_TYPE", 1.0, INT8, 2, 0)
    talk.script.rules = [lambda usual: usual, *[lambda _: [stubborn]] * 3]
    talk.link.write_parameter(1, "GPS1_TYPE", 14)
    (news,) = talk.run(5.0)

    assert (news.status, news.value) == (ParameterStatus.REFUSED, 1.0)
    assert news.text == "the vehicle keeps it at 1 instead of 14"


@pytest.mark.parametrize(("value", "words"), [(14.5, "whole number"), (200.0, "from -128 to 127")])
def test_what_the_type_cannot_hold_is_not_sent(value: float, words: str) -> None:
    talk = copter()
    talk.link.write_parameter(1, "GPS1_TYPE", value)
    (news,) = talk.run(3.0)

    assert news.status is ParameterStatus.REFUSED
    assert words in news.text
    assert not talk.asked("PARAM_SET")


def test_a_restart_ends_a_write_and_repeats_a_read() -> None:
    talk = copter()
    for number in range(10):
        talk.t_us += 40_000
        talk.take(talk.wire.attitude(60_000 + 40 * number))
    talk.script.rules = [lambda usual: usual, nothing, nothing, nothing]
    talk.link.write_parameter(1, "GPS1_TYPE", 14)
    talk.run(0.2)
    talk.link.read_parameters(1, ["VISO_DELAY_MS"])
    talk.run(0.2)
    talk.script.rules = []
    restarted = []
    for number in range(5):
        restarted += talk.link.receive(talk.wire.attitude(2_000 + 40 * number), talk.t_us + 40_000 * number)
    talk.keep(restarted)
    talk.run(1.0)

    assert any(isinstance(event, VehicleRebooted) for event in restarted)
    assert [(n.asked, n.status) for n in talk.news] == [
        ("GPS1_TYPE", ParameterStatus.TIMEOUT), ("VISO_DELAY_MS", ParameterStatus.KNOWN),
    ]  # fmt: skip


def test_a_vehicle_that_falls_silent_ends_everything() -> None:
    talk = copter()
    talk.script.rules = [nothing] * 50
    talk.link.read_parameters(1, [f"NAME_{number}" for number in range(6)])
    news = talk.run(6.0, heartbeats=False)

    assert len(news) == 6
    assert all(n.status in (ParameterStatus.TIMEOUT, ParameterStatus.UNKNOWN) for n in news)
    assert any(n.status is ParameterStatus.TIMEOUT for n in news)


def test_a_clock_that_is_set_back_leaves_nothing_waiting() -> None:
    talk = copter()
    talk.script.rules = [nothing]
    talk.link.read_parameters(1, ["VISO_DELAY_MS"])
    talk.run(0.2)
    talk.t_us -= 3_600_000_000
    assert [n.value for n in talk.run(2.0)] == [10.0]


def test_few_are_in_flight_at_a_time() -> None:
    channel = ParameterChannel(1, 1, Autopilot.ARDUPILOT)
    channel.read(1, [f"NAME_{number}" for number in range(20)])
    channel.tick(T_US)
    assert len(channel.take_messages()) == 4


def test_px4_s_integers_are_bytes_and_its_floats_numbers() -> None:
    talk = Talk({"EKF2_AGP_CTRL": (bits(1), INT32), "EKF2_EV_DELAY": (20.0, REAL32)}, PX4)
    talk.link.read_parameters(1, ["EKF2_AGP0_CTRL", "EKF2_EV_DELAY"])
    read = talk.run(6.0)
    talk.link.write_parameter(1, "EKF2_AGP_CTRL", 3)
    (written,) = talk.run(2.0)

    assert {n.asked: n.value for n in read} == {"EKF2_AGP0_CTRL": 1.0, "EKF2_EV_DELAY": 20.0}
    assert written.status is ParameterStatus.WRITTEN
    assert talk.script.held["EKF2_AGP_CTRL"][0] == bits(3)


# What has the bytes of a signalling NaN does not pass through a float on every machine.
@given(st.integers(-4_000_000, 2_000_000_000))
def test_an_integer_survives_both_encodings(value: int) -> None:
    wire = encode_value(value, INT32, Autopilot.PX4)
    assert decode_value(struct.unpack("<f", struct.pack("<f", wire))[0], INT32, Autopilot.PX4) == value
    if abs(value) <= 2**24:
        cast = encode_value(value, INT32, Autopilot.ARDUPILOT)
        assert decode_value(struct.unpack("<f", struct.pack("<f", cast))[0], INT32, Autopilot.ARDUPILOT) == value
    else:
        with pytest.raises(ValueError, match="too large"):
            encode_value(value, INT32, Autopilot.ARDUPILOT)


@pytest.mark.parametrize("name", ["", "A" * 17, "GPS TYPE", "GPS/TYPE", "TÄG"])
def test_what_is_no_name_is_not_asked_for(name: str) -> None:
    with pytest.raises(ValueError, match="no parameter's name"):
        copter().link.read_parameters(1, [name])


def test_what_is_no_number_is_not_written() -> None:
    with pytest.raises(ValueError, match="cannot be nan"):
        copter().link.write_parameter(1, "GPS1_TYPE", math.nan)


def test_spellings_are_each_other_s() -> None:
    assert spellings("GPS_TYPE") == ("GPS_TYPE", "GPS1_TYPE")
    assert spellings("EK3_ENABLE") == ("EK3_ENABLE",)


# --- recorded ---


@cache
def recorded() -> tuple[Any, ...]:
    log = mavutil.mavlink_connection(str(shared_data("telemetry/ext_switch.tlog")), dialect="ardupilotmega")
    found = []
    while (message := log.recv_match(type=["PARAM_VALUE", "PARAM_SET"])) is not None:
        found.append(message)
    return tuple(found)


def test_a_recorded_write_is_sent_as_it_was_and_its_answer_read() -> None:
    """The write that cut the simulated receiver of a flight; ArduPilot answered with the new value at once."""
    log = recorded()
    (sent,) = [m for m in log if m.get_type() == "PARAM_SET"]
    came = [m for m in log if m.get_type() == "PARAM_VALUE" and m.param_id == sent.param_id][-1]
    channel = ParameterChannel(1, 1, Autopilot.ARDUPILOT)
    channel.write(9, sent.param_id, sent.param_value)
    channel.tick(T_US)
    channel.take_messages()
    before = dialect.MAVLink_param_value_message(sent.param_id.encode(), 1.0, came.param_type, 1, 0)
    assert channel.receive(before, T_US) == []
    (ours,) = channel.take_messages()
    (news,) = channel.receive(came, T_US)

    assert (ours.param_id, ours.param_value) == (sent.param_id, sent.param_value)
    assert (news.status, news.value) == (ParameterStatus.WRITTEN, 0.0)
