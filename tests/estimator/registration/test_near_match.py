import cv2
import numpy as np
import pytest

from estimator.registration.global_search import EdgeMap, SearchConfig, Slice, template_of
from estimator.registration.near_match import NearMatcher
from tests.estimator.wide_map import HALF_M, WideMap

WORLD = WideMap(3)
MATCHER = NearMatcher(EdgeMap(WORLD, SearchConfig(cell_m=3.0)))
HEADING_RAD, SCALE = 2.2, 1.13


def _template(centre_ne: np.ndarray):
    """A patch of 160 x 80 m about a place as a mosaic turned by the heading and shrunk by the scale shows it."""
    row, col = np.mgrid[0:201, 0:201] - 100
    cos, sin = np.cos(HEADING_RAD), np.sin(HEADING_RAD)
    north, east = -row * SCALE, col * SCALE
    true_north, true_east = cos * north - sin * east + centre_ne[0], sin * north + cos * east + centre_ne[1]
    rows, cols = (HALF_M - true_north).astype(np.float32), (true_east + HALF_M).astype(np.float32)
    image = cv2.remap(WORLD.seen, cols, rows, cv2.INTER_LINEAR).astype(np.float32)
    return template_of(image, (np.abs(row) <= 70) & (np.abs(col) <= 35), 1.0, 3.0, SearchConfig())


def _best(centre_ne: np.ndarray, at_ne: np.ndarray):
    """Where the similarity is highest within 12 m of a place, and how high in deviations of the clutter."""
    template = _template(centre_ne)
    half = MATCHER.half_cells(template, SCALE)
    clutter = MATCHER.clutter(template, SCALE)
    found = MATCHER.surface(template, Slice(HEADING_RAD, SCALE), at_ne, 4, half)
    assert found is not None
    assert clutter is not None
    r, c = np.unravel_index(int(np.argmax(found.similarity)), found.similarity.shape)
    place = MATCHER.map.ne_m(found.row - 4 + r, found.col - 4 + c)
    return place, float(found.similarity[r, c]) * np.sqrt(found.cells) / clutter


def test_a_piece_is_found_where_it_is() -> None:
    centre = np.array([120.0, -160.0])
    place, height = _best(centre, centre + np.array([8.0, -7.0]))
    np.testing.assert_allclose(place, centre, atol=3.0)
    assert height > 7.0


@pytest.mark.parametrize("elsewhere", [(-100.0, 60.0), (200.0, 200.0), (-250.0, -30.0)])
def test_elsewhere_it_reaches_what_chance_does(elsewhere: tuple[float, float]) -> None:
    _, height = _best(np.array([120.0, -160.0]), np.array(elsewhere))
    # the greatest of some twenty independent values
    assert height < 4.5


def test_similarity_is_normalised() -> None:
    template = _template(np.array([0.0, 0.0]))
    half = MATCHER.half_cells(template, SCALE)
    found = MATCHER.surface(template, Slice(HEADING_RAD, SCALE), np.zeros(2), 2, half)
    assert found is not None
    assert 0.3 < found.similarity.max() <= 1.0 + 1e-5


def test_where_most_of_it_is_off_the_map_nothing_is_said() -> None:
    template = _template(np.array([0.0, 0.0]))
    half = MATCHER.half_cells(template, SCALE)
    rim = MATCHER.surface(template, Slice(0.0, SCALE), np.array([0.0, HALF_M - 2.0]), 0, half)
    assert rim is not None
    assert rim.similarity[0, 0] == -1.0
    assert MATCHER.surface(template, Slice(0.0, SCALE), np.array([0.0, HALF_M + 20.0]), 0, half) is None


def test_clutter_is_of_one_cell() -> None:
    """The deviation over unrelated ground, measured at random, is that of one cell over the root of the cells."""
    template = _template(np.array([120.0, -160.0]))
    clutter, half = MATCHER.clutter(template, SCALE), MATCHER.half_cells(template, SCALE)
    rng = np.random.default_rng(8)
    heights = []
    for _ in range(150):
        what = Slice(float(rng.uniform(0.0, 6.28)), SCALE)
        found = MATCHER.surface(template, what, rng.uniform(-300.0, 300.0, 2), 0, half)
        assert found is not None
        heights.append(float(found.similarity[0, 0]) * np.sqrt(found.cells) / clutter)
    # 150 values give the deviation to 6 %; the clutter's own sample to as much
    assert np.std(heights) == pytest.approx(1.0, abs=0.25)
