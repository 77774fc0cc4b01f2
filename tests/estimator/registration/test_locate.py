"""Locating one picture over a painted map that no code of the registration took part in making."""

import math
from dataclasses import replace

import numpy as np
import pytest

from estimator.geometry.rotation import matrix_from_euler
from estimator.registration.locate import LocateConfig, Located, NotLocated, locate
from estimator.registration.pose_prior import PosePrior
from tests.estimator.registration.textured_map import (
    CAMERA,
    MAP,
    NADIR_TOP_NORTH,
    ORIGIN_ALT_M,
    FlatGround,
    TexturedMap,
    seen_by,
)

HEADING_RAD = 2.1
TRUE_POS = np.array([34.0, -41.0, -92.0])
TRUE_ROTATION = matrix_from_euler(0.08, -0.1, HEADING_RAD) @ NADIR_TOP_NORTH
PRIOR = PosePrior(TRUE_POS[:2] + np.array([50.0, -30.0]), 120.0, math.inf, -88.0, 6.0)


def _locate(picture: np.ndarray, prior: PosePrior, *proposers: str) -> Located | NotLocated:
    config = LocateConfig(proposers=proposers) if proposers else LocateConfig()
    return locate(picture, CAMERA, MAP, FlatGround(), ORIGIN_ALT_M, prior, config)


def _miss_m(found: Located) -> float:
    return float(np.hypot(*(found.pose.pos_ned_m - TRUE_POS)[:2]))


@pytest.mark.parametrize("proposer", ["sift", "akaze"])
def test_keypoints_find_a_tilted_picture_of_unknown_heading(proposer: str) -> None:
    found = _locate(seen_by(TRUE_POS, TRUE_ROTATION), PRIOR, proposer)

    assert isinstance(found, Located)
    assert found.accepted
    # a map pixel is a metre, and tilt and position pull against each other
    assert _miss_m(found) < 2.0
    assert abs(np.angle(np.exp(1j * (found.heading_rad - HEADING_RAD)))) < math.radians(2.0)
    assert _miss_m(found) < 4.0 * math.sqrt(np.linalg.eigvalsh(found.cov_ne_m2)[-1])


def test_slope_that_the_ground_model_leaves_open_stands_in_the_covariance() -> None:
    picture = seen_by(TRUE_POS, TRUE_ROTATION)
    sloping = LocateConfig(proposers=("sift",), ground_slope_std=0.03)

    level = _locate(picture, PRIOR, "sift")
    open_slope = locate(picture, CAMERA, MAP, FlatGround(), ORIGIN_ALT_M, PRIOR, sloping)

    assert isinstance(level, Located) and isinstance(open_slope, Located)
    added_m2 = open_slope.cov_ne_m2 - level.cov_ne_m2
    # 92 m high: 3 % of it
    assert np.sqrt(np.diag(added_m2)) == pytest.approx([2.76, 2.76], rel=0.05)


def test_correlation_finds_what_keypoints_cannot() -> None:
    # contrast reversed and noise, as between sensors
    picture = seen_by(TRUE_POS, TRUE_ROTATION)
    noise = np.random.default_rng(3).normal(0.0, 12.0, picture.shape)
    odd = np.clip(255.0 - 0.5 * picture + noise, 0, 255).astype(np.uint8)
    prior = replace(PRIOR, heading_rad=HEADING_RAD + 0.06, heading_std_rad=0.09)

    found = _locate(odd, prior, "correlation")

    assert isinstance(found, Located)
    assert found.accepted
    assert _miss_m(found) < 8.0


def test_a_picture_of_other_ground_is_refused() -> None:
    elsewhere = seen_by(TRUE_POS, TRUE_ROTATION, TexturedMap(seed=77))

    found = _locate(elsewhere, replace(PRIOR, heading_rad=HEADING_RAD, heading_std_rad=0.05), "correlation", "sift")

    assert isinstance(found, Located)
    assert not found.accepted
    assert "sure" in found.reason or "ambiguous" in found.reason


def test_a_blank_picture_and_a_place_off_the_map_are_told_apart() -> None:
    blank = np.full((CAMERA.height_px, CAMERA.width_px), 90, dtype=np.uint8)
    away = replace(PRIOR, pos_ne_m=np.array([5000.0, 0.0]))

    of_blank = _locate(blank, PRIOR)
    of_away = _locate(seen_by(TRUE_POS, TRUE_ROTATION), away, "correlation")

    assert isinstance(of_blank, NotLocated) and "one brightness" in of_blank.reason
    assert isinstance(of_away, NotLocated) and "map does not reach" in of_away.reason


def test_misuse_is_an_error() -> None:
    picture = seen_by(TRUE_POS, TRUE_ROTATION)
    with pytest.raises(ValueError, match="unknown proposers surf"):
        _locate(picture, PRIOR, "surf")
    with pytest.raises(ValueError, match="pixels"):
        _locate(picture[:100], PRIOR)
