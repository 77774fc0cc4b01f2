"""Sun and shade."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.world.light import leaned, sunlight
from simulator.world.patch import Patch

PATCH = Patch(30.0, -30.0, 240, 240, 0.25)


def block(height_m: float) -> np.ndarray:
    """A tower of 2 m by 2 m in the middle."""
    raised = np.zeros((240, 240), np.float32)
    raised[116:124, 116:124] = height_m
    return raised


@pytest.mark.parametrize("azimuth_deg", [0.0, 90.0, 180.0, 229.0])
def test_shadow_points_away_from_the_sun_and_has_the_right_length(azimuth_deg: float) -> None:
    raised = block(8.0)
    _, shadow = sunlight(np.zeros_like(raised), raised, PATCH, azimuth_deg, 45.0)
    away = -np.array([np.cos(np.radians(azimuth_deg)), np.sin(np.radians(azimuth_deg))])
    rows, cols = np.nonzero((shadow > 0.5) & (raised == 0))
    offset = np.stack([30.0 - 0.25 * rows, -30.0 + 0.25 * cols], axis=1) - (0.125, -0.125)
    along = offset @ away
    # From the foot (1 m, or 1.4 m across a corner) to where the 8 m tower's top throws it.
    assert along.min() > 0.0
    assert along.max() == pytest.approx(9.2, abs=0.9)
    assert np.abs(offset @ np.array([-away[1], away[0]])).max() < 2.2


def test_slope_towards_the_sun_is_brighter() -> None:
    ground = np.repeat(0.2 * PATCH.norths_m(), 240, axis=1)
    to_north, _ = sunlight(ground, np.zeros_like(ground), PATCH, 0.0, 40.0)
    to_south, _ = sunlight(ground, np.zeros_like(ground), PATCH, 180.0, 40.0)
    # Ground that rises to the north faces south.
    assert to_south[120, 120] > 1.1
    assert to_north[120, 120] < 0.9
    flat, _ = sunlight(np.zeros_like(ground), np.zeros_like(ground), PATCH, 77.0, 33.0)
    assert flat[120, 120] == pytest.approx(1.0)


def test_raised_things_lean_by_their_height() -> None:
    raised = block(10.0)
    image = np.where(raised[..., None] > 0, np.uint8(255), np.uint8(20)).repeat(3, axis=2)
    seen = leaned(image, raised, PATCH, 0.2, 90.0)
    white = np.nonzero(seen[120, :, 0] > 128)[0]
    # The roof moves by 10 m times 0.2 to the east, eight pixels.
    assert white.max() == pytest.approx(123 + 8, abs=1)
    assert np.nonzero(seen[:, 126, 0] > 128)[0].min() == pytest.approx(116, abs=1)
