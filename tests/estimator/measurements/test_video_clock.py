import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.camera import Camera, Mount
from estimator.geometry.rotation import matrix_from_euler, q_from_matrix
from estimator.measurements.video_clock import VideoClock, VideoClockConfig
from estimator.types import AttitudeSample, InertialSample
from tests.estimator.measurements.filters import general_filter
from tests.estimator.registration.textured_map import NADIR_TOP_NORTH, seen_by

CAMERA = Camera.from_hfov(320, 240, np.deg2rad(60.0))
MOUNT = Mount(0.0, -np.pi / 2, 0.0, np.zeros(3))
T0_US = 1_700_000_000_000_000
TRUE_POS = np.array([14.0, -22.0, -110.0])
DOWN = np.array([0.0, 0.0, 1.0])


def _attitude(t_s: float) -> np.ndarray:
    """Rolls, pitches and yaws at periods that have nothing in common."""
    return matrix_from_euler(0.12 * np.sin(2.1 * t_s), 0.1 * np.sin(1.3 * t_s + 1.0), 0.3 * np.sin(0.7 * t_s))


def _rate(t_s: float) -> np.ndarray:
    step = 1e-4
    turn = _attitude(t_s - step).T @ _attitude(t_s + step)
    return np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]]) / (4.0 * step)


def _fly(clock: VideoClock, seconds: float, offset_s: float, moving: bool = True, start_s: float = 0.0) -> None:
    """Gyroscopes at 50 Hz, stamped 10 ms late, and pictures at 10 a second whose times want ``offset_s`` added."""
    for k in range(round(50 * start_s), round(50 * (start_s + seconds))):
        t_s = k / 50.0
        at = t_s if moving else 0.0
        t_us = T0_US + round(t_s * 1e6)
        rate = _rate(t_s - 0.010) if moving else np.zeros(3)
        clock.offer(InertialSample(t_us, rate, np.array([0.0, 0.0, -9.8])))
        clock.offer(AttitudeSample(t_us, q_from_matrix(_attitude(at)), rate))
        if k % 5 == 0:
            exposed_s = t_s if moving else 0.0
            image = seen_by(TRUE_POS, _attitude(exposed_s) @ NADIR_TOP_NORTH, camera=CAMERA)
            image = image + np.random.default_rng(k).normal(0.0, 1.0, image.shape)
            clock.see(t_us - round(offset_s * 1e6), np.clip(image, 0, 255).astype(np.uint8), DOWN)


@pytest.mark.parametrize("offset_s", [-0.13, 0.2])
def test_offset_is_found_and_then_applied(offset_s: float) -> None:
    clock = VideoClock(CAMERA, MOUNT, "fixed")
    assert not clock.settled
    assert clock.lag_us == 0
    _fly(clock, 12.0, offset_s)

    assert clock.settled
    # the sensors' own delay is known to 4 ms
    assert clock.offset_us / 1e6 == pytest.approx(offset_s, abs=0.012)
    assert clock.lag_us == max(-clock.offset_us, 0)


def test_hovering_aircraft_tells_nothing_and_is_not_waited_for_forever() -> None:
    clock = VideoClock(CAMERA, MOUNT, "fixed", VideoClockConfig(patience_s=6.0))
    _fly(clock, 4.0, 0.2, moving=False)
    assert not clock.settled

    _fly(clock, 8.0, 0.2, moving=False)

    assert clock.settled
    assert clock.offset_us == 0
    assert clock.estimate is None or not clock.estimate.observable


def test_misalignment_is_told_once() -> None:
    clock, eskf = VideoClock(CAMERA, MOUNT, "fixed"), general_filter()
    assert clock.boresight(eskf) is None
    _fly(clock, 12.0, 0.1)

    innovation = clock.boresight(eskf)

    assert innovation is not None
    assert_allclose(innovation.H[:, eskf.layout.slices["boresight"]], np.eye(3))
    # the mount is right: within three of the sigmas stated
    left = innovation.z + eskf.nominal.boresight_rad
    assert (np.abs(left) < 3.0 * np.sqrt(np.diag(innovation.R))).all()
    assert clock.boresight(eskf) is None


def test_another_clock_of_the_pictures_is_found_anew() -> None:
    """After a reconnect the offset of before serves, and the turns of before do not count against the new clock's."""
    clock = VideoClock(CAMERA, MOUNT, "fixed")
    _fly(clock, 12.0, 0.2)
    assert clock.offset_us / 1e6 == pytest.approx(0.2, abs=0.012)
    clock.restart()
    assert clock.settled
    assert clock.offset_us / 1e6 == pytest.approx(0.2, abs=0.012)

    _fly(clock, 12.0, -0.1, start_s=12.0)

    assert clock.offset_us / 1e6 == pytest.approx(-0.1, abs=0.012)
