import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.odometry.mosaic import MosaicConfig, MosaicOdometry, scaled_shift
from tests.estimator.wide_map import CAMERA, HALF_M, HEIGHT_M, Flight, WideMap, yaw_matrix

WORLD = WideMap(3)
FLIGHT = Flight()
WRONG_TURN_RAD = 1.1
ASSUMED_HEIGHT_M = 80.0  # of 60


@pytest.fixture(scope="module")
def flown() -> MosaicOdometry:
    """Twelve seconds at 4 Hz with the heading off by a constant and the height by a third."""
    odometry = MosaicOdometry(CAMERA, 1.0)
    for k in range(48):
        level = yaw_matrix(WRONG_TURN_RAD) @ FLIGHT.ned_from_camera(k / 4.0)
        assert odometry.offer(k * 250_000, FLIGHT.picture(k / 4.0, WORLD), level, ASSUMED_HEIGHT_M)
    return odometry


def _true_ne(mosaic_m: np.ndarray) -> np.ndarray:
    turn = yaw_matrix(-WRONG_TURN_RAD)[:2, :2]
    return FLIGHT.pos_ned_m(0.0)[:2] + HEIGHT_M / ASSUMED_HEIGHT_M * (mosaic_m @ turn.T)


def test_the_path_is_right_but_for_turn_and_scale(flown: MosaicOdometry) -> None:
    assert flown.pose is not None
    assert flown.parts == 0
    # 1 % of 141 m
    assert_allclose(_true_ne(flown.pose.pos_m), FLIGHT.pos_ned_m(47 / 4.0)[:2], atol=1.5)
    assert flown.pose.height_m == pytest.approx(ASSUMED_HEIGHT_M, rel=0.01)


def test_the_mosaic_shows_the_ground_where_it_is(flown: MosaicOdometry) -> None:
    mosaic = flown.mosaic()
    assert mosaic is not None
    rows, cols = np.nonzero(mosaic.known)
    ne = _true_ne(mosaic.first_m + mosaic.gsd_m * np.stack((-rows, cols), axis=-1))
    truth = WORLD.seen[np.round(HALF_M - ne[:, 0]).astype(int), np.round(ne[:, 1] + HALF_M).astype(int)]
    assert np.corrcoef(mosaic.image[mosaic.known], truth)[0, 1] > 0.9


def test_fresh_ground_is_what_was_not_seen(flown: MosaicOdometry) -> None:
    whole, late = flown.mosaic(), flown.mosaic(0.6 * flown.way_m)
    assert whole is not None
    assert late is not None
    assert late.without(whole).area_m2 == 0.0
    fresh = whole.without(late)
    assert fresh.area_m2 == pytest.approx(whole.area_m2 - late.area_m2)


def test_a_hover_adds_nothing() -> None:
    odometry = MosaicOdometry(CAMERA, 1.0)
    areas = []
    for k in range(8):
        odometry.offer(k * 250_000, FLIGHT.picture(0.0, WORLD), FLIGHT.ned_from_camera(0.0), HEIGHT_M)
        mosaic = odometry.mosaic()
        assert mosaic is not None
        areas.append(mosaic.area_m2)
    assert areas == [areas[0]] * 8
    assert odometry.way_m < 0.5


def test_a_cut_in_the_video_begins_anew() -> None:
    odometry = MosaicOdometry(CAMERA, 1.0)
    for t_us, t_s in ((0, 0.0), (250_000, 0.25), (9_000_000, 0.5)):
        odometry.offer(t_us, FLIGHT.picture(t_s, WORLD), FLIGHT.ned_from_camera(t_s), HEIGHT_M)
    assert odometry.parts == 1
    assert odometry.way_m == 0.0


def test_scaled_shift_survives_outliers() -> None:
    rng = np.random.default_rng(0)
    second = rng.uniform(-0.5, 0.5, (80, 2))
    first = 1.04 * second + np.array([0.07, -0.02]) + 0.0005 * rng.standard_normal((80, 2))
    first[:20] += rng.uniform(0.1, 0.4, (20, 2))
    found = scaled_shift(first, second, MosaicConfig())
    assert found is not None
    assert_allclose(found[0], [0.07, -0.02], atol=5e-4)
    assert found[1] == pytest.approx(1.04, abs=2e-3)


def test_scaled_shift_refuses_what_does_not_agree() -> None:
    rng = np.random.default_rng(1)
    assert scaled_shift(rng.uniform(-1, 1, (60, 2)), rng.uniform(-1, 1, (60, 2)), MosaicConfig()) is None
