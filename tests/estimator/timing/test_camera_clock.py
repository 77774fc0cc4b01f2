import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.interpolate import CubicSpline

from estimator.geometry.camera import GIMBAL_FROM_CAMERA, Mount
from estimator.geometry.rotation import (
    matrix_from_euler,
    matrix_from_q,
    q_conjugate,
    q_from_euler,
    q_from_matrix,
    q_multiply,
    rotvec_from_q,
)
from estimator.timing.camera_clock import CameraClock, CameraClockConfig
from estimator.types import AttitudeSample, CameraAttitudeSample, InertialSample, Sample
from tests.estimator.timing.synthetic import Motion, smooth_rates, turns_and_sensor

# rates of these tests are stamped when they happen
PROMPT = CameraClockConfig(sensor_delay_s=0.0)
START_US = 1_760_000_000_000_000


def _us(t_s: float) -> int:
    return START_US + round(t_s * 1e6)


def _fed(clock: CameraClock, samples: list[Sample], turns: list[tuple[float, float, np.ndarray, np.ndarray]]) -> None:
    for sample in sorted(samples, key=lambda sample: sample.t_us):
        clock.offer(sample)
    for first_s, second_s, rotvec, cov in turns:
        clock.add_turn(_us(first_s), _us(second_s), rotvec, cov)


def _gyro_flight(seed: int, offset_s: float, start_s: float, motion: Motion) -> tuple[list[Sample], list]:
    turns, sensor_s, readings = turns_and_sensor(seed, motion, offset_s, np.zeros(3))
    samples: list[Sample] = [
        InertialSample(_us(start_s + t_s), rate, np.zeros(3)) for t_s, rate in zip(sensor_s, readings, strict=True)
    ]
    columns = (turns.first_s + start_s, turns.second_s + start_s, turns.rotvec_camera_rad, turns.cov_rotvec_rad2)
    return samples, list(zip(*columns, strict=True))


class _Swing:
    """A vehicle whose Euler angles swing smoothly, known at any time."""

    def __init__(self, seed: int, seconds: float = 40.0) -> None:
        angles = smooth_rates(np.random.default_rng(seed), Motion((0.08, 0.06, 0.15), 0.5, seconds))
        self._angles: CubicSpline = angles

    def q_ned_from_body(self, t_s: np.ndarray) -> np.ndarray:
        """Attitudes (n, 4)."""
        angles = self._angles(t_s)
        return q_from_euler(angles[:, 0], angles[:, 1], angles[:, 2])

    def rate_body_rad_s(self, t_s: np.ndarray) -> np.ndarray:
        """Rates (n, 3) by central differences over a millisecond."""
        before, after = self.q_ned_from_body(t_s - 5e-4), self.q_ned_from_body(t_s + 5e-4)
        return rotvec_from_q(q_multiply(q_conjugate(before), after)) / 1e-3

    def heading_rad(self, t_s: np.ndarray) -> np.ndarray:
        """Yaw (n,)."""
        return np.asarray(self._angles(t_s)[:, 2])


def _turns_of(seed: int, ned_from_camera: np.ndarray, frame_s: np.ndarray) -> list:
    """Noisy turns between the camera attitudes (n, 3, 3) at the frames."""
    rng = np.random.default_rng(seed)
    q = q_from_matrix(ned_from_camera)
    std_rad = np.array([4e-3, 4e-3, 2e-3]) * np.diff(frame_s)[:, None]
    rotvec = rotvec_from_q(q_multiply(q_conjugate(q[:-1]), q[1:])) + std_rad * rng.normal(size=(len(q) - 1, 3))
    return [(frame_s[i], frame_s[i + 1], rotvec[i], np.diag(std_rad[i] ** 2)) for i in range(len(rotvec))]


def test_gyroscopes_of_a_fixed_camera() -> None:
    clock = CameraClock(Mount(), "fixed", PROMPT)
    _fed(clock, *_gyro_flight(1, -0.23, 0.0, Motion()))

    found = clock.estimate()

    assert found.observable, found.reason
    assert found.offset_s == pytest.approx(-0.23, abs=0.004)
    assert clock.estimate() is found


def test_delay_of_the_rates_is_taken_out() -> None:
    """Each reading is the mean of the 20 ms before its stamp, as the simulator's: the clock's own default."""
    swing, offset_s = _Swing(2), 0.15
    sensor_s, frame_s = np.arange(-3.5, 43.5, 0.02), np.arange(0.0, 40.0, 0.08)
    steps = q_multiply(q_conjugate(swing.q_ned_from_body(sensor_s - 0.02)), swing.q_ned_from_body(sensor_s))
    samples: list[Sample] = [
        InertialSample(_us(t), turn / 0.02, np.zeros(3)) for t, turn in zip(sensor_s, rotvec_from_q(steps), strict=True)
    ]
    body = swing.q_ned_from_body(frame_s + offset_s)
    camera = matrix_from_q(body) @ Mount().body_from_camera
    clock = CameraClock(Mount(), "fixed")

    _fed(clock, samples, _turns_of(3, camera, frame_s))

    assert clock.estimate().offset_s == pytest.approx(offset_s, abs=0.003)


@pytest.mark.parametrize("rate_hz", [25.0, 10.0, 4.0])
@pytest.mark.parametrize("with_rates", [True, False])
def test_attitude_alone(rate_hz: float, with_rates: bool) -> None:
    """No raw gyroscopes on the link: the quaternions, and the rates where the autopilot sends them."""
    swing, offset_s = _Swing(4), -0.31
    mount = Mount(math.radians(3.0), math.radians(-60.0), math.radians(20.0))
    sensor_s, frame_s = np.arange(-3.5, 43.5, 1.0 / rate_hz), np.arange(0.0, 40.0, 0.08)
    rates = swing.rate_body_rad_s(sensor_s) if with_rates else np.zeros((len(sensor_s), 3))
    samples: list[Sample] = [
        AttitudeSample(_us(t), q, rate)
        for t, q, rate in zip(sensor_s, swing.q_ned_from_body(sensor_s), rates, strict=True)
    ]
    camera = matrix_from_q(swing.q_ned_from_body(frame_s + offset_s)) @ mount.body_from_camera
    clock = CameraClock(mount, "fixed", PROMPT)

    _fed(clock, samples, _turns_of(5, camera, frame_s))
    found = clock.estimate()

    assert found.observable, found.reason
    assert abs(found.offset_s - offset_s) < 3.0 * found.std_s
    # interpolation over a quarter of a second costs
    assert found.std_s < (0.04 if rate_hz < 10.0 else 0.008)


@pytest.mark.parametrize("yaw_is_earth", [True, False])
def test_gimbal_that_reports(yaw_is_earth: bool) -> None:
    """The camera turns as its gimbal says, whatever the body does; without earth yaw the body's yaw is added."""
    body, gimbal, offset_s = _Swing(6), _Swing(7), 0.4
    sensor_s, frame_s = np.arange(-3.5, 43.5, 0.05), np.arange(0.0, 40.0, 0.08)

    def q_ned_from_gimbal(t_s: np.ndarray) -> np.ndarray:
        relative = q_multiply(gimbal.q_ned_from_body(t_s), q_from_euler(np.zeros(1), np.full(1, -1.0), np.zeros(1)))
        heading = body.heading_rad(t_s)
        return q_multiply(q_from_euler(0.0 * heading, 0.0 * heading, heading), relative)

    samples: list[Sample] = []
    for t_s in sensor_s:
        at = np.array([t_s])
        samples.append(AttitudeSample(_us(t_s), body.q_ned_from_body(at)[0], body.rate_body_rad_s(at)[0]))
        heading = float(body.heading_rad(at)[0])
        q = q_ned_from_gimbal(at)[0]
        if not yaw_is_earth:
            q = q_multiply(q_conjugate(q_from_euler(0.0, 0.0, heading)), q)
        samples.append(CameraAttitudeSample(_us(t_s), q, yaw_is_earth))
    boresight = matrix_from_euler(0.01, -0.02, 0.015)
    camera = matrix_from_q(q_ned_from_gimbal(frame_s + offset_s)) @ boresight @ GIMBAL_FROM_CAMERA
    clock = CameraClock(Mount(), "pan_tilt", PROMPT)

    _fed(clock, samples, _turns_of(8, camera, frame_s))
    found = clock.estimate()

    assert found.observable, found.reason
    assert found.offset_s == pytest.approx(offset_s, abs=0.005)
    assert_allclose(found.boresight_rad, (0.01, -0.02, 0.015), atol=0.012)


def test_stabilised_camera_that_reports_nothing_turns_with_the_heading() -> None:
    body, offset_s = _Swing(9), 0.2
    sensor_s, frame_s = np.arange(-3.5, 43.5, 0.05), np.arange(0.0, 40.0, 0.08)
    samples: list[Sample] = [
        AttitudeSample(_us(t), q, np.zeros(3)) for t, q in zip(sensor_s, body.q_ned_from_body(sensor_s), strict=True)
    ]
    mount = Mount(0.0, math.radians(-45.0), 0.0)
    heading = body.heading_rad(frame_s + offset_s)
    camera = matrix_from_euler(0.0 * heading, 0.0 * heading, heading) @ mount.body_from_camera
    clock = CameraClock(mount, "stabilised", PROMPT)

    _fed(clock, samples, _turns_of(10, camera, frame_s))
    found = clock.estimate()

    assert found.observable, found.reason
    assert found.offset_s == pytest.approx(offset_s, abs=0.005)


def test_window_forgets_an_offset_that_has_changed() -> None:
    """
    Fault: the video's clock steps by a quarter of a second in flight.
    Expected: once the window has passed, the new offset, and no earlier claim of anything but the two.
    """
    clock = CameraClock(Mount(), "fixed", CameraClockConfig(sensor_delay_s=0.0, window_s=20.0))
    for start_s, offset_s in ((0.0, 0.1), (37.5, 0.35)):
        samples, turns = _gyro_flight(11, offset_s, start_s, Motion())
        _fed(clock, samples, turns)
        found = clock.estimate()
        assert found.offset_s == pytest.approx(offset_s, abs=0.004)
        assert found.pairs <= 20.0 * 12.5


def test_reset_forgets_the_pictures() -> None:
    clock = CameraClock(Mount(), "fixed", PROMPT)
    _fed(clock, *_gyro_flight(12, 0.1, 0.0, Motion()))
    clock.reset()

    found = clock.estimate()

    assert not found.observable
    assert found.pairs == 0


def test_pictures_without_telemetry_are_not_guessed_at() -> None:
    clock = CameraClock(Mount(), "fixed", PROMPT)
    _, turns = _gyro_flight(13, 0.1, 0.0, Motion())
    _fed(clock, [], turns)

    found = clock.estimate()

    assert not found.observable
    assert "telemetry" in found.reason


def test_samples_that_run_back_are_left_out() -> None:
    samples, turns = _gyro_flight(14, 0.1, 0.0, Motion())
    clock, spoilt = (CameraClock(Mount(), "fixed", PROMPT) for _ in range(2))
    _fed(clock, samples, turns)
    for sample in samples:
        spoilt.offer(sample)
        spoilt.offer(InertialSample(sample.t_us - 500_000, np.full(3, 9.0), np.zeros(3)))
    for turn in turns:
        spoilt.add_turn(_us(turn[0]), _us(turn[1]), turn[2], turn[3])
        spoilt.add_turn(_us(turn[0]) - 200_000, _us(turn[1]) - 200_000, turn[2], turn[3])

    assert spoilt.estimate().offset_s == clock.estimate().offset_s
