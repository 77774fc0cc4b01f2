"""The simulated autopilot's missions, asked by the station's own link; and it flies on as if nothing had been asked."""

from __future__ import annotations

import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from backend.link.events import Autopilot, CommandStatus, TransferAction, TransferNews
from backend.link.link import VehicleLink
from backend.link.mission_items import items_for_vehicle, items_of_vehicle
from guidance.mission import Home, Mission, MissionItem, MissionType
from simulator.mission_store import MissionStore
from simulator.scenario import Scenario
from simulator.simulation import Simulation
from simulator.world.world import World

START_US = 1_760_000_000_000_000
MISSION = Mission(
    (
        MissionItem(22, 3, (15.0, 0.0, 0.0, math.nan, 47.397742, 8.546921, 60.0)),
        MissionItem(16, 3, (2.5, 1.0, 0.25, 90.0, -47.4022336, -8.5522294, 80.123)),
        MissionItem(177, 2, (1.0, 3.0, 0.0, 0.0, 0.0, 0.0, 0.0)),
    ),
    Home(47.0, 8.0, 400.0),
)


class Flight:
    """A simulation and a link, byte by byte, on the simulation's clock."""

    def __init__(self, scenario: Scenario, world: World) -> None:
        self.simulation = Simulation(scenario, world, 7, START_US)
        self.link = VehicleLink(rates_hz={})
        self.news: list[TransferNews] = []

    def fly(self, seconds: float, *, deaf: bool = False) -> None:
        for _ in range(round(seconds * 200)):
            output = self.simulation.step()
            for packet in output.packets:
                self._take(self.link.receive(packet, output.t_unix_us))
            self._take(self.link.tick(output.t_unix_us))
            for data in self.link.data_to_send():
                if not deaf:
                    self.simulation.receive(data)

    def _take(self, events: list[Any]) -> None:
        self.news += [event for event in events if isinstance(event, TransferNews) and event.final]


def test_a_mission_comes_back_as_it_was_sent_and_the_flight_is_the_same(scenario: Scenario, world: World) -> None:
    flight, undisturbed = Flight(scenario, world), Flight(scenario, world)
    flight.fly(1.5)
    items = items_for_vehicle(MISSION, Autopilot.ARDUPILOT)
    flight.link.transfer(1, TransferAction.UPLOAD, MissionType.MISSION, items)
    flight.link.transfer(1, TransferAction.DOWNLOAD, MissionType.MISSION)
    flight.link.transfer(1, TransferAction.UPLOAD, MissionType.FENCE, items)
    flight.fly(1.5)
    undisturbed.fly(3.0)

    up, down, fence = flight.news
    assert (up.status, down.status, fence.status) == (
        CommandStatus.ACCEPTED, CommandStatus.ACCEPTED, CommandStatus.UNSUPPORTED,
    )  # fmt: skip
    for sent, held in zip(MISSION.items, items_of_vehicle(down.items, Autopilot.ARDUPILOT), strict=True):
        assert (sent.command, sent.frame) == (held.command, held.frame)
        assert held.params == pytest.approx(sent.params, nan_ok=True, rel=1e-7)
    assert flight.simulation.state is not None
    assert undisturbed.simulation.state is not None
    assert flight.simulation.state.pos_ned_m.tolist() == undisturbed.simulation.state.pos_ned_m.tolist()


class Radio:
    """What a store says, and a station with a system id that speaks to it."""

    def __init__(self) -> None:
        self.said: list[Any] = []
        self.store = MissionStore(self.said.append)

    def say(self, message: Any, t_us: int = 0, station: int = 255) -> list[Any]:
        """Its answer."""
        self.said.clear()
        message.pack(mavlink.MAVLink(None, srcSystem=station, srcComponent=190))
        self.store.receive(message, t_us)
        return list(self.said)


def item(seq: int) -> Any:
    return mavlink.MAVLink_mission_item_int_message(1, 1, seq, 3, 16, 0, 1, 0, 0, 0, 0, 470_000_000, 80_000_000, 50.0)


def count(number: int) -> Any:
    return mavlink.MAVLink_mission_count_message(1, 1, number)


def test_it_asks_again_and_gives_up_and_keeps_what_it_had() -> None:
    radio = Radio()
    radio.say(count(1))
    assert radio.say(item(0))[0].type == mavlink.MAV_MISSION_ACCEPTED

    radio.say(count(2))
    radio.said.clear()
    for tenth in range(1, 100):
        radio.store.step(tenth * 100_000)
    assert [m.get_type() for m in radio.said] == ["MISSION_REQUEST"] * 7 + ["MISSION_ACK"]
    assert radio.said[-1].type == mavlink.MAV_MISSION_OPERATION_CANCELLED
    assert len(radio.store.items) == 1


def test_it_refuses_what_does_not_belong_to_the_transfer() -> None:
    radio = Radio()
    assert radio.say(item(0))[0].type == mavlink.MAV_MISSION_ERROR
    assert radio.say(count(701))[0].type == mavlink.MAV_MISSION_NO_SPACE
    assert radio.say(count(2))[0].seq == 0
    assert radio.say(item(1))[0].type == mavlink.MAV_MISSION_INVALID_SEQUENCE
    assert radio.say(count(2), station=254)[0].type == mavlink.MAV_MISSION_DENIED
    assert radio.say(item(0), station=254)[0].type == mavlink.MAV_MISSION_ERROR
    assert radio.say(item(0))[0].seq == 1
    assert (
        radio.say(mavlink.MAVLink_mission_request_int_message(1, 1, 0))[0].type == mavlink.MAV_MISSION_INVALID_SEQUENCE
    )
