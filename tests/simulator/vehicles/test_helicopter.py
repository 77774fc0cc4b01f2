"""The motion, and the inertial quantities that go with it."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from estimator.geometry.local import LocalFrame
from simulator.vehicles.helicopter import Helicopter
from simulator.vehicles.state import VehicleState

FRAME = LocalFrame(np.radians(58.5), np.radians(15.6), 80.0)
DT_S = 0.005


def fly(seconds: float, velocity: tuple[float, float, float], yaw: float, seed: int = 1) -> list[VehicleState]:
    helicopter = Helicopter(FRAME, np.array([30.0, -40.0, -120.0]), 0.3, seed, 4.0, 1.0)
    command = np.array(velocity)
    return [helicopter.step(round(k * DT_S * 1e6), DT_S, command, yaw) for k in range(1, int(seconds / DT_S) + 1)]


def test_follows_the_commanded_velocity_and_heading() -> None:
    states = fly(25.0, (8.0, 5.0, -1.0), 2.5)
    late = np.array([state.vel_ned_m_s for state in states[-1000:]])
    np.testing.assert_allclose(late.mean(axis=0), [8.0, 5.0, -1.0], atol=0.8)
    assert states[-1].yaw_rad == pytest.approx(2.5, abs=0.1)
    assert max(abs(state.roll_rad) + abs(state.pitch_rad) for state in states) < np.radians(30)


def test_inertial_readings_lead_to_the_same_place() -> None:
    """
    Independent strapdown integration in Earth-centred axes with SciPy's rotations.

    Expected: after 10 s with a turn the position agrees to a few centimetres.
    """
    states = fly(10.0, (9.0, -4.0, 0.5), -2.0)
    start = states[0]
    sin_lat, cos_lat = np.sin(FRAME.lat_rad), np.cos(FRAME.lat_rad)
    earth_rate = 7.292115e-5 * np.array([cos_lat, 0.0, -sin_lat])
    # Normal gravity at 58.5 degrees and 80 m by the 1980 formula.
    gravity = 9.780327 * (1 + 0.0053024 * sin_lat**2 - 5.8e-6 * np.sin(2 * FRAME.lat_rad) ** 2) - 3.086e-6 * 80
    attitude = Rotation.from_quat(start.q_ned_from_body, scalar_first=True)
    position, velocity = start.pos_ned_m.copy(), start.vel_ned_m_s.copy()
    for state in states[1:]:
        turn = state.rate_body_rad_s * DT_S
        attitude = Rotation.from_rotvec(-earth_rate * DT_S) * attitude * Rotation.from_rotvec(turn)
        plumb = gravity * np.array([-position[0] / 6.38e6, -position[1] / 6.38e6, 1.0])
        acceleration = attitude.apply(state.specific_force_body_m_s2) + plumb - 2 * np.cross(earth_rate, velocity)
        position = position + velocity * DT_S + 0.5 * acceleration * DT_S**2
        velocity = velocity + acceleration * DT_S
    np.testing.assert_allclose(position, states[-1].pos_ned_m, atol=0.06)
    np.testing.assert_allclose(velocity, states[-1].vel_ned_m_s, atol=0.01)


def test_seeds_differ_and_repeat() -> None:
    one, same, other = (fly(2.0, (5.0, 0.0, 0.0), 0.0, seed)[-1].pos_ned_m for seed in (1, 1, 2))
    np.testing.assert_array_equal(one, same)
    assert np.linalg.norm(one - other) > 0.01
