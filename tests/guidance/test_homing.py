"""A flight home closed around a vehicle whose autopilot flies by a drifting velocity of its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from estimator.types import Float
from guidance.homing import HomingCommand, HomingConfig, HomingEstimate, HomingGuidance, HomingPhase
from guidance.path import CubicSegment, PathSegment
from guidance.route import route_through

HOME = np.array([400.0, 0.0, -80.0])
WAY = np.array([[0.0, 0.0, -80.0], [300.0, 120.0, -80.0], HOME])
STEP_S = 0.1
VEHICLE_PER_S = 0.8
"""How fast a helicopter's velocity follows its autopilot's set-point."""

Estimate = Callable[[float, Float, Float], HomingEstimate | None]


def known(pos: Float, vel: Float, std_m: float = 1.0, std_m_s: float = 0.1, lost: bool = False) -> HomingEstimate:
    """An estimate of this place; the ground is at zero."""
    return HomingEstimate(np.array(pos), np.array(vel), std_m, std_m_s, 0.0, -float(pos[2]), lost)


class Flight:
    """A vehicle as slow as a helicopter, its autopilot's error of velocity, and ground; 10 calls a second."""

    def __init__(
        self, pos: Float, drift: tuple[float, float] = (0.0, 0.0), *, way: Float = WAY, land: bool = True,
        config: HomingConfig | None = None,
    ) -> None:  # fmt: skip
        self.pos, self.vel, self.drift = np.array(pos, float), np.zeros(3), np.array((*drift, 0.0))
        self.guidance = HomingGuidance(route_through(way, 8.0), config, land=land)
        self.t_s = 0.0
        self.commands: list[HomingCommand] = []
        self.track: list[Float] = []

    def fly(self, seconds: float, estimate: Estimate = lambda _, pos, vel: known(pos, vel)) -> Flight:
        """Until it is over, ``seconds`` at most."""
        for _ in range(round(seconds / STEP_S)):
            command = self.guidance.step(round(self.t_s * 1e6), estimate(self.t_s, self.pos, self.vel))
            self.commands.append(command)
            self.track.append(self.pos.copy())
            if self.guidance.over:
                break
            self.vel = self.vel + VEHICLE_PER_S * (command.vel_ned_m_s - self.drift - self.vel) * STEP_S
            self.pos = self.pos + self.vel * STEP_S
            if self.pos[2] >= 0.0:
                self.pos[2], self.vel = 0.0, np.zeros(3)
            self.t_s += STEP_S
        return self

    @property
    def phases(self) -> list[HomingPhase]:
        """Phases in the order of their first time."""
        return list(dict.fromkeys(command.phase for command in self.commands))


def farthest_from_way_m(track: Float) -> float:
    """Of the track's places the one farthest from the way, across."""
    s = np.linspace(0.0, 1.0, 400)
    way = np.concatenate([segment.curve.point(s) for segment in route_through(WAY, 8.0)])
    return float(max(np.linalg.norm(way[:, :2] - place[:2], axis=1).min() for place in track))


@pytest.mark.parametrize("drift", [(0.0, 0.0), (1.5, -1.0)])
def test_it_comes_home_and_lands_though_the_autopilots_own_velocity_is_wrong(drift: tuple[float, float]) -> None:
    flight = Flight(np.array([0.0, 0.0, -70.0]), drift).fly(300.0)

    assert flight.guidance.phase is HomingPhase.LANDED
    assert flight.phases == [
        HomingPhase.CLIMB, HomingPhase.FOLLOW, HomingPhase.ARRIVE, HomingPhase.DESCEND, HomingPhase.TOUCHDOWN,
        HomingPhase.LANDED,
    ]  # fmt: skip
    assert np.hypot(*(flight.pos - HOME)[:2]) < 0.5
    # Half a leg's bend is cut at 8 m/s by a vehicle that follows in 1.3 s.
    assert farthest_from_way_m(np.array(flight.track)) < 4.0


def test_it_climbs_before_it_goes_and_keeps_the_height_of_the_way() -> None:
    track = np.array(Flight(np.array([0.0, 0.0, -30.0])).fly(110.0).track)

    away = np.hypot(track[:, 0], track[:, 1]) > 5.0
    assert away.any()
    low = track[away & (np.hypot(*(track - HOME)[:, :2].T) > 20.0), 2]
    assert low.max() < -75.0


def test_without_landing_it_stays_over_home() -> None:
    flight = Flight(np.array([0.0, 0.0, -80.0]), (0.5, 0.5), land=False).fly(200.0)

    assert flight.guidance.phase is HomingPhase.ARRIVE
    assert flight.guidance.over_home
    assert np.linalg.norm(flight.pos - HOME) < 1.0


@pytest.mark.parametrize("worse", [{"lost": True}, {"std_m": 60.0}, {"std_m": math.nan}])
def test_a_lost_place_is_waited_for_standing_and_then_gone_on_from(worse: dict[str, float]) -> None:
    def lost_on_the_way(t_s: float, pos: Float, vel: Float) -> HomingEstimate:
        return known(pos, vel, **(worse if 30.0 < t_s < 60.0 else {}))  # type: ignore[arg-type]

    flight = Flight(np.array([0.0, 0.0, -80.0]), (0.8, 0.0)).fly(300.0, lost_on_the_way)

    waiting = [k for k, command in enumerate(flight.commands) if command.phase is HomingPhase.WAIT]
    assert len(waiting) == pytest.approx(30.0 / STEP_S, abs=2)
    assert all(flight.commands[k].reason for k in waiting)
    # Braking from 8 m/s at 1.2 m/s2 takes seven seconds; after that it stands.
    still = np.array(flight.track)[waiting[120:]]
    assert float(np.linalg.norm(still - still[0], axis=1).max()) < 1.5
    assert flight.guidance.phase is HomingPhase.LANDED
    assert np.hypot(*(flight.pos - HOME)[:2]) < 0.5


def test_an_estimate_that_stays_lost_ends_the_flight_and_says_why() -> None:
    config = replace(HomingConfig(), wait_s=20.0)
    flight = Flight(np.array([0.0, 0.0, -80.0]), config=config)
    flight.fly(120.0, lambda t_s, pos, vel: known(pos, vel, lost=t_s > 25.0))

    assert flight.guidance.phase is HomingPhase.ABORT
    assert "lost the place" in flight.guidance.reason and "20 s" in flight.guidance.reason
    assert flight.t_s == pytest.approx(45.0, abs=1.0)


def test_a_velocity_that_is_not_known_is_not_stood_by() -> None:
    flight = Flight(np.array([0.0, 0.0, -80.0]), (0.5, 0.0)).fly(20.0)
    flight.fly(5.0, lambda _, pos, vel: known(pos, vel + 5.0, std_m_s=4.0))

    # What it was found to be off by keeps it still, not the velocity that is wrong.
    assert flight.commands[-1].phase is HomingPhase.WAIT
    assert np.allclose(flight.commands[-1].vel_ned_m_s, flight.guidance.trim_ned_m_s * (1, 1, 0))


def test_gaps_of_a_second_are_flown_through_and_longer_ones_waited_out() -> None:
    def gaps(t_s: float, pos: Float, vel: Float) -> HomingEstimate | None:
        return None if 20.0 < t_s < 21.0 or 40.0 < t_s < 46.0 else known(pos, vel)

    flight = Flight(np.array([0.0, 0.0, -80.0])).fly(300.0, gaps)

    waiting = [k * STEP_S for k, command in enumerate(flight.commands) if command.phase is HomingPhase.WAIT]
    assert waiting and min(waiting) == pytest.approx(42.0, abs=0.3) and max(waiting) < 46.2
    assert flight.guidance.phase is HomingPhase.LANDED


def test_close_to_the_ground_it_goes_on_down_whatever_is_seen() -> None:
    flight = Flight(np.array([400.0, 0.0, -40.0]), way=np.array([[398.0, 0, -40], [400, 0, -40]]))
    flight.fly(200.0, lambda _, pos, vel: known(pos, vel) if pos[2] < -3.5 else None)
    flight.fly(30.0, lambda _, pos, vel: known(pos, vel, lost=True))

    assert flight.guidance.phase in (HomingPhase.TOUCHDOWN, HomingPhase.LANDED)
    assert flight.pos[2] == 0.0


def test_where_the_ground_is_unknown_it_comes_down_slowly() -> None:
    flight = Flight(np.array([398.0, 0.0, -10.0]), way=np.array([[398.0, 0, -10], [400, 0, -10]]))
    flight.fly(40.0, lambda _, pos, vel: replace(known(pos, vel), alt_agl_m=math.nan))

    sinks = [command.vel_wanted_ned_m_s[2] for command in flight.commands if command.phase is HomingPhase.DESCEND]
    assert sinks and max(sinks) <= HomingConfig().touchdown_sink_m_s + 1e-9


def test_it_is_aborted_once_and_time_goes_forward() -> None:
    flight = Flight(np.array([0.0, 0.0, -80.0])).fly(5.0)
    flight.guidance.abort("the operator ended it")
    flight.guidance.abort("something else")

    assert flight.guidance.step(6_000_000, known(flight.pos, flight.vel)).reason == "the operator ended it"
    with pytest.raises(ValueError, match="forward in time"):
        flight.guidance.step(1_000_000, None)


def test_nonsense_is_refused() -> None:
    with pytest.raises(ValueError, match="needs a way"):
        HomingGuidance([])
    with pytest.raises(ValueError, match="sink_m_s"):
        HomingConfig(touchdown_sink_m_s=3.0)
    with pytest.raises(ValueError, match="std_m"):
        HomingConfig(std_m=math.nan)
    leg = np.array((10.0, 0.0, 0.0))
    assert not HomingGuidance([PathSegment(CubicSegment(np.zeros(3), leg, leg, leg), 5.0, 0.0)]).over
