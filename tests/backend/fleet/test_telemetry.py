import math

from backend.fleet.telemetry import Telemetry, telemetry_fields, told
from backend.link.events import (
    Autopilot,
    TelemetryBattery,
    TelemetryHeartbeat,
    TelemetryPosition,
    TelemetrySpeed,
    TelemetryWind,
    VehicleLost,
    VehicleType,
)

S_US = 1_000_000


def test_each_value_has_the_age_of_its_own_message() -> None:
    """
    Fault: the vehicle goes on with heartbeats and falls silent about everything else.
    Expected: the old values are still told, with ages that grow.
    """
    said = Telemetry()
    for t_s, event in enumerate(
        (
            TelemetryBattery(0, 7, 22.1, 80.0, 14.5),
            TelemetrySpeed(0, 7, 11.0, 9.0, 55.0),
            TelemetryPosition(0, 7, 0.8, 0.1, 520.0, 118.0, 0.0, 0.0, 0.0),
            TelemetryWind(0, 7, 4.0, math.radians(270.0)),
            TelemetryHeartbeat(0, 7, Autopilot.ARDUPILOT, VehicleType.HELICOPTER, True, "AUTO", False),
        )
    ):
        said = told(said, event, t_s * S_US)

    fields = telemetry_fields(said, 10 * S_US)
    assert (fields["battery_v"], fields["battery_a"], fields["battery_age_s"]) == (22.1, 14.5, 10.0)
    assert (fields["airspeed_m_s"], fields["airspeed_age_s"]) == (11.0, 9.0)
    assert (fields["alt_rel_m"], fields["alt_rel_age_s"]) == (118.0, 8.0)
    assert (fields["wind_speed_m_s"], round(fields["wind_from_deg"], 9), fields["wind_age_s"]) == (4.0, 270.0, 7.0)
    assert (fields["armed"], fields["flight_mode"]) == (True, "AUTO")


def test_what_was_never_said_has_no_age() -> None:
    fields = telemetry_fields(Telemetry(), 10 * S_US)

    assert {name: value for name, value in fields.items() if name.endswith("_age_s")} == dict.fromkeys(
        ("battery_age_s", "airspeed_age_s", "alt_rel_age_s", "wind_age_s")
    )


def test_other_events_change_nothing() -> None:
    said = Telemetry(battery_v=22.1)

    assert told(said, VehicleLost(S_US, 7, 0), S_US) is said
