"""Pixels of the video and of the calibrated camera."""

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from backend.clicks import camera_pixel, typed_target
from backend.errors import InvalidRequestError, NoStateForFrameError
from backend.fleet.feed import FrameIdentity
from backend.navigation.setup import NavigationSetup
from backend.schemas.geometry import NewTarget
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.local import LocalFrame
from geodata.elevation import FlatGround

SETUP = NavigationSetup(
    Camera.from_hfov(640, 480, 1.0), Mount(0.0, -math.pi / 2, 0.0, np.zeros(3)), "fixed", True,
    LocalFrame(0.8, 0.1, 400.0), None, FlatGround(400.0), 10.0, None,
)  # fmt: skip


def test_the_same_size_changes_nothing() -> None:
    assert camera_pixel(17.25, 300.5, FrameIdentity(1, 0, 640, 480), SETUP) == (17.25, 300.5)


def test_a_smaller_video_is_scaled_about_the_pictures_edge() -> None:
    frame = FrameIdentity(1, 0, 320, 240)

    assert_allclose(camera_pixel(-0.5, -0.5, frame, SETUP), (-0.5, -0.5))
    assert_allclose(camera_pixel(319.5, 239.5, frame, SETUP), (639.5, 479.5))
    assert_allclose(camera_pixel(159.5, 119.5, frame, SETUP), (319.5, 239.5))  # the centre stays the centre


@pytest.mark.parametrize("uv", [(-1.0, 5.0), (640.0, 5.0), (5.0, 479.6)])
def test_a_click_outside_the_frame_is_refused(uv: tuple[float, float]) -> None:
    with pytest.raises(InvalidRequestError, match="outside"):
        camera_pixel(*uv, FrameIdentity(1, 0, 640, 480), SETUP)


def test_a_video_of_another_shape_gives_no_coordinates() -> None:
    with pytest.raises(NoStateForFrameError, match="contradicts"):
        camera_pixel(5.0, 5.0, FrameIdentity(1, 0, 640, 360), SETUP)


def test_typed_coordinates_have_no_uncertainty() -> None:
    target = typed_target(NewTarget(lat_deg=47.0, lon_deg=8.0, name="x"))

    assert (target.method, target.var_n_m2, target.version) == ("manual", None, 1)
    with pytest.raises(InvalidRequestError):
        typed_target(NewTarget(lat_deg=47.0))
