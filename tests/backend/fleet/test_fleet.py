"""Link events folded into vehicles."""

import math
from dataclasses import replace
from typing import Any

import pytest

from backend.fleet.fleet import Fleet
from backend.fleet.vehicle import LiveVehicle
from backend.link.events import (
    Autopilot,
    CommandResult,
    CommandStatus,
    SampleEvent,
    TelemetryBattery,
    TelemetryGps,
    TelemetryHeartbeat,
    TelemetryMission,
    TelemetryPosition,
    VehicleAppeared,
    VehicleLost,
    VehicleType,
)
from backend.navigation.setup import Place
from estimator.types import BarometerSample, GnssSample, HomeSample

A, B = "udpin:0.0.0.0:14550", "serial:/dev/ttyUSB0:57600"


class Heard:
    def __init__(self) -> None:
        self.said: list[tuple[str, dict[str, Any]]] = []
        self.placed: list[Place | None] = []
        self.fleet = Fleet(
            0, lambda kind, /, **fields: self.said.append((kind, fields)), on_heard=lambda _: None,
            on_place=lambda _, place: self.placed.append(place), on_state=lambda *_: None, on_reports=lambda *_: None,
        )  # fmt: skip
        self.fleet.take(A, VehicleAppeared(1, 7, 1, Autopilot.ARDUPILOT, VehicleType.HELICOPTER))

    @property
    def vehicle(self) -> LiveVehicle:
        return self.fleet.vehicles["7"]

    def of(self, kind: str) -> list[dict[str, Any]]:
        return [fields for said, fields in self.said if said == kind]


def heartbeat(t_us: int, mode: str) -> TelemetryHeartbeat:
    return TelemetryHeartbeat(t_us, 7, Autopilot.ARDUPILOT, VehicleType.HELICOPTER, True, mode, True)


def gps(t_us: int, fix_type: int = 3) -> TelemetryGps:
    has = fix_type >= 3
    return TelemetryGps(
        t_us, 7, fix_type, 9, math.radians(47.0) if has else None, math.radians(8.0) if has else None,
        500.0 if has else None, 1.2 if has else None,
    )  # fmt: skip


def test_telemetry_is_a_fold_of_what_was_said() -> None:
    heard = Heard()
    heard.fleet.take(A, heartbeat(2, "AUTO"))
    heard.fleet.take(A, TelemetryBattery(3, 7, 22.1, 80.0))

    message = heard.vehicle.telemetry_message(500_003)
    assert (message["armed"], message["flight_mode"], message["simulated"]) == (True, "AUTO", True)
    assert (message["battery_v"], message["battery_pct"], message["battery_age_s"]) == (22.1, 80.0, 0.5)
    assert (message["airspeed_m_s"], message["airspeed_age_s"]) == (None, None)


@pytest.mark.parametrize(("autopilot", "numbers"), [(Autopilot.ARDUPILOT, [None, 1, 7]), (Autopilot.PX4, [1, 2, 8])])
def test_the_current_item_counts_from_one_whatever_the_vehicle_counts(
    autopilot: Autopilot, numbers: list[int | None]
) -> None:
    heard = Heard()
    heard.fleet.take(A, replace(heartbeat(1, "AUTO"), autopilot=autopilot))
    told = []
    for seq in (0, 1, 7):
        heard.fleet.take(A, TelemetryMission(2, 7, seq))
        told.append(heard.vehicle.telemetry_message(1)["mission_item"])
    assert told == numbers


def test_a_gps_without_fix_has_no_place_and_no_track() -> None:
    heard = Heard()
    heard.fleet.take(A, gps(1_000_000, fix_type=1))
    heard.fleet.take(A, gps(2_000_000))

    without, with_fix = heard.of("gps")
    assert (without["lat_deg"], without["fix_type"]) == (None, 1)
    assert abs(with_fix["lat_deg"] - 47.0) < 1e-9
    assert not with_fix["used"]  # there is no estimator yet that could use it
    assert [len(piece) for piece in heard.vehicle.tracks["gps"].pieces()] == [1]


def test_home_places_the_vehicle_before_a_fix_with_height_does() -> None:
    fix = GnssSample(1, math.radians(47), math.radians(8), 520.0, None, 1.0, 1.5, 9)  # type: ignore[arg-type]
    heard = Heard()
    heard.fleet.take(A, SampleEvent(1, 7, fix))
    assert heard.placed == []  # the height of the ground below is not known yet
    heard.fleet.take(A, TelemetryPosition(2, 7, 0.8, 0.1, 520.0, 120.0, 0, 0, 0))
    heard.fleet.take(A, SampleEvent(3, 7, fix))
    assert heard.placed[-1].alt_amsl_m == 400.0
    heard.fleet.take(A, SampleEvent(4, 7, HomeSample(4, 0.8, 0.1, 398.0)))
    assert heard.placed[-1].alt_amsl_m == 398.0
    home = heard.vehicle.telemetry_message(1)["home"]
    assert (round(math.radians(home["lat_deg"]), 9), home["alt_amsl_m"]) == (0.8, 398.0)


def test_a_second_link_takes_over_only_when_the_first_is_silent() -> None:
    heard = Heard()
    heard.fleet.take(B, heartbeat(2, "ON B"))
    assert heard.vehicle.telemetry.flight_mode is None
    heard.fleet.take(A, VehicleLost(3, 7, 1))
    assert not heard.vehicle.connected
    heard.fleet.take(B, heartbeat(4, "ON B"))

    assert (heard.vehicle.telemetry.flight_mode, heard.vehicle.endpoint, heard.vehicle.connected) == ("ON B", B, True)
    heard.fleet.take(A, heartbeat(5, "ON A"))
    assert heard.vehicle.telemetry.flight_mode == "ON B"


def test_answers_to_commands_carry_the_callers_id() -> None:
    heard = Heard()
    heard.fleet.note_command(A, 3, "my-id", "arm")
    for number, status in ((3, CommandStatus.IN_PROGRESS), (4, CommandStatus.DENIED), (3, CommandStatus.ACCEPTED)):
        heard.fleet.take(A, CommandResult(1, 7, number, 400, status, str(status)))
    heard.fleet.take(A, CommandResult(1, 7, 3, 400, CommandStatus.ACCEPTED, "again"))

    assert [(ack["command_id"], ack["command"], ack["status"]) for ack in heard.of("ack")] == [
        ("my-id", "arm", "in_progress"),
        ("my-id", "arm", "accepted"),
    ]


def test_a_link_that_the_vehicle_has_left_still_answers_what_was_asked_on_it() -> None:
    heard = Heard()
    heard.fleet.note_command(A, 3, "my-id", "arm")
    heard.fleet.take(A, VehicleLost(3, 7, 1))
    heard.fleet.take(B, heartbeat(4, "ON B"))
    heard.fleet.take(A, CommandResult(5, 7, 3, 400, CommandStatus.TIMEOUT, "no answer"))

    assert [said["status"] for said in heard.of("ack")] == ["timeout"]
    assert not heard.fleet._commands


def test_a_vehicle_that_long_tells_no_place_is_set_up_without_one() -> None:
    """Expected: nothing for ten seconds of samples, then a set-up without a place, and a home that comes counts."""
    heard = Heard()
    for t_s in (1, 5, 10):
        heard.fleet.take(A, SampleEvent(t_s * 1_000_000, 7, BarometerSample(t_s * 1_000_000, 300.0)))
    early = list(heard.placed)
    heard.fleet.take(A, SampleEvent(12_000_000, 7, BarometerSample(12_000_000, 300.0)))
    late = list(heard.placed)
    heard.fleet.take(A, SampleEvent(13_000_000, 7, HomeSample(13_000_000, 0.82, 0.14, 400.0)))

    assert early == []
    assert late == [None]
    assert heard.placed[-1] == Place(0.82, 0.14, 400.0)
