"""The RMAX against the thesis's transfer functions by SciPy, and its equations of motion by another integrator."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from estimator.geometry.local import LocalFrame
from estimator.types import Float
from simulator.vehicles.rmax import AttitudeDynamics, Heave, Rmax, RmaxConfig, YacsInput, yacs_input
from simulator.vehicles.state import VehicleState

FRAME = LocalFrame(math.radians(58.5), math.radians(15.6), 80.0)
DT_S = 0.02
STILL = np.zeros(3)
# (3.4), written out from the print once more: gain, zeros' factors, poles' factors.
PRINTED = {
    "aileron": (2.3, [(1, 3.87, 53.3)], [(1, 6.29, 16.2), (1, 8.97, 168)]),
    "elevator": (0.5, [(1, 9.76, 75.5)], [(1, 3, 5.55), (1, 2.06, 123.5)]),
    "rudder": (9.7, [(1, 12.25)], [(1, 4.17), (1, 3.5, 213.4)]),
    "throttle": (0.0828, [(1, 0), (1, 3.37)], [(1, 0.95), (1, 13.1, 214.1)]),
}


def by_scipy(channel: str, t_s: Float) -> Float:
    """Response to a unit step by SciPy, from roots and gain rather than from polynomials in a state space."""
    gain, zeros, poles = PRINTED[channel]
    system = signal.ZerosPolesGain(
        np.concatenate([np.roots(one) for one in zeros]), np.concatenate([np.roots(one) for one in poles]), gain
    )
    _, response = signal.step(system, T=t_s)
    return np.asarray(response, np.float64)


def fly(rmax: Rmax, seconds: float, command: YacsInput, dt_s: float = DT_S) -> list[VehicleState]:
    return [rmax.step(round(k * dt_s * 1e6), dt_s, command) for k in range(1, round(seconds / dt_s) + 1)]


def still_rmax(config: RmaxConfig | None = None, wind: Float = STILL, yaw_rad: float = 0.0) -> Rmax:
    return Rmax(FRAME, np.array((0.0, 0.0, -50.0)), yaw_rad, 1, wind, 0.0, config)


@pytest.mark.parametrize("channel", list(PRINTED))
@pytest.mark.parametrize("dt_s", [0.02, 0.005, 0.1])
def test_step_responses_are_those_of_the_transfer_functions(channel: str, dt_s: float) -> None:
    """Within 1 % of the largest value is asked; what is held over a step is integrated exactly."""
    size = 120.0
    dynamics, command = AttitudeDynamics(), YacsInput(**{channel: size})
    responses = [dynamics.response, *(dynamics.step(dt_s, command) for _ in range(round(6.0 / dt_s)))]
    t_s = dt_s * np.arange(len(responses))
    expected = size * by_scipy(channel, t_s)
    found = {
        "aileron": [math.degrees(one.roll_rad) for one in responses],
        "elevator": [math.degrees(one.pitch_rad) for one in responses],
        "rudder": [math.degrees(one.yaw_rate_rad_s) for one in responses],
        "throttle": [one.lift_g for one in responses],
    }
    assert np.abs(expected).max() > 0.01
    for name, values in found.items():
        # The channels are decoupled.
        wanted = expected if name == channel else np.zeros(len(t_s))
        assert_allclose(values, wanted, atol=1e-6 * np.abs(expected).max())


def test_rates_are_derivatives_of_the_angles() -> None:
    dynamics = AttitudeDynamics()
    states = [dynamics.step(0.001, YacsInput(aileron=100.0, elevator=-80.0)) for _ in range(1500)]
    for angle, rate in (("roll_rad", "roll_rate_rad_s"), ("pitch_rad", "pitch_rate_rad_s")):
        slope = np.gradient([getattr(one, angle) for one in states], 0.001)
        assert_allclose([getattr(one, rate) for one in states[1:-1]], slope[1:-1], atol=2e-4)


def test_the_whole_helicopter_responds_in_the_same_way() -> None:
    """Roll of the flying vehicle within 1 % of SciPy's."""
    states = fly(still_rmax(), 3.0, YacsInput(aileron=100.0))
    expected = 100.0 * by_scipy("aileron", DT_S * np.arange(len(states) + 1))[1:]
    assert_allclose([math.degrees(s.roll_rad) for s in states], expected, atol=0.01 * np.abs(expected).max())


def equations(t: float, x: Float, command: YacsInput, wind: Float, printed_heave: bool) -> Float:
    """(3.4), (3.7), (3.9), (3.10) written again: transfer functions as chains of SciPy's state spaces."""
    inputs = (command.aileron, command.elevator, command.rudder, command.throttle)
    outputs, slopes, at = [], [], 7
    for (gain, zeros, poles), value in zip(PRINTED.values(), inputs, strict=True):
        num, den = [gain], [1.0]
        for factor in zeros:
            num = np.polymul(num, factor)
        for factor in poles:
            den = np.polymul(den, factor)
        a, b, c, _ = signal.tf2ss(num, den)
        part = x[at : at + len(a)]
        slope = a @ part + b[:, 0] * value
        outputs.append((float(c[0] @ part), float(c[0] @ slope)))
        slopes.append(slope)
        at += len(a)
    (roll, roll_rate), (pitch, pitch_rate), (r, _), (lift_g, _) = outputs
    roll, roll_rate, pitch, pitch_rate, r = np.radians((roll, roll_rate, pitch, pitch_rate, r))
    u, v, w_throttle, w_other, yaw = x[:5]
    w = w_throttle + w_other
    # The body's rates from Euler's by the inverse of (3.7).
    q = (pitch_rate + r * math.sin(roll)) / math.cos(roll)
    yaw_rate = (q * math.sin(roll) + r * math.cos(roll)) / math.cos(pitch)
    p = roll_rate - yaw_rate * math.sin(pitch)
    attitude = Rotation.from_euler("ZYX", (yaw, pitch, roll))
    air = attitude.inv().apply(wind)
    g = 9.8181
    motion = np.array((
        -0.025 * (u - air[0]) - q * w + r * v - g * math.sin(pitch),
        -0.1 * (v - air[1]) - r * u + p * w + g * math.cos(pitch) * math.sin(roll),
        -9.81 * lift_g - (0.6 * w_throttle if printed_heave else 0.0),
        -0.6 * (w_other - air[2]) - g - p * v + q * u + g * math.cos(pitch) * math.cos(roll),
        yaw_rate,
    ))  # fmt: skip
    over_ground = attitude.apply((u, v, w))[:2]
    return np.concatenate((motion, over_ground, *slopes))


@pytest.mark.parametrize("heave", list(Heave))
def test_motion_is_that_of_the_equations_by_another_integrator(heave: Heave) -> None:
    """Eight seconds of a climbing, accelerating turn in wind: within 1 % of the way."""
    command = YacsInput(aileron=90.0, elevator=-60.0, rudder=70.0, throttle=150.0)
    wind, yaw = np.array((2.0, -3.0, 0.5)), 0.7
    states = fly(still_rmax(RmaxConfig(heave=heave), wind, yaw), 8.0, command)
    start = np.zeros(7 + 14)
    start[4] = yaw
    solved = solve_ivp(
        equations, (0.0, 8.0), start, method="RK45", rtol=1e-8, atol=1e-9,
        args=(command, wind, heave is Heave.AS_PRINTED),
    ).y[:, -1]  # fmt: skip
    way_m = float(np.linalg.norm(states[-1].pos_ned_m[:2]))
    assert way_m > 12.0
    assert_allclose(states[-1].pos_ned_m[:2], solved[5:7], atol=0.01 * way_m)
    assert states[-1].yaw_rad == pytest.approx(math.remainder(solved[4], 2 * math.pi), abs=0.01)
    speed = Rotation.from_euler("ZYX", (states[-1].yaw_rad, states[-1].pitch_rad, states[-1].roll_rad)).apply(
        (solved[0], solved[1], solved[2] + solved[3])
    )
    assert_allclose(states[-1].vel_ned_m_s, speed, atol=0.01 * float(np.linalg.norm(speed)))


def test_it_hovers_untouched_in_still_air() -> None:
    last = fly(still_rmax(), 20.0, YacsInput())[-1]
    assert_allclose(last.pos_ned_m, (0.0, 0.0, -50.0), atol=1e-9)
    assert_allclose(last.specific_force_body_m_s2, (0.0, 0.0, -9.818), atol=2e-3)


def test_wind_carries_it_away_by_the_derivatives() -> None:
    """From the side Y_v = -0.1 pulls it to 1 - exp(-1) of the wind in ten seconds; from ahead X_u to 22 %."""
    last = fly(still_rmax(wind=np.array((4.0, 4.0, 0.0))), 10.0, YacsInput())[-1]
    assert_allclose(last.vel_ned_m_s[:2], (4.0 * (1 - math.exp(-0.25)), 4.0 * (1 - math.exp(-1.0))), rtol=1e-3)
    assert_allclose(last.wind_ned_m_s, (4.0, 4.0, 0.0))


def test_signs_of_the_inputs() -> None:
    right, up = (
        fly(still_rmax(), 2.0, YacsInput(aileron=100.0))[-1],
        fly(still_rmax(), 2.0, YacsInput(throttle=100.0))[-1],
    )
    ahead, turned = (
        fly(still_rmax(), 2.0, YacsInput(elevator=-100.0))[-1],
        fly(still_rmax(), 2.0, YacsInput(rudder=100.0))[-1],
    )
    assert right.roll_rad > 0.0 and right.vel_ned_m_s[1] > 0.5
    assert up.vel_ned_m_s[2] < -0.5
    assert ahead.pitch_rad < 0.0 and ahead.vel_ned_m_s[0] > 0.5
    assert turned.yaw_rad > 0.1


def test_inputs_for_settled_values_lead_there() -> None:
    command = yacs_input(0.05, -0.03, 0.2, 1.5)
    dynamics = AttitudeDynamics()
    for _ in range(1000):
        now = dynamics.step(DT_S, command)
    assert (now.roll_rad, now.pitch_rad, now.yaw_rate_rad_s) == pytest.approx((0.05, -0.03, 0.2), abs=1e-6)
    assert now.lift_g == pytest.approx(0.0, abs=1e-6)
    climbing = fly(still_rmax(), 20.0, yacs_input(0.0, 0.0, 0.0, 1.5))[-1]
    assert climbing.vel_ned_m_s[2] == pytest.approx(-1.5, rel=0.01)


def test_as_printed_all_of_the_throttle_lifts_it_by_eleven_metres() -> None:
    """Why Z_w does not damp what the throttle does: table 4.1 has climbs of 30 m."""
    printed = fly(still_rmax(RmaxConfig(heave=Heave.AS_PRINTED)), 40.0, YacsInput(throttle=500.0))[-1]
    here = fly(still_rmax(), 40.0, YacsInput(throttle=500.0))[-1]
    assert -50.0 - printed.pos_ned_m[2] == pytest.approx(11.2, abs=0.2)
    assert -50.0 - here.pos_ned_m[2] > 200.0


def test_vertical_gusts_are_damped_by_z_w() -> None:
    last = fly(still_rmax(wind=np.array((0.0, 0.0, -1.0))), 1.0 / 0.6, YacsInput(), dt_s=1.0 / 60.0)[-1]
    assert last.vel_ned_m_s[2] == pytest.approx(-(1 - math.exp(-1.0)), rel=1e-3)


def test_the_same_seed_is_the_same_flight_and_another_is_not() -> None:
    def end(seed: int) -> Float:
        rmax = Rmax(FRAME, STILL, 0.0, seed, np.array((3.0, 0.0, 0.0)), 1.0, RmaxConfig(trim_std_rad=0.01))
        return fly(rmax, 5.0, YacsInput(aileron=20.0))[-1].pos_ned_m

    assert np.array_equal(end(7), end(7))
    assert not np.allclose(end(7), end(8), atol=0.05)


def test_inertial_readings_lead_to_the_same_place() -> None:
    """Strapdown over flat ground with SciPy's rotations: 5 s with a turn, a few centimetres."""
    states = fly(still_rmax(wind=np.array((1.0, 2.0, 0.0))), 5.0, YacsInput(aileron=60.0, elevator=-60.0, rudder=40.0))
    pos, vel, attitude = np.array((0.0, 0.0, -50.0)), np.zeros(3), Rotation.identity()
    earth = 7.292115e-5 * np.array((math.cos(FRAME.lat_rad), 0.0, -math.sin(FRAME.lat_rad)))
    for state in states:
        turned = attitude * Rotation.from_rotvec((state.rate_body_rad_s - attitude.inv().apply(earth)) * DT_S)
        # The force is in axes of the step's end.
        accel = turned.apply(state.specific_force_body_m_s2) + np.array((0.0, 0.0, 9.8181)) - 2 * np.cross(earth, vel)
        pos = pos + DT_S * (vel + 0.5 * DT_S * accel)
        vel, attitude = vel + DT_S * accel, turned
    assert_allclose(pos, states[-1].pos_ned_m, atol=0.05)


def test_inputs_beyond_the_limits_are_held_at_them() -> None:
    assert YacsInput(aileron=1e4, rudder=-501.0) == YacsInput(aileron=500.0, rudder=-500.0)
    steep = yacs_input(1.0, 0.0, 0.0, 0.0)
    assert steep.aileron == 500.0


@pytest.mark.parametrize("bad", [math.nan, math.inf])
def test_numbers_that_are_none_are_refused(bad: float) -> None:
    with pytest.raises(ValueError, match="aileron must be finite"):
        YacsInput(aileron=bad)
    with pytest.raises(ValueError, match="pos_ned_m"):
        Rmax(FRAME, np.array((0.0, bad, 0.0)), 0.0, 1, STILL, 0.0)
    with pytest.raises(ValueError, match="wind_ned_m_s"):
        Rmax(FRAME, STILL, 0.0, 1, np.array((0.0, 0.0, bad)), 0.0)
    with pytest.raises(ValueError, match="yaw_rad"):
        Rmax(FRAME, STILL, bad, 1, STILL, 0.0)
    with pytest.raises(ValueError, match="gust_std_m_s"):
        Rmax(FRAME, STILL, 0.0, 1, STILL, -1.0)
    with pytest.raises(ValueError, match="dt_s"):
        still_rmax().step(0, bad, YacsInput())


@pytest.mark.parametrize(("name", "value"), [("x_u_per_s", 0.1), ("z_w_per_s", math.nan), ("trim_std_rad", -0.1)])
def test_derivatives_that_are_none_are_refused(name: str, value: float) -> None:
    with pytest.raises(ValueError, match=name):
        RmaxConfig(**{name: value})
