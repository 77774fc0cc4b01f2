"""The pad in rendered pictures: found at every height with honest sigmas, else refused with the reason."""

import math

import cv2
import numpy as np
import pytest

from benchmarks.pad_scenes import HD, VGA, Look, PadScene, compressed, looking_at_pad, pose_at
from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.landing.detector import detect_circles
from estimator.landing.pad import CirclePad, Ring, Triple, circle_pad
from estimator.landing.pose import PadPose, TiltPrior
from estimator.landing.sighting import NoPad, PadSighting, Refusal
from estimator.types import Image

PAD = circle_pad("p", 1.5, 0.3)


def _ground(seed: int) -> Image:
    """Grass, shadows and stones: noise at four scales."""
    rng = np.random.default_rng(seed)
    grey = np.full((1000, 1000), 105.0)
    for size, strength in ((400, 25.0), (60, 18.0), (12, 14.0), (1, 8.0)):
        coarse = rng.normal(0.0, strength, (1000 // size + 2, 1000 // size + 2)).astype(np.float32)
        grey += cv2.resize(coarse, (1000, 1000), interpolation=cv2.INTER_CUBIC)
    return np.clip(grey, 10, 245).astype(np.uint8)


GROUND = _ground(1)


def _told(pose: PadPose, rng: np.random.Generator, std_rad: float = 0.005) -> TiltPrior:
    down = pose.camera_from_pad[:, 2] + rng.normal(0.0, std_rad, 3)
    return TiltPrior(down / np.linalg.norm(down), std_rad)


def _view(height_m: float, rng: np.random.Generator) -> PadPose:
    away = rng.normal(0.0, 0.15 * height_m, 2)
    return looking_at_pad(height_m, (away[0], away[1]), rng.uniform(0.0, 2.0 * math.pi), (0.01, -0.02))


def _refusal(found: PadSighting | NoPad) -> Refusal | None:
    return found.refusal if isinstance(found, NoPad) else None


@pytest.mark.parametrize(
    ("height_m", "camera"), [*((h, VGA) for h in (20.0, 15.0, 8.0, 3.0, 1.0, 0.4, 0.15)), (12.0, HD), (0.4, HD)]
)
def test_found_from_twenty_metres_to_touchdown(height_m: float, camera: Camera) -> None:
    rng = np.random.default_rng(round(100 * height_m))
    scene = PadScene(GROUND, camera, PAD)
    triples = []
    for _ in range(2):
        pose = _view(height_m, rng)
        found = detect_circles(scene.render(pose, Look(jpeg=80, motion_px=1.0), rng), camera, PAD, _told(pose, rng))

        assert isinstance(found, PadSighting), found
        error = found.best.pose.pos_pad_m - pose.pos_pad_m
        # Half a degree of tilt is nine millimetres a metre of range: edges do better, at 20 m by a factor of two.
        assert float(np.linalg.norm(error)) < 0.012 * height_m
        assert float(error @ np.linalg.solve(found.best.cov_pos_pad_m2, error)) < 25.0
        assert not found.ambiguous and found.seen_share > 0.85
        triples.append(found.triple)
    # The largest that fits the view: from a height of 0.4 m the first is far outside the picture.
    assert max(triples) == 0 if height_m > 5.0 else min(triples) >= (1 if height_m <= 0.4 else 0)


def test_errors_match_their_sigmas_in_compressed_video() -> None:
    rng = np.random.default_rng(11)
    scene = PadScene(GROUND, VGA, PAD)
    poses = [_view(float(h), rng) for h in np.geomspace(14.0, 0.8, 24)]
    images = compressed([scene.render(pose, Look(), rng) for pose in poses], 2000)
    nees = []
    for pose, image in zip(poses, images, strict=True):
        found = detect_circles(image, VGA, PAD, _told(pose, rng))
        assert isinstance(found, PadSighting)
        error = found.best.pose.pos_pad_m - pose.pos_pad_m
        nees.append(float(error @ np.linalg.solve(found.best.cov_pos_pad_m2, error)))
    # Three is right. Encoders err alike over blocks, which residuals show only in part: up to twice that is let pass.
    assert 0.8 < float(np.mean(nees)) < 6.0


def test_no_flip_on_the_way_through_the_cylinder_of_the_three_centres() -> None:
    """Three centres alone are singular 0.87 m off the axis; edges are not, even with no tilt known."""
    rng = np.random.default_rng(12)
    scene = PadScene(GROUND, VGA, PAD)
    for beside in np.linspace(1.3, 0.4, 8):
        pose = looking_at_pad(5.0, (float(beside), 0.0), 0.3)
        found = detect_circles(scene.render(pose, Look(jpeg=85), rng), VGA, PAD)
        assert isinstance(found, PadSighting)
        assert float(np.linalg.norm(found.best.pose.pos_pad_m - pose.pos_pad_m)) < 0.03
        assert float(found.best.pose.camera_from_pad[:, 2] @ pose.camera_from_pad[:, 2]) > math.cos(0.02)


@pytest.mark.parametrize(
    "look", [Look(jpeg=80, shaded=0.3), Look(jpeg=80, glare=200.0), Look(motion_px=4.0, noise=6.0)]
)
def test_shade_glare_and_blur_do_not_hide_it(look: Look) -> None:
    rng = np.random.default_rng(13)
    scene = PadScene(GROUND, VGA, PAD)
    for _ in range(5):
        pose = _view(18.0, rng)
        found = detect_circles(scene.render(pose, look, rng), VGA, PAD, _told(pose, rng))
        assert isinstance(found, PadSighting)
        assert float(np.linalg.norm(found.best.pose.pos_pad_m - pose.pos_pad_m)) < 0.4


def test_with_all_rings_cut_it_is_found_where_it_is_expected_and_never_elsewhere() -> None:
    rng = np.random.default_rng(14)
    scene = PadScene(GROUND, VGA, PAD)
    for _ in range(6):
        pose = _view(18.0, rng)
        image, prior = scene.render(pose, Look(jpeg=80, littered=0.3), rng), _told(pose, rng)
        guess = pose.moved(np.array((0.003, -0.003, 0.003, 0.1, -0.1, 0.1)))

        expected = detect_circles(image, VGA, PAD, prior, guess)
        alone = detect_circles(image, VGA, PAD, prior)

        assert isinstance(expected, PadSighting)
        for found in (expected, alone):
            if isinstance(found, PadSighting):
                assert float(np.linalg.norm(found.best.pose.pos_pad_m - pose.pos_pad_m)) < 0.6


@pytest.mark.parametrize("height_m", [15.0, 4.0])
def test_a_mirrored_print_is_told(height_m: float) -> None:
    rng = np.random.default_rng(15)
    scene = PadScene(GROUND, VGA, PAD, rings=PAD.mirrored())
    for prior in (True, False):
        pose = _view(height_m, rng)
        found = detect_circles(scene.render(pose, Look(), rng), VGA, PAD, _told(pose, rng) if prior else None)
        assert _refusal(found) is Refusal.MIRRORED
        assert isinstance(found, NoPad) and "mirrored" in found.reason


def test_half_a_print_is_not_used() -> None:
    rng = np.random.default_rng(16)
    for cut_at_m in (-0.3, -0.6):
        scene = PadScene(GROUND, VGA, PAD, missing_beyond_y_m=cut_at_m)
        pose = pose_at(12.0, (0.3, 0.4), 0.5)
        found = detect_circles(scene.render(pose, Look(), rng), VGA, PAD, _told(pose, rng))
        assert _refusal(found) in (Refusal.INCOMPLETE, Refusal.NOTHING, Refusal.FOREIGN)


def test_two_pads_are_told() -> None:
    rng = np.random.default_rng(17)
    scene = PadScene(GROUND, VGA, PAD, second_at_m=(0.4, 3.2))
    pose = pose_at(12.0, (0.2, 1.6), 0.1)

    found = detect_circles(scene.render(pose, Look(), rng), VGA, PAD, _told(pose, rng))

    assert _refusal(found) is Refusal.TWO_PADS


def _scaled(rings: tuple[Ring, ...], radii: float) -> tuple[Ring, ...]:
    return tuple(Ring(r.x_m, r.y_m, r.outer_m * radii, r.inner_m * radii, r.triple, r.place) for r in rings)


@pytest.mark.parametrize("printed", ["larger discs", "other ratios", "other sides"])
def test_another_print_than_described_is_not_used(printed: str) -> None:
    rng = np.random.default_rng(18)
    largest = PAD.triples[0]
    rings = {
        "larger discs": _scaled(PAD.rings, 1.2),
        "other ratios": CirclePad("q", (Triple(largest.side_m, largest.radius_m, (0.25, 0.38, 0.64)),)).rings,
        "other sides": circle_pad("q", 1.7, 0.3).rings,
    }[printed]  # fmt: skip
    scene = PadScene(GROUND, VGA, PAD, rings=rings)
    for height_m in (12.0, 6.0):
        pose = _view(height_m, rng)
        found = detect_circles(scene.render(pose, Look(), rng), VGA, PAD, _told(pose, rng))
        assert isinstance(found, NoPad)
        assert found.refusal in (Refusal.FOREIGN, Refusal.INCOMPLETE)


def test_ground_and_discs_are_no_pad() -> None:
    rng = np.random.default_rng(19)
    scene = PadScene(GROUND, VGA, None)
    rings = tuple(
        Ring(x, y, 0.3, 0.3 * ratio, 0, 0) for x, y, ratio in ((0.0, 0.0, 0.5), (1.0, 0.4, 0.5), (0.2, 1.1, 0.5))
    )
    tyres = PadScene(GROUND, VGA, PAD, rings=rings)
    for _ in range(10):
        pose = _view(float(rng.uniform(3.0, 20.0)), rng)
        assert isinstance(detect_circles(scene.render(pose, Look(jpeg=60), rng), VGA, PAD), NoPad)
        assert isinstance(detect_circles(tyres.render(pose, Look(jpeg=60), rng), VGA, PAD), NoPad)


@pytest.mark.parametrize("value", [0, 128, 255])
def test_empty_pictures_and_noise(value: int) -> None:
    empty = np.full((480, 640), value, np.uint8)
    noise = np.random.default_rng(20).integers(0, 256, (480, 640)).astype(np.uint8)

    assert _refusal(detect_circles(empty, VGA, PAD)) is Refusal.NOTHING
    assert isinstance(detect_circles(noise, VGA, PAD), NoPad)
    with pytest.raises(GeometryError, match="the picture is"):
        detect_circles(noise[:100], VGA, PAD)


def test_an_expected_pose_that_is_wrong_or_behind_leads_nowhere_wrong() -> None:
    rng = np.random.default_rng(21)
    scene = PadScene(GROUND, VGA, PAD)
    pose = _view(10.0, rng)
    image, prior = scene.render(pose, Look(), rng), _told(pose, rng)
    behind = PadPose(pose.camera_from_pad, -pose.pad_in_camera_m)
    far = PadPose(pose.camera_from_pad, pose.pad_in_camera_m + np.array((3.0, -2.0, 4.0)))

    for guess in (behind, far):
        found = detect_circles(image, VGA, PAD, prior, guess)
        assert isinstance(found, PadSighting)
        assert float(np.linalg.norm(found.best.pose.pos_pad_m - pose.pos_pad_m)) < 0.1
