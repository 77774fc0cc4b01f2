"""The pad from straight above, of pictures drawn by the pad's geometry, and its outlines in them."""

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from backend.landing.view import PICTURES_KEPT, Pictures, outlines_px, pad_view, view_side_m
from benchmarks.pad_scenes import HD, INK, PAPER, VGA, Look, PadScene
from estimator.geometry.camera import Camera
from estimator.geometry.rotation import matrix_from_euler
from estimator.landing.pad import CirclePad, Pad, TagPad, circle_pad, tag_pad
from estimator.landing.pose import PadPose
from estimator.types import FrameSample, Image, PadSeen

PAD = circle_pad("test pad", 1.5, 0.3)
TAGS = tag_pad("tags", 0.9)
GRASS = np.full((512, 512), 110, np.uint8)
MIDDLE = (PAPER + INK) / 2.0


def pictured(
    camera: Camera, pad: Pad, at_m: tuple[float, float, float], tilt_deg: tuple[float, float, float]
) -> tuple[FrameSample, PadSeen]:
    """A picture from a place in the pad's frame (z down), by a camera that looks down, tilted and turned."""
    turned = matrix_from_euler(*np.radians(tilt_deg)) @ np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0)))
    pose = PadPose(turned.T, -turned.T @ np.array(at_m))
    image: Image = PadScene(GRASS, camera, pad).render(pose, Look(), np.random.default_rng(3))
    return FrameSample(5, 7, image, 1), PadSeen(5, 7, pose.camera_from_pad, pose.pad_in_camera_m, 0, 0.9)


def warped(picture: FrameSample, seen: PadSeen, camera: Camera, pad: Pad) -> tuple[Image, float]:
    view = pad_view(picture, seen, camera, pad)
    assert (view.frame_id, view.t_us) == (7, 5)
    image = cv2.imdecode(np.frombuffer(view.jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    return np.asarray(image, np.uint8), view.side_m


def value_at(image: Image, side_m: float, x_m: float, y_m: float) -> float:
    """What is shown of a place on the pad: x up, y to the right, the centre in the middle."""
    size = image.shape[0]
    return float(image[round((0.5 - x_m / side_m) * size - 0.5), round((0.5 + y_m / side_m) * size - 0.5)])


@pytest.mark.parametrize("camera", [VGA, HD])
def test_the_view_is_the_print_as_seen_from_straight_above(camera: Camera) -> None:
    picture, seen = pictured(camera, PAD, (-0.5, 0.6, -6.0), (6.0, -5.0, 40.0))
    image, side_m = warped(picture, seen, camera, PAD)

    for ring in PAD.rings:
        if ring.triple > 0:
            continue
        assert value_at(image, side_m, ring.x_m, ring.y_m) > MIDDLE
        between = 0.5 * (ring.inner_m + ring.outer_m)
        for x, y in ((between, 0.0), (-between, 0.0), (0.0, between), (0.0, -between)):
            assert value_at(image, side_m, ring.x_m + x, ring.y_m + y) < MIDDLE
            # White again a little outside, so that the size is right and not only the place.
            assert value_at(image, side_m, ring.x_m + 1.25 * x / between * ring.outer_m, ring.y_m
                            + 1.25 * y / between * ring.outer_m) > MIDDLE  # fmt: skip


def test_from_close_by_what_the_picture_holds_is_shown_larger() -> None:
    far = view_side_m(pictured(VGA, PAD, (0, 0, -15.0), (0, 0, 0))[1], VGA, PAD)
    picture, seen = pictured(VGA, PAD, (0.0, 0.0, -0.5), (0, 0, 0))
    image, side_m = warped(picture, seen, VGA, PAD)

    assert far == pytest.approx(2.2 * PAD.bounds_m[2])
    # 640 pixels at 800 pixels focal length show 0.4 m from half a metre.
    assert 0.4 < side_m < 0.4 * 1.25 * 2**0.5
    small = [ring for ring in PAD.rings if ring.triple == 2]
    assert all(value_at(image, side_m, ring.x_m, ring.y_m) > MIDDLE for ring in small)


def test_outlines_lie_on_the_edges_in_the_picture() -> None:
    """Just inside each outer edge it is black, just outside white: within two pixels, through lens and tilt."""
    picture, seen = pictured(VGA, PAD, (-0.3, 0.2, -6.0), (3.0, -4.0, -70.0))
    outlines = outlines_px(seen, VGA, PAD)

    assert len(outlines) == len(PAD.rings)
    for outline in outlines[:6]:
        points = np.array(outline)
        middle = points.mean(axis=0)
        outward = (points - middle) / np.linalg.norm(points - middle, axis=1)[:, None]
        for shift, dark in ((-2.0, True), (2.0, False)):
            u, v = np.rint(points + shift * outward).astype(int).T
            assert np.all((np.asarray(picture.image)[v, u] < MIDDLE) == dark)


def test_outlines_that_the_picture_does_not_hold_are_left_out() -> None:
    _, close = pictured(VGA, PAD, (0.0, 0.0, -0.4), (0, 0, 0))
    assert 3 <= len(outlines_px(close, VGA, PAD)) <= 6
    behind = PadSeen(5, 7, np.diag((1.0, -1.0, -1.0)), np.array((0.0, 0.0, -3.0)), 0, 0.9)
    assert outlines_px(behind, VGA, PAD) == []


def test_tags_have_their_borders_for_outlines() -> None:
    _, seen = pictured(VGA, TAGS, (0.1, -0.2, -3.0), (0, 0, 20.0))
    outlines = outlines_px(seen, VGA, TAGS)

    assert isinstance(TAGS, TagPad)
    assert not isinstance(TAGS, CirclePad)
    largest = np.array(outlines[0])
    # Side 0.9 m at 3 m and 800 pixels: 240 pixels, less a little for the lens.
    assert_allclose(np.linalg.norm(np.roll(largest, 1, axis=0) - largest, axis=1), 240.0, rtol=0.03)


def test_only_the_newest_pictures_are_kept() -> None:
    pictures = Pictures()
    for number in range(PICTURES_KEPT + 3):
        pictures.take(FrameSample(number, number, GRASS, 1))

    assert pictures.get(2) is None
    found = pictures.get(3)
    assert found is not None
    assert found.frame_id == 3
    pictures.clear()
    assert pictures.get(3) is None
