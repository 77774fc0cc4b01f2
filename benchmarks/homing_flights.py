"""One flight home by vision in a closed loop: see ``benchmarks.closed_loop``.

The helicopter flies its route; GPS is cut, for its own autopilot as for the station; then the station is told to fly it
home: to a place a kilometre off that it has never seen, over which it comes down and lands.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from backend.guided.flight import Order, Orders
from backend.homing.flight import HomeFlight, WhenLost
from backend.homing.planning import plan_way
from backend.link.events import Autopilot
from backend.link.landing_target import velocity_set_point
from backend.navigation.setup import Place
from backend.schemas.homing import HomingRequest
from benchmarks.closed_loop import AUTOPILOT, GUIDANCE_US, START_US, TICK_US, ClosedLoop
from estimator.types import Float, Mode, NavigationState
from guidance.geofence import Geofence, InclusionRule
from guidance.homing import HomingGuidance, HomingPhase
from simulator.errors import SimulatorError
from simulator.random_streams import rng_for
from simulator.scenario import CameraSection, FlightSection, Scenario, WorldSection
from simulator.simulation import Exposure
from simulator.vehicles.pilot import FlightMode
from simulator.vehicles.state import VehicleState
from simulator.world.pad_place import open_ground

PICTURES_PER_S = 10.0
CUT_S, HOME_S, GIVE_UP_S = 30.0, 40.0, 480.0
AWAY_M, EDGE_M = 1000.0, 90.0
SETTLED_S = 20.0
"""So long it takes to turn about from the route, which is flown at 11 m/s."""
WIND_M_S, GUST_SHARE = 6.0, 0.25
MODES = {Order.TAKE: FlightMode.GUIDED, Order.HOLD: FlightMode.LOITER, Order.LAND: FlightMode.LAND}


@dataclass(frozen=True, slots=True)
class Homing:
    """How one flight home ended. Lengths are horizontal; NaN where it did not touch the ground.

    ``touch_m`` is where the skids first touched, from home; ``estimate_m`` how far off the estimate was there and
    ``estimate_std_m`` what it said; ``worst_m`` how far off it was at most on the way, ``worst_sigmas`` in its own
    standard deviations; ``aside_m`` how far from the way the vehicle was at most, once it had turned into it.
    """

    seed: int
    wind_m_s: float
    outcome: str
    reason: str
    length_m: float
    touch_m: float
    sink_m_s: float
    estimate_m: float
    estimate_std_m: float
    worst_m: float
    worst_sigmas: float
    aside_m: float
    rms_m: float
    waited_s: float
    home_s: float
    drift_of_autopilot_m_s: float
    times_real_time: float


def scenario_for(seed: int) -> Scenario:
    """A helicopter at about 110 m above woods, fields and villages, in a wind of this seed up to ``WIND_M_S``."""
    wind_m_s = float(rng_for(seed, "homing", "wind").uniform(0.0, WIND_M_S))
    return Scenario(
        name="homing", duration_s=GIVE_UP_S, start_unix_us=START_US,
        gps_denied_s=((CUT_S, 1e6),), gps_cut_s=((CUT_S, 1e6),), world=WorldSection(half_size_m=750.0),
        camera=CameraSection(frames_per_s=PICTURES_PER_S),
        flight=FlightSection(
            hover_stops=0, wind_m_s=wind_m_s, gust_std_m_s=max(0.3, GUST_SHARE * wind_m_s), by_belief=True
        ),
    )  # fmt: skip


class HomingLoop(ClosedLoop):
    """A vehicle on its route, and a station that flies it home; ``blind_s`` is without pictures, from its begin on."""

    def __init__(
        self, seed: int, folder: Path, cache: Path | None, when_lost: WhenLost = "hold",
        blind_s: tuple[float, float] | None = None,
    ) -> None:  # fmt: skip
        super().__init__(seed, scenario_for(seed), folder, cache)
        self.when_lost = when_lost
        self._blind_s = blind_s
        self.flight: HomeFlight | None = None
        self.home_ned_m: Float = np.full(3, math.nan)
        self.length_m = math.nan
        self.at_touchdown: NavigationState | None = None
        self._errors: list[tuple[float, float]] = []
        self._aside_m = 0.0
        self._waited_us = 0
        self._way_ne_m: Float = np.zeros((0, 2))

    def fly(self, watch: Callable[[HomingLoop], None] = lambda _: None) -> Homing:
        """Until the vehicle stands, the flight is given up, or time is over; ``watch`` is called at 20 Hz."""
        started = time.perf_counter()
        after_us = 0
        while self.simulation.elapsed_us < GIVE_UP_S * 1e6 and after_us < 3_000_000:
            self._step()
            if self.simulation.elapsed_us % GUIDANCE_US == 0:
                self._decide()
                watch(self)
            if self.simulation.touchdown is not None and self.at_touchdown is None:
                self.at_touchdown = self.navigator.predict(self.now_us)
            if self.flight is not None and not self.flight.active:
                after_us += 5_000
        return self._told(time.perf_counter() - started)

    def _decide(self) -> None:
        state = self.navigator.predict(self.now_us)
        if state is None or self.simulation.state is None:
            return
        if self.flight is None:
            if self.simulation.elapsed_us >= HOME_S * 1e6 and state.mode is not Mode.LOST:
                self._begin(state)
            return
        self._note(state, self.simulation.state)
        self._obey(self.flight.take(state, self.said))
        if self.simulation.elapsed_us % TICK_US == 0:
            self._obey(self.flight.tick(self.now_us, self.said, page_there=True, connected=True))

    def _begin(self, state: NavigationState) -> None:
        frame = self.setup.frame
        self.home_ned_m = self._choose_home()
        # The world's frame and the station's have not the same origin.
        lat, lon, alt = (float(x) for x in self.world.frame.geodetic_from_ned(self.home_ned_m))
        wish = HomingRequest(action="fly", when_lost=self.when_lost)
        way = plan_way(state, self.setup, Place(lat, lon, alt), wish, Geofence(), InclusionRule.ALL)
        self.length_m = way.body.length_m
        s = np.linspace(0.0, 1.0, 400)
        points = np.concatenate([segment.curve.point(s) for segment in way.segments])
        lat_rad, lon_rad, alt_m = frame.geodetic_from_ned(points)
        self._way_ne_m = np.asarray(self.world.frame.ned_from_geodetic(lat_rad, lon_rad, alt_m))[:, :2]
        guidance = HomingGuidance(way.segments)
        self.flight = HomeFlight(Autopilot.ARDUPILOT, "page", self.now_us, guidance, self.when_lost)

    def _choose_home(self) -> Float:
        """Open ground a kilometre from where it truly is, inside of the world."""
        at, rng = self.simulation.state, rng_for(self.seed, "homing", "place")
        if at is None:
            message = "the flight has not begun"
            raise ValueError(message)
        angle = rng.uniform(-np.pi, np.pi, 2000)
        places = at.pos_ned_m[:2] + AWAY_M * np.stack([np.cos(angle), np.sin(angle)], axis=1)
        inside = np.abs(places).max(axis=1) < self.scenario.world.half_size_m - EDGE_M
        places = places[inside]
        good = open_ground(self.world, places) if len(places) else np.zeros(0, bool)
        if not good.any():
            raise SimulatorError(f"world {self.seed} has no open ground {AWAY_M:.0f} m from the vehicle")
        north, east = places[int(np.argmax(good))].tolist()
        return np.array([north, east, -float(self.world.terrain.at(north, east))])

    def _take(self, exposure: Exposure, now_us: int) -> None:
        since_s = self.simulation.elapsed_us / 1e6 - HOME_S
        if self._blind_s is None or not self._blind_s[0] <= since_s < self._blind_s[1]:
            super()._take(exposure, now_us)

    def _obey(self, orders: Orders) -> None:
        if orders.vel_ned_m_s is not None:
            self._send(velocity_set_point(self.scenario.system_id, AUTOPILOT, orders.vel_ned_m_s))
        if orders.order is not None:
            self._order(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(MODES[orders.order]))

    def error_ne_m(self, state: NavigationState, truth: VehicleState) -> Float:
        """Estimate minus truth (2,), both at the state's time within 50 ms."""
        lat, lon, alt = self.world.frame.geodetic_from_ned(truth.pos_ned_m)
        there = self.setup.frame.ned_from_geodetic(lat, lon, alt)
        off: Float = (state.pos_ned_m - there)[:2]
        return off

    def _note(self, state: NavigationState, truth: VehicleState) -> None:
        error = self.error_ne_m(state, truth)
        sigmas = float(np.sqrt(error @ np.linalg.solve(state.cov_pos_ned_m2[:2, :2], error)))
        self._errors.append((float(np.hypot(*error)), sigmas))
        if self.flight is None:
            return
        if self.flight.phase is HomingPhase.FOLLOW and self.simulation.elapsed_us > (HOME_S + SETTLED_S) * 1e6:
            off = np.linalg.norm(self._way_ne_m - truth.pos_ned_m[:2], axis=1).min()
            self._aside_m = max(self._aside_m, float(off))
        self._waited_us += GUIDANCE_US if self.flight.phase is HomingPhase.WAIT else 0

    def _told(self, elapsed_s: float) -> Homing:
        touched, at, flight = self.simulation.touchdown, self.at_touchdown, self.flight
        outcome, reason = ("not begun", "the place was lost") if flight is None else (str(flight.phase), flight.reason)
        errors = np.array(self._errors) if self._errors else np.full((1, 2), math.nan)
        estimate_m = std_m = math.nan
        if touched is not None and at is not None:
            estimate_m = float(np.hypot(*self.error_ne_m(at, touched)))
            std_m = float(np.sqrt(np.linalg.eigvalsh(at.cov_pos_ned_m2[:2, :2])[-1]))
        return Homing(
            seed=self.seed, wind_m_s=self.scenario.flight.wind_m_s, outcome=outcome, reason=reason,
            length_m=self.length_m,
            touch_m=math.nan if touched is None else float(np.hypot(*(touched.pos_ned_m - self.home_ned_m)[:2])),
            sink_m_s=math.nan if touched is None else float(touched.vel_ned_m_s[2]),
            estimate_m=estimate_m, estimate_std_m=std_m, worst_m=float(errors[:, 0].max()),
            worst_sigmas=float(errors[:, 1].max()), aside_m=self._aside_m,
            rms_m=float(np.sqrt(np.mean(errors[:, 0] ** 2))), waited_s=self._waited_us / 1e6,
            home_s=math.nan if touched is None else touched.t_us / 1e6 - HOME_S,
            drift_of_autopilot_m_s=float(np.hypot(*self.simulation.believed_vel_error_ned_m_s[:2])),
            times_real_time=self.simulation.elapsed_us / 1e6 / elapsed_s,
        )  # fmt: skip
