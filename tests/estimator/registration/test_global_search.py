import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.rotation import wrap_pi
from estimator.registration.global_search import (
    EdgeMap,
    SearchConfig,
    Slice,
    Sweep,
    Template,
    main_mode,
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
    places, none = _swept(WORLD).places()
    best = places[0]
    # half a cell, and half a step between the refined headings and scales
    assert_allclose(best.centre_ne_m, CENTRE_NE, atol=1.5)
    assert wrap_pi(best.heading_rad - HEADING_RAD) == pytest.approx(0.0, abs=0.03)
    assert best.scale == pytest.approx(SCALE, rel=0.03)
    assert main_mode(places, 20.0, 0.15) > 0.99
    assert none < 0.01
    assert sum(place.probability for place in places) + none == pytest.approx(1.0)


def test_on_a_map_of_elsewhere_no_place_stands_out() -> None:
    places, none = _swept(OTHER).places()
    assert main_mode(places, 20.0, 0.15) < 0.99
    assert none > 0.05


def test_what_else_is_known_speaks_too() -> None:
    """What rules out the north of the map rules out the true place, and nothing else is as good."""
    sweep = _swept(WORLD)
    places, none = sweep.places(lambda centre_ne_m, scale: np.where(centre_ne_m[:, 0] > 0.0, -300.0, 0.0 * scale))
    assert places[0].centre_ne_m[0] <= 0.0
    assert none > sweep.places()[1]


def test_one_place_is_tested_alone() -> None:
    coarse, template = EdgeMap(WORLD, CONFIG), _template()
    what = Slice(HEADING_RAD, SCALE)
    sweep = Sweep(coarse, template, [what], CONFIG)
    here = sweep.best_near(what, CENTRE_NE + np.array([5.0, -4.0]), 12.0)
    elsewhere = sweep.best_near(what, np.array([-100.0, 60.0]), 12.0)
    assert here is not None
    assert elsewhere is not None
    assert_allclose(here.centre_ne_m, CENTRE_NE, atol=1.5)
    assert here.height_sigmas > 8.0
    assert elsewhere.height_sigmas < 5.0
    assert sweep.best_near(what, np.array([5000.0, 0.0]), 12.0) is None


def test_a_map_too_small_is_refused() -> None:
    with pytest.raises(ValueError, match="too small to search"):
        EdgeMap(WORLD, SearchConfig(cell_m=200.0))
