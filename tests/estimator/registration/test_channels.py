import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.registration.channels import CHANNELS, EDGE_SHARE, double_angle_gradients, edge_overlap, intensity


def _blocks(seed: int = 1) -> np.ndarray:
    rng = np.random.default_rng(seed)
    coarse = rng.integers(20, 236, size=(12, 16)).astype(np.uint8)
    return cv2.resize(coarse, (128, 96), interpolation=cv2.INTER_NEAREST)


def test_reversed_contrast_leaves_the_channels_alone() -> None:
    image = _blocks()

    # rounding of the blurred grey values by one
    difference = double_angle_gradients(image) - double_angle_gradients(255 - image)

    assert np.abs(difference).mean() < 0.01
    assert np.abs(double_angle_gradients(image)).mean() > 0.1


def test_intensity_does_reverse() -> None:
    image = _blocks()

    assert_allclose(intensity(image), -intensity(255 - image), atol=1.1)


@pytest.mark.parametrize(
    ("angle_deg", "expected"), [(0.0, (1.0, 0.0)), (45.0, (0.0, 1.0)), (90.0, (-1.0, 0.0)), (135.0, (0.0, -1.0))]
)
def test_direction_of_an_edge_in_double_angle_form(angle_deg: float, expected: tuple[float, float]) -> None:
    """A step across x (0 degrees) gives (1, 0), one across y (-1, 0), and 180 degrees are the same as none."""
    row, col = np.mgrid[:80, :80] - 40.0
    across = np.cos(np.deg2rad(angle_deg)) * col + np.sin(np.deg2rad(angle_deg)) * row
    image = (127.5 + 100.0 * np.tanh(across / 2.0)).astype(np.uint8)

    c1, c2 = double_angle_gradients(image)[:, 36:45, 36:45].reshape(2, -1)
    strongest = np.argmax(np.hypot(c1, c2))
    length = np.hypot(c1[strongest], c2[strongest])

    assert_allclose([c1[strongest] / length, c2[strongest] / length], expected, atol=0.1)


def test_magnitude_is_saturated_below_one() -> None:
    channels = double_angle_gradients(_blocks())

    assert np.hypot(channels[0], channels[1]).max() < 1.0


def test_blank_picture_has_no_direction_and_no_nan() -> None:
    assert_allclose(double_angle_gradients(np.full((40, 40), 90, dtype=np.uint8)), 0.0)


@pytest.mark.parametrize("name", sorted(CHANNELS))
def test_channels_keep_the_pictures_shape(name: str) -> None:
    channels = CHANNELS[name](_blocks())

    assert channels.shape[1:] == (96, 128)
    assert channels.dtype == np.float32


def test_edges_are_the_strongest_share_and_the_same_whatever_the_contrast() -> None:
    image = cv2.GaussianBlur(_blocks(), (0, 0), 1.0)
    edges = edge_overlap(image)

    assert set(np.unique(edges)) == {0.0, 1.0}
    assert EDGE_SHARE <= edges.mean() < EDGE_SHARE + 0.03
    assert (edges != edge_overlap(255 - image)).mean() < 0.002


def test_edges_lie_where_cannys_do() -> None:
    """Outside truth: OpenCV's Canny on a disc finds the same circle, to a pixel of Sobel's width."""
    disc = cv2.circle(np.full((120, 120), 60, np.uint8), (60, 60), 40, 190, -1)
    near_canny = cv2.dilate(cv2.Canny(disc, 100, 200), np.ones((5, 5), np.uint8)) > 0
    edges = edge_overlap(disc)[0] > 0

    assert edges.sum() > 300
    assert near_canny[edges].all()


def test_small_things_leave_no_edge() -> None:
    """A speck that the median removes: edges only where the large step is."""
    image = np.full((80, 80), 60, np.uint8)
    image[:, 40:] = 180
    clean = edge_overlap(image)
    image[20:22, 20:22] = 255

    assert_allclose(edge_overlap(image), clean)
    assert edge_overlap(np.full((40, 40), 90, np.uint8)).sum() == 0.0
