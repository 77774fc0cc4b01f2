"""Which pictures show ground: by their texture, whatever their size, and not where a light blinds the lens."""

from __future__ import annotations

import numpy as np
import pytest

from estimator.integrity.picture import shows_ground, texture
from tests.estimator.registration.textured_map import MAP

SHAPE = (480, 640)


def ground() -> np.ndarray:
    """A picture of a textured map."""
    return np.ascontiguousarray(np.resize(MAP.image, SHAPE).astype(np.uint8))


def noisy(grey: np.ndarray, std: float) -> np.ndarray:
    noise = np.random.default_rng(3).normal(0.0, std, grey.shape)
    return np.clip(np.rint(grey + noise), 0, 255).astype(np.uint8)


def test_ground_shows() -> None:
    assert shows_ground(ground())


@pytest.mark.parametrize("std", [0.0, 1.0, 5.0])
def test_a_capped_camera_shows_nothing_however_it_hisses(std: float) -> None:
    assert not shows_ground(noisy(np.full(SHAPE, 12.0), std))


def test_noise_is_averaged_out_of_the_texture() -> None:
    """Over 16 pixels a quarter of its deviation is left."""
    assert texture(noisy(np.full(SHAPE, 100.0), 4.0)) == pytest.approx(1.0, abs=0.1)


def test_fog_thins_the_texture_by_as_much_as_the_contrast() -> None:
    clear = ground().astype(float)
    fog = np.rint(180.0 + 0.25 * (clear - 180.0)).astype(np.uint8)

    assert texture(fog) == pytest.approx(0.25 * texture(ground()), rel=0.05)


def test_one_bright_spot_does_not_make_a_picture() -> None:
    spot = np.full(SHAPE, 20, dtype=np.uint8)
    spot[100:140, 200:240] = 240

    assert not shows_ground(spot)


def test_a_light_in_the_lens_blinds_it_though_there_is_texture_beside_it() -> None:
    blinded = ground()
    blinded[:200, :250] = 255
    glint = ground()
    glint[:60, :60] = 255

    assert texture(blinded) > 5.0
    assert not shows_ground(blinded)
    assert shows_ground(glint)


@pytest.mark.parametrize("shape", [(0, 0), (1, 1), (5, 7), (24, 32)])
def test_pictures_of_any_size_have_an_answer(shape: tuple[int, int]) -> None:
    assert not shows_ground(np.zeros(shape, dtype=np.uint8))
