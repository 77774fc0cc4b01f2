import math
from typing import Any

import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as dialect

from backend.link import telemetry
from backend.link.events import (
    Autopilot,
    StatusText,
    TelemetryBattery,
    TelemetryGps,
    TelemetryPosition,
    TelemetryWind,
    VehicleType,
)

GPS = dialect.MAVLink_gps_raw_int_message
T_US = 1_760_000_000_000_000


def _shown(message: Any) -> Any:
    return telemetry.TELEMETRY[message.get_msgId()](message, T_US, 1)


def _chunk(text: str, text_id: int, seq: int) -> Any:
    return dialect.MAVLink_statustext_message(3, text.encode(), text_id, seq)


@pytest.mark.parametrize(
    ("base_mode", "armed", "simulated"), [(1, False, False), (129, True, False), (161, True, True)]
)
def test_heartbeat(base_mode: int, armed: bool, simulated: bool) -> None:
    event = telemetry.heartbeat(dialect.MAVLink_heartbeat_message(4, 3, base_mode, 5, 4, 3), T_US, 1)

    assert (event.armed, event.simulated, event.mode) == (armed, simulated, "LOITER")
    assert (event.autopilot, event.vehicle_type) == (Autopilot.ARDUPILOT, VehicleType.HELICOPTER)


def test_battery_of_sys_status() -> None:
    def status(millivolt: int, percent: int) -> Any:
        return _shown(dialect.MAVLink_sys_status_message(0, 0, 0, 0, millivolt, 0, percent, 0, 0, 0, 0, 0, 0))

    assert status(11_800, 64) == TelemetryBattery(T_US, 1, 11.8, 64.0, 0.0)
    assert status(11_800, -1) == TelemetryBattery(T_US, 1, 11.8, None, 0.0)
    assert status(65_535, -1) is None


def test_battery_status_adds_up_its_cells() -> None:
    cells = [4_000, 4_000, 3_900] + [65_535] * 7
    event = _shown(dialect.MAVLink_battery_status_message(0, 0, 1, 2500, cells, 0, 0, 0, 50))

    assert_allclose(event.voltage_v, 11.9)
    assert _shown(dialect.MAVLink_battery_status_message(1, 0, 1, 2500, cells, 0, 0, 0, 50)) is None


def test_current_of_the_battery() -> None:
    def status(current_ca: int) -> Any:
        return _shown(dialect.MAVLink_sys_status_message(0, 0, 0, 0, 11_800, current_ca, 64, 0, 0, 0, 0, 0, 0))

    assert (status(1_234).current_a, status(-1).current_a) == (12.34, None)


def test_wind_is_where_it_comes_from_in_both_messages() -> None:
    # A westerly of 5 m/s: ArduPilot says where it comes from, PX4 where the air goes.
    of_ardupilot = _shown(dialect.MAVLink_wind_message(-90.0, 5.0, 0.3))
    of_px4 = _shown(dialect.MAVLink_wind_cov_message(0, 0.0, 5.0, 0.0, 1.0, 1.0, 100.0, 1.0, 1.0))

    assert isinstance(of_ardupilot, TelemetryWind)
    for wind in (of_ardupilot, of_px4):
        assert_allclose([wind.speed_m_s, math.degrees(wind.from_rad)], [5.0, 270.0])
    assert _shown(dialect.MAVLink_wind_message(math.nan, 5.0, 0.0)) is None
    assert _shown(dialect.MAVLink_wind_cov_message(0, math.nan, 5.0, 0.0, 1.0, 1.0, 100.0, 1.0, 1.0)) is None


def test_gps_with_and_without_a_fix() -> None:
    def gps(fix_type: int) -> TelemetryGps:
        event = _shown(
            dialect.MAVLink_gps_raw_int_message(0, fix_type, 583_000_000, 155_000_000, 1000, 100, 1, 0, 0, 9)
        )
        assert isinstance(event, TelemetryGps)
        return event

    assert gps(1).lat_rad is None
    assert gps(1).satellites == 9
    assert_allclose(math.degrees(gps(3).lat_rad or 0.0), 58.3)
    assert_allclose(gps(3).std_horizontal_m or 0.0, 1.5)


def test_position_in_si_units() -> None:
    event = _shown(
        dialect.MAVLink_global_position_int_message(0, 583_000_000, -155_000_000, 152_000, 52_000, 100, -200, 300, 0)
    )

    assert isinstance(event, TelemetryPosition)
    assert_allclose((math.degrees(event.lat_rad), math.degrees(event.lon_rad)), (58.3, -15.5))
    assert (event.alt_amsl_m, event.alt_rel_m) == (152.0, 52.0)
    assert_allclose((event.vn_m_s, event.ve_m_s, event.vd_m_s), (1.0, -2.0, 3.0))


def test_a_position_not_known_is_not_shown() -> None:
    assert _shown(dialect.MAVLink_global_position_int_message(0, 0, 0, 0, 0, 0, 0, 0, 0)) is None


def test_status_text_from_its_chunks_in_any_order() -> None:
    texts = telemetry.StatusTexts(1)
    assert texts.add(_chunk("b" * 50, 7, 1), 1, T_US) == []
    assert texts.add(_chunk("end", 7, 2), 1, T_US) == []

    assert texts.add(_chunk("a" * 50, 7, 0), 1, T_US) == [StatusText(T_US, 1, 1, 3, "a" * 50 + "b" * 50 + "end")]


def test_two_texts_at_once_are_kept_apart() -> None:
    texts = telemetry.StatusTexts(1)
    texts.add(_chunk("a" * 50, 7, 0), 1, T_US)
    texts.add(_chunk("b" * 50, 8, 0), 1, T_US)

    assert [e.text for e in texts.add(_chunk("x", 7, 1), 1, T_US) if isinstance(e, StatusText)] == ["a" * 50 + "x"]
    assert [e.text for e in texts.add(_chunk("y", 8, 1), 1, T_US) if isinstance(e, StatusText)] == ["b" * 50 + "y"]


def test_a_lost_chunk_leaves_a_gap_after_two_seconds() -> None:
    texts = telemetry.StatusTexts(1)
    texts.add(_chunk("a" * 50, 7, 0), 1, T_US)
    texts.add(_chunk("end", 7, 2), 1, T_US)
    assert texts.expire(T_US + 1_000_000) == []

    late = T_US + 2_100_000
    assert texts.expire(late) == [StatusText(late, 1, 1, 3, "a" * 50 + "[…]end")]
    assert texts.expire(late) == []
