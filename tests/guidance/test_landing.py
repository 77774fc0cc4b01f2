"""A landing closed around a vehicle whose autopilot flies by a drifting velocity of its own."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import pytest

from estimator.types import Float, PadMode, PadRelative
from guidance.landing import LandingCommand, LandingConfig, LandingGuidance, LandingPhase

STEP_US = 50_000
GEAR_M = 0.3
VEHICLE_PER_S = 1.5
"""How fast a helicopter's velocity follows its autopilot's set-point."""

Estimate = Callable[[float, Float, Float], PadRelative | None]


def seen(
    pos: Float, vel: Float, mode: PadMode = PadMode.TRACKING, age_s: float = 0.0, std_m: float = 0.02
) -> PadRelative:
    """An estimate of this place."""
    return PadRelative(
        mode, np.array(pos), np.array(vel), std_m**2 * np.eye(3), 0.01**2 * np.eye(3), np.array([1.0, 0, 0, 0]), age_s,
        "covered" if age_s else "",
    )  # fmt: skip


class Descent:
    """A vehicle as slow as a helicopter, its autopilot's error of velocity, and ground; 20 calls a second."""

    def __init__(
        self, pos: Float, drift: tuple[float, float] = (0.0, 0.0), config: LandingConfig | None = None
    ) -> None:
        self.pos, self.vel = np.array(pos, float), np.zeros(3)
        self.drift = np.array((*drift, 0.0))
        self.guidance = LandingGuidance(config)
        self.t_s = 0.0
        self.commands: list[LandingCommand] = []
        self.track: list[Float] = []
        self.impact_m_s = math.nan

    def fly(self, seconds: float, estimate: Estimate = lambda _, pos, vel: seen(pos, vel)) -> Descent:
        """Until it has landed or aborted, ``seconds`` at most."""
        for _ in range(round(seconds / 0.05)):
            command = self.guidance.step(round(self.t_s * 1e6), estimate(self.t_s, self.pos, self.vel))
            self.commands.append(command)
            self.track.append(self.pos.copy())
            if self.guidance.over:
                break
            self.move(command.vel_ned_m_s, 0.05)
            self.t_s += 0.05
        return self

    def move(self, command: Float, step_s: float) -> None:
        """On by a step, at this set-point."""
        self.vel = self.vel + VEHICLE_PER_S * (command - self.drift - self.vel) * step_s
        self.pos = self.pos + self.vel * step_s
        if self.pos[2] >= -GEAR_M:
            if math.isnan(self.impact_m_s):
                self.impact_m_s = float(self.vel[2])
            self.pos[2], self.vel = -GEAR_M, np.zeros(3)


@pytest.mark.parametrize("drift", [(0.0, 0.0), (0.8, -0.5)])
def test_it_lands_on_the_middle_though_the_autopilots_own_velocity_is_wrong(drift: tuple[float, float]) -> None:
    descent = Descent(np.array([4.0, -3.0, -20.3]), drift).fly(120.0)

    assert descent.guidance.phase is LandingPhase.LANDED
    assert np.hypot(*descent.pos[:2]) < 0.03
    # The skids of a light helicopter take half a metre a second.
    assert 0.1 < descent.impact_m_s < 0.3


@pytest.mark.parametrize("pauses_s", [(0.3,), (0.5,), (0.8,), (0.05, 0.05, 0.05, 0.1, 0.4, 0.05, 1.0)])
@pytest.mark.parametrize("behind_s", [0.05, 0.3])
def test_a_station_that_is_slow_does_not_make_it_swing(pauses_s: tuple[float, ...], behind_s: float) -> None:
    # A pause longer than this is bridged ten times a second without an estimate, as the station does.
    stale_s, bridge_s, step_s = 0.3, 0.1, 0.025
    descent, waiting = Descent(np.array([2.0, -1.5, -8.3]), (0.8, -0.5)), []
    estimate_s = bridged_s = 0.0
    command, pauses = np.zeros(3), 0
    for n in range(round(120.0 / step_s)):
        t_s = n * step_s
        pad = seen(descent.pos, descent.vel) if t_s >= estimate_s + pauses_s[pauses % len(pauses_s)] else None
        if pad is not None:
            estimate_s, pauses = t_s, pauses + 1
        if pad is not None or (t_s - estimate_s > stale_s and t_s >= bridged_s + bridge_s):
            bridged_s = t_s
            waiting.append((t_s + behind_s, descent.guidance.step(round(t_s * 1e6), pad).vel_ned_m_s))
        if descent.guidance.over:
            break
        while waiting and waiting[0][0] <= t_s:
            command = waiting.pop(0)[1]
        descent.move(command, step_s)
        descent.track.append(descent.pos.copy())

    assert descent.guidance.phase is LandingPhase.LANDED
    assert np.hypot(*descent.pos[:2]) < 0.3
    assert np.hypot(*np.array(descent.track)[:, :2].T).max() < 5.0


def test_phases_follow_each_other_and_the_sink_stays_within_the_profile() -> None:
    config = LandingConfig()
    descent = Descent(np.array([4.0, -3.0, -20.3])).fly(120.0)

    phases = list(dict.fromkeys(command.phase for command in descent.commands))
    assert phases == [LandingPhase.APPROACH, LandingPhase.DESCEND, LandingPhase.TOUCHDOWN, LandingPhase.LANDED]
    wanted = np.array([command.vel_wanted_ned_m_s for command in descent.commands])
    assert wanted[:, 2].max() <= config.sink_m_s + 1e-9
    assert np.hypot(wanted[:, 0], wanted[:, 1]).max() <= config.speed_m_s + 1e-9
    change = np.linalg.norm(np.diff(wanted[:-1, :2], axis=0), axis=1) / 0.05
    assert change.max() <= config.acceleration_m_s2 + 1e-9
    # From 20 m in not less than a constant sink takes, and not more than a minute and a half.
    assert 20.0 / config.sink_m_s < descent.t_s < 90.0


def test_nothing_sinks_beside_the_pad() -> None:
    descent = Descent(np.array([9.0, 0.0, -12.3])).fly(3.0)

    assert {command.phase for command in descent.commands} == {LandingPhase.APPROACH}
    assert descent.pos[2] == pytest.approx(-12.3)


def test_a_gust_out_of_the_funnel_stops_the_sink_until_it_is_back() -> None:
    descent = Descent(np.array([0.0, 0.0, -8.3])).fly(4.0)
    descent.pos[0] += 3.0
    blown = len(descent.commands)
    descent.fly(90.0)

    # What sinks still is what the limit of acceleration has left: some decimetres.
    assert "beside the pad" in descent.commands[blown + 5].reason
    assert descent.commands[blown + 25].vel_wanted_ned_m_s[2] == 0.0
    assert descent.guidance.phase is LandingPhase.LANDED
    assert np.hypot(*descent.pos[:2]) < 0.03


def test_a_pad_lost_above_the_decision_height_ends_the_landing() -> None:
    """
    Fault: nothing of the pad is seen from 6 m on.
    Expected: it stops sinking within half a second, and gives up after two, standing still.
    """
    lost_at: list[float] = []

    def estimate(t_s: float, pos: Float, vel: Float) -> PadRelative:
        if -pos[2] > 6.0 and not lost_at:
            return seen(pos, vel)
        lost_at.append(t_s)
        return seen(pos, vel, PadMode.DEAD_RECKONING, t_s - lost_at[0])

    descent = Descent(np.array([0.0, 0.0, -10.3]), (0.5, 0.0)).fly(120.0, estimate)

    assert descent.guidance.phase is LandingPhase.ABORT
    assert "lost above 1.5 m: covered" in descent.guidance.reason
    assert descent.t_s - lost_at[0] == pytest.approx(2.0, abs=0.11)
    # 0.4 s at 0.6 m/s, then what braking takes.
    assert descent.pos[2] == pytest.approx(-6.0 + 0.5, abs=0.35)
    # The autopilot's own error is still made up for, as far as ten seconds have shown it.
    assert descent.commands[-1].vel_ned_m_s == pytest.approx([0.5, 0.0, 0.0], abs=0.06)


def test_a_pad_lost_below_the_decision_height_is_landed_on() -> None:
    """
    Fault: nothing of the pad is seen below 0.9 m, and the estimate slides away by 2 cm/s.
    Expected: it goes on down without waiting, and stands within the slide.
    """
    lost_at: list[float] = []

    def estimate(t_s: float, pos: Float, vel: Float) -> PadRelative:
        if -pos[2] > 0.9:
            return seen(pos, vel)
        lost_at.append(t_s)
        age = t_s - lost_at[0]
        mode = PadMode.LOST if age > 5.0 else PadMode.DEAD_RECKONING
        return seen(pos + np.array((0.02 * age, 0, 0)), vel, mode, age, std_m=0.02 + 0.2 * age)

    descent = Descent(np.array([0.0, 0.0, -6.3]), (0.4, 0.0)).fly(120.0, estimate)

    assert descent.guidance.phase is LandingPhase.LANDED
    assert np.hypot(*descent.pos[:2]) < 0.15


def test_standing_is_noticed_though_the_estimate_moves_on() -> None:
    """
    Fault: on the ground the estimate slides away by 0.3 m/s.
    Expected: it has landed after six seconds of touchdown all the same.
    """

    def estimate(_: float, pos: Float, vel: Float) -> PadRelative:
        return seen(pos, vel + np.array((0.3 if pos[2] == -GEAR_M else 0.0, 0, 0)))

    descent = Descent(np.array([0.0, 0.0, -3.3])).fly(60.0, estimate)

    assert descent.guidance.phase is LandingPhase.LANDED
    touchdown = [command for command in descent.commands if command.phase is LandingPhase.TOUCHDOWN]
    assert len(touchdown) * 0.05 == pytest.approx(6.0, abs=0.11)


def test_no_estimate_at_all() -> None:
    at_once = Descent(np.array([0.0, 0.0, -10.0])).fly(10.0, lambda *_: None)
    assert at_once.guidance.phase is LandingPhase.ABORT
    assert at_once.guidance.reason == "the pad has not been seen"
    assert at_once.t_s == pytest.approx(2.05, abs=0.06)

    low = Descent(np.array([0.0, 0.0, -3.3])).fly(60.0, lambda _, pos, vel: seen(pos, vel) if -pos[2] > 1.0 else None)
    assert low.pos[2] == -GEAR_M


def test_an_estimate_that_is_not_sure_is_not_landed_by() -> None:
    descent = Descent(np.array([0.0, 0.0, -10.3])).fly(5.0, lambda _, pos, vel: seen(pos, vel, std_m=1.0))

    assert descent.guidance.phase is LandingPhase.ABORT
    assert "1.00 m" in descent.guidance.reason


def test_a_wind_that_it_cannot_fly_against_ends_it() -> None:
    config = replace(LandingConfig(), patience_s=20.0)
    descent = Descent(np.array([3.0, 0.0, -10.3]), (-9.0, 0.0), config).fly(120.0)

    assert descent.guidance.phase is LandingPhase.ABORT
    assert descent.t_s == pytest.approx(20.0, abs=1.0)


def test_the_operator_ends_it_at_once_and_it_stays_ended() -> None:
    descent = Descent(np.array([1.0, 0.0, -10.3])).fly(5.0)
    descent.guidance.abort("asked to")
    descent.guidance.abort("again")
    after = descent.guidance.step(10_000_000, seen(descent.pos, descent.vel))

    assert (after.phase, after.reason) == (LandingPhase.ABORT, "asked to")
    assert np.array_equal(after.vel_wanted_ned_m_s, np.zeros(3))
    assert after.vel_ned_m_s[2] == 0.0


def test_misuse_is_refused() -> None:
    guidance = LandingGuidance()
    guidance.step(1_000_000, None)
    with pytest.raises(ValueError, match="forward in time"):
        guidance.step(900_000, None)
    with pytest.raises(ValueError, match="touchdown_height_m <= decision_height_m"):
        LandingConfig(touchdown_height_m=3.0)
    with pytest.raises(ValueError, match="gear_m"):
        LandingConfig(gear_m=math.nan)
