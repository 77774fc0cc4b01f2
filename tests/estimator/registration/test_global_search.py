import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.rotation import wrap_pi
from estimator.registration.global_search import (
    EdgeMap,
    SearchConfig,
    Sweep,
    Template,
    slices,
    template_of,
)
from tests.estimator.wide_map import HALF_M, WideMap

WORLD, OTHER = WideMap(3), WideMap(4)
CONFIG = SearchConfig(cell_m=3.0)
CENTRE_NE = np.array([120.0, -160.0])
HEADING_RAD, SCALE = 2.2, 1.13


def _template() -> Template:
    """A strip of 200 x 80 m about the centre as a mosaic turned by the heading and shrunk by the scale shows it."""
    side, middle = 241, 120
    cos, sin = np.cos(HEADING_RAD), np.sin(HEADING_RAD)
    row, col = np.mgrid[0:side, 0:side] - middle
    north, east = -row * SCALE, col * SCALE
    true_north, true_east = cos * north - sin * east + CENTRE_NE[0], sin * north + cos * east + CENTRE_NE[1]
    image = cv2.remap(
        WORLD.seen, (true_east + HALF_M).astype(np.float32), (HALF_M - true_north).astype(np.float32), cv2.INTER_LINEAR
    )
    known = (np.abs(row) <= 100) & (np.abs(col) <= 40)
    return template_of(np.where(known, image, 0).astype(np.float32), known, 1.0, 3.0, CONFIG)


def _swept(world: WideMap) -> Sweep:
    coarse, template = EdgeMap(world, CONFIG), _template()
    sweep = Sweep(coarse, template, slices(template, coarse.cell_m, (0.9, 1.3), CONFIG), CONFIG)
    while not sweep.done:
        sweep.step()
    return sweep


def test_the_place_stands_out_with_heading_and_scale() -> None:
    best, second = _swept(WORLD).places(2)
    # half a cell, and half a step between headings and scales
    assert_allclose(best.centre_ne_m, CENTRE_NE, atol=3.0)
    step = 2.0 * CONFIG.slack_cells * CONFIG.cell_m / _template().radius_m
    assert wrap_pi(best.heading_rad - HEADING_RAD) == pytest.approx(0.0, abs=step)
    assert best.scale == pytest.approx(SCALE, rel=step)
    # a Gaussian surface of so many independent values reaches five or so
    assert best.height_sigmas > 8.0 > second.height_sigmas


def test_on_a_map_of_elsewhere_no_place_stands_out() -> None:
    assert _swept(OTHER).places(1)[0].height_sigmas < 8.0


def test_places_are_the_highest_and_distinct() -> None:
    places = _swept(WORLD).places(20)
    heights = [place.height_sigmas for place in places]
    assert len(places) == 20
    assert heights == sorted(heights, reverse=True)
    for i, place in enumerate(places):
        for other in places[:i]:
            apart_m = float(np.hypot(*(place.centre_ne_m - other.centre_ne_m)))
            turned = abs(wrap_pi(place.heading_rad - other.heading_rad))
            assert apart_m > 2.0 * CONFIG.cell_m or turned > 0.1 or abs(place.scale - other.scale) > 0.1


def test_a_map_too_small_is_refused() -> None:
    with pytest.raises(ValueError, match="too small to search"):
        EdgeMap(WORLD, SearchConfig(cell_m=200.0))
