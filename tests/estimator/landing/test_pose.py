"""Poses from circles against OpenCV's projection, their Jacobians, their sigmas, and both planar solutions."""

import math

import cv2
import numpy as np
import pytest

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.landing.pad import circle_pad
from estimator.landing.pose import (
    Edges,
    PadPose,
    Samples,
    TiltPrior,
    both_solutions,
    circle_poses,
    corners,
    joined,
    other_side,
    sample_rings,
    seen,
    solve,
)
from estimator.types import Float

CAMERA = Camera(640, 480, 800.0, 790.0, 320.5, 238.5, (-0.2, 0.05, 0.001, -0.0005, 0.0))
PAD = circle_pad("p", 1.5, 0.3)


def _pose(rng: np.random.Generator, range_m: float, tilt_rad: float, away_m: float = 0.0) -> PadPose:
    about = rng.uniform(0.0, 2.0 * math.pi)
    tilt = cv2.Rodrigues(tilt_rad * np.array((math.cos(about), math.sin(about), 0.0)))[0]
    turn = cv2.Rodrigues(np.array((0.0, 0.0, rng.uniform(-math.pi, math.pi))))[0]
    return PadPose(np.asarray(tilt @ turn, np.float64), np.array((*rng.normal(0.0, away_m, 2), range_m)))


def _edges(pose: PadPose, samples: Samples, noise_px: Float) -> Edges:
    curve = seen(CAMERA, pose, samples)
    return Edges.found(samples, curve, noise_px, np.ones(len(noise_px), bool))


def _tilted(pose: PadPose, std_rad: float, rng: np.random.Generator) -> TiltPrior:
    down = pose.camera_from_pad[:, 2] + rng.normal(0.0, std_rad, 3)
    return TiltPrior(down / np.linalg.norm(down), std_rad)


def test_samples_are_seen_where_opencv_projects_them() -> None:
    rng = np.random.default_rng(1)
    pose = _pose(rng, 9.0, 0.3, 0.5)
    samples = sample_rings(PAD.rings[:3], 0, 20)

    curve = seen(CAMERA, pose, samples)

    wanted, _ = cv2.projectPoints(
        samples.points_m, cv2.Rodrigues(pose.camera_from_pad)[0], pose.pad_in_camera_m, CAMERA.matrix,
        np.array(CAMERA.distortion),
    )  # fmt: skip
    np.testing.assert_allclose(curve.pixels, wanted.reshape(-1, 2), atol=1e-6)
    # A point a millimetre further out lies along the normal by that millimetre's share of the radius.
    further = Samples(samples.points_m + 1e-3 * samples.outward, samples.outward, samples.radius_m, samples.rises,
                      samples.ring)  # fmt: skip
    moved = np.einsum("ni,ni->n", seen(CAMERA, pose, further).pixels - curve.pixels, curve.normals)
    np.testing.assert_allclose(moved / 1e-3 * samples.radius_m, curve.radius_px, rtol=1e-3)


def test_a_circles_ellipse_gives_its_centre_and_normal_as_one_of_two() -> None:
    """Fitted by OpenCV through points that OpenCV projected, without the lens."""
    rng = np.random.default_rng(2)
    for _ in range(50):
        pose = _pose(rng, rng.uniform(2.0, 20.0), rng.uniform(0.05, 0.9), 0.5)
        angle = np.linspace(0.0, 2.0 * np.pi, 60, endpoint=False)
        circle = np.column_stack((0.3 * np.cos(angle), 0.3 * np.sin(angle), np.zeros(60)))
        # A scale of 1e4 keeps OpenCV's single precision out of the comparison.
        scale = np.diag((1e4, 1e4, 1.0))
        uv, _ = cv2.projectPoints(circle, cv2.Rodrigues(pose.camera_from_pad)[0], pose.pad_in_camera_m, scale, None)
        uv = uv.reshape(-1, 2)
        middle = uv.mean(axis=0)
        (u, v), (width, height), degrees = cv2.fitEllipseDirect((uv - middle).astype(np.float32))
        c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
        to_unit = np.diag((2.0 / width, 2.0 / height, 1.0)) @ np.array(((c, s, 0.0), (-s, c, 0.0), (0.0, 0.0, 1.0)))
        to_unit = to_unit @ np.array(((1.0, 0.0, -u - middle[0]), (0.0, 1.0, -v - middle[1]), (0.0, 0.0, 1.0))) @ scale
        conic = to_unit.T @ np.diag((1.0, 1.0, -1.0)) @ to_unit

        both = circle_poses(conic, 0.3)

        off = min(
            float(np.linalg.norm(centre - pose.pad_in_camera_m)) / pose.pad_in_camera_m[2]
            + float(np.linalg.norm(normal - pose.camera_from_pad[:, 2]))
            for centre, normal in both
        )  # fmt: skip
        assert off < 0.02  # what the ellipse's single precision leaves of a tilt of three degrees


def test_a_hyperbola_is_no_circle() -> None:
    with pytest.raises(GeometryError, match="no ellipse"):
        circle_poses(np.diag((1.0, 1.0, 1.0)), 0.3)


def test_jacobian_by_the_step_that_a_solution_takes() -> None:
    """Exact edges and a start ten centimetres and three degrees off lead back to the pose to a micrometre."""
    rng = np.random.default_rng(3)
    for _ in range(20):
        pose = _pose(rng, 8.0, rng.uniform(0.0, 0.4), 0.5)
        samples = joined([sample_rings(PAD.rings[:3], 0, 24), sample_rings(PAD.rings[3:6], 3, 12)])
        exact = _edges(pose, samples, -0.4 / seen(CAMERA, pose, samples).radius_px)

        found = solve(exact, pose.moved(rng.normal(0.0, 0.03, 6)), None)

        assert found is not None
        np.testing.assert_allclose(found.pose.pos_pad_m, pose.pos_pad_m, atol=2e-4)


@pytest.mark.parametrize("with_prior", [False, True])
def test_errors_match_their_sigmas(with_prior: bool) -> None:
    """Squared errors of 300 poses by their covariances have the mean 3 of three degrees of freedom."""
    rng = np.random.default_rng(4)
    samples = sample_rings(PAD.rings[:3], 0, 36)
    nees, off = [], []
    for _ in range(300):
        pose = _pose(rng, 10.0, rng.uniform(0.15, 0.4), 0.5)
        noise = rng.normal(0.0, 0.3, len(samples.ring)) - 0.4 / seen(CAMERA, pose, samples).radius_px
        prior = _tilted(pose, math.radians(0.3), rng) if with_prior else None
        found = solve(_edges(pose, samples, noise), pose, prior)
        assert found is not None
        error = found.pose.pos_pad_m - pose.pos_pad_m
        nees.append(float(error @ np.linalg.solve(found.cov_pos_pad_m2, error)))
        off.append(error)
    # The mean of 300 draws of chi-squared with three degrees lies within 0.42 of it with 99.7 %; noise taken from the
    # residuals widens that.
    assert 2.4 < float(np.mean(nees)) < 3.6
    lateral = float(np.sqrt(np.mean(np.square(np.array(off)[:, :2]))))
    assert lateral < (0.035 if with_prior else 0.045)


def test_neighbours_that_err_alike_do_not_make_it_surer() -> None:
    rng = np.random.default_rng(5)
    samples = sample_rings(PAD.rings[:3], 0, 36)
    pose = _pose(rng, 10.0, 0.3, 0.3)
    white = rng.normal(0.0, 0.3, len(samples.ring))
    smooth = np.convolve(white, np.ones(5) / np.sqrt(5.0), mode="same")

    alone, alike = (solve(_edges(pose, samples, noise), pose, None) for noise in (white, smooth))

    assert alone is not None and alike is not None
    ratio = np.sqrt(np.diag(alike.cov) / np.diag(alone.cov)) * alone.sigma_px / alike.sigma_px
    assert float(np.median(ratio)) > 1.3


def test_far_away_both_planar_solutions_are_kept_and_the_tilt_prior_tells_them_apart() -> None:
    rng = np.random.default_rng(6)
    samples = sample_rings(PAD.rings[:3], 0, 20)
    kept = right = 0
    for _ in range(40):
        pose = _pose(rng, 40.0, math.radians(12.0), 0.2)
        edges = _edges(pose, samples, rng.normal(0.0, 0.3, len(samples.ring)))
        start = pose if rng.random() < 0.5 else other_side(pose)

        blind = both_solutions(edges, start, None, 0.3, 13.8)
        told = both_solutions(edges, start, _tilted(pose, math.radians(0.5), rng), 0.3, 13.8)

        normals = [one.pose.camera_from_pad[:, 2] for one in blind]
        assert min(float(np.linalg.norm(n - pose.camera_from_pad[:, 2])) for n in normals) < 0.15
        kept += len(blind) == 2
        right += len(told) == 1 and float(told[0].pose.camera_from_pad[:, 2] @ pose.camera_from_pad[:, 2]) > 0.999
    assert kept >= 30
    assert right == 40


def test_the_other_side_shows_nearly_the_same_picture() -> None:
    rng = np.random.default_rng(7)
    pose = _pose(rng, 60.0, math.radians(20.0), 0.5)
    samples = sample_rings(PAD.rings[:3], 0, 20)

    apart = seen(CAMERA, pose, samples).pixels - seen(CAMERA, other_side(pose), samples).pixels

    assert float(np.abs(apart).max()) < 0.2
    assert float(pose.camera_from_pad[:, 2] @ other_side(pose).camera_from_pad[:, 2]) < math.cos(math.radians(35.0))


def test_corners_give_opencvs_pose() -> None:
    rng = np.random.default_rng(8)
    pose = _pose(rng, 5.0, 0.5, 0.3)
    points = np.array(((0.4, -0.4, 0.0), (0.4, 0.4, 0.0), (-0.4, 0.4, 0.0), (-0.4, -0.4, 0.0), (0.1, 0.3, 0.0)))
    uv = CAMERA.project(points @ pose.camera_from_pad.T + pose.pad_in_camera_m) + rng.normal(0.0, 0.3, (5, 2))
    turn, shift = cv2.Rodrigues(pose.camera_from_pad)[0], pose.pad_in_camera_m.reshape(3, 1).copy()
    turn, shift = cv2.solvePnPRefineLM(points, uv, CAMERA.matrix, np.array(CAMERA.distortion), turn, shift)

    found = solve(corners(CAMERA, points, uv), pose, None, sigma_px=1.0)

    assert found is not None
    # Both minimise the same sum but for the lens, which counts as linear over a fraction of a pixel.
    np.testing.assert_allclose(found.pose.pad_in_camera_m, shift.ravel(), atol=2e-3)


def test_a_prior_needs_a_unit_vector() -> None:
    with pytest.raises(GeometryError, match="unit vector"):
        TiltPrior(np.array((0.0, 0.0, 2.0)), 0.01)
