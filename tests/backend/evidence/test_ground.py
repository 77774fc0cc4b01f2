"""A strip of ground says what the grid it was taken from says."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from backend.evidence.ground import GroundStrip, WatchedGround, ground_model_of, ground_part_of
from backend.evidence.schema import StripPart
from estimator.geometry.ground import intersect_terrain
from estimator.types import Float
from geodata.elevation import ElevationGrid, FlatGround


def grid(seed: int, rows: int = 90, cols: int = 140) -> ElevationGrid:
    rng = np.random.default_rng(seed)
    heights = 400.0 + 15.0 * rng.standard_normal((rows, cols)).cumsum(axis=0) / 5.0
    heights[rng.random((rows, cols)) < 0.01] = np.nan
    return ElevationGrid(heights.astype(np.float32), 441.3, -333.7, 7.31)


@pytest.mark.parametrize("azimuth_deg", [0.0, 37.0, 90.0, 163.0, 270.0, 315.0])
def test_a_ray_is_cut_by_the_strip_as_by_the_grid(azimuth_deg: float) -> None:
    rng = np.random.default_rng(round(azimuth_deg))
    cut = 0
    for seed in range(12):
        watched = WatchedGround(grid(seed))
        origin = np.array([*rng.uniform(-100.0, 100.0, 2), -600.0])
        azimuth, down = np.radians(azimuth_deg), rng.uniform(0.4, 1.5)
        ray = np.array([np.cos(azimuth) * np.cos(down), np.sin(azimuth) * np.cos(down), np.sin(down)])
        point = through(watched, origin, ray)
        if not np.isfinite(point).all():
            continue
        cut += 1
        strip = ground_part_of(watched, origin, point)
        assert isinstance(strip, StripPart)

        again = through(GroundStrip.of(strip), origin, ray)

        assert_array_equal(again, point)
        asked = watched.asked_ne_m()
        assert_array_equal(
            GroundStrip.of(strip).alt_amsl_m(asked[:, 0], asked[:, 1]),
            watched.ground.alt_amsl_m(asked[:, 0], asked[:, 1]),
        )
        assert sum(len(row) for row in strip.alt_amsl_m) < 1_500  # of 12 600 cells
    assert cut >= 6


def through(ground: WatchedGround | GroundStrip, origin: Float, ray: Float) -> Float:
    return intersect_terrain(origin, ray, lambda north, east: -ground.alt_amsl_m(north, east))


def test_beside_the_strip_the_ground_is_unknown() -> None:
    strip = GroundStrip.of(
        StripPart(
            north_max_m=100.0, east_min_m=0.0, gsd_m=10.0, first_row=3, first_cols=[2, 1],
            alt_amsl_m=[[1.0, 2.0], [3.0, 4.0, 5.0]],
        )
    )  # fmt: skip

    # rows 3 and 4 lie at north 70 and 60, columns 2 and 3 at east 20 and 30
    assert strip.alt_amsl_m(np.array([65.0, 61.0]), np.array([25.0, 20.0])) == pytest.approx([3.0, 3.7])
    for north_m, east_m in ((71.0, 20.0), (59.0, 20.0), (65.0, 19.0), (1e300, 0.0), (np.nan, 5.0), (-np.inf, 5.0)):
        assert np.isnan(strip.alt_amsl_m(np.array([north_m]), np.array([east_m]))).all(), (north_m, east_m)


def test_level_ground_and_a_model_of_another_kind() -> None:
    class Other:
        def alt_amsl_m(self, north_m: Float, east_m: Float) -> Float:
            return north_m * east_m

    flat = ground_part_of(WatchedGround(FlatGround(431.7)), np.zeros(3), np.ones(3))

    assert ground_model_of(flat).alt_amsl_m(np.zeros(2), np.zeros(2)).tolist() == [431.7, 431.7]
    with pytest.raises(TypeError, match="Other"):
        ground_part_of(WatchedGround(Other()), np.zeros(3), np.ones(3))
