"""A landing of the station in simulated time: taken over, flown down, and ended safely by each of those who may."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np
import pytest

from backend.fleet.telemetry import Telemetry
from backend.guided.flight import STALE_US, STAND_STD_M_S, STREAM_FIRST_US, TAKEN_WITHIN_US, Moving, Order, Orders
from backend.landing.descent import Descent
from backend.link.events import Autopilot
from estimator.types import Float, PadMode, PadRelative
from guidance.landing import LandingConfig, LandingPhase

T0_US = 1_760_000_000_000_000
STEP_US = 50_000
CONFIG = LandingConfig()


@dataclass
class World:
    """A vehicle that flies the velocities it is sent, with a lag of 0.4 s and a velocity sense that is wrong."""

    descent: Descent
    pos: Float
    mode: str = "LOITER"
    drift: Float = field(default_factory=lambda: np.array((0.25, -0.15, 0.05)))
    obeys: bool = True
    armed: bool = True
    t_us: int = T0_US
    vel: Float = field(default_factory=lambda: np.zeros(3))
    orders: list[Order] = field(default_factory=list)
    sent: list[Float] = field(default_factory=list)
    pad_mode: PadMode = PadMode.TRACKING
    age_s: float = 0.02
    std_m_s: float = 0.03

    @property
    def said(self) -> Telemetry:
        return Telemetry(armed=self.armed, flight_mode=self.mode)

    def estimate(self) -> PadRelative:
        level = np.array((1.0, 0.0, 0.0, 0.0))
        small = np.eye(3) * 0.02**2
        return PadRelative(self.pad_mode, self.pos.copy(), self.vel.copy(), small, small, level, self.age_s)

    @property
    def moving(self) -> Moving:
        return Moving(self.vel.copy(), self.std_m_s)

    def take(self, orders: Orders) -> None:
        if orders.vel_ned_m_s is not None:
            self.sent.append(orders.vel_ned_m_s)
        if orders.order is not None:
            self.orders.append(orders.order)
            if self.obeys:
                self.mode = {Order.TAKE: self.descent.wanted_mode, Order.HOLD: "LOITER", Order.LAND: "LAND"}[
                    orders.order
                ]

    def step(self, *, state: bool = True) -> None:
        self.t_us += STEP_US
        told = self.sent[-1] if self.sent and self.mode == self.descent.wanted_mode else np.zeros(3)
        self.vel = self.vel + (told + self.drift - self.vel) * 0.05 / 0.4
        self.pos = self.pos + self.vel * 0.05
        if self.pos[2] >= -CONFIG.gear_m:
            self.pos[2], self.vel = -CONFIG.gear_m, np.zeros(3)
        if state:
            self.take(self.descent.on_state(self.t_us, self.estimate(), self.moving, self.said))
        self.take(self.descent.tick(self.t_us, self.said, page_there=True, connected=True))

    def run_until(self, seconds: float, what: object = None) -> None:
        for _ in range(int(seconds / 0.05)):
            if not self.descent.active or self.descent.phase is what:
                return
            self.step()


def world(
    north_m: float = 2.0, east_m: float = -1.5, height_m: float = 8.0, kind: Autopilot = Autopilot.ARDUPILOT
) -> World:
    return World(Descent(kind, "page", T0_US, CONFIG), np.array((north_m, east_m, -height_m)))


@pytest.mark.parametrize("kind", [Autopilot.ARDUPILOT, Autopilot.PX4])
def test_it_is_flown_down_onto_the_pad_and_then_told_to_land(kind: Autopilot) -> None:
    """Although what the autopilot takes for its velocity is 0.3 m/s wrong: the estimate's velocity closes the loop."""
    flown = world(kind=kind)
    flown.run_until(120.0)

    assert flown.descent.phase is LandingPhase.LANDED
    assert flown.orders == [Order.TAKE, Order.LAND]
    assert np.hypot(*flown.pos[:2]) < 0.15


def test_px4_hears_set_points_before_it_is_asked() -> None:
    flown = world(kind=Autopilot.PX4)
    while not flown.orders:
        assert flown.t_us - T0_US <= STREAM_FIRST_US
        flown.step()
    assert len(flown.sent) >= STREAM_FIRST_US // STEP_US - 1
    assert not np.any(flown.sent)


def test_nothing_moves_until_the_vehicle_is_seen_to_obey() -> None:
    flown = world()
    flown.obeys = False
    flown.run_until(10.0)

    assert flown.orders == [Order.TAKE]
    assert not np.any(flown.sent)
    assert not flown.descent.active
    assert "did not take GUIDED; it is in LOITER" in flown.descent.reason
    assert (flown.t_us - T0_US) == pytest.approx(TAKEN_WITHIN_US, abs=2 * STEP_US)


def test_a_mode_it_was_in_before_it_was_asked_is_no_obedience_yet() -> None:
    flown = world(kind=Autopilot.PX4)
    flown.mode = "OFFBOARD"
    flown.step()

    assert not np.any(flown.sent[-1])
    flown.run_until(20.0, LandingPhase.DESCEND)
    assert np.any(flown.sent[-1])


def test_whoever_takes_it_out_of_the_mode_flies_it() -> None:
    flown = world()
    flown.run_until(60.0, LandingPhase.DESCEND)
    flown.mode = "STABILIZE"
    count = len(flown.sent)
    flown.step()
    flown.step()

    assert flown.orders == [Order.TAKE]
    assert len(flown.sent) == count
    assert "left GUIDED for STABILIZE" in flown.descent.reason


def test_what_the_operator_ends_stands_still_by_the_estimate_until_that_is_ended_too() -> None:
    flown = world()
    flown.run_until(60.0, LandingPhase.DESCEND)
    flown.take(flown.descent.abort("the operator ended it"))
    for _ in range(100):
        flown.step()
    stood = flown.pos.copy()
    for _ in range(400):
        flown.step()

    # Its autopilot is 0.3 m/s wrong: in twenty seconds its own hold would have drifted by six metres.
    assert np.linalg.norm(flown.pos - stood) < 0.1
    assert (flown.descent.phase, flown.descent.reason) == (LandingPhase.HOLD, "the operator ended it")
    assert flown.orders == [Order.TAKE]

    flown.take(flown.descent.abort("the operator ended that too"))
    assert flown.orders == [Order.TAKE, Order.HOLD]
    assert (flown.descent.active, flown.descent.phase) == (False, LandingPhase.ABORT)
    assert flown.descent.reason == "the operator ended that too"


def test_a_landing_goes_on_from_where_it_stands() -> None:
    flown = world()
    flown.run_until(60.0, LandingPhase.DESCEND)
    flown.take(flown.descent.abort("the operator ended it"))
    for _ in range(100):
        flown.step()
    stood = flown.pos.copy()
    flown.descent = Descent(Autopilot.ARDUPILOT, "page", flown.t_us, CONFIG, flown.descent)
    away = [np.linalg.norm(flown.pos[:2] - stood[:2])]
    for _ in range(20):
        flown.step()
        away.append(np.linalg.norm(flown.pos[:2] - stood[:2]))
    flown.run_until(120.0)

    # What was found of the autopilot's velocity is kept: it does not sway when it is taken anew.
    assert max(away) < 0.3
    assert flown.descent.phase is LandingPhase.LANDED
    assert flown.orders == [Order.TAKE, Order.TAKE, Order.LAND]


@pytest.mark.parametrize("silent", [True, False])
def test_where_its_velocity_is_not_known_any_more_the_vehicle_holds_by_itself(silent: bool) -> None:
    flown = world()
    flown.run_until(60.0, LandingPhase.DESCEND)
    flown.take(flown.descent.abort("the operator ended it"))
    flown.step()
    flown.std_m_s = np.nan if silent else 2.0 * STAND_STD_M_S
    began_us = flown.t_us
    while flown.descent.active:
        assert flown.t_us - began_us < 10_000_000
        flown.step(state=not silent)

    assert flown.orders == [Order.TAKE, Order.HOLD]
    assert flown.t_us - began_us == pytest.approx(CONFIG.lost_after_s * 1e6, abs=2 * STEP_US)
    assert flown.descent.reason == "the operator ended it; then its velocity was not known any more"


@pytest.mark.parametrize(("until_m", "order"), [(4.0, Order.HOLD), (0.9, Order.LAND)])
def test_without_a_page_it_holds_or_lands_where_it_is_committed(until_m: float, order: Order) -> None:
    flown = world()
    while -flown.pos[2] - CONFIG.gear_m > until_m:
        flown.step()
    flown.take(flown.descent.tick(flown.t_us, flown.said, page_there=False, connected=True))

    assert flown.orders == [Order.TAKE, order]
    assert flown.descent.reason == "the operator's page has gone"


def test_a_pad_lost_above_the_decision_height_ends_it_and_below_does_not() -> None:
    high, low = world(), world()
    for flown, until_m in ((high, 4.0), (low, 1.0)):
        while -flown.pos[2] - CONFIG.gear_m > until_m:
            flown.step()
        flown.pad_mode, flown.age_s = PadMode.DEAD_RECKONING, CONFIG.lost_after_s + 0.1
        flown.run_until(60.0, LandingPhase.HOLD)

    assert (high.orders, high.descent.phase) == ([Order.TAKE], LandingPhase.HOLD)
    assert "lost above" in high.descent.reason
    assert (low.orders[-1], low.descent.phase) == (Order.LAND, LandingPhase.LANDED)


def test_an_estimator_that_falls_silent_ends_it() -> None:
    flown = world()
    while -flown.pos[2] - CONFIG.gear_m > 4.0:
        flown.step()
    silent_us = flown.t_us
    while flown.descent.active:
        flown.step(state=False)

    assert flown.orders == [Order.TAKE, Order.HOLD]
    assert flown.t_us - silent_us < STALE_US + CONFIG.lost_after_s * 1e6 + 2 * STEP_US
    # Meanwhile it did not go down.
    assert all(vel[2] <= 0.0 for vel in flown.sent[-20:])


def test_a_vehicle_that_disarms_on_the_pad_has_landed_and_elsewhere_not() -> None:
    low, high = world(), world()
    low.run_until(120.0, LandingPhase.TOUCHDOWN)
    high.run_until(60.0, LandingPhase.DESCEND)
    for flown in (low, high):
        flown.armed = False
        flown.step()

    assert low.descent.phase is LandingPhase.LANDED
    assert (high.descent.phase, high.descent.reason) == (LandingPhase.ABORT, "the vehicle is disarmed")
    assert Order.LAND not in low.orders + high.orders


def test_states_that_come_late_do_not_turn_time_back() -> None:
    flown = world()
    flown.run_until(60.0, LandingPhase.DESCEND)
    later = flown.t_us + 1_000_000
    flown.take(flown.descent.tick(later, flown.said, page_there=True, connected=True))
    flown.take(flown.descent.on_state(later - 400_000, flown.estimate(), flown.moving, replace(flown.said)))

    assert flown.descent.active
