"""Pictures at the calibrated size."""

import numpy as np

from backend.fleet.cameras import fitted
from geodata.flight_meta import CameraMeta

CAMERA = CameraMeta(width_px=640, height_px=480, fx_px=500.0, fy_px=500.0, cx_px=319.5, cy_px=239.5)


def test_the_calibrated_size_is_passed_as_it_is() -> None:
    image = np.zeros((480, 640), np.uint8)

    assert fitted(image, CAMERA)[0] is image


def test_a_scaled_video_is_brought_to_size() -> None:
    ramp = np.tile(np.linspace(0, 255, 1280).astype(np.uint8), (960, 1))
    image, problem = fitted(ramp, CAMERA)

    assert problem is None
    assert image is not None
    assert image.shape == (480, 640)
    assert abs(int(image[100, 320]) - 128) <= 1


def test_another_shape_is_refused_in_words() -> None:
    image, problem = fitted(np.zeros((720, 1280), np.uint8), CAMERA)

    assert image is None
    assert "1280 x 720" in (problem or "")
    assert "640 x 480" in (problem or "")
