"""The published contour registration, against views of a painted land turned by known angles."""

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
import rasterio
from numpy.testing import assert_allclose

from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_euler
from estimator.registration.alignment import CameraPose, NoMatch
from estimator.registration.contour import (
    CONTOURS,
    Alignment,
    AlignmentConfig,
    ContourConfig,
    align,
    place_by_contours,
    turned,
)
from estimator.registration.placement import Placement
from estimator.targets.registered import TargetErrors, locate_registered
from tests.estimator.registration.textured_map import (
    CAMERA,
    NADIR_TOP_NORTH,
    ORIGIN_ALT_M,
    FlatGround,
    PaintedMap,
    seen_by,
)
from tests.shared_data import shared_data

POS = np.array([12.0, -18.0, -95.0])
FRAME = LocalFrame(0.8, 0.15, ORIGIN_ALT_M)
POSE_COV = np.diag([16.0, 16.0, 4.0, 0.02**2, 0.02**2, math.radians(26.0) ** 2])


def village(seed: int = 4) -> PaintedMap:
    """Roads of three bearings with houses along them: straight things, and no two corners alike."""
    rng = np.random.default_rng(seed)
    fine = np.full((1601, 1601), 95, dtype=np.uint8)
    for bearing_deg, count in ((20.0, 4), (104.0, 3), (63.0, 1)):
        bearing = math.radians(bearing_deg)
        along = 1400.0 * np.array([math.sin(bearing), -math.cos(bearing)])
        for _ in range(count):
            middle = rng.uniform(400.0, 1200.0, size=2)
            ends = (middle - along).astype(int), (middle + along).astype(int)
            cv2.line(fine, tuple(map(int, ends[0])), tuple(map(int, ends[1])), int(rng.integers(150, 220)), 26)
            for step in rng.uniform(-0.5, 0.5, size=14):
                aside = rng.choice([-1.0, 1.0]) * np.array([math.cos(bearing), math.sin(bearing)]) * rng.uniform(40, 80)
                size = tuple(rng.uniform(30.0, 70.0, size=2))
                box = cv2.boxPoints((tuple(middle + step * along + aside), size, bearing_deg))
                cv2.fillConvexPoly(fine, box.astype(np.int32), int(rng.choice([35, 160, 230])))
    return PaintedMap(fine)


SCENE = village()


def _rotation(heading_deg: float) -> np.ndarray:
    return np.asarray(matrix_from_euler(0.0, 0.0, math.radians(heading_deg)) @ NADIR_TOP_NORTH)


def _other_sensor(picture: np.ndarray, seed: int = 2) -> np.ndarray:
    """Tones upside down and bent, grain on top: contours stay, tones do not."""
    bent = 255.0 * (1.0 - picture / 255.0) ** 0.6
    grain = np.random.default_rng(seed).normal(0.0, 6.0, picture.shape)
    return np.clip(bent + grain, 0, 255).astype(np.uint8)


def _told(error_deg: float, heading_deg: float, away_m: tuple[float, float, float] = (3.0, -4.0, 0.0)) -> CameraPose:
    return CameraPose(POS - np.array(away_m), _rotation(heading_deg - error_deg))


def _placed(picture: np.ndarray, pose: CameraPose, by: Alignment) -> Placement | NoMatch:
    config = ContourConfig(alignment=AlignmentConfig(by=by))
    return place_by_contours(
        picture, CAMERA, SCENE, FlatGround(), ORIGIN_ALT_M, pose, POSE_COV, POSE_COV, config
    )  # fmt: skip


def _opencv_pixel(point: np.ndarray, rotation: np.ndarray) -> tuple[float, float]:
    uv = cv2.projectPoints(
        point.reshape(1, 1, 3), cv2.Rodrigues(rotation.T)[0], -rotation.T @ POS, CAMERA.matrix,
        np.array(CAMERA.distortion),
    )[0]  # fmt: skip
    return float(uv[0, 0, 0]), float(uv[0, 0, 1])


@pytest.mark.parametrize("by", [Alignment.LINES, Alignment.HYPOTHESES, Alignment.SWEEP])
@pytest.mark.parametrize("error_deg", [-38.0, -12.0, 0.0, 21.0, 40.0])
def test_a_heading_far_off_is_turned_back(by: Alignment, error_deg: float) -> None:
    """A picture whose telemetry is told to point ``error_deg`` too little: the correction is that angle."""
    heading_deg = 37.0
    picture = seen_by(POS, _rotation(heading_deg), SCENE)
    config, placement = AlignmentConfig(by=by), ContourConfig().placement

    found = align(
        picture, CAMERA, SCENE, FlatGround(), ORIGIN_ALT_M, _told(error_deg, heading_deg), POSE_COV, config, placement
    )

    assert isinstance(found, float)
    assert math.degrees(found) == pytest.approx(error_deg, abs=2.5)


@pytest.mark.parametrize("error_deg", [-31.0, 27.0])
@pytest.mark.parametrize("height_m", [0.0, 2.5])
def test_pixels_come_to_their_place_though_heading_and_tones_are_others(error_deg: float, height_m: float) -> None:
    heading_deg = 200.0
    rotation = _rotation(heading_deg)
    picture = _other_sensor(seen_by(POS, rotation, SCENE))
    told = _told(error_deg, heading_deg, (3.0, -4.0, height_m))

    placed = _placed(picture, told, Alignment.HYPOTHESES)

    assert isinstance(placed, Placement)
    assert placed.by == CONTOURS
    for aside in ((0.0, 0.0), (28.0, 15.0), (-20.0, 25.0)):
        point = np.array([POS[0] + aside[0], POS[1] + aside[1], 0.0])
        found = locate_registered(
            placed, CAMERA, _opencv_pixel(point, rotation), FlatGround(), FRAME, TargetErrors(0.5, 0.0)
        )
        d = (found.pos_ned_m - point)[:2]
        # a map pixel is a metre; of the way from the middle the steps of heading and height leave some per cent
        assert np.hypot(*d) < 2.5
        assert d @ np.linalg.solve(found.cov_on_map_ned_m2[:2, :2], d) < 9.2  # 99 %


def test_a_real_town_turned_and_scaled_is_laid_back_on_itself() -> None:
    """A satellite map's middle as land of a quarter metre a pixel, seen from two metres too high and turned.

    Roofs by the hundred draw lines everywhere: their angles mislead, the more so alone, and a sweep is not misled.
    """
    with rasterio.open(shared_data("flights/ariel_b/reference.tif")) as file:
        middle = rasterio.windows.Window((file.width - 1601) // 2, (file.height - 1601) // 2, 1601, 1601)
        town = PaintedMap(cv2.cvtColor(np.moveaxis(file.read(window=middle), 0, -1), cv2.COLOR_RGB2GRAY))
    rotation = _rotation(120.0)
    picture = _other_sensor(seen_by(POS, rotation, town))
    point = np.array([POS[0] + 20.0, POS[1] - 18.0, 0.0])
    uv_px = _opencv_pixel(point, rotation)

    def right(by: Alignment) -> int:
        """How many of five turns are put right, the best place being taken whatever it is like, as published."""
        config = ContourConfig(alignment=AlignmentConfig(by=by))
        config = replace(config, placement=replace(config.placement, max_outlier_probability=1.0))
        count = 0
        for error_deg in (-33.0, -14.0, 7.0, 18.0, 41.0):
            told = _told(error_deg, 120.0, (3.0, -4.0, 2.0))
            placed = place_by_contours(
                picture, CAMERA, town, FlatGround(), ORIGIN_ALT_M, told, POSE_COV, POSE_COV, config
            )
            if isinstance(placed, Placement):
                found = locate_registered(placed, CAMERA, uv_px, FlatGround(), FRAME, TargetErrors(0.5, 0.0))
                count += bool(np.hypot(*(found.pos_ned_m - point)[:2]) < 2.0)
        return count

    assert right(Alignment.TELEMETRY) == 0
    assert right(Alignment.HYPOTHESES) >= 2
    assert right(Alignment.SWEEP) == 5


def test_without_alignment_the_same_picture_is_not_placed_right() -> None:
    """What the alignment is for: the telemetry's heading alone leads elsewhere, or nowhere."""
    picture = seen_by(POS, _rotation(200.0), SCENE)

    placed = _placed(picture, _told(27.0, 200.0), Alignment.TELEMETRY)

    if isinstance(placed, Placement):
        off = math.radians(27.0) - placed.correction[5]
        assert abs(off) > math.radians(15.0)


def test_lines_beyond_what_is_known_of_the_heading_are_left_out() -> None:
    """Streets cross: a quarter turn fits as well, but a heading known to a degree is not turned by one."""
    picture = seen_by(POS, _rotation(37.0), SCENE)
    sure = POSE_COV.copy()
    sure[5, 5] = math.radians(1.0) ** 2
    config, placement = AlignmentConfig(by=Alignment.LINES), ContourConfig().placement

    found = align(
        picture, CAMERA, SCENE, FlatGround(), ORIGIN_ALT_M, _told(30.0, 37.0), sure, config, placement
    )  # fmt: skip

    assert isinstance(found, float)
    assert abs(math.degrees(found)) <= 3.5


def test_a_turned_pose_stays_where_it_is_and_looks_the_other_way() -> None:
    pose = CameraPose(POS, _rotation(10.0))

    there = turned(pose, math.radians(25.0))

    assert_allclose(there.pos_ned_m, POS)
    assert_allclose(there.ned_from_camera, cv2.Rodrigues(np.array([0.0, 0.0, math.radians(25.0)]))[0] @ _rotation(10.0))


def test_a_picture_of_another_village_is_refused() -> None:
    picture = seen_by(POS, _rotation(37.0), village(91))
    told = _told(10.0, 37.0)

    judged = _placed(picture, told, Alignment.HYPOTHESES)

    assert isinstance(judged, NoMatch)


@pytest.mark.parametrize("by", list(Alignment))
def test_off_the_map_there_is_no_placement(by: Alignment) -> None:
    away = CameraPose(POS + np.array([3000.0, 0.0, 0.0]), _rotation(0.0))

    assert isinstance(_placed(seen_by(POS, _rotation(0.0), SCENE), away, by), NoMatch)


@pytest.mark.parametrize("median_px", [1, 4, -3])
def test_a_median_of_no_middle_is_refused(median_px: int) -> None:
    with pytest.raises(ValueError, match="median_px"):
        ContourConfig(median_px=median_px)
