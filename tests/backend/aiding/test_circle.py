"""What an autopilot that is told where it is says of its own place comes back to no estimator as if it were GPS."""

from __future__ import annotations

from typing import Any

import pytest

from backend.fleet.fleet import Fleet
from backend.fleet.vehicle import LiveVehicle
from backend.link.link import VehicleLink
from estimator.types import AttitudeSample, GnssSample, HomeSample, Sample
from tests.backend.link.wire import Sender, dialect

T_US = 1_760_000_000_000_000
ENDPOINT = "udpin:0.0.0.0:14550"
LAT, LON = 470_000_000, 80_000_000


class Estimator:
    """Takes down what it is offered."""

    def __init__(self) -> None:
        self.offered: list[Sample] = []

    def offer(self, sample: Sample) -> None:
        self.offered.append(sample)


class Heard:
    """A link, a fleet, and an estimator for the one vehicle."""

    def __init__(self) -> None:
        self.wire, self.link, self.estimator = Sender(), VehicleLink(rates_hz={}), Estimator()
        self.placed: list[Any] = []
        self.fleet = Fleet(
            0, lambda *_, **__: None, on_heard=lambda _: None, on_place=lambda _, place: self.placed.append(place),
            on_state=lambda *_: None, on_reports=lambda *_: None,
        )  # fmt: skip
        self.take(self.wire.heartbeat())
        self.vehicle.worker = self.estimator  # type: ignore[assignment]

    @property
    def vehicle(self) -> LiveVehicle:
        return self.fleet.vehicles["1"]

    def take(self, data: bytes) -> None:
        for event in self.link.receive(data, T_US):
            self.fleet.take(ENDPOINT, event)

    def says(self, *messages: Any) -> None:
        for message in messages:
            self.take(self.wire.pack(message))

    def of(self, kind: type) -> list[Any]:
        return [sample for sample in self.estimator.offered if isinstance(sample, kind)]


def own_place() -> list[Any]:
    """All that an ArduPilot says of where it has itself, from its filter and from its receiver."""
    return [
        dialect.MAVLink_global_position_int_message(1000, LAT, LON, 500_000, 100_000, 300, -400, 0, 9000),
        dialect.MAVLink_local_position_ned_message(1000, 300.0, -400.0, -100.0, 3.0, -4.0, 0.0),
        dialect.MAVLink_gps_global_origin_message(LAT, LON, 400_000, 0),
        dialect.MAVLink_ahrs2_message(0.1, 0.1, 0.1, 500.0, LAT, LON),
        dialect.MAVLink_vfr_hud_message(12.0, 12.0, 90, 50, 500.0, 0.0),
        dialect.MAVLink_odometry_message(
            1000, 1, 12, 1.0, 2.0, 3.0, [1.0, 0.0, 0.0, 0.0], 0, 0, 0, 0, 0, 0, [0.0] * 21, [0.0] * 21, 0, 8, 90
        ),
    ]


def gps_raw(fix_type: int = 3) -> Any:
    return dialect.MAVLink_gps_raw_int_message(1_000_000, fix_type, LAT, LON, 500_000, 80, 80, 500, 0, 10)


def home(lat: int = LAT) -> Any:
    return dialect.MAVLink_home_position_message(lat, LON, 400_000, 0, 0, 0, [1.0, 0.0, 0.0, 0.0], 0, 0, 0, 0)


@pytest.mark.parametrize("aided", [False, True])
def test_nothing_of_its_filter_s_place_is_ever_a_sample(aided: bool) -> None:
    heard = Heard()
    heard.vehicle.aided = aided
    heard.says(*own_place())

    assert heard.estimator.offered == []
    assert heard.vehicle.own_position is not None
    assert heard.vehicle.origin is not None


def test_its_attitude_goes_on_to_be_one() -> None:
    """Its filter makes it of gyroscopes and compass: the check of parameters keeps the heading out of what is sent."""
    heard = Heard()
    heard.vehicle.aided = heard.vehicle.gps_is_echo = True
    heard.take(heard.wire.attitude(1000))
    assert len(heard.of(AttitudeSample)) == 1


def test_what_comes_back_of_gps_input_is_no_gps() -> None:
    heard = Heard()
    heard.vehicle.gps_is_echo = True
    heard.says(gps_raw())

    assert heard.of(GnssSample) == []
    assert heard.placed == []
    assert heard.vehicle.gps is not None
    assert not heard.vehicle.gps.has_fix
    assert heard.vehicle.tracks["gps"].pieces(0) == []
    told = heard.vehicle.gps_message()
    assert told is not None
    assert (told["used"], told["lat_deg"]) == (False, None)


def test_a_receiver_s_own_fix_stays_one_where_nothing_is_sent_in_its_place() -> None:
    heard = Heard()
    heard.vehicle.aided = True
    heard.says(gps_raw())
    assert len(heard.of(GnssSample)) == 1


def test_a_home_that_moves_while_it_is_told_where_it_is_is_not_taken() -> None:
    """ArduPilot moves its home to where it has itself, as long as it stands disarmed."""
    heard = Heard()
    heard.says(home())
    heard.vehicle.aided = True
    heard.says(home(LAT + 5000))

    assert len(heard.of(HomeSample)) == 1
    assert heard.vehicle.home == heard.of(HomeSample)[0]


def test_a_first_home_is_taken_at_any_time() -> None:
    heard = Heard()
    heard.vehicle.aided = True
    heard.says(home())
    assert heard.vehicle.home is not None
