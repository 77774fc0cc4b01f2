import numpy as np
import pytest

from estimator.measurements.hypothesis import FollowConfig, first_fit, predicted
from estimator.registration.global_search import Slice

CONFIG = FollowConfig()
WHAT = Slice(0.7, 0.9)
HEIGHT_M, ALT_M = 120.0, 300.0


def _slope(ne_m: complex) -> float:
    """Ground that rises by a tenth towards the north."""
    return 150.0 + 0.1 * ne_m.real


def _unknown(_: complex) -> float:
    return float("nan")


def test_a_fit_turns_and_scales_about_its_anchor() -> None:
    fit = first_fit(100.0 + 50.0j, WHAT, (10.0 - 4.0j, HEIGHT_M, ALT_M), _slope, CONFIG)
    assert fit.ne_m(10.0 - 4.0j) == pytest.approx(100.0 + 50.0j)
    step = fit.ne_m(20.0 - 4.0j) - fit.anchor_ne_m
    assert abs(step) == pytest.approx(9.0)
    assert np.angle(step) == pytest.approx(0.7)
    assert (fit.scale, fit.turn_rad) == pytest.approx((0.9, 0.7))


def test_the_scale_follows_the_ground_of_the_place() -> None:
    """North over rising ground at one height: the camera comes nearer to it, the mosaic's height stays."""
    north = Slice(0.0, 0.9)
    fit = first_fit(0.0j, north, (0.0j, HEIGHT_M, ALT_M), _slope, CONFIG)
    after = predicted(fit, 100.0 + 0.0j, HEIGHT_M, ALT_M, _slope, CONFIG)
    # 90 m of way rise by 9 m, of 108 m
    assert after.scale == pytest.approx(0.9 * (108.0 - 9.0) / 108.0)
    assert after.anchor_ne_m.real == pytest.approx(0.5 * (0.9 + after.scale) * 100.0)


def test_a_climb_that_the_pictures_saw_changes_no_scale() -> None:
    fit = first_fit(0.0j, WHAT, (0.0j, HEIGHT_M, ALT_M), _slope, CONFIG)
    after = predicted(fit, 0.0j, HEIGHT_M + 10.0, ALT_M + 9.0, _slope, CONFIG)
    assert after.scale == pytest.approx(0.9)


def test_without_elevation_the_scale_stays() -> None:
    fit = first_fit(0.0j, WHAT, (0.0j, HEIGHT_M, ALT_M), _unknown, CONFIG)
    assert predicted(fit, 100.0 + 0.0j, HEIGHT_M, ALT_M, _unknown, CONFIG).ratio == pytest.approx(fit.ratio)


def test_the_stated_uncertainty_is_that_of_the_walk() -> None:
    """Many walks of ratio and place, as the configuration states them, spread as far as predicted."""
    fit = first_fit(0.0j, WHAT, (0.0j, HEIGHT_M, ALT_M), _unknown, CONFIG)
    after = predicted(fit, 150.0 + 0.0j, HEIGHT_M, ALT_M, _unknown, CONFIG)
    rng = np.random.default_rng(5)
    runs, steps = 4000, 100
    ratio = 0.9 * CONFIG.first_ratio_std * rng.standard_normal(runs)
    place = CONFIG.first_std_m * rng.standard_normal(runs) + CONFIG.walk_std_m * rng.standard_normal(runs)
    for _ in range(steps):
        place = place + ratio * 150.0 / steps
        ratio = ratio + 0.9 * CONFIG.walk_ratio_std / np.sqrt(steps) * rng.standard_normal(runs)
    # 4000 runs know a deviation to 1.1 %
    assert np.sqrt(after.cov[0, 0]) == pytest.approx(place.std(), rel=0.05)
    assert np.sqrt(after.cov[1, 1]) == pytest.approx(ratio.std(), rel=0.05)
