"""Pixels carried to the map by a match, against OpenCV's own projection over sloped ground."""

from dataclasses import dataclass, field, replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.geometry.local import LocalFrame
from estimator.targets.registered import RegisteredTarget, TargetErrors, locate_registered

FRAME = LocalFrame(np.deg2rad(47.2), np.deg2rad(8.6), 420.0)
CAMERA = Camera(640, 480, 520.0, 522.0, 315.0, 243.0, (-0.15, 0.05, 0.001, -0.0005, -0.006))
ERRORS = TargetErrors(pixel_std_px=1.0, ground_std_m=0.0)
CORRECTION = np.array([3.0, -2.0, 0.02, 0.015, -0.02, 0.03])
COV = np.diag([1.2**2, 0.8**2, 0.02**2, 0.01**2, 0.008**2, 0.012**2])


class Slope:
    """Ground that rises fifteen per cent to the north and ten to the west; nothing is known beyond 150 m east."""

    def alt_amsl_m(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.where(east_m > 150.0, np.nan, 420.0 + 0.15 * north_m - 0.1 * east_m)


class Level:
    def alt_amsl_m(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.full(np.shape(north_m), 420.0)


@dataclass(frozen=True, eq=False)
class Registered:
    centre_ned_m: np.ndarray
    pos_ned_m: np.ndarray
    ned_from_camera: np.ndarray
    correction: np.ndarray = field(default_factory=lambda: np.zeros(6))
    cov: np.ndarray = field(default_factory=lambda: COV)


def _ground(north_m: float, east_m: float) -> np.ndarray:
    return np.array([north_m, east_m, -0.15 * north_m + 0.1 * east_m])


def _rodrigues(rotvec: np.ndarray) -> np.ndarray:
    return np.asarray(cv2.Rodrigues(np.asarray(rotvec, dtype=np.float64))[0])


# looking north and down by 60 degrees: camera x east, y down the picture, z ahead
LOOKING_NORTH = np.array([[0.0, -np.sin(np.pi / 3), 0.5], [1.0, 0.0, 0.0], [0.0, 0.5, np.sin(np.pi / 3)]])
PREDICTED = _rodrigues(np.array([0.03, -0.05, 0.7])) @ LOOKING_NORTH
PREDICTED_POS = np.array([-30.0, -55.0, -118.0])


def _aim(pos: np.ndarray, rotation: np.ndarray) -> np.ndarray:
    """Where the optical axis meets the sloped plane d = -0.15 n + 0.1 e, by its equation."""
    normal = np.array([0.15, -0.1, 1.0])
    axis = rotation[:, 2]
    return pos - axis * (normal @ pos) / (normal @ axis)


def _opencv_pixel(point: np.ndarray, pos: np.ndarray, rotation: np.ndarray) -> tuple[float, float]:
    """OpenCV's pixel of an NED point for a camera."""
    camera_from_ned = rotation.T
    uv = cv2.projectPoints(
        point.reshape(1, 1, 3), cv2.Rodrigues(camera_from_ned)[0], -camera_from_ned @ pos, CAMERA.matrix,
        np.array(CAMERA.distortion),
    )[0]  # fmt: skip
    return float(uv[0, 0, 0]), float(uv[0, 0, 1])


def _true_camera() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """The camera as CORRECTION has it, written out anew: the matched middle, then the camera hung over it."""
    centre = _aim(PREDICTED_POS, PREDICTED)
    moved = _ground(centre[0] + CORRECTION[0], centre[1] + CORRECTION[1])
    turn = _rodrigues(CORRECTION[3:])
    towards = turn @ (centre - PREDICTED_POS)
    height = (centre - PREDICTED_POS)[2] * (1.0 + CORRECTION[2])
    return centre, moved - towards * height / towards[2], turn @ PREDICTED


def _located(
    uv: tuple[float, float], registration: Registered, errors: TargetErrors = ERRORS, height_m: float = 0.0
) -> RegisteredTarget:
    return locate_registered(registration, CAMERA, uv, Slope(), FRAME, errors, height_m)


@pytest.mark.parametrize("height_m", [0.0, 12.0])
@pytest.mark.parametrize("aside_ne_m", [(0.0, 0.0), (25.0, -18.0), (-15.0, 22.0)])
def test_the_match_carries_a_pixel_to_where_opencv_projected_it_from(
    aside_ne_m: tuple[float, float], height_m: float
) -> None:
    centre, true_pos, true_rotation = _true_camera()
    point = _ground(centre[0] + aside_ne_m[0], centre[1] + aside_ne_m[1]) - np.array([0.0, 0.0, height_m])
    uv = _opencv_pixel(point, true_pos, true_rotation)

    found = _located(uv, Registered(centre, PREDICTED_POS, PREDICTED, CORRECTION), height_m=height_m)

    # the ray is bisected to a tenth of a millimetre, the lens inverted to 1e-9
    assert_allclose(found.pos_ned_m, point, atol=2e-3)
    assert_allclose(FRAME.ned_from_geodetic(found.lat_rad, found.lon_rad, found.alt_amsl_m), point, atol=2e-3)


def test_a_wrong_position_of_the_pose_takes_no_part() -> None:
    """Over level ground the pose may be metres off: the middle that was matched is what counts."""

    wrong_m = np.array([8.0, -6.0, 0.0])
    centre = PREDICTED_POS - PREDICTED[:, 2] * PREDICTED_POS[2] / PREDICTED[2, 2]
    right = Registered(centre, PREDICTED_POS, PREDICTED)
    off = Registered(
        centre + wrong_m, PREDICTED_POS + wrong_m, PREDICTED, np.array([-wrong_m[0], -wrong_m[1], 0.0, 0.0, 0.0, 0.0])
    )

    places = [locate_registered(r, CAMERA, (150.0, 400.0), Level(), FRAME, ERRORS) for r in (right, off)]

    assert_allclose(places[0].pos_ned_m, places[1].pos_ned_m, atol=1e-3)


def test_a_target_above_ground_is_nearer_by_its_height_times_the_slant() -> None:
    registration = Registered(np.array([0.0, 0.0, 0.0]), np.array([-60.0, 0.0, -120.0]), LOOKING_NORTH)
    level = replace(registration, cov=np.eye(6) * 1e-12)

    def at(height_m: float, std_m: float = 0.0) -> RegisteredTarget:
        errors = TargetErrors(1e-6, 0.0, target_height_std_m=std_m)
        return locate_registered(level, CAMERA, (315.0, 243.0), Level(), FRAME, errors, height_m)

    low, high, unsure = at(0.0), at(20.0), at(20.0, 5.0)

    slant = np.tan(low.off_nadir_rad)
    assert slant == pytest.approx(np.tan(np.pi / 6), rel=1e-6)  # 60 degrees below the horizon
    assert low.pos_ned_m[0] - high.pos_ned_m[0] == pytest.approx(20.0 * slant, abs=1e-3)
    assert high.alt_amsl_m == pytest.approx(440.0, abs=0.01)
    # along the ray alone: five metres of height, and their slant to the north
    assert np.sqrt(unsure.cov_ned_m2[2, 2]) == pytest.approx(5.0, rel=1e-3)
    assert np.sqrt(unsure.cov_ned_m2[0, 0]) == pytest.approx(5.0 * slant, rel=1e-3)
    assert unsure.cov_ned_m2[1, 1] < 1e-4
    assert high.cov_ned_m2[0, 0] < 1e-4


@pytest.mark.parametrize("uv", [(315.0, 243.0), (90.0, 60.0), (600.0, 430.0)])
def test_covariance_agrees_with_drawn_errors(uv: tuple[float, float]) -> None:
    """Match, click, and heights drawn from their stated errors, and the place found anew by OpenCV's lens."""
    rng = np.random.default_rng(11)
    centre = _aim(PREDICTED_POS, PREDICTED)
    mixed = _rodrigues(np.array([0.3, 0.2, -0.4]))
    cov = COV.copy()
    cov[:3, :3] = np.diag([1.0, 1.0, 0.01]) @ mixed @ np.diag([1.5, 0.5, 1.0]) @ mixed.T @ np.diag([1.0, 1.0, 0.01])
    errors = TargetErrors(pixel_std_px=3.0, ground_std_m=1.5, target_height_std_m=1.0)
    found = _located(uv, Registered(centre, PREDICTED_POS, PREDICTED, cov=cov), errors, 6.0)

    normal = np.array([0.15, -0.1, 1.0])
    ends = []
    for _ in range(3000):
        d = rng.multivariate_normal(np.zeros(6), cov)
        pixel = np.asarray(uv) + rng.normal(0.0, 3.0, 2)
        raised = 6.0 + rng.normal(0.0, 1.5) + rng.normal(0.0, 1.0)
        turn = _rodrigues(d[3:])
        towards = turn @ (centre - PREDICTED_POS)
        pos = _ground(centre[0] + d[0], centre[1] + d[1])
        pos = pos - towards * (centre - PREDICTED_POS)[2] * (1.0 + d[2]) / towards[2]
        xy = cv2.undistortPointsIter(
            pixel.reshape(1, 1, 2), CAMERA.matrix, np.array(CAMERA.distortion), np.eye(3), np.eye(3), (3, 100, 1e-12)
        ).ravel()
        ray = turn @ PREDICTED @ np.array([*xy, 1.0])
        ends.append(pos - ray * (normal @ pos + raised) / (normal @ ray))

    spread = np.cov(np.array(ends).T)
    # standard deviations of 3000 draws are good to 1.3 %; three times that, and some for what is not linear
    assert_allclose(np.sqrt(np.diag(spread)), np.sqrt(np.diag(found.cov_on_map_ned_m2)), rtol=0.06)
    scale = np.sqrt(np.diag(found.cov_on_map_ned_m2))
    assert_allclose(np.corrcoef(np.array(ends).T), found.cov_on_map_ned_m2 / np.outer(scale, scale), atol=0.06)


def test_away_from_the_middle_a_turn_counts_by_the_way() -> None:
    nadir = np.array([[0.0, -1.0, 0.0], [1.0, 0.0, 0.0], [0.0, 0.0, 1.0]])

    registration = Registered(
        np.zeros(3), np.array([0.0, 0.0, -100.0]), nadir, cov=np.diag([1.0, 1.0, 1e-12, 1e-12, 1e-12, 0.02**2])
    )
    camera = Camera(640, 480, 500.0, 500.0, 319.5, 239.5)
    # 50 m east of the middle: a turn moves it north and south
    found = locate_registered(registration, camera, (569.5, 239.5), Level(), FRAME, TargetErrors(1e-6, 0.0))

    assert found.lever_m == pytest.approx(50.0, abs=1e-3)
    assert found.cov_ned_m2[0, 0] == pytest.approx(1.0 + (50.0 * 0.02) ** 2, rel=1e-3)
    assert found.cov_ned_m2[1, 1] == pytest.approx(1.0, rel=1e-3)
    assert found.budget.heading_m == pytest.approx(1.0, rel=1e-3)
    assert found.budget.centre_m == pytest.approx(1.0, rel=1e-3)


def test_the_maps_own_displacement_is_kept_apart() -> None:
    centre = _aim(PREDICTED_POS, PREDICTED)
    registration = Registered(centre, PREDICTED_POS, PREDICTED)

    alone = _located((200.0, 300.0), registration)
    both = _located((200.0, 300.0), registration, TargetErrors(1.0, 0.0, map_offset_std_m=4.0, ground_bias_std_m=3.0))

    assert_allclose(both.cov_on_map_ned_m2[:2, :2], alone.cov_on_map_ned_m2[:2, :2])
    assert_allclose(both.cov_ned_m2 - alone.cov_ned_m2, np.diag([16.0, 16.0, 9.0]), atol=1e-9)


@pytest.mark.parametrize(("uv", "reason"), [
    ((640.0, 10.0), "outside the 640 x 480"), ((float("nan"), 10.0), "outside"), ((-3.0, 10.0), "outside"),
])  # fmt: skip
def test_a_pixel_outside_the_picture_is_refused(uv: tuple[float, float], reason: str) -> None:
    with pytest.raises(GeometryError, match=reason):
        _located(uv, Registered(_aim(PREDICTED_POS, PREDICTED), PREDICTED_POS, PREDICTED))


def test_sky_and_unknown_ground_are_refused() -> None:
    ahead = np.array([[0.0, -0.2588, 0.9659], [1.0, 0.0, 0.0], [0.0, 0.9659, 0.2588]])  # 15 degrees down
    east = _rodrigues(np.array([0.0, 0.0, np.pi / 2])) @ ahead
    pos = np.array([0.0, -100.0, -80.0])
    registration = Registered(np.array([-5.0, 140.0, 14.75]), pos, east, cov=COV * 1e-4)

    with pytest.raises(GeometryError, match="at or above the horizon"):
        _located((315.0, 20.0), registration)
    with pytest.raises(GeometryError, match="beyond the known terrain"):
        _located((315.0, 200.0), registration)
    # nearer than the end of the terrain there is an answer
    assert _located((315.0, 420.0), registration).pos_ned_m[1] < 150.0


def test_ground_met_too_flatly_for_its_errors_is_refused() -> None:
    """Four degrees below the horizon, with six degrees of tilt at one sigma."""
    ahead = np.array([[0.0, -0.2588, 0.9659], [1.0, 0.0, 0.0], [0.0, 0.9659, 0.2588]])
    pos = np.array([0.0, 0.0, -80.0])
    sure, unsure = (
        Registered(np.array([298.6, 0.0, 0.0]), pos, ahead, cov=np.diag([1.0, 1.0, 1e-6, 1e-8, tilt**2, 1e-6]))
        for tilt in (0.002, 0.1)
    )
    v = 243.0 - 522.0 * np.tan(np.deg2rad(11.0)) * 0.97

    assert locate_registered(sure, CAMERA, (315.0, v), Level(), FRAME, ERRORS).pos_ned_m[0] > 600.0
    with pytest.raises(GeometryError, match="too flatly"):
        locate_registered(unsure, CAMERA, (315.0, v), Level(), FRAME, ERRORS)


def test_a_ray_close_over_an_edge_is_told_apart_from_one_over_open_ground() -> None:
    """A roof ends 3 m below the ray, the ground behind is 15 m lower: an elevation two metres off hides that."""

    class Roof:
        def alt_amsl_m(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
            return np.where((north_m > -20.0) & (north_m < 0.0), 435.0, 420.0) + 0.0 * east_m

    # looking north and 45 degrees down from 60 m above the roof: the axis passes its far edge at 3 m
    half = np.sqrt(0.5)
    rotation = np.array([[0.0, -half, half], [1.0, 0.0, 0.0], [0.0, half, half]])
    pos = np.array([-57.0, 0.0, -75.0])
    registration = Registered(np.array([18.0, 0.0, 0.0]), pos, rotation, cov=np.eye(6) * 1e-8)
    errors = TargetErrors(0.01, 2.0)

    close = locate_registered(registration, CAMERA, (315.0, 243.0), Roof(), FRAME, errors)
    open_ground = locate_registered(registration, CAMERA, (315.0, 243.0), Level(), FRAME, errors)

    assert_allclose(close.pos_ned_m, [18.0, 0.0, 0.0], atol=0.01)
    # two metres of height on 45 degrees; the roof is met 18 m nearer once it is two deviations higher
    assert np.sqrt(open_ground.cov_ned_m2[0, 0]) == pytest.approx(2.0, rel=0.01)
    assert np.sqrt(close.cov_ned_m2[0, 0]) > 6.0


def test_errors_must_be_possible() -> None:
    with pytest.raises(ValueError, match="ground_std_m must be finite"):
        TargetErrors(ground_std_m=-1.0)
