"""Which landmarks are seen."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from estimator.geometry.camera import Camera, Mount
from simulator.visibility import Sight
from simulator.world.landmarks import Landmark
from simulator.world.world import World

CAMERA = Camera.from_hfov(640, 480, np.radians(60))


@pytest.fixture
def open_world(world: World) -> World:
    """Level ground with two landmarks and nothing on it."""
    marks = (Landmark("near", 0.0, 0.0, 0.0), Landmark("far", 0.0, 170.0, 0.0))
    return replace(world, raised=np.zeros_like(world.raised), landmarks=marks)


def test_below_the_camera_is_the_principal_point(open_world: World) -> None:
    seen = Sight(open_world, CAMERA).visible(np.array([0.0, 0.0, -80.0]), Mount().body_from_camera)
    assert [name for name, _ in seen] == ["near"]
    np.testing.assert_allclose(seen[0][1], [319.5, 239.5], atol=1e-9)


def test_a_wall_hides_what_is_behind_it(open_world: World) -> None:
    raised = open_world.raised.copy()
    patch = open_world.raised_patch
    rows, cols = patch.box(np.array([[-10.0, 6.0], [10.0, 8.0]]))
    raised[rows, cols] = 120
    sight = Sight(replace(open_world, raised=raised), CAMERA)
    # A wall of 12 m stands 6 to 8 m east: from 30 m east and 40 m up it is in the way, from the west it is not.
    assert sight.visible(np.array([0.0, 30.0, -40.0]), Mount(roll_rad=0.5).body_from_camera) == []
    names = [n for n, _ in sight.visible(np.array([0.0, -12.0, -40.0]), Mount().body_from_camera)]
    assert names == ["near"]


def test_from_below_nothing_is_seen(open_world: World) -> None:
    assert Sight(open_world, CAMERA).visible(np.array([0.0, 0.0, 5.0]), Mount().body_from_camera) == []
