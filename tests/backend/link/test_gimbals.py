"""Gimbals by protocol v2: control asked for at the manager, its status read, angles sent, control handed back."""

import math
from typing import Any

import pytest

from backend.link.events import CommandResult, CommandStatus
from backend.link.gimbals import pitch_yaw
from backend.link.link import UnknownVehicleError, VehicleLink
from tests.backend.link.wire import Sender, dialect, parsed

T0_US = 1_700_000_000_000_000
GIMBAL_ID = 154


def status(system_id: int, component_id: int) -> Any:
    return dialect.MAVLink_gimbal_manager_status_message(1000, 0, 0, system_id, component_id, 0, 0)


def link_with_vehicle() -> VehicleLink:
    link = VehicleLink(rates_hz={})
    link.receive(Sender().heartbeat(), T0_US)
    link.tick(T0_US)
    link.data_to_send()
    return link


def to_gimbal(link: VehicleLink, t_us: int) -> list[Any]:
    link.tick(t_us)
    return [m for m in parsed(link.data_to_send()) if m.get_type() not in ("HEARTBEAT", "TIMESYNC")]


def test_the_autopilot_is_asked_for_control_until_a_manager_is_heard() -> None:
    link = link_with_vehicle()

    link.take_gimbal(1)
    (asked,) = to_gimbal(link, T0_US + 1)

    assert (asked.get_type(), asked.command, asked.target_component) == ("COMMAND_LONG", 1001, 1)
    # Ourselves in primary control, the secondary as it is, all gimbals.
    assert (asked.param1, asked.param2, asked.param3, asked.param4, asked.param7) == (255, 190, -1, -1, 0)


def test_control_is_seen_only_in_the_manager_s_status() -> None:
    """An accepted command is not yet control: somebody may have taken it since."""
    link, gimbal = link_with_vehicle(), Sender(1, GIMBAL_ID)
    link.receive(gimbal.pack(status(0, 0)), T0_US)
    command_id = link.take_gimbal(1)
    (asked,) = to_gimbal(link, T0_US + 1)
    link.receive(gimbal.ack(1001, 0), T0_US + 2)
    (rate,) = to_gimbal(link, T0_US + 3)
    events = link.receive(gimbal.ack(511, 0), T0_US + 4)

    assert asked.target_component == GIMBAL_ID
    assert (rate.command, rate.param1) == (511, 281)
    (result,) = [event for event in events if isinstance(event, CommandResult)]
    assert (result.command_id, result.status) == (command_id, CommandStatus.ACCEPTED)
    manager = link.vehicles[1].gimbals.manager
    assert manager is not None
    assert not manager.obeys(255, 190)

    link.receive(gimbal.pack(status(255, 190)), T0_US + 5)
    manager = link.vehicles[1].gimbals.manager
    assert manager is not None
    assert manager.obeys(255, 190)


def test_control_is_handed_back_only_if_it_is_ours() -> None:
    link = link_with_vehicle()

    link.release_gimbal(1)
    (asked,) = to_gimbal(link, T0_US + 1)

    assert (asked.command, asked.param1, asked.param2) == (1001, -3, -3)


def test_angles_go_to_the_manager() -> None:
    link = link_with_vehicle()
    link.receive(Sender(1, GIMBAL_ID).pack(status(255, 190)), T0_US)

    link.point_gimbal(1, math.radians(-80.0), math.radians(15.0))
    (told,) = to_gimbal(link, T0_US + 1)

    assert (told.get_type(), told.target_system, told.target_component) == ("GIMBAL_MANAGER_SET_PITCHYAW", 1, GIMBAL_ID)
    assert math.degrees(told.pitch) == pytest.approx(-80.0, abs=1e-5)
    assert math.degrees(told.yaw) == pytest.approx(15.0, abs=1e-5)
    assert math.isnan(told.pitch_rate)
    assert math.isnan(told.yaw_rate)
    # Against the horizon, yaw from the vehicle's nose.
    assert told.flags == 4 | 8 | 32


def test_yaw_may_be_from_north() -> None:
    assert pitch_yaw(1, 1, 0.0, 1.0, earth=True).flags == 4 | 8 | 16 | 64


def test_an_angle_that_is_none_is_not_sent() -> None:
    with pytest.raises(ValueError, match="cannot be pointed"):
        pitch_yaw(1, 1, math.nan, 0.0)


def test_a_vehicle_never_heard_has_no_gimbal() -> None:
    link = link_with_vehicle()
    for ask in (link.take_gimbal, link.release_gimbal, lambda vehicle: link.point_gimbal(vehicle, 0.0, 0.0)):
        with pytest.raises(UnknownVehicleError):
            ask(9)
