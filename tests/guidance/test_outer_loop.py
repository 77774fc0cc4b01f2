"""Signs, limits, equation (4.25) by hand, and the lead compensator against SciPy."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from guidance.outer_loop import FlightState, LeadCompensator, LeadFilter, OuterLoop, OuterLoopConfig, as_published
from guidance.path_following import PathReference
from guidance.velocity_profile import SpeedPhase, TargetSpeed

STILL = np.zeros(3)
NO_LIMIT = TargetSpeed(5.0, math.inf, math.inf, SpeedPhase.CRUISE)


def wanted(
    pos: tuple[float, float, float] = (0.0, 0.0, 0.0), vel: tuple[float, float, float] = (0.0, 0.0, 0.0),
    yaw_rad: float = 0.0, yaw_rate_rad_s: float = 0.0, roll_rad: float = 0.0,
) -> PathReference:  # fmt: skip
    return PathReference(np.array(pos), np.array(vel), yaw_rad, yaw_rate_rad_s, roll_rad, NO_LIMIT, 0, 0.5, 50.0)


def state(yaw_rad: float = 0.0, roll_rad: float = 0.0, pitch_rad: float = 0.0) -> FlightState:
    return FlightState(STILL, STILL, roll_rad, pitch_rad, yaw_rad)


def test_equation_4_25_by_hand() -> None:
    """The first step, heading east: forward is east, right is south."""
    config = as_published()
    reference = wanted((-0.4, 0.3, 0.2), (0.1, 0.5, -0.1), math.pi / 2 + 0.1, 0.05, 0.02)
    command = OuterLoop(config).step(0.02, reference, state(math.pi / 2))
    forward = 0.25 * 0.3 + 1.2 * 0.5 + 0.1 * 0.5 * 0.02
    assert command.pitch_rad == pytest.approx(-forward / 9.81)
    assert command.roll_rad == pytest.approx(0.02 + (0.6 * 0.4 + 1.3 * -0.1) / 9.81)
    assert command.yaw_rate_rad_s == pytest.approx(0.05 + 0.8 * 0.1)
    assert command.climb_m_s == pytest.approx(-(1.2 * 0.2 + 1.2 * -0.1 + 0.3 * -0.1 * 0.02))


def test_the_heading_error_goes_the_short_way() -> None:
    command = OuterLoop().step(0.02, wanted(yaw_rad=math.radians(-175.0)), state(math.radians(175.0)))
    assert command.yaw_rate_rad_s == pytest.approx(0.8 * math.radians(10.0))


def test_commands_stay_within_limits_and_integrals_come_back() -> None:
    loop = OuterLoop()
    config = loop.config
    for _ in range(3000):
        far = loop.step(0.02, wanted((500.0, -500.0, -500.0), (90.0, 0.0, 0.0), 3.0), state())
    assert (far.pitch_rad, far.roll_rad) == (-config.pitch_max_rad, -config.roll_max_rad)
    assert (far.yaw_rate_rad_s, far.climb_m_s) == (config.yaw_rate_max_rad_s, config.climb_max_m_s)
    # What was integrated meanwhile is bounded: two metres to the other side are enough to turn it about.
    for _ in range(10):
        back = loop.step(0.02, wanted((0.0, 2.0, 8.0), (-3.0, 0.0, 0.0)), state(roll_rad=-config.roll_max_rad))
    assert back.roll_rad > 0.0 and back.climb_m_s < 0.0 and back.pitch_rad > 0.0


def test_a_steady_offset_is_integrated_away_only_beyond_the_thesis() -> None:
    for config, grows in ((OuterLoopConfig(lead=None), True), (as_published(), False)):
        loop = OuterLoop(config)
        first, *_, last = (loop.step(0.02, wanted((0.0, 0.5, 0.5)), state()) for _ in range(200))
        assert (last.roll_rad > first.roll_rad * 1.2) == grows
        assert (last.climb_m_s < first.climb_m_s * 1.2) == grows


def test_a_helicopter_that_is_nose_down_is_lifted_by_more() -> None:
    moving = FlightState(STILL, np.array((10.0, 0.0, 0.0)), 0.0, -0.1, 0.0)
    held, tilted = (
        OuterLoop(OuterLoopConfig(pitch_feed_forward=share)).step(0.02, wanted(), moving) for share in (0.0, 1.0)
    )
    assert tilted.climb_m_s - held.climb_m_s == pytest.approx(10.0 * math.tan(0.1))


def test_lead_is_equation_4_26() -> None:
    """Against SciPy's response to a held error, well inside the limits."""
    c = LeadCompensator(gain=1.7, ratio=0.3, integral_per_s=0.8, roll_max_rad=1.0)
    lead, dt_s, error = LeadFilter(c), 0.002, 0.01
    # It begins settled to its first error: from zero, as SciPy does.
    lead.step(dt_s, 0.0, 0.0)
    found = [lead.step(dt_s, 0.0, -error) for _ in range(1500)]
    lag = signal.lti([c.gain * c.ratio, c.gain * c.ratio], [c.ratio, 1.0])
    t_s = dt_s * np.arange(1, 1501)
    _, expected = signal.step(lag, T=np.concatenate(((0.0,), t_s)))
    assert_allclose(found, error * (expected[1:] + c.integral_per_s * t_s), atol=2e-5)


def test_the_leads_integral_does_not_wind_up_at_the_limit() -> None:
    c = LeadCompensator(gain=2.0, ratio=0.4, integral_per_s=1.0)
    lead = LeadFilter(c)
    for _ in range(2000):
        held = lead.step(0.02, c.roll_max_rad, 0.0)
    assert held == c.roll_max_rad
    assert lead.step(0.02, -0.1, 0.0) < 0.0


@pytest.mark.parametrize(("name", "value"), [("gain", 0.0), ("ratio", 1.0), ("integral_per_s", math.nan)])
def test_compensators_that_are_none_are_refused(name: str, value: float) -> None:
    numbers = {"gain": 1.0, "ratio": 0.5, "integral_per_s": 1.0}
    with pytest.raises(ValueError, match=name):
        LeadCompensator(**numbers | {name: value})


def test_input_that_is_none_is_refused() -> None:
    with pytest.raises(ValueError, match="yaw_per_s"):
        OuterLoopConfig(yaw_per_s=-1.0)
    with pytest.raises(ValueError, match="vel_ned_m_s"):
        FlightState(STILL, np.full(3, math.nan), 0.0, 0.0, 0.0)
    with pytest.raises(ValueError, match="roll_rad"):
        state(roll_rad=math.inf)
    for dt_s in (0.0, math.nan, 1.5):
        with pytest.raises(ValueError, match="dt_s"):
            OuterLoop().step(dt_s, wanted(), state())
