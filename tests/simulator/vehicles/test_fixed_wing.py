"""The aeroplane against the thesis's matrices and modes, another integrator, and conservation laws."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import euler_from_q, matrix_from_q, q_from_euler
from estimator.types import Float
from simulator.vehicles.airframes import OSPREY, PING_WING, Airframe
from simulator.vehicles.fixed_wing import STATES, Controls, FixedWing, derivative, moved, runge_kutta, trim
from simulator.vehicles.state import VehicleState
from tests.authorities.stored import stored

FRAME = LocalFrame(math.radians(58.5), math.radians(15.6), 80.0)
STILL = (0.0, 0.0, 0.0)
G = 9.81
DT_S = 0.01
# (2-13) and (2-14), read off the print: V, alpha, q, theta; beta, p, r, phi. Inputs in degrees and newtons.
A_LON = np.array(((-0.15, 11.08, 0.08, -9.81), (-0.03, -7.17, 0.83, 0), (0, -37.35, -9.96, 0), (0, 0, 1, 0)))
B_LON = np.array(((3e-3, 0.06), (1e-5, 1e-4), (0.98, 0), (0, 0)))
A_LAT = np.array(((-0.69, -0.03, -0.99, 0.39), (-3.13, -12.92, 1.10, 0), (17.03, -0.10, -0.97, 0), (0, 1, 0, 0)))
B_LAT = np.array(((0, 0), (1.50, -0.02), (-0.09, 0.17), (0, 0)))


def euler_slope(airframe: Airframe, x: Float, inputs: Float) -> Float:
    """Derivatives of V, alpha, q, theta, beta, p, r, phi; the state is kinematically exact, heading left out."""
    speed, alpha, q, theta, beta, p, r, phi = x.tolist()
    state = np.zeros(STATES)
    state[3:6] = speed * np.array((math.cos(alpha) * math.cos(beta), math.sin(beta), math.sin(alpha) * math.cos(beta)))
    state[6:10], state[10:13] = q_from_euler(phi, theta, 0.0), (p, q, r)
    elevator, thrust, aileron, rudder = inputs.tolist()
    controls = Controls(math.radians(aileron), math.radians(elevator), math.radians(rudder), thrust)
    rate = derivative(airframe, state, controls, STILL, G)
    velocity, change = state[3:6], rate[3:6]
    speed_rate = float(velocity @ change) / speed
    alpha_rate = (velocity[0] * change[2] - velocity[2] * change[0]) / (velocity[0] ** 2 + velocity[2] ** 2)
    beta_rate = (change[1] - speed_rate * math.sin(beta)) / (speed * math.cos(beta))
    theta_rate = q * math.cos(phi) - r * math.sin(phi)
    phi_rate = p + (q * math.sin(phi) + r * math.cos(phi)) * math.tan(theta)
    return np.array((speed_rate, alpha_rate, rate[11], theta_rate, beta_rate, rate[10], rate[12], phi_rate))


def linearised(airframe: Airframe) -> tuple[Float, Float]:
    """Jacobians (8, 8) and (8, 4) at level flight by central differences."""
    level = trim(airframe, airframe.airspeed_m_s)
    x = np.array((airframe.airspeed_m_s, level.alpha_rad, 0, level.pitch_rad, 0, 0, 0, 0))
    u = np.array((math.degrees(level.controls.elevator_rad), level.controls.thrust_n, 0, 0))
    step = 1e-5

    def column(dx: Float, du: Float) -> Float:
        ahead, behind = euler_slope(airframe, x + dx, u + du), euler_slope(airframe, x - dx, u - du)
        return (ahead - behind) / (2 * step)

    a = np.column_stack([column(step * one, np.zeros(4)) for one in np.eye(8)])
    b = np.column_stack([column(np.zeros(8), step * one) for one in np.eye(4)])
    return a, b


def oscillation(values: Float, near_rad_s: float) -> tuple[float, float]:
    """Frequency and damping of the oscillating mode closest to a frequency."""
    pairs = [one for one in values if one.imag > 0]
    mode = min(pairs, key=lambda one: abs(abs(one) - near_rad_s))
    return abs(mode), -mode.real / abs(mode)


def fly(aircraft: FixedWing, seconds: float, command: Controls, dt_s: float = DT_S) -> list[VehicleState]:
    return [aircraft.step(round(k * dt_s * 1e6), dt_s, command) for k in range(1, round(seconds / dt_s) + 1)]


def test_osprey_has_the_matrices_of_the_print() -> None:
    """Two decimals are printed; the last of (2-14), phi by r, is zero here: level flight is along the body's axis."""
    a, b = linearised(OSPREY)
    assert_allclose(a[:4, :4], A_LON, atol=0.006)
    assert_allclose(a[4:, 4:], A_LAT, atol=0.006)
    assert_allclose(b[:4, :2], B_LON, atol=2e-6)
    assert_allclose(b[4:, 2:], B_LAT, atol=1e-6)
    assert_allclose(a[:4, 4:], 0.0, atol=1e-6)
    assert_allclose(a[4:, :4], 0.0, atol=1e-6)


def test_osprey_has_the_modes_of_the_print() -> None:
    """Page 19, last digits as printed; the spiral doubles in 26 s here: -0.03 for phi by r makes the 44 s."""
    a, _ = linearised(OSPREY)
    along, across = np.linalg.eigvals(a[:4, :4]), np.linalg.eigvals(a[4:, 4:])
    assert_allclose(oscillation(along, 10.0), (10.1, 0.85), atol=0.05)
    assert_allclose(oscillation(along, 0.3), (0.34, 0.24), atol=0.015)
    assert_allclose(oscillation(across, 4.0), (4.20, 0.19), atol=0.02)
    real = sorted(one.real for one in across if abs(one.imag) < 1e-9)
    assert -1 / real[0] == pytest.approx(0.08, abs=0.005)
    assert math.log(2) / real[1] == pytest.approx(44.0, rel=0.5)


def test_ping_wing_has_modes_of_its_size() -> None:
    """No outside answer. Short period: sqrt(0.25 q S c / I_y) = 28.6 / s, heaved on by the lift; phugoid: about
    sqrt(2) g / V = 0.73 / s; the dutch roll is damped; roll settles within a tenth of a second."""
    a, _ = linearised(PING_WING)
    along, across = np.linalg.eigvals(a[:4, :4]), np.linalg.eigvals(a[4:, 4:])
    short, damping = oscillation(along, 30.0)
    assert short == pytest.approx(28.6, rel=0.15)
    assert 0.3 < damping < 1.0
    assert oscillation(along, 0.7)[0] == pytest.approx(0.73, rel=0.1)
    dutch, damping = oscillation(across, 12.0)
    assert dutch == pytest.approx(12.4, rel=0.15)
    assert 0.05 < damping < 0.6
    assert min(one.real for one in across) < -10.0
    assert max(one.real for one in across) < 0.2


@pytest.mark.parametrize("airframe", [OSPREY, PING_WING], ids=lambda one: one.name)
@pytest.mark.parametrize(("share", "climb_deg"), [(1.0, 0.0), (1.15, 0.0), (1.0, 5.0), (1.0, -5.0)])
def test_trim_is_held(airframe: Airframe, share: float, climb_deg: float) -> None:
    """For ten seconds within a decimetre: what an unstable spiral makes of rounding is less."""
    level = trim(airframe, share * airframe.airspeed_m_s, math.radians(climb_deg))
    state = np.zeros(STATES)
    state[3:6] = level.airspeed_m_s * np.array((math.cos(level.alpha_rad), 0.0, math.sin(level.alpha_rad)))
    state[6:10] = q_from_euler(0.0, level.pitch_rad, 0.0)
    for _ in range(1000):
        state = runge_kutta(airframe, state, level.controls, STILL, G, 0.01)
    way_m = 10.0 * level.airspeed_m_s
    climb_rad = math.radians(climb_deg)
    assert_allclose(state[:3], (way_m * math.cos(climb_rad), 0.0, -way_m * math.sin(climb_rad)), atol=0.1)
    assert_allclose(euler_from_q(state[6:10]), (0.0, level.pitch_rad, 0.0), atol=1e-4)


@pytest.mark.parametrize("airspeed_m_s", [8.0, 90.0, math.nan, -25.0])
def test_what_cannot_be_flown_is_not_trimmed(airspeed_m_s: float) -> None:
    with pytest.raises(ValueError, match=r"airspeed_m_s must be|cannot hold"):
        trim(OSPREY, airspeed_m_s)


@pytest.mark.parametrize("flight", stored("fixed_wing_scipy")["flights"], ids=lambda flight: flight["name"])
def test_flights_are_those_of_another_integrator(flight: dict) -> None:  # type: ignore[type-arg]
    """Rough handling for two seconds, 10 ms steps against 1e-11: the methods' difference is below a millimetre."""
    state = np.zeros(STATES)
    state[6] = 1.0
    wind = tuple(float(one) for one in flight["wind_ned_m_s"])
    state[3:6] = np.array((25.0, 0.0, 0.0)) + wind
    worst = 0.0
    for k in range(200):
        aileron, elevator, rudder, thrust = flight["first_deg_n"] if k < 50 else flight["then_deg_n"]
        controls = Controls(*(math.radians(one) for one in (aileron, elevator, rudder)), thrust)
        state = runge_kutta(OSPREY, state, controls, wind, G, 0.01)
        if k % 10 == 9:
            expected = np.array(flight["states"][k // 10])
            worst = max(worst, float(np.abs(expected[9:]).max()))
            assert_allclose(state[:3], expected[:3], atol=1e-3)
            assert_allclose(state[3:6], expected[3:6], atol=2e-3)
            assert_allclose(euler_from_q(state[6:10]), expected[6:9], atol=2e-4)
            assert_allclose(state[10:], expected[9:], atol=2e-3)
    assert worst > 0.2


def test_energy_and_angular_momentum_are_kept_where_nothing_acts() -> None:
    """A tumbling body without air: its energies and its angular momentum in NED stay, to the method's 1e-6."""
    none = (0.0, 0.0, 0.0, 0.0, 0.0)
    body = replace(
        OSPREY, lift_m_s2=(0.0,) * 4, drag_m_s2=(0.0,) * 3, forward_m_s2=(0.0, 0.0), down_by_thrust_m_s2_n=0.0,
        side_m_s2=none, roll_rad_s2=none, pitch_rad_s2=(0.0,) * 3, yaw_rad_s2=none,
    )  # fmt: skip
    state = np.zeros(STATES)
    state[3:6], state[6:10], state[10:] = (20.0, 3.0, -5.0), q_from_euler(0.3, -0.4, 1.0), (1.5, 2.0, -1.0)
    inertia = np.array(body.inertia)

    def kept(at: Float) -> Float:
        ned = matrix_from_q(at[6:10])
        turning = 0.5 * float(inertia @ at[10:] ** 2)
        moving = 0.5 * float(at[3:6] @ at[3:6]) - G * float(at[2])
        return np.array((turning, moving, *(ned @ (inertia * at[10:])), *(ned @ at[3:6])[:2]))

    before = kept(state)
    for _ in range(1000):
        state = runge_kutta(body, state, Controls(), STILL, G, 0.005)
    assert state[2] > 50.0
    assert_allclose(kept(state), before, rtol=1e-6)


def test_steady_wind_carries_the_aeroplane_along_and_nothing_else() -> None:
    wind = np.array((3.0, -4.0, 0.0))
    calm = FixedWing(FRAME, np.zeros(3), 0.7, 1, np.zeros(3), 0.0)
    carried = FixedWing(FRAME, np.zeros(3), 0.7, 1, wind, 0.0)
    command = replace(calm.trim.controls, aileron_rad=0.02, elevator_rad=0.01)
    still, blown = fly(calm, 4.0, command)[-1], fly(carried, 4.0, command)[-1]
    assert_allclose(blown.pos_ned_m - still.pos_ned_m, 4.0 * wind, atol=1e-6)
    assert_allclose(blown.q_ned_from_body, still.q_ned_from_body, atol=1e-9)
    assert abs(still.roll_rad) > 0.1


def test_a_gust_from_below_lifts() -> None:
    aircraft = FixedWing(FRAME, np.zeros(3), 0.0, 1, np.zeros(3), 0.0)
    states = [aircraft.step(k, DT_S, aircraft.trim.controls, np.array((0.0, 0.0, -5.0))) for k in range(1, 51)]
    # 5 m/s at 25 m/s are 0.2 rad: 3.6 g at once.
    assert states[0].specific_force_body_m_s2[2] < -3.0 * G
    assert states[-1].vel_ned_m_s[2] < -2.0


def test_gusts_come_from_the_seed() -> None:
    def last(seed: int) -> Float:
        aircraft = FixedWing(FRAME, np.zeros(3), 0.0, seed, np.zeros(3), 1.0)
        return fly(aircraft, 1.0, aircraft.trim.controls)[-1].pos_ned_m

    assert_allclose(last(3), last(3), rtol=0, atol=0)
    assert np.abs(last(3) - last(4)).max() > 0.01


def test_inputs_keep_their_limits_and_rates() -> None:
    """Table 3-1: 30 degrees at 300 degrees a second, 200 N at 200 N a second."""
    wanted = Controls(9.0, -9.0, 9.0, 1e4)
    one = moved(OSPREY, Controls(), wanted, 0.01)
    assert_allclose(np.degrees((one.aileron_rad, one.elevator_rad, one.rudder_rad)), (3.0, -3.0, 3.0))
    assert one.thrust_n == pytest.approx(2.0)
    for _ in range(300):
        one = moved(OSPREY, one, wanted, 0.01)
    assert_allclose(np.degrees((one.aileron_rad, one.elevator_rad, one.rudder_rad)), (30.0, -30.0, 30.0))
    assert 190.0 < one.thrust_n <= 200.0
    assert moved(OSPREY, Controls(), Controls(thrust_n=-5.0), 0.01).thrust_n == 0.0


def test_readings_are_of_the_motion() -> None:
    """In level trim: gravity and nothing else, up to the turning of the Earth (0.01 m/s2 at 25 m/s)."""
    state = fly(FixedWing(FRAME, np.zeros(3), 0.0, 1, np.zeros(3), 0.0), 1.0, trim(OSPREY, 25.0, 0.0, 9.819).controls)[
        -1
    ]
    assert_allclose(state.specific_force_body_m_s2, (0.0, 0.0, -9.819), atol=0.03)


def test_bad_input_is_named() -> None:
    with pytest.raises(ValueError, match="elevator_rad must be finite"):
        Controls(elevator_rad=math.nan)
    with pytest.raises(ValueError, match="roll_rad_s2 must be 5 finite"):
        replace(OSPREY, roll_rad_s2=(0.0,))  # type: ignore[arg-type]
    with pytest.raises(ValueError, match="mass_kg must be positive"):
        replace(OSPREY, mass_kg=0.0)
    with pytest.raises(ValueError, match="gust_std_m_s"):
        FixedWing(FRAME, np.zeros(3), 0.0, 1, np.zeros(3), -1.0)
    aircraft = FixedWing(FRAME, np.zeros(3), 0.0, 1, np.zeros(3), 0.0)
    with pytest.raises(ValueError, match="dt_s"):
        aircraft.step(1, 0.05, Controls())
    with pytest.raises(ValueError, match="gust_ned_m_s"):
        aircraft.step(1, 0.01, Controls(), np.array((math.nan, 0.0, 0.0)))
