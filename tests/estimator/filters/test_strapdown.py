import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.strapdown import EarthModel, Motion, propagate
from estimator.geometry.earth import EARTH_RATE_RAD_S, gravity_m_s2
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import euler_from_q, matrix_from_q, q_from_euler

LAT_RAD = np.deg2rad(52.0)
EARTH = EarthModel.at(LAT_RAD, 200.0)
STILL = EarthModel(np.zeros(3), EARTH.gravity_m_s2, np.inf, np.inf, 0.0)
"""A flat Earth that does not turn."""


@pytest.mark.parametrize("attitude_rad", [(0.0, 0.0, 0.0), (0.3, -0.2, 2.5)])
def test_at_rest_on_the_turning_earth_stays_at_rest(attitude_rad: tuple[float, float, float]) -> None:
    """The gyroscopes feel the Earth's rate and the accelerometers gravity: nothing moves in five minutes."""
    motion = Motion(np.zeros(3), np.zeros(3), q_from_euler(*attitude_rad))
    body_from_ned = matrix_from_q(motion.q_ned_from_body).T
    rate = body_from_ned @ (EARTH_RATE_RAD_S * np.array([np.cos(LAT_RAD), 0.0, -np.sin(LAT_RAD)]))
    force = body_from_ned @ np.array([0.0, 0.0, -float(gravity_m_s2(LAT_RAD, 200.0))])

    for _ in range(3000):
        motion = propagate(motion, rate, force, 0.1, EARTH)

    # half an Earth rate times the step tilts the force by 4e-6 rad, 4e-5 m/s2, of which little adds up
    assert_allclose(motion.vel_ned_m_s, 0.0, atol=0.02)
    assert_allclose(motion.pos_ned_m, 0.0, atol=3.0)
    assert_allclose(euler_from_q(motion.q_ned_from_body), attitude_rad, atol=1e-6)


def test_without_gyroscopes_the_earths_rate_tilts_the_platform() -> None:
    """The attitude drifts against the Earth's rate: roll by its north part, yaw by its vertical part, pitch by none."""
    motion = Motion(np.zeros(3), np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0]))
    support = np.array([0.0, 0.0, -EARTH.gravity_m_s2])

    for _ in range(100):
        motion = propagate(motion, np.zeros(3), support, 0.1, EARTH)

    roll, pitch, yaw = euler_from_q(motion.q_ned_from_body)
    turned = 10.0 * EARTH_RATE_RAD_S
    assert roll == pytest.approx(-turned * np.cos(LAT_RAD), rel=1e-3)
    assert yaw == pytest.approx(turned * np.sin(LAT_RAD), rel=1e-3)
    assert abs(pitch) < 1e-6


def test_free_fall_is_half_g_t_squared() -> None:
    motion = Motion(np.zeros(3), np.array([5.0, 0.0, 0.0]), q_from_euler(0.1, 0.2, 0.3))

    for _ in range(40):
        motion = propagate(motion, np.zeros(3), np.zeros(3), 0.05, STILL)

    assert_allclose(motion.pos_ned_m, [10.0, 0.0, 0.5 * STILL.gravity_m_s2 * 4.0], rtol=1e-12, atol=1e-12)
    assert_allclose(motion.vel_ned_m_s, [5.0, 0.0, 2.0 * STILL.gravity_m_s2])


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_coordinated_turn_is_a_circle(side: float) -> None:
    """Speed V, turn rate w: bank atan(V w / g), no side force, radius V / w; right turns first go north, then east."""
    speed, turn, dt_s = 20.0, side * 0.2, 0.01
    bank = np.arctan(speed * turn / STILL.gravity_m_s2)
    motion = Motion(np.zeros(3), np.array([speed, 0.0, 0.0]), q_from_euler(bank, 0.0, 0.0))
    rate = turn * np.array([0.0, np.sin(bank), np.cos(bank)])
    force = np.array([0.0, 0.0, -STILL.gravity_m_s2 / np.cos(bank)])

    for k in range(1, 2001):
        motion = propagate(motion, rate, force, dt_s, STILL)
        if k % 500 == 0:
            angle = turn * k * dt_s
            # the middle of the interval gives second order: (w dt)^2 / 24 of the radius
            expected = speed / turn * np.array([np.sin(angle), 1.0 - np.cos(angle), 0.0])
            assert_allclose(motion.pos_ned_m, expected, atol=0.01)
            assert_allclose(motion.vel_ned_m_s, speed * np.array([np.cos(angle), np.sin(angle), 0.0]), atol=1e-3)
            assert_allclose(
                matrix_from_q(motion.q_ned_from_body), matrix_from_q(q_from_euler(bank, 0, angle)), atol=1e-9
            )


def test_error_falls_with_the_square_of_the_step() -> None:
    def end(dt_s: float) -> np.ndarray:
        motion = Motion(np.zeros(3), np.array([10.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
        for _ in range(round(4.0 / dt_s)):
            motion = propagate(motion, np.array([0.0, 0.0, 0.5]), np.array([0.0, 5.0, -9.81]), dt_s, STILL)
        return motion.vel_ned_m_s

    truth = np.array([10.0 * np.cos(2.0), 10.0 * np.sin(2.0)])
    coarse, fine = (np.linalg.norm(end(dt_s)[:2] - truth) for dt_s in (0.1, 0.05))

    assert coarse / fine == pytest.approx(4.0, rel=0.05)


def test_coriolis_pushes_northbound_flight_to_the_east() -> None:
    """Free of force sideways, north at 100 m/s for 20 s on the northern half: 2 w sin(lat) V to the right."""
    motion = Motion(np.zeros(3), np.array([100.0, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))

    for _ in range(200):
        # what the attitude loses to the Earth's rate is fed in, so that the force stays vertical
        rate = EARTH.rate_ned_rad_s + EARTH.transport_rate_ned_rad_s(*motion.vel_ned_m_s[:2])
        motion = propagate(motion, rate, np.array([0.0, 0.0, -EARTH.gravity_m_s2]), 0.1, EARTH)

    assert motion.vel_ned_m_s[1] == pytest.approx(2.0 * EARTH_RATE_RAD_S * np.sin(LAT_RAD) * 100.0 * 20.0, rel=0.01)


def test_fixed_platform_pitches_up_as_the_vertical_turns_away() -> None:
    """
    North at constant speed over an ellipsoid that does not rotate, with gyroscopes that feel nothing.

    The turn of the vertical is taken from the geodetic latitude of the place reached, not from the radii.
    """
    frame = LocalFrame(LAT_RAD, 0.0, 200.0)
    speed, seconds = 200.0, 60
    lat_end, _, _ = frame.geodetic_from_ned(np.array([speed * seconds, 0.0, 0.0]))
    motion = Motion(np.zeros(3), np.array([speed, 0.0, 0.0]), np.array([1.0, 0.0, 0.0, 0.0]))
    earth = EarthModel(
        np.zeros(3), EARTH.gravity_m_s2, EARTH.meridian_radius_m, EARTH.transverse_radius_m, EARTH.tan_lat
    )
    support = np.array([0.0, 0.0, -earth.gravity_m_s2 - speed**2 / earth.meridian_radius_m])
    for _ in range(seconds * 10):
        # an inertially fixed platform: no rate at all
        tilt = Motion(motion.pos_ned_m, np.array([speed, 0.0, 0.0]), motion.q_ned_from_body)
        motion = propagate(tilt, np.zeros(3), support, 0.1, earth)

    _, pitch, _ = euler_from_q(motion.q_ned_from_body)
    assert pitch == pytest.approx(float(lat_end) - LAT_RAD, rel=2e-3)


def test_tilt_error_grows_as_a_parabola_before_schuler() -> None:
    """A milliradian of tilt: position error g tilt t^2 / 2 within minutes, as 84 minutes of Schuler are far away."""
    tilt, seconds = 1e-3, 60.0
    motion = Motion(np.zeros(3), np.zeros(3), q_from_euler(0.0, tilt, 0.0))

    for _ in range(600):
        motion = propagate(motion, np.zeros(3), np.array([0.0, 0.0, -STILL.gravity_m_s2]), 0.1, STILL)

    assert motion.pos_ned_m[0] == pytest.approx(-0.5 * STILL.gravity_m_s2 * tilt * seconds**2, rel=1e-5)
