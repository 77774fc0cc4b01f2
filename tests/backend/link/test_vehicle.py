from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from backend.link.events import (
    Autopilot,
    LinkEvent,
    SampleEvent,
    TelemetryBattery,
    TelemetryHeartbeat,
    TelemetryLocalPosition,
    VehicleType,
)
from backend.link.framing import MavlinkFramer, RawPacket
from backend.link.vehicle import Vehicle
from estimator.types import GnssSample, InertialSample
from tests.backend.link.wire import Sender

T_US = 1_760_000_000_000_000


def _vehicle(autopilot: Autopilot = Autopilot.ARDUPILOT) -> Vehicle:
    heartbeat = TelemetryHeartbeat(T_US, 1, autopilot, VehicleType.MULTIROTOR, False, "GUIDED", False)
    return Vehicle(heartbeat, 1, None)


def _take(vehicle: Vehicle, message: Any, t_us: int = T_US) -> list[LinkEvent]:
    (packet,) = MavlinkFramer().feed(Sender().pack(message))
    assert isinstance(packet, RawPacket)
    return vehicle.receive(packet, t_us)


@pytest.mark.parametrize(("autopilot", "count"), [(Autopilot.ARDUPILOT, 1), (Autopilot.PX4, 0), (Autopilot.OTHER, 0)])
def test_raw_imu_is_used_of_ardupilot_only(autopilot: Autopilot, count: int) -> None:
    message = dialect.MAVLink_raw_imu_message(1_000_000, 0, 0, -1000, 1, 1, 1, 0, 0, 0)
    events = _take(_vehicle(autopilot), message)

    assert sum(isinstance(e, SampleEvent) and isinstance(e.sample, InertialSample) for e in events) == count


def test_a_fix_with_the_vehicle_s_calendar_time_is_mapped_through_it() -> None:
    vehicle = _vehicle()
    for i in range(3):
        stamp = dialect.MAVLink_system_time_message(1_500_000_000_000_000 + i * 1_000_000, 60_000 + 1000 * i)
        _take(vehicle, stamp, T_US + i * 1_000_000)
    fix = dialect.MAVLink_gps_raw_int_message(1_500_000_001_900_000, 3, 583_000_000, 155_000_000, 0, 1, 1, 1, 1, 9)
    (event, _) = _take(vehicle, fix, T_US + 2_100_000)

    assert isinstance(event, SampleEvent)
    assert isinstance(event.sample, GnssSample)
    assert event.sample.t_us == T_US + 1_900_000


def test_a_calendar_of_1970_is_not_believed() -> None:
    vehicle = _vehicle()
    _take(vehicle, dialect.MAVLink_system_time_message(5_000_000, 60_000))

    assert vehicle.clock.is_set
    assert vehicle.clock.unix_from_vehicle_unix(5_000_000) is None


def test_battery_status_serves_until_sys_status_tells_the_voltage() -> None:
    vehicle = _vehicle()
    cells = [11_000] + [65_535] * 9
    battery = dialect.MAVLink_battery_status_message(0, 0, 1, 2500, cells, 0, 0, 0, 50)
    status = dialect.MAVLink_sys_status_message(0, 0, 0, 0, 12_000, 0, 80, 0, 0, 0, 0, 0, 0)

    assert [type(e) for e in _take(vehicle, battery)] == [TelemetryBattery]
    assert [type(e) for e in _take(vehicle, status)] == [TelemetryBattery]
    assert _take(vehicle, battery) == []


def test_the_autopilot_s_own_local_position_has_the_time_at_which_it_was_so() -> None:
    vehicle = _vehicle(Autopilot.PX4)
    _take(vehicle, dialect.MAVLink_system_time_message(0, 60_000))
    late = T_US + 300_000
    (event,) = _take(vehicle, dialect.MAVLink_local_position_ned_message(60_200, 1, 2, -3, 0.1, 0.2, 0.3), late)

    assert isinstance(event, TelemetryLocalPosition)
    assert event.t_us == T_US + 200_000
    assert event.pos_ned_m == (1.0, 2.0, -3.0)
    assert event.vel_ned_m_s == pytest.approx((0.1, 0.2, 0.3))


def test_a_local_position_without_a_number_is_none() -> None:
    message = dialect.MAVLink_local_position_ned_message(60_200, 1, float("nan"), -3, 0, 0, 0)

    assert _take(_vehicle(Autopilot.PX4), message) == []
