"""The multirotor: balances of forces, limits, wind, the ground, and what its sensors read."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from estimator.geometry.local import LocalFrame
from estimator.types import Float
from simulator.vehicles.multirotor import Multirotor, MultirotorConfig
from simulator.vehicles.state import VehicleState

FRAME = LocalFrame(math.radians(58.5), math.radians(15.6), 80.0)
DT_S = 0.005
G = 9.82
STILL = (0.0, 0.0, 0.0)


def aircraft(
    wind: tuple[float, float, float] = STILL, gust_std_m_s: float = 0.0, seed: int = 1,
    config: MultirotorConfig | None = None,
) -> Multirotor:  # fmt: skip
    return Multirotor(FRAME, np.array((30.0, -40.0, -120.0)), 0.3, seed, np.array(wind), gust_std_m_s, config)


def fly(
    one: Multirotor, seconds: float, velocity: tuple[float, float, float], yaw: float = 0.3, floor: float = math.inf
) -> list[VehicleState]:
    command: Float = np.array(velocity)
    return [one.step(k * 5000, DT_S, command, yaw, floor) for k in range(1, round(seconds / DT_S) + 1)]


def tilt_rad(state: VehicleState) -> float:
    return math.acos(math.cos(state.roll_rad) * math.cos(state.pitch_rad))


def test_hovers_in_wind_with_the_tilt_that_holds_the_drag() -> None:
    """8 m/s: 0.2 * 8 + 0.012 * 64 = 2.37 m/s2 against gravity."""
    state = fly(aircraft((8.0, 0.0, 0.0)), 20.0, STILL)[-1]
    assert_allclose(state.vel_ned_m_s, 0.0, atol=0.02)
    assert tilt_rad(state) == pytest.approx(math.atan(2.368 / G), rel=0.01)
    # Nose into the wind from behind: leaning back against it, whatever the heading.
    assert Rotation.from_quat(state.q_ned_from_body, scalar_first=True).as_matrix()[0, 2] > 0.2


def test_flies_the_commanded_velocity_and_heading_in_gusts() -> None:
    late = fly(aircraft((3.0, -2.0, 0.0), 1.0), 25.0, (8.0, 5.0, -1.0), 2.5)[-2000:]
    assert_allclose(np.mean([one.vel_ned_m_s for one in late], axis=0), (8.0, 5.0, -1.0), atol=0.2)
    assert max(abs(math.remainder(one.yaw_rad - 2.5, 2 * math.pi)) for one in late) < 0.1


def test_without_thrust_to_spare_it_climbs_as_fast_as_drag_lets_it() -> None:
    """1.2 g leave 0.2 g: 0.2 v + 0.012 v^2 = 1.96 at 6.93 m/s, of 12 that are wanted."""
    config = MultirotorConfig(thrust_max_g=1.2, tilt_max_rad=math.radians(20.0))
    state = fly(aircraft(config=config), 30.0, (0.0, 0.0, -12.0))[-1]
    assert -state.vel_ned_m_s[2] == pytest.approx(6.93, abs=0.02)


def test_tilt_stays_within_its_limit() -> None:
    states = fly(aircraft((0.0, 12.0, 0.0), 1.0), 10.0, (18.0, 0.0, 0.0))
    # The attitude loop's overshoot and the shaking are a few degrees.
    assert max(map(tilt_rad, states)) < math.radians(39.0)
    assert max(map(tilt_rad, states)) > math.radians(20.0)


def test_attitude_answers_within_a_quarter_of_a_second() -> None:
    """The lag of motors (50 ms), rate loop (1 / 16 s) and attitude loop (1 / 6 s) follow each other."""
    states = fly(aircraft(), 1.0, (6.0, 0.0, 0.0), 0.0)
    pitch = np.array([one.pitch_rad for one in states])
    wanted = -math.atan(4.0 / G)
    reached = DT_S * int(np.argmax(pitch < 0.63 * wanted))
    assert 0.1 < reached < 0.3


def test_lands_stands_and_lifts_off() -> None:
    one = aircraft()
    floor = -118.0
    states = fly(one, 6.0, (0.0, 0.0, 0.5), floor=floor)
    assert one.on_ground
    assert_allclose(states[-1].pos_ned_m[2], floor, atol=1e-9)
    assert_allclose(states[-1].vel_ned_m_s, 0.0, atol=1e-6)
    assert tilt_rad(states[-1]) < 1e-6
    up = fly(one, 3.0, (0.0, 0.0, -1.0), floor=floor)
    assert not one.on_ground
    assert up[-1].pos_ned_m[2] < floor - 1.0


def test_readings_lead_to_the_same_place() -> None:
    """Strapdown integration by SciPy's rotations over 8 s with a turn, within centimetres."""
    states = fly(aircraft((3.0, 0.0, 0.0), 0.5), 8.0, (9.0, -4.0, 0.5), -2.0)
    earth = 7.292115e-5 * np.array((math.cos(FRAME.lat_rad), 0.0, -math.sin(FRAME.lat_rad)))
    gravity = 9.780327 * (1 + 0.0053024 * math.sin(FRAME.lat_rad) ** 2 - 5.8e-6 * math.sin(2 * FRAME.lat_rad) ** 2)
    gravity -= 3.086e-6 * 80
    at = Rotation.from_quat(states[0].q_ned_from_body, scalar_first=True)
    pos, vel = states[0].pos_ned_m.copy(), states[0].vel_ned_m_s.copy()
    for one in states[1:]:
        at = Rotation.from_rotvec(-earth * DT_S) * at * Rotation.from_rotvec(one.rate_body_rad_s * DT_S)
        plumb = gravity * np.array((-pos[0] / 6.38e6, -pos[1] / 6.38e6, 1.0))
        acceleration = at.apply(one.specific_force_body_m_s2) + plumb - 2 * np.cross(earth, vel)
        pos = pos + vel * DT_S + 0.5 * acceleration * DT_S**2
        vel = vel + acceleration * DT_S
    assert_allclose(pos, states[-1].pos_ned_m, atol=0.06)


def test_seeds_differ_and_repeat() -> None:
    one, same, other = (fly(aircraft(gust_std_m_s=1.0, seed=seed), 2.0, STILL)[-1].pos_ned_m for seed in (1, 1, 2))
    assert_allclose(one, same, rtol=0, atol=0)
    assert np.linalg.norm(one - other) > 1e-4


def test_steps_of_any_length_agree() -> None:
    fine, coarse = aircraft((4.0, 0.0, 0.0)), aircraft((4.0, 0.0, 0.0))
    command = np.array((5.0, 2.0, -1.0))
    for k in range(1, 1501):
        last = fine.step(k * 2000, 0.002, command, 1.0)
    for k in range(1, 301):
        other = coarse.step(k * 10_000, 0.01, command, 1.0)
    assert_allclose(other.pos_ned_m, last.pos_ned_m, atol=0.05)
    assert_allclose(other.vel_ned_m_s, last.vel_ned_m_s, atol=0.03)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"motor_time_s": 0.0}, "motor_time_s must be positive"),
        ({"drag_per_s": -1.0}, "drag_per_s must be positive"),
        ({"thrust_max_g": 0.9}, "1 g must lie between"),
        ({"tilt_max_rad": 1.2}, "cannot be flown level"),
    ],
)
def test_bad_settings_are_named(change: dict[str, float], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(MultirotorConfig(), **change)


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="gust_std_m_s"):
        aircraft(gust_std_m_s=-1.0)
    with pytest.raises(ValueError, match="wind_ned_m_s"):
        aircraft((math.nan, 0.0, 0.0))
    with pytest.raises(ValueError, match="dt_s"):
        aircraft().step(1, 0.1, np.zeros(3), 0.0)
