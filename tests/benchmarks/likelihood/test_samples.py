"""What the truth of a registration is."""

import numpy as np
import pytest

from benchmarks.likelihood.samples import SIGMAS, PoseError, draw_error, true_displacement
from estimator.geometry.camera import Camera
from estimator.measurements.map_fix import MapFixConfig
from estimator.registration.alignment import CameraPose

CAMERA = Camera.from_hfov(640, 480, 1.0)
NADIR = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
POSE = CameraPose(np.array([20.0, -5.0, -100.0]), NADIR)
CENTRE = np.array([20.0, -5.0, 0.0])


def _flat(north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
    return np.zeros_like(north_m)


def _error(pos: tuple[float, float, float] = (0.0, 0.0, 0.0), turn: tuple[float, float, float] = (0.0, 0.0, 0.0)):
    return PoseError(np.array(pos), np.array(turn), 30.0, 0.01, 1.0)


def test_a_told_place_too_far_north_is_to_be_moved_south() -> None:
    told = _error((3.0, -2.0, 0.0)).told(POSE)

    moved = true_displacement(CENTRE + np.array([3.0, -2.0, 0.0]), POSE, told, CAMERA, _flat)

    np.testing.assert_allclose(moved, [-3.0, 2.0], atol=1e-9)


def test_a_tilt_moves_the_ground_by_the_height() -> None:
    """Told to lean 10 mrad about east, it would see the point below it 1 m off the picture's middle."""
    told = _error(turn=(0.0, 0.01, 0.0)).told(POSE)

    moved = true_displacement(CENTRE, POSE, told, CAMERA, _flat)

    # the told axis points north of the vertical for a turn about east: what is below it the true camera sees south
    np.testing.assert_allclose(moved, [-100.0 * np.tan(0.01), 0.0], atol=1e-6)


def test_the_true_ray_is_cut_with_the_true_ground() -> None:
    """Over a slope of a tenth a ray that leans by a tenth meets the ground later than over a plain."""
    told = _error((10.0, 0.0, 0.0)).told(POSE)

    moved = true_displacement(np.array([40.0, -5.0, 0.0]), POSE, told, CAMERA, lambda n, e: -0.1 * (n - 20.0))

    # ray from (20, -100): n = 20 + 0.1 s at down -100 + s; ground down = -0.1 (n - 20), so s = 100 / 1.01
    assert 40.0 + moved[0] == pytest.approx(20.0 + 0.1 * 100.0 / 1.01, abs=1e-3)


def test_drawn_errors_are_those_of_their_sigmas_and_searched_for() -> None:
    rng = np.random.default_rng(4)
    drawn = [draw_error(rng, 100.0, MapFixConfig()) for _ in range(2000)]

    headings = np.array([e.rotvec_ned_rad[2] / e.heading_std_rad for e in drawn])
    assert headings.std() == pytest.approx(1.0, abs=0.06)
    assert all(SIGMAS["heading_rad"][0] <= e.heading_std_rad <= SIGMAS["heading_rad"][1] for e in drawn)
    inside = [np.hypot(*e.pos_ned_m[:2]) < e.radius_m for e in drawn]
    # 3.5 sigma of two axes hold 99.8 %, and ten metres more
    assert np.mean(inside) > 0.995
