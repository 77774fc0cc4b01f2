import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.registration.correlation import MIN_KNOWN_FRACTION, SearchArea


def _brute_force(
    channels: np.ndarray, valid: np.ndarray, template: np.ndarray, mask: np.ndarray, centred: bool
) -> np.ndarray:
    """Masked correlation as the textbook has it: one window after the other, the energies of all channels summed."""
    rows, cols = mask.shape
    out = np.full((valid.shape[0] - rows + 1, valid.shape[1] - cols + 1), np.nan)
    inside = template[:, mask].astype(np.float64)
    inside -= inside.mean(axis=1, keepdims=True)
    for i, j in np.ndindex(out.shape):
        if valid[i : i + rows, j : j + cols][mask].mean() < MIN_KNOWN_FRACTION:
            continue
        window = np.where(valid, channels, 0.0)[:, i : i + rows, j : j + cols][:, mask].astype(np.float64)
        if centred:
            window = window - window.mean(axis=1, keepdims=True)
        out[i, j] = (inside * window).sum() / np.sqrt((inside**2).sum() * (window**2).sum())
    return out


def _scene(seed: int, channels: int, mean: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    rng = np.random.default_rng(seed)
    area = (rng.normal(size=(channels, 45, 52)) + mean).astype(np.float32)
    mask = np.hypot(*(np.mgrid[:17, :21] - np.array([8, 10])[:, None, None])) < 9.5
    template = area[:, 11:28, 23:44] + 0.3 * rng.normal(size=(channels, 17, 21)).astype(np.float32)
    return area, template.astype(np.float32), mask


@pytest.mark.parametrize(("channels", "mean"), [(1, 4.0), (1, 0.0), (2, 0.0), (3, 2.0)])
def test_agrees_with_brute_force(channels: int, mean: float) -> None:
    area, template, mask = _scene(channels, channels, mean)
    valid = np.ones(area.shape[1:], dtype=np.bool_)

    surface = SearchArea(area, valid, mask.shape).correlate(template, mask)

    assert surface.shape == (29, 32)
    # single precision of sums of about 300 products; channels without a mean are not centred per window
    assert_allclose(surface, _brute_force(area, valid, template, mask, centred=mean != 0.0), atol=2e-3)
    assert np.unravel_index(np.argmax(surface), surface.shape) == (11, 23)


def test_agrees_with_brute_force_next_to_the_maps_edge() -> None:
    """The map ends on a slant: offsets with too little of it are NaN, the others count what is known."""
    area, template, mask = _scene(9, 2, 0.0)
    valid = np.add.outer(np.arange(45), np.arange(52)) > 30

    surface = SearchArea(area, valid, mask.shape).correlate(template, mask)
    expected = _brute_force(area, valid, template, mask, centred=False)

    assert np.isnan(expected).any()
    assert_allclose(np.isnan(surface), np.isnan(expected))
    assert_allclose(surface, expected, atol=2e-3)


def test_off_the_map_is_nan_everywhere() -> None:
    area, template, mask = _scene(3, 1, 0.0)

    surface = SearchArea(area, np.zeros(area.shape[1:], dtype=np.bool_), mask.shape).correlate(template, mask)

    assert np.isnan(surface).all()


def test_masked_pixels_do_not_count() -> None:
    area, template, mask = _scene(4, 2, 0.0)
    search = SearchArea(area, np.ones(area.shape[1:], dtype=np.bool_), mask.shape)
    spoiled = np.where(mask, template, 1e3).astype(np.float32)

    assert_allclose(search.correlate(spoiled, mask), search.correlate(template, mask), atol=1e-6)


def test_grey_values_correlate_whatever_their_gain_and_offset() -> None:
    area, template, mask = _scene(5, 1, 100.0)
    search = SearchArea(area, np.ones(area.shape[1:], dtype=np.bool_), mask.shape)

    assert_allclose(search.correlate(2.5 * template - 40.0, mask), search.correlate(template, mask), atol=1e-3)
    assert_allclose(search.correlate(-template, mask), -search.correlate(template, mask), atol=1e-5)


def test_values_stay_within_one_and_a_perfect_match_reaches_it() -> None:
    area, _, mask = _scene(6, 2, 0.0)
    search = SearchArea(area, np.ones(area.shape[1:], dtype=np.bool_), mask.shape)

    # an eighth of a per cent: the template is centred, the window is not
    surface = search.correlate(area[:, 5:22, 7:28].copy(), mask)

    assert surface[5, 7] == pytest.approx(1.0, abs=0.01)
    assert np.abs(surface).max() <= 1.0


def test_empty_mask_and_blank_template() -> None:
    area, template, mask = _scene(7, 1, 0.0)
    search = SearchArea(area, np.ones(area.shape[1:], dtype=np.bool_), mask.shape)

    assert np.isnan(search.correlate(template, np.zeros_like(mask))).all()
    assert_allclose(search.correlate(np.full_like(template, 8.0), mask), 0.0, atol=1e-3)


def test_template_larger_than_the_area_is_refused() -> None:
    area, _, _ = _scene(8, 1, 0.0)

    with pytest.raises(ValueError, match="larger than the searched area"):
        SearchArea(area, np.ones(area.shape[1:], dtype=np.bool_), (46, 20))
