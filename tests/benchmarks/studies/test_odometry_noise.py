"""Odometer noise against closed forms and the thesis's findings."""

from __future__ import annotations

import numpy as np
import pytest

from benchmarks.studies.odometry_noise import FOCAL_PX, translation_noise


@pytest.mark.parametrize("method", ["rays", "homography", "depth_average"])
def test_attitude_noise_goes_into_the_translation_as_tilt(method: str) -> None:
    """Two attitudes, each wrong by 0.5 degrees: sqrt(2) of its tangent at unit depth (figure 5.7)."""
    found = translation_noise(1, method, 50, 0.0, 0.5, left=False)

    # 250 trials know a standard deviation to 5 %
    assert found["sigma_x"] == pytest.approx(np.sqrt(2.0) * np.tan(np.radians(0.5)), rel=0.15)
    assert found["sigma_y"] == pytest.approx(np.sqrt(2.0) * np.tan(np.radians(0.5)), rel=0.15)


def test_a_mean_of_features_errs_by_their_noise_over_the_root_of_their_number() -> None:
    found = translation_noise(2, "depth_average", 64, 2.0, 0.0, left=False)

    assert found["sigma_x"] == pytest.approx(2.0 * np.sqrt(2.0) / FOCAL_PX / 8.0, rel=0.15)


def test_features_on_one_side_tell_a_homography_less_across_than_along() -> None:
    """Figure 5.10: worse than all over the picture, and along x worse than along y."""
    left = translation_noise(3, "homography", 50, 2.0, 0.0, left=True)
    all_over = translation_noise(3, "homography", 50, 2.0, 0.0, left=False)

    assert left["sigma_x"] > 2.0 * all_over["sigma_x"]
    assert left["sigma_x"] > 1.2 * left["sigma_y"]
    assert all_over["sigma_x"] == pytest.approx(all_over["sigma_y"], rel=0.25)


def test_too_few_features_solve_nothing() -> None:
    assert translation_noise(4, "rays", 4, 1.0, 0.0, left=False) == {"solved": 0.0}
