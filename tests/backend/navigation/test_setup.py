"""Camera files, and what an estimator is built from."""

import json
import math
from pathlib import Path

import numpy as np
import pytest
import rasterio
from numpy.testing import assert_allclose

from backend.errors import StartError
from backend.navigation.setup import MapFiles, Place, build_setup, read_camera_profile

CAMERA = {"width_px": 640, "height_px": 480, "fx_px": 500.0, "distortion": [-0.1], "mount": {"pitch_deg": -45}}
HERE = Place(math.radians(47.0), math.radians(8.0), 400.0)
NO_MAP = MapFiles(None, None, None, None)


@pytest.mark.parametrize(
    "content",
    [CAMERA, {"camera": CAMERA}, {"schema": "pilotage.flight/1", "camera": CAMERA, "vehicle": {"system_id": 3}}],
)
def test_a_camera_file_may_be_the_section_or_a_whole_flight(tmp_path: Path, content: dict[str, object]) -> None:
    path = tmp_path / "cam.json"
    path.write_text(json.dumps(content))
    profile = read_camera_profile(path)
    setup = build_setup(profile, NO_MAP, HERE)

    assert (setup.camera.fx_px, setup.camera.fy_px, setup.camera.cx_px) == (500.0, 500.0, 319.5)
    assert setup.has_camera
    # pitched down by 45 degrees: the optical axis points forward and down in equal parts
    assert_allclose(setup.mount.body_from_camera @ [0, 0, 1], np.array([1, 0, 1]) / math.sqrt(2), atol=1e-12)


@pytest.mark.parametrize(
    ("text", "words"),
    [("", "not JSON"), ("[1]", "no JSON object"), ("{}", "camera"), ('{"camera": {"width_px": 640}}', "height_px")],
)
def test_what_is_no_camera_file_is_told(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "cam.json"
    path.write_text(text)

    with pytest.raises(StartError, match=words) as refused:
        read_camera_profile(path)
    assert str(path) in str(refused.value)


def test_without_a_camera_file_pictures_are_not_used() -> None:
    setup = build_setup(None, NO_MAP, HERE, (1280, 720))

    assert not setup.has_camera
    assert (setup.camera.width_px, setup.camera.height_px) == (1280, 720)


def test_flat_ground_lies_where_the_file_says_else_at_home(tmp_path: Path) -> None:
    path = tmp_path / "cam.json"
    path.write_text(json.dumps({"camera": CAMERA, "map": {"ground_alt_amsl_m": 123.0}}))
    zero = np.zeros(1)

    assert build_setup(read_camera_profile(path), NO_MAP, HERE).ground.alt_amsl_m(zero, zero)[0] == 123.0
    assert build_setup(None, NO_MAP, HERE).ground.alt_amsl_m(zero, zero)[0] == 400.0


def test_the_frame_lies_in_the_middle_of_a_map_unless_that_is_far_away() -> None:
    near = build_setup(None, MapFiles(None, None, None, (47.0, 8.0, 47.02, 8.02)), HERE)
    large = build_setup(None, MapFiles(None, None, None, (40.0, 0.0, 50.0, 20.0)), HERE)

    assert_allclose(np.degrees([near.frame.lat_rad, near.frame.lon_rad]), [47.01, 8.01])
    assert_allclose([large.frame.lat_rad, large.frame.lon_rad], [HERE.lat_rad, HERE.lon_rad])


@pytest.mark.parametrize(
    ("offset_s", "has_camera", "searches"),
    [(None, True, True), (0.0, True, False), (0.3, True, False), (None, False, False)],
)
def test_the_videos_clock_is_searched_where_nobody_said_its_offset(
    tmp_path: Path, offset_s: float | None, has_camera: bool, searches: bool
) -> None:
    path = tmp_path / "cam.json"
    path.write_text(json.dumps(CAMERA))
    profile = read_camera_profile(path) if has_camera else None
    setup = build_setup(profile, NO_MAP, HERE, time_offset_s=offset_s)

    assert (setup.navigator().video_clock is not None) is searches


def _coarse_elevation(path: Path, posting_m: float) -> Path:
    heights = np.full((40, 40), 400.0, dtype=np.float32)
    degrees = posting_m / 111_320.0
    transform = rasterio.transform.from_origin(8.0 - 20 * degrees, 47.0 + 20 * degrees, degrees, degrees)
    profile = {"driver": "GTiff", "width": 40, "height": 40, "count": 1, "dtype": "float32", "crs": "EPSG:4326"}
    with rasterio.open(path, "w", transform=transform, **profile) as target:
        target.write(heights, 1)
    return path


def test_the_filter_learns_as_much_of_the_ground_as_its_model_leaves_open(tmp_path: Path) -> None:
    """Ground taken for flat may roll by tens of metres; an elevation model of 30 m posting errs by metres."""
    fine = MapFiles(None, None, _coarse_elevation(tmp_path / "fine.tif", 2.0), None)
    coarse = MapFiles(None, None, _coarse_elevation(tmp_path / "coarse.tif", 30.0), None)
    flat, by_fine, by_coarse = (
        build_setup(None, maps, HERE).navigator().config.noise for maps in (NO_MAP, fine, coarse)
    )

    assert flat.ground_bias_std_m[1] >= 10.0
    assert flat.ground_bias_length_m[1] <= 500.0
    assert by_fine.ground_bias_std_m[1] < 1.0
    assert 2.0 < by_coarse.ground_bias_std_m[1] < 4.0
    assert by_fine.ground_bias_length_m[1] > 1000.0
    # what stands on the ground is as high everywhere
    assert flat.ground_bias_std_m[0] == by_fine.ground_bias_std_m[0]
