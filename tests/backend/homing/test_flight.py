"""A flight home of the station in simulated time: taken over, flown, and ended safely by each of those who may."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
import pytest

from backend.fleet.telemetry import Telemetry
from backend.guided.flight import STREAM_FIRST_US, TAKEN_WITHIN_US, Moving, Order, Orders
from backend.homing.flight import PAD_FOLLOWED_US, HomeFlight, WhenLost, estimate_of
from backend.link.events import Autopilot
from estimator.types import Float, Mode
from guidance.homing import HomingConfig, HomingEstimate, HomingGuidance, HomingPhase
from guidance.route import route_through
from tests.backend.flight_maker import state
from tests.backend.landing.relative import over_pad

T0_US = 1_760_000_000_000_000
STEP_US = 100_000
HOME = np.array([120.0, 0.0, -40.0])
MODES = {Order.HOLD: "LOITER", Order.LAND: "LAND"}


@dataclass
class World:
    """A vehicle that flies the velocities it is sent, with a lag, and a velocity sense that is wrong."""

    flight: HomeFlight
    pos: Float = field(default_factory=lambda: np.array([0.0, 0.0, -40.0]))
    mode: str = "AUTO"
    drift: Float = field(default_factory=lambda: np.array((0.5, -0.4, 0.0)))
    obeys: bool = True
    armed: bool = True
    lost: bool = False
    std_m_s: float = 0.1
    page_there: bool = True
    t_us: int = T0_US
    vel: Float = field(default_factory=lambda: np.zeros(3))
    orders: list[Order] = field(default_factory=list)
    sent: list[Float] = field(default_factory=list)

    @property
    def said(self) -> Telemetry:
        return Telemetry(armed=self.armed, flight_mode=self.mode)

    def take(self, orders: Orders) -> None:
        if orders.vel_ned_m_s is not None:
            self.sent.append(orders.vel_ned_m_s)
        if orders.order is not None:
            self.orders.append(orders.order)
            if self.obeys:
                self.mode = MODES.get(orders.order, self.flight.wanted_mode)

    def step(self, *, states: bool = True) -> None:
        self.t_us += STEP_US
        told = self.sent[-1] if self.sent and self.mode == self.flight.wanted_mode else np.zeros(3)
        self.vel = self.vel + 0.8 * (told + self.drift - self.vel) * 0.1
        self.pos = self.pos + self.vel * 0.1
        if self.pos[2] >= 0.0:
            self.pos[2], self.vel = 0.0, np.zeros(3)
        if states:
            seen = HomingEstimate(
                self.pos.copy(), self.vel.copy(), 1.0, self.std_m_s, 0.0, -float(self.pos[2]), self.lost
            )
            self.take(self.flight.on_state(self.t_us, seen, Moving(self.vel.copy(), self.std_m_s), self.said))
        self.take(self.flight.tick(self.t_us, self.said, page_there=self.page_there, connected=True))

    def run(self, seconds: float, until: HomingPhase | None = None, *, states: bool = True) -> World:
        for _ in range(round(seconds / 0.1)):
            if not self.flight.active or self.flight.phase is until:
                break
            self.step(states=states)
        return self


def world(
    kind: Autopilot = Autopilot.ARDUPILOT, when_lost: WhenLost = "hold", config: HomingConfig | None = None,
    **options: Any,
) -> World:  # fmt: skip
    guidance = HomingGuidance(route_through(np.array([[0.0, 0.0, -40.0], HOME]), 6.0), config)
    return World(HomeFlight(kind, "page", T0_US, guidance, when_lost), **options)


@pytest.mark.parametrize("kind", [Autopilot.ARDUPILOT, Autopilot.PX4])
def test_it_is_flown_home_and_then_told_to_land(kind: Autopilot) -> None:
    flown = world(kind).run(200.0)

    assert flown.flight.landed
    assert flown.orders == [Order.TAKE, Order.LAND]
    assert np.hypot(*(flown.pos - HOME)[:2]) < 0.5
    assert flown.flight.reason == ""


def test_px4_hears_velocities_before_it_is_asked_to_take_them() -> None:
    flown = world(Autopilot.PX4)
    for _ in range(STREAM_FIRST_US // STEP_US - 1):
        flown.step()
        assert flown.orders == []
    assert len(flown.sent) >= STREAM_FIRST_US // STEP_US - 1
    assert flown.run(3.0, HomingPhase.FOLLOW).orders == [Order.TAKE]


def test_one_that_does_not_obey_is_left_alone() -> None:
    flown = world(obeys=False).run(TAKEN_WITHIN_US / 1e6 + 1.0)

    assert not flown.flight.active and "did not take GUIDED" in flown.flight.reason
    assert flown.orders == [Order.TAKE]


def test_whoever_changes_its_mode_flies_it() -> None:
    flown = world().run(10.0)
    flown.mode = "LOITER"
    sent = len(flown.sent)
    flown.run(2.0)

    assert not flown.flight.active and "left GUIDED for LOITER" in flown.flight.reason
    assert len(flown.sent) == sent


def test_without_its_page_it_stands_still_by_the_estimate() -> None:
    flown = world().run(12.0)
    assert flown.flight.phase is HomingPhase.FOLLOW
    flown.page_there = False
    # Braking from 6 m/s takes five seconds, and the calm loop some ten to settle.
    flown.run(20.0)
    there = flown.pos.copy()
    flown.run(30.0)

    assert flown.flight.active and flown.flight.phase is HomingPhase.HOLD
    assert "page has gone" in flown.flight.reason
    assert flown.orders == [Order.TAKE]
    assert np.linalg.norm(flown.pos - there) < 0.5


def test_a_page_that_goes_before_the_vehicle_obeys_takes_nothing_over() -> None:
    flown = world(obeys=False).run(1.0)
    flown.page_there = False
    flown.step()
    flown.mode, sent = flown.flight.wanted_mode, len(flown.sent)
    flown.run(2.0)

    assert not flown.flight.active and "page has gone" in flown.flight.reason
    assert len(flown.sent) == sent and flown.orders == [Order.TAKE]


def test_without_its_page_and_low_over_home_it_lands() -> None:
    flown = world().run(200.0, HomingPhase.TOUCHDOWN)
    flown.page_there = False
    flown.step()

    assert flown.orders == [Order.TAKE, Order.LAND]


def test_the_operator_ends_it_twice() -> None:
    flown = world().run(12.0)
    flown.take(flown.flight.abort("the operator ended it"))
    flown.run(20.0)
    there = flown.pos.copy()
    flown.run(20.0)
    assert flown.flight.phase is HomingPhase.HOLD and np.linalg.norm(flown.pos - there) < 0.5

    flown.take(flown.flight.abort("the operator ended it"))
    assert not flown.flight.active
    assert flown.orders == [Order.TAKE, Order.HOLD]


@pytest.mark.parametrize(("when_lost", "order"), [("hold", Order.HOLD), ("land", Order.LAND)])
def test_an_estimate_that_stays_lost_ends_it_as_was_wished(when_lost: WhenLost, order: Order) -> None:
    flown = world(when_lost=when_lost, config=replace(HomingConfig(), wait_s=15.0)).run(12.0)
    flown.lost, flown.std_m_s = True, 3.0
    flown.run(30.0)

    assert flown.orders == [Order.TAKE, order]
    assert "lost the place, for 15 s" in flown.flight.reason


def test_no_states_at_all_end_it_too() -> None:
    flown = world(config=replace(HomingConfig(), wait_s=15.0)).run(12.0)
    flown.run(10.0, states=False)
    assert flown.flight.phase is HomingPhase.WAIT and flown.flight.active
    flown.run(10.0, states=False)

    assert flown.orders == [Order.TAKE, Order.HOLD]


def test_a_vehicle_that_disarms_on_the_ground_has_landed() -> None:
    flown = world().run(200.0, HomingPhase.TOUCHDOWN)
    flown.armed = False
    flown.step()

    assert flown.flight.landed and not flown.flight.active


def test_a_link_that_is_lost_is_told_to_hold() -> None:
    flown = world().run(12.0)
    flown.take(flown.flight.tick(flown.t_us, flown.said, page_there=True, connected=False))

    assert flown.orders == [Order.TAKE, Order.HOLD]


def test_the_pad_must_be_followed_for_a_while() -> None:
    flight = world().flight
    seen = [(t_us, flight.seen_in(over_pad(T0_US + t_us)) and flight.pad_followed) for t_us in (0, PAD_FOLLOWED_US)]
    flight.seen_in(state(T0_US + PAD_FOLLOWED_US + 1))

    assert [bool(followed) for _, followed in seen] == [False, True]
    assert not flight.pad_followed


def test_the_estimate_says_the_worst_axis_and_whether_it_is_lost() -> None:
    flown = replace(state(T0_US, yaw_rad=0.5), mode=Mode.LOST)
    found = estimate_of(flown)

    # Variances of 1 and 4 m2 across.
    assert (found.std_m, found.lost, found.alt_agl_m) == (pytest.approx(2.0), True, 100.0)
    assert found.yaw_rad == pytest.approx(0.5)
