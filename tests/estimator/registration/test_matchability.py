"""Matchability of painted maps: what a person sees at a glance must come out."""

import math

import numpy as np
import pytest

from estimator.registration.matchability import (
    AMBIGUOUS,
    GOOD,
    WEAK,
    Matchability,
    MatchabilityConfig,
    at_place,
    matchability,
)
from tests.estimator.registration.textured_map import MAP, straight_road

CONFIG = MatchabilityConfig(footprint_m=80.0, radius_m=40.0)


def _predict(image: np.ndarray, valid: np.ndarray | None = None) -> Matchability:
    return matchability(image, np.ones(image.shape, dtype=bool) if valid is None else valid, 1.0, CONFIG)


def test_blocks_of_every_direction_are_good_everywhere() -> None:
    found = _predict(MAP.image)

    assert (found.kind == GOOD).mean() > 0.95
    # the map's own error of a pixel bounds what a match can tell
    assert np.median(found.sigma_m) < 2.0


def test_along_a_lone_road_the_worst_axis_is_the_roads() -> None:
    # grain as in a real field, far weaker than the road
    scene = straight_road(math.pi / 2, (0.0, 0.0)).image.astype(float)
    grain = np.random.default_rng(2).normal(0.0, 3.0, scene.shape)
    found = _predict(np.clip(scene + grain, 0, 255).astype(np.uint8))
    blocks = _predict(MAP.image)

    on_road = at_place(found.sigma_m, found, np.array([200.0]), np.array([200.0]))[0]

    assert on_road > 4.0 * np.median(blocks.sigma_m)


def test_bare_ground_is_weak_and_a_grid_of_trees_ambiguous() -> None:
    rng = np.random.default_rng(4)
    bare = np.clip(rng.normal(100.0, 3.0, (401, 401)), 0, 255).astype(np.uint8)
    row, col = np.mgrid[:401, :401]
    # an orchard: the same tree every 16 m
    trees = np.where(np.hypot(row % 16 - 8, col % 16 - 8) < 4.5, 60, 170).astype(np.uint8)

    of_bare, of_trees = _predict(bare), _predict(trees)

    assert (of_bare.kind == WEAK).mean() > 0.9
    assert (of_trees.kind == AMBIGUOUS).mean() > 0.9
    assert np.median(of_trees.elsewhere) > 0.5


def test_unknown_ground_has_no_value() -> None:
    valid = np.ones(MAP.image.shape, dtype=bool)
    valid[:, 200:] = False

    found = _predict(MAP.image, valid)

    assert np.isnan(at_place(found.sigma_m, found, np.array([200.0]), np.array([330.0]))).all()
    assert np.isfinite(at_place(found.sigma_m, found, np.array([200.0]), np.array([80.0]))).all()
    assert set(np.unique(found.kind[:, -1])) == {255}


def test_a_map_smaller_than_a_footprint_is_an_error() -> None:
    with pytest.raises(ValueError, match="the map is 50 m wide"):
        _predict(MAP.image[:50, :50])
    with pytest.raises(ValueError, match="16 are needed"):
        matchability(MAP.image, np.ones(MAP.image.shape, dtype=bool), 10.0, CONFIG)
