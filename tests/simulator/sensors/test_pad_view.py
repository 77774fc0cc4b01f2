"""A pad in the picture, against OpenCV's projection and against sixteen rays for every pixel."""

from __future__ import annotations

import cv2
import numpy as np
import pytest

from estimator.geometry.camera import Camera, Mount
from estimator.geometry.rotation import matrix_from_euler
from estimator.landing.pad import circle_pad
from estimator.types import Float, Image
from simulator.sensors.pad_view import PadView
from simulator.world.pad_place import PadPlace
from simulator.world.pad_print import INK, PAPER, in_ring, in_sheet, on_plane

CAMERA = Camera(640, 480, 800.0, 800.0, 319.5, 239.5, (-0.12, 0.06, 0.0005, -0.0004, 0.0))
PAD = circle_pad("pad", 1.5, 0.3)
GROUND = 90
PLACE = PadPlace(PAD, np.array([12.0, -7.0, 4.0]), matrix_from_euler(0.02, -0.03, 0.6))


def looking_down(height_m: float, north_m: float, east_m: float) -> tuple[Float, Float]:
    pos = PLACE.pos_ned_m + np.array([north_m, east_m, -height_m])
    return pos, matrix_from_euler(0.03, -0.05, -0.9) @ Mount().body_from_camera


def drawn(pos: Float, ned_from_camera: Float) -> Image:
    picture = np.full((CAMERA.height_px, CAMERA.width_px, 3), GROUND, np.uint8)
    PadView(PLACE, CAMERA, 1).draw(picture, pos, ned_from_camera)
    return picture


@pytest.mark.parametrize("height_m", [20.0, 5.0, 1.5, 0.3])
def test_it_is_the_mean_of_sixteen_rays_everywhere(height_m: float) -> None:
    pos, ned_from_camera = looking_down(height_m, 0.05 * height_m, -0.1 * height_m)
    picture = drawn(pos, ned_from_camera)

    part = (np.arange(4) + 0.5) / 4 - 0.5
    u = (np.arange(CAMERA.width_px)[:, None] + part).ravel()
    v = (np.arange(CAMERA.height_px)[:, None] + part).ravel()
    rays = CAMERA.rays(np.stack(np.meshgrid(u, v), axis=-1))
    xy = on_plane(
        (rays[..., :2] / rays[..., 2:]).astype(np.float32),
        ned_from_camera.T @ PLACE.ned_from_pad,
        ned_from_camera.T @ (PLACE.pos_ned_m - pos),
    )
    value = np.where(in_sheet(xy[..., 0], xy[..., 1], PAD.bounds_m), np.float32(PAPER), np.float32(GROUND))
    for ring in PAD.rings:
        value[in_ring(xy[..., 0], xy[..., 1], ring)] = INK
    expected = cv2.resize(value, (CAMERA.width_px, CAMERA.height_px), interpolation=cv2.INTER_AREA)

    # Rays of sub-pixels are those of neighbours carried on, so one of sixteen may fall on the other side of an edge.
    off = np.abs(picture[..., 0].astype(float) - expected)
    assert off.max() <= (PAPER - INK) / 16 * 2 + 1.0
    assert off.mean() < 0.05


@pytest.mark.parametrize("height_m", [20.0, 8.0])
def test_rings_are_where_opencv_projects_them(height_m: float) -> None:
    pos, ned_from_camera = looking_down(height_m, 1.0, -1.0)
    dark = drawn(pos, ned_from_camera)[..., 0] < GROUND
    _, _, _, centres = cv2.connectedComponentsWithStats(dark.astype(np.uint8))
    places = np.array([[r.x_m, r.y_m, 0.0] for r in PAD.rings[:3]]) @ PLACE.ned_from_pad.T + PLACE.pos_ned_m
    rotation, _ = cv2.Rodrigues(ned_from_camera.T)
    uv, _ = cv2.projectPoints(places, rotation, -ned_from_camera.T @ pos, CAMERA.matrix, np.array(CAMERA.distortion))

    for expected in uv.reshape(-1, 2):
        # Of thresholded pixels; an ellipse's middle is 0.1 px from the circle's at 8 m.
        assert np.linalg.norm(centres[1:] - expected, axis=1).min() < 0.25


def test_from_below_or_out_of_view_nothing_is_drawn() -> None:
    pos, ned_from_camera = looking_down(10.0, 300.0, 0.0)
    assert (drawn(pos, ned_from_camera) == GROUND).all()
    under, _ = looking_down(-1.0, 0.0, 0.0)
    assert (drawn(under, ned_from_camera) == GROUND).all()
