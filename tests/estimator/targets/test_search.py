"""What is looked at closely when much looks alike."""

import numpy as np

from estimator.targets.appearance import RING_PX, Appearance, grid_from_picture, square_about
from estimator.targets.search import Look, SearchArea, Searcher, affine_from_grid
from tests.estimator.targets.drawn import RED, draw, pixel_of, pose_at, view_of

M_PER_PX = 0.16
FADED = (78, 82, 150)


def test_what_differs_from_an_earlier_picture_is_looked_at_though_much_that_stands_fits_better() -> None:
    pose, middle = pose_at(0.0, 0.0), np.zeros(2)
    size = 5.0 / M_PER_PX
    uv, px_per_m = pixel_of(pose, middle), view_of(pose, middle).px_per_m
    from_grid = affine_from_grid(uv, px_per_m, M_PER_PX)
    clicked = draw(*pose, [(middle, 0.0, RED)])
    patch = grid_from_picture(clicked, from_grid, square_about(int(np.ceil(size)) + RING_PX)).image
    search = Searcher(Appearance(patch, size), 6, 0.45, 0.35)
    rows, cols = np.arange(-32.0, 33.0, 8.0), np.arange(-40.0, 41.0, 10.0)
    places = [(n, e) for n in rows for e in cols if (n, e) != (16.0, 20.0)]
    parked = [(np.array(place), 0.2, RED) for place in places]
    then, now = np.array([16.0, 18.0]), np.array([16.0, 20.0])
    turns = tuple(np.radians(12.0) * k for k in range(-15, 15))
    area = SearchArea(np.zeros(2), 260, turns)
    look = Look(draw(*pose, [*parked, (now, np.pi / 2, FADED)], 1), from_grid, 1.0)
    earlier = Look(draw(*pose, [*parked, (then, np.pi / 2, FADED)], 2), from_grid, 1.0)
    at = np.array([now[1], -now[0]]) / M_PER_PX

    def nearest_m(seen: Look | None) -> float:
        found = search.find(look, area, earlier=seen)
        offsets = [one.offset_px for one in found.matches] + list(found.in_vain)
        return min(float(np.hypot(*(offset - at))) for offset in offsets) * M_PER_PX

    assert nearest_m(None) > 2.0
    assert nearest_m(earlier) < 1.5
