"""Headings from lines, against pictures turned by OpenCV by known angles."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.registration.lines import BINS, direction_histogram, headings_by_lines

SIDE = 240
EVERYWHERE = np.ones((SIDE, SIDE), dtype=bool)


def roads(seed: int = 3, bearings_deg: tuple[float, ...] = (20.0, 20.0, 65.0, 140.0)) -> np.ndarray:
    """Fields of grain with straight roads on them, wider than the picture so that turning it leaves no rim."""
    rng = np.random.default_rng(seed)
    image = cv2.GaussianBlur(rng.normal(110.0, 12.0, size=(480, 480)).astype(np.float32), (0, 0), 2.0)
    for bearing in np.deg2rad(bearings_deg):
        u, v = rng.uniform(160.0, 320.0, size=2)
        step = 500.0 * np.array([np.sin(bearing), -np.cos(bearing)])
        first, last = (np.array([u, v]) - step).astype(int), (np.array([u, v]) + step).astype(int)
        cv2.line(image, tuple(map(int, first)), tuple(map(int, last)), 200.0, 7)
    return np.clip(image, 0, 255).astype(np.uint8)


def turned(image: np.ndarray, angle_deg: float) -> np.ndarray:
    """The middle of a picture whose content is turned clockwise, as bearings grow."""
    # OpenCV turns counter-clockwise
    matrix = cv2.getRotationMatrix2D((239.5, 239.5), -angle_deg, 1.0)
    whole = cv2.warpAffine(image, matrix, (480, 480), flags=cv2.INTER_LINEAR)
    return whole[120:360, 120:360]


def test_lines_stand_at_their_bearings() -> None:
    histogram = direction_histogram(turned(roads(bearings_deg=(30.0, 30.0, 30.0)), 0.0), EVERYWHERE)

    assert histogram is not None
    assert np.argmax(histogram) * 180.0 / BINS == pytest.approx(30.0, abs=1.0)


@pytest.mark.parametrize("angle_deg", [-17.0, -4.0, 0.0, 6.5, 12.0])
@pytest.mark.parametrize("negative", [False, True])
def test_a_known_turn_is_among_the_hypotheses(angle_deg: float, negative: bool) -> None:
    """Too small a heading by h shows bearings smaller by h, bright on dark or dark on bright."""
    scene = roads()
    template = turned(scene, -angle_deg)
    found = headings_by_lines(
        255 - template if negative else template, EVERYWHERE, turned(scene, 0.0), EVERYWHERE, np.deg2rad(25.0)
    )

    assert np.rad2deg(found[0]) == pytest.approx(angle_deg, abs=1.0)


def test_a_town_gives_both_quarters() -> None:
    """Streets at right angles: a heading and the one a quarter turn from it look alike."""
    town = roads(bearings_deg=(10.0, 100.0, 10.0, 100.0))
    found = np.rad2deg(
        headings_by_lines(turned(town, 0.0), EVERYWHERE, turned(town, 0.0), EVERYWHERE, np.pi / 2.0, most=3)
    )

    assert np.abs(found).min() < 1.0
    assert np.abs(np.abs(found) - 90.0).min() < 1.5


def test_nothing_straight_gives_nothing() -> None:
    rng = np.random.default_rng(1)
    woods = cv2.GaussianBlur(rng.normal(110.0, 60.0, size=(SIDE, SIDE)), (0, 0), 4.0).astype(np.uint8)

    assert len(headings_by_lines(woods, EVERYWHERE, turned(roads(), 0.0), EVERYWHERE, 0.4)) == 0
    assert direction_histogram(np.full((SIDE, SIDE), 90, np.uint8), EVERYWHERE) is None


def test_the_rim_of_the_mask_is_no_line() -> None:
    """A picture that ends at a slanted border: what the border draws is not on the ground."""
    plain = np.full((SIDE, SIDE), 120, np.uint8)
    mask = np.fromfunction(lambda r, c: c > 60 + 0.3 * r, (SIDE, SIDE))
    plain[~mask] = 0

    assert direction_histogram(plain, mask) is None


def test_hypotheses_beyond_reach_are_left_out() -> None:
    scene = roads(bearings_deg=(20.0, 20.0, 20.0))
    found = headings_by_lines(turned(scene, -30.0), EVERYWHERE, turned(scene, 0.0), EVERYWHERE, np.deg2rad(10.0))

    assert_allclose(found, np.zeros(0))
