"""The finished world: repeatable, cached, and a fair test of map matching."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import cv2
import numpy as np
import pyproj
import pytest

from estimator.types import Float
from simulator.scenario import Scenario
from simulator.world.world import World, make_world, world_for


def both_epochs(world: World) -> tuple[Float, Float]:
    """Grey pictures of the older and the present epoch on the reference's pixels; positions by pyproj alone."""
    rows, cols = world.reference.bands.shape[:2]
    a, _, x_min, _, e, y_max = world.reference.transform
    x, y = np.meshgrid(x_min + a * (np.arange(cols) + 0.5), y_max + e * (np.arange(rows) + 0.5))
    spec = world.spec
    pipeline = (
        f"+proj=pipeline +step +inv +proj=utm +zone=33 +ellps=WGS84 +step +proj=cart +ellps=WGS84 "
        f"+step +proj=topocentric +ellps=WGS84 +lon_0={spec.lon_deg} +lat_0={spec.lat_deg} +h_0={spec.alt_amsl_m}"
    )
    east, north, _ = pyproj.Transformer.from_pipeline(pipeline).transform(x, y, np.full_like(x, spec.alt_amsl_m))
    row_col = world.ground_patch.row_col(np.stack([north, east], axis=-1)).astype(np.float32)
    blurred = cv2.GaussianBlur(world.ground_bgr, (0, 0), 0.4 * a / spec.gsd_m)
    now = cv2.remap(blurred, row_col[..., 1], row_col[..., 0], cv2.INTER_LINEAR)
    return world.reference.bands.astype(float).mean(axis=2), now.astype(float).mean(axis=2)


def orientation(grey: Float) -> np.ndarray:
    """Double-angle gradients (rows, cols) as complex numbers: the same for an edge and its negative."""
    gradient = cv2.Sobel(grey, cv2.CV_64F, 1, 0) + 1j * cv2.Sobel(grey, cv2.CV_64F, 0, 1)
    return gradient**2 / (np.abs(gradient) ** 2 + 200.0)


def test_epochs_lie_on_each_other(world: World) -> None:
    """What stays, edges of fields, roads and roofs, is at the same place in both, to within a map pixel."""
    older, now = both_epochs(world)
    spectrum = np.fft.fft2(orientation(older)) * np.conj(np.fft.fft2(orientation(now)))
    surface = np.fft.fftshift(np.fft.ifft2(spectrum).real)
    peak = np.array(np.unravel_index(np.argmax(surface), surface.shape)) - np.array(surface.shape) // 2
    # One pixel for the older sensor's oblique view: what is raised leans.
    assert np.abs(peak).max() <= 1


def test_epochs_do_not_look_alike(world: World) -> None:
    """Grey values do not carry over between the epochs; a matcher that relies on them must fail."""
    older, now = both_epochs(world)
    assert np.corrcoef(older.ravel(), now.ravel())[0, 1] < 0.6


def test_fine_texture_is_not_shared(world: World) -> None:
    """On open fields, away from everything raised, the fine structure of one epoch says nothing about the other's."""
    older, now = both_epochs(world)
    fine = [grey - cv2.GaussianBlur(grey, (0, 0), 2.5) for grey in (older, now)]
    scores = []
    size = 24
    for row in range(0, older.shape[0] - size, size):
        for col in range(0, older.shape[1] - size, size):
            cells = [f[row : row + size, col : col + size].ravel() for f in fine]
            # Calm in both epochs: no edge, no shadow, no tree.
            if max(cell.std() for cell in cells) < 9.0:
                scores.append(np.corrcoef(*cells)[0, 1])
    assert len(scores) > 30
    assert abs(np.mean(scores)) < 0.08


def test_landmarks_stand_clear_on_the_ground(world: World) -> None:
    assert len(world.landmarks) >= 4
    assert len({landmark.name for landmark in world.landmarks}) == len(world.landmarks)
    for landmark in world.landmarks:
        assert landmark.height_m == pytest.approx(float(world.terrain.at(landmark.north_m, landmark.east_m)))


def test_elevation_model_is_true_to_the_ground(world: World) -> None:
    rows, cols = world.elevation.bands.shape
    a, _, x_min, _, e, y_max = world.elevation.transform
    lon, lat = pyproj.Transformer.from_crs(world.elevation.crs, "EPSG:4326", always_xy=True).transform(
        x_min + a * (np.arange(cols) + 0.5), np.full(cols, y_max + e * (rows // 2 + 0.5))
    )
    ned = world.frame.ned_from_geodetic(np.radians(lat), np.radians(lon), world.spec.alt_amsl_m)
    expected = world.spec.alt_amsl_m + world.terrain.at(ned[:, 0], ned[:, 1])
    error = world.elevation.bands[rows // 2] - expected
    assert np.abs(error).max() < 0.8
    assert error.std() < 0.3


def test_cache_gives_the_same_world(world: World, scenario: Scenario, world_cache: Path) -> None:
    kept = set(world_cache.iterdir())
    again = world_for(scenario.world.spec(7), world_cache)
    np.testing.assert_array_equal(again.ground_bgr, world.ground_bgr)
    np.testing.assert_array_equal(again.reference.bands, world.reference.bands)
    assert again.landmarks == world.landmarks
    assert set(world_cache.iterdir()) == kept


def test_seed_decides(scenario: Scenario, world: World) -> None:
    spec = replace(scenario.world.spec(7), half_size_m=150.0, gsd_m=0.5, reference_gsd_m=1.0)
    first, same, other = make_world(spec), make_world(spec), make_world(replace(spec, seed=8))
    np.testing.assert_array_equal(first.ground_bgr, same.ground_bgr)
    np.testing.assert_array_equal(first.reference.bands, same.reference.bands)
    assert np.mean(first.ground_bgr != other.ground_bgr) > 0.5


def test_broken_cache_folder_is_replaced(scenario: Scenario, tmp_path: Path) -> None:
    spec = replace(scenario.world.spec(7), half_size_m=150.0, gsd_m=0.5, reference_gsd_m=1.0)
    world_for(spec, tmp_path)
    folder = next(tmp_path.iterdir())
    (folder / "complete").unlink()
    (folder / "ground.npy").write_bytes(b"cut off")
    assert world_for(spec, tmp_path).ground_bgr.shape[2] == 3
