"""What is made bad is bad in the way that it says, in its time and nowhere else."""

from __future__ import annotations

import math
from dataclasses import replace

import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from backend.navigation.setup import NavigationSetup
from benchmarks.studies.degraded import (
    SHIFT_M,
    TURN_DEG,
    WATER_SHARE,
    Degradation,
    Degrader,
    MapFault,
    PictureFault,
    coarser,
    degraded_map,
    degraded_picture,
    turned_mount,
)
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.local import LocalFrame
from estimator.integrity.picture import shows_ground, texture
from estimator.types import AttitudeSample, BarometerSample, FrameSample
from geodata.elevation import FlatGround
from geodata.imagery import ImageryGrid
from tests.estimator.registration.textured_map import MAP

DENIED_US = 1_700_000_000_000_000
PICTURE = np.ascontiguousarray(np.resize(MAP.image, (240, 320)).astype(np.uint8))
STRETCH = (15.0, 45.0)


def grid() -> ImageryGrid:
    image = np.ascontiguousarray(MAP.image.astype(np.uint8))
    return ImageryGrid(image, np.ones(image.shape, dtype=np.bool_), 200.0, -200.0, 1.0)


def setup() -> NavigationSetup:
    return NavigationSetup(
        Camera.from_hfov(320, 240, math.radians(60.0)), Mount(), "fixed", True, LocalFrame(0.8, 0.1, 200.0), grid(),
        FlatGround(200.0), 2.0, None,
    )  # fmt: skip


def frame(t_s: float, image: np.ndarray = PICTURE) -> FrameSample:
    return FrameSample(DENIED_US + round(1e6 * t_s), 1, image)


def pictured(degrader: Degrader, t_s: float, image: np.ndarray = PICTURE) -> np.ndarray:
    sample = degrader.sample(frame(t_s, image))
    assert isinstance(sample, FrameSample)
    return sample.image


def test_nothing_is_changed_where_nothing_is_wrong() -> None:
    degrader = Degrader(Degradation(), DENIED_US, 1)
    whole = setup()
    changed = degrader.setup(whole)

    assert changed.camera == whole.camera
    assert changed.reference is whole.reference
    assert changed.mount is whole.mount
    assert pictured(degrader, 20.0) is PICTURE
    barometer = BarometerSample(DENIED_US, 300.0)
    assert degrader.sample(barometer) is barometer


@pytest.mark.parametrize("fault", list(PictureFault))
def test_pictures_are_bad_in_their_stretch_alone(fault: PictureFault) -> None:
    degrader = Degrader(Degradation(STRETCH, picture=fault), DENIED_US, 1)

    assert pictured(degrader, 14.9) is PICTURE
    other = 255 - PICTURE
    pictured(degrader, 20.0)
    assert (pictured(degrader, 30.0, other) != other).any()
    assert pictured(degrader, 45.1) is PICTURE


@pytest.mark.parametrize("fault", [PictureFault.FOG, PictureFault.NIGHT, PictureFault.GLARE])
def test_fog_night_and_glare_come_gradually_and_leave_nothing_to_see(fault: PictureFault) -> None:
    rng = np.random.default_rng(1)
    slight, full = (degraded_picture(PICTURE, fault, depth, rng) for depth in (0.1, 1.0))

    assert shows_ground(PICTURE)
    assert shows_ground(slight) or fault is PictureFault.GLARE
    assert not shows_ground(full)
    if fault is not PictureFault.GLARE:
        assert texture(full) < 0.2 * texture(PICTURE)
    assert full.dtype == np.uint8
    assert degraded_picture(np.dstack([PICTURE] * 3), fault, 1.0, rng).shape == (240, 320, 3)


def test_a_frozen_video_is_told_by_the_station_s_own_watch() -> None:
    degrader = Degrader(Degradation(STRETCH, picture=PictureFault.FROZEN), DENIED_US, 1)
    rng = np.random.default_rng(2)
    for k in range(480):
        noise = rng.integers(-4, 5, PICTURE.shape)
        pictured(degrader, k / 8.0, np.clip(PICTURE + noise, 0, 255).astype(np.uint8))
    at = degrader.frozen_at(DENIED_US + 1e6 * np.array([-5.0, 10.0, 20.0, 40.0, 50.0]))

    assert at.tolist() == [False, False, True, True, False]


def test_the_barometer_drifts_over_its_stretch_and_stays() -> None:
    degrader = Degrader(Degradation((0.0, 60.0), barometer_drift_m=20.0), DENIED_US, 1)
    read = [
        degrader.sample(BarometerSample(DENIED_US + round(1e6 * t_s), 300.0)) for t_s in (-10.0, 0.0, 30.0, 60.0, 90.0)
    ]

    assert [r.pressure_alt_m for r in read if isinstance(r, BarometerSample)] == [300.0, 300.0, 310.0, 320.0, 320.0]


def test_attitude_is_thinned_and_frames_come_late() -> None:
    degrader = Degrader(Degradation(attitude_hz=10.0, frames_late_s=0.5), DENIED_US, 1)
    level = np.array([1.0, 0.0, 0.0, 0.0])
    kept = [degrader.sample(AttitudeSample(DENIED_US + 20_000 * k, level, np.zeros(3))) is not None for k in range(50)]
    late = degrader.sample(frame(3.0))

    assert sum(kept) == 10
    assert late is not None
    assert late.t_us == DENIED_US + 3_500_000


def test_the_mount_is_turned_about_the_body_s_axes_by_so_much() -> None:
    nadir = Mount(lever_arm_frd_m=np.zeros(3))
    turned = turned_mount(nadir, (1.5, -0.5, 2.0))
    rotation = turned.body_from_gimbal @ nadir.body_from_gimbal.T

    assert_allclose(np.degrees(cv2.Rodrigues(rotation)[0].ravel()), (1.5, -0.5, 2.0), atol=1e-6)


def test_a_shifted_map_has_everything_twenty_metres_off() -> None:
    moved = degraded_map(grid(), MapFault.SHIFTED, np.random.default_rng(1))

    assert math.hypot(moved.north_max_m - 200.0, moved.east_min_m + 200.0) == pytest.approx(SHIFT_M)
    assert moved.image is grid().image or (moved.image == grid().image).all()


def test_a_turned_map_lies_right_in_its_middle_and_wrong_at_its_edge() -> None:
    whole = grid()
    turned = degraded_map(whole, MapFault.TURNED, np.random.default_rng(1))
    # 150 m north of the middle a turn to the left puts the west
    off = 150.0 * math.sin(math.radians(TURN_DEG))
    middle, above = 200, 50
    patch = whole.image[above - 8 : above + 9, middle - 8 : middle + 9]
    found = cv2.minMaxLoc(cv2.matchTemplate(turned.image[:110], patch, cv2.TM_CCOEFF_NORMED))[3]

    assert found[0] + 8 == pytest.approx(middle - off, abs=2.0)
    assert abs(int(turned.image[middle, middle]) - int(whole.image[middle, middle])) < 40


@pytest.mark.parametrize(("fault", "share"), [(MapFault.CHANGED, 0.4), (MapFault.WATER, WATER_SHARE)])
def test_so_much_of_the_map_is_something_else(fault: MapFault, share: float) -> None:
    changed = degraded_map(grid(), fault, np.random.default_rng(4))

    assert (changed.image != grid().image).mean() == pytest.approx(share, abs=0.06)
    assert changed.image.shape == grid().image.shape


def test_elsewhere_has_the_same_land_and_none_of_it_here() -> None:
    whole = grid()
    other = degraded_map(whole, MapFault.ELSEWHERE, np.random.default_rng(1))
    here, there = (image[100:300, 100:300].astype(float).ravel() for image in (whole.image, other.image))

    assert other.image.std() == pytest.approx(whole.image.std(), rel=0.02)
    assert abs(np.corrcoef(here, there)[0, 1]) < 0.25


def test_a_coarser_map_shows_the_same_ground_in_the_same_place() -> None:
    whole = grid()
    coarse = coarser(whole, 2.0)
    window = coarse.window(-50.0, -50.0, 50.0, 50.0)
    row, col = 20, 30
    north, east = window.north_max_m - 2.0 * row, window.east_min_m + 2.0 * col
    fine = whole.image[
        round(200.0 - north - 0.5) : round(200.0 - north + 1.5), round(east + 199.5) : round(east + 201.5)
    ]

    assert coarse.gsd_m == 2.0
    assert coarse.valid.all()
    assert abs(float(window.image[row, col]) - float(fine.mean())) <= 1.0


def test_the_same_seed_draws_the_same_fault() -> None:
    first, again, other = (degraded_map(grid(), MapFault.CHANGED, np.random.default_rng(s)).image for s in (1, 1, 2))

    assert (first == again).all()
    assert (first != other).any()
    assert replace(Degradation(), map=MapFault.WATER) != Degradation()
