"""Rasters of ground: where their pixels are and where shapes land on them."""

from __future__ import annotations

import numpy as np
from numpy.testing import assert_allclose

from simulator.world.patch import Patch

PATCH = Patch(north_max_m=10.0, east_min_m=-5.0, rows=81, cols=61, gsd_m=0.25)


def test_first_pixel_is_the_north_west_corner() -> None:
    assert_allclose(PATCH.row_col(np.array([10.0, -5.0])), [0.0, 0.0])
    assert_allclose(PATCH.row_col(np.array([9.0, -3.0])), [4.0, 8.0])
    assert PATCH.north_min_m == -10.0
    assert PATCH.east_max_m == 10.0


def test_filled_square_covers_its_own_ground() -> None:
    image = np.zeros((81, 61), np.uint8)
    PATCH.fill(image, np.array([[2.0, 1.0], [2.0, 4.0], [-3.0, 4.0], [-3.0, 1.0]]), 1)
    rows, cols = np.nonzero(image)
    assert_allclose([10 - rows.min() * 0.25, 10 - rows.max() * 0.25], [2.0, -3.0])
    assert_allclose([-5 + cols.min() * 0.25, -5 + cols.max() * 0.25], [1.0, 4.0])


def test_stroke_has_its_width() -> None:
    image = np.zeros((81, 61), np.uint8)
    PATCH.stroke(image, np.array([[-8.0, 0.0], [8.0, 0.0]]), 1.25, 1)
    assert image[40].sum() * 0.25 == 1.25


def test_grown_and_cut_are_inverse() -> None:
    grown = PATCH.grown(6)
    assert grown.cut(slice(6, 6 + PATCH.rows), slice(6, 6 + PATCH.cols)) == PATCH


def test_coarser_pixel_is_the_middle_of_its_block() -> None:
    coarse = Patch(0.0, 0.0, 8, 8, 0.5).coarser(2)
    assert (coarse.north_max_m, coarse.east_min_m, coarse.gsd_m) == (-0.25, 0.25, 1.0)


def test_box_is_clipped_to_the_patch() -> None:
    rows, cols = PATCH.box(np.array([[100.0, -100.0], [9.0, -4.0]]))
    assert (rows.start, cols.start) == (0, 0)
    assert rows.stop >= 5
    assert cols.stop >= 5
    assert not PATCH.touches(np.array([[50.0, 0.0], [60.0, 1.0]]))
