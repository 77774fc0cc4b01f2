"""Tags on real photos (a turntable in steps of ten degrees) and boards drawn by OpenCV."""

import math
from pathlib import Path

import cv2
import numpy as np
import pytest
import yaml

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.landing.pad import Tag, TagPad, tag_pad
from estimator.landing.pose import PadPose
from estimator.landing.sighting import NoPad, PadSighting, Refusal
from estimator.landing.tags import detect_tags, find_tags
from estimator.types import Image
from tests.shared_data import shared_data

FOLDER = shared_data("tags/dt")
INFO = yaml.safe_load((FOLDER / "test_info.yaml").read_text())
CAMERA = Camera(640, 480, 700.0, 700.0, 319.5, 239.5)


def _photo_camera(entry: str) -> Camera:
    k = INFO[entry]["K"]
    return Camera(INFO[entry]["width"], INFO[entry]["height"], k[0], k[4], k[2], k[5])


def _photos() -> dict[int, Path]:
    return {int(p.stem.rsplit("_", 1)[1]): p for p in FOLDER.glob("test_image_rotation_*.png")}


def test_photos_of_a_turning_tag_give_its_turns() -> None:
    camera, side_m = _photo_camera("rotation_test"), INFO["rotation_test"]["tag_size"]
    turned, ranges = {}, []
    for degrees, path in sorted(_photos().items()):
        image = np.asarray(cv2.imread(str(path), cv2.IMREAD_GRAYSCALE), np.uint8)
        tags = find_tags(image)
        if not tags:
            continue
        assert len(tags) == 1
        found = detect_tags(image, camera, TagPad("photo", (Tag(tags[0][0], 0.0, 0.0, side_m),)))
        assert isinstance(found, PadSighting)
        normals = [one.pose.camera_from_pad[:, 2] for one in found.solutions]
        angles = [-math.degrees(math.atan2(n[0], n[2])) for n in normals]
        turned[degrees] = min(angles, key=lambda angle: abs(angle - degrees))
        ranges.append(float(np.linalg.norm(found.best.pose.pad_in_camera_m)))

    # At 70 degrees the far side is a few pixels: one of 15 photos may be without its tag.
    assert len(turned) >= 14
    off = np.array([turned[degrees] - degrees for degrees in turned])
    # The stand is set by hand and the lens is taken as free of distortion: three degrees about a common offset.
    assert float(np.abs(off - np.median(off)).max()) < 6.0 and float(np.std(off)) < 3.0
    assert float(np.std(ranges)) < 0.005


def test_tags_of_another_photo_are_told_from_those_of_the_pad() -> None:
    image = np.asarray(cv2.imread(str(FOLDER / "test_image.png"), cv2.IMREAD_GRAYSCALE), np.uint8)
    numbers = sorted(number for number, _ in find_tags(image))
    assert len(numbers) >= 4

    found = detect_tags(image, _photo_camera("sample_test"), tag_pad("board", 0.9))

    assert isinstance(found, NoPad) and found.refusal is Refusal.FOREIGN
    assert str(numbers[0]) in found.reason


def _board(pad: TagPad, pose: PadPose, copies: tuple[float, ...] = (0.0,)) -> Image:
    """The board through a pinhole, warped from a raster of 1000 pixels a metre."""
    picture = np.full((480, 640), 120, np.uint8)
    for shift_m in copies:
        sheet = np.full((2400, 2400), 230, np.uint8)
        dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
        for tag in pad.tags:
            size = round(tag.side_m * 1000.0)
            top, left = round(1200 - tag.x_m * 1000 - size / 2), round(1200 + tag.y_m * 1000 - size / 2)
            sheet[top : top + size, left : left + size] = cv2.aruco.generateImageMarker(dictionary, tag.number, size)
        # Pixel (c, r) of the raster has its centre at y = (c - 1199.5) mm and x = (1199.5 - r) mm.
        plane = np.array(((0.0, -1e-3, 1.1995), (1e-3, 0.0, -1.1995 + shift_m), (0.0, 0.0, 1.0)))
        columns = np.column_stack((pose.camera_from_pad[:, :2], pose.pad_in_camera_m))
        warp = CAMERA.matrix @ columns @ plane
        white = cv2.warpPerspective(np.full_like(sheet, 255), warp, (640, 480))
        drawn = cv2.warpPerspective(sheet, warp, (640, 480), flags=cv2.INTER_AREA)
        picture = np.where(white > 127, drawn, picture)
    return np.asarray(cv2.GaussianBlur(picture, (0, 0), 0.8), np.uint8)


def _looking_down(height_m: float, tilt_rad: float) -> PadPose:
    level = np.array(((0.0, 1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    tilt = np.asarray(cv2.Rodrigues(np.array((tilt_rad, 0.0, 0.0)))[0], np.float64)
    return PadPose(tilt @ level, np.array((0.05, -0.02, height_m)))


@pytest.mark.parametrize("height_m", [2.5, 6.0])
def test_a_board_gives_the_position(height_m: float) -> None:
    pad, pose = tag_pad("board", 0.9), _looking_down(height_m, 0.3)

    found = detect_tags(_board(pad, pose), CAMERA, pad)

    assert isinstance(found, PadSighting)
    off = min(float(np.linalg.norm(one.pose.pos_pad_m - pose.pos_pad_m)) for one in found.solutions)
    assert off < 0.015 * height_m


def test_two_boards_and_a_wrong_description_are_refused() -> None:
    pad = tag_pad("board", 0.9)
    small = tag_pad("small", 0.45, sizes=1)
    pose = _looking_down(5.0, 0.1)

    two = detect_tags(_board(small, pose, copies=(-0.8, 0.8)), CAMERA, small)
    assert isinstance(two, NoPad) and two.refusal is Refusal.TWO_PADS

    shifted = TagPad(
        "shifted", (pad.tags[0], *(Tag(t.number, t.x_m + 0.2, t.y_m + 0.3, t.side_m) for t in pad.tags[1:]))
    )
    wrong = detect_tags(_board(pad, pose), CAMERA, shifted)
    assert isinstance(wrong, NoPad) and wrong.refusal is Refusal.FOREIGN

    mirrored = detect_tags(np.ascontiguousarray(_board(pad, pose)[:, ::-1]), CAMERA, pad)
    assert isinstance(mirrored, NoPad)


def test_a_picture_of_another_size_is_an_error() -> None:
    with pytest.raises(GeometryError, match="the picture is"):
        detect_tags(np.zeros((10, 10), np.uint8), CAMERA, tag_pad("board", 0.9))
