"""``pilotage target`` on real photos: coordinates against the truth, what they come with, and what is refused."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from backend.photos.cli import register
from estimator.geometry.local import LocalFrame
from tests.shared_data import shared_data

# what the structure from motion says the centre of IMG_0533.jpg shows (truth.csv of the set)
TRUE_CENTRE = (41.03576206, -83.30471218, 220.413)
CENTRE = "899.5,674.5"


def _run(*arguments: object) -> Result:
    app = typer.Typer()
    register(app)
    return CliRunner().invoke(app, ["target", *(str(a) for a in arguments)], env={"COLUMNS": "200"})


def _camera(folder: Path) -> Path:
    path = folder / "camera.json"
    path.write_text(json.dumps({
        "width_px": 1800, "height_px": 1350, "fx_px": 1273.454, "cx_px": 899.5, "cy_px": 674.5,
        "distortion": [-0.024835, 0.0, 0.0, 0.0, 0.0],
    }))  # fmt: skip
    return path


def _seneca(tmp_path: Path, *more: object) -> Result:
    seneca = shared_data("photos/seneca")
    return _run(
        seneca / "photos" / "IMG_0533.jpg", "--map", seneca / "map_passA_30cm.tif", "--elevation",
        seneca / "dem_4m.tif", "--near", "41.0353,-83.3049", "--agl", 63, "--camera", _camera(tmp_path), *more,
    )  # fmt: skip


def _answer(result: Result) -> dict[str, Any]:
    lines = [line for line in result.stdout.splitlines() if line.startswith("{")]
    assert len(lines) == 1, result.output
    answer: dict[str, Any] = json.loads(lines[0])
    return answer


def _away_m(target: dict[str, Any], lat_deg: float, lon_deg: float) -> np.ndarray:
    frame = LocalFrame(math.radians(lat_deg), math.radians(lon_deg), 0.0)
    return frame.ne_from_geodetic(math.radians(target["lat_deg"]), math.radians(target["lon_deg"]))


def test_the_centre_of_a_photo_is_where_structure_from_motion_has_it(tmp_path: Path) -> None:
    out = tmp_path / "targets.geojson"

    result = _seneca(tmp_path, "--pixel", CENTRE, "--pixel", "1900,20", "--json", "--out", out)

    answer = _answer(result)
    first, outside = answer["targets"]
    miss = _away_m(first, *TRUE_CENTRE[:2])
    cov = np.array(first["cov_ned_m2"])
    assert result.exit_code == 1  # one of two pixels was refused
    assert (first["accepted"], outside["accepted"], answer["accepted"]) == (True, False, False)
    # map and truth share one frame to a decimetre, a map pixel is 0.3 m
    assert np.hypot(*miss) < 1.0
    assert miss @ np.linalg.solve(cov[:2, :2], miss) < 5.99
    assert first["alt_amsl_m"] == pytest.approx(TRUE_CENTRE[2], abs=3.0 * math.sqrt(cov[2][2]))
    assert 0.0 < first["ce90_m"] < 5.0
    assert first["ellipse95"]["semi_major_m"] >= first["ellipse95"]["semi_minor_m"] > 0.0
    assert first["map_offset_std_m"] is None
    assert first["ray"]["apart_m"] < 2.0 and first["ray"]["apart_sigmas"] < 3.0
    assert "outside the 1800 x 1350" in outside["reason"]
    assert "lat_deg" not in outside
    features = json.loads(out.read_text())["features"]
    assert [f["properties"]["pixel"] for f in features] == [[899.5, 674.5]]
    assert features[0]["geometry"]["coordinates"] == [first["lon_deg"], first["lat_deg"], first["alt_amsl_m"]]
    assert features[0]["properties"]["ce90_m"] == first["ce90_m"]


def test_height_above_ground_and_the_maps_displacement_are_in_the_answer(tmp_path: Path) -> None:
    low, high = (
        _answer(_seneca(tmp_path, "--pixel", "1700,100", "--json", *more))["targets"][0]
        for more in ((), ("--target-height", 8, "--target-height-std", 3, "--map-offset-std", 5))
    )

    slant = math.tan(math.radians(low["off_nadir_deg"]))
    moved = np.hypot(*_away_m(high, low["lat_deg"], low["lon_deg"]))
    # the ground slopes by some per cent
    assert moved == pytest.approx(8.0 * slant, rel=0.1)
    assert high["alt_amsl_m"] - low["alt_amsl_m"] == pytest.approx(8.0, abs=0.5)
    on_map = np.trace(np.array(high["cov_on_map_ned_m2"])[:2, :2])
    assert np.trace(np.array(high["cov_ned_m2"])[:2, :2]) - on_map == pytest.approx(50.0, abs=0.01)
    grown = high["std_by_source_m"]["height_m"] ** 2 - low["std_by_source_m"]["height_m"] ** 2
    assert grown == pytest.approx((3.0 * slant) ** 2, rel=0.3)


def test_the_text_says_coordinate_uncertainty_and_both_methods(tmp_path: Path) -> None:
    result = _seneca(tmp_path, "--pixel", CENTRE)

    assert result.exit_code == 0, result.output
    for word in ("MGRS 17TLF", "CE90", "95 % ellipse", "AMSL", "by the match", "sigmas", "is not counted"):
        assert word in result.output


def test_contours_as_published_come_to_the_same_place(tmp_path: Path) -> None:
    answer = _answer(_seneca(tmp_path, "--pixel", CENTRE, "--json", "--method", "contour"))

    target = answer["targets"][0]
    assert (answer["match"], target["method"]) == ("contours", "contour")
    assert np.hypot(*_away_m(target, *TRUE_CENTRE[:2])) < 1.5
    assert target["ce90_m"] > 0.0


def test_a_photo_that_is_not_located_gives_no_coordinate() -> None:
    seneca, brighton = shared_data("photos/seneca"), shared_data("photos/brighton")

    result = _run(
        seneca / "photos" / "IMG_0533.jpg", "--pixel", CENTRE, "--map", brighton / "map_10cm.tif", "--agl", 63,
        "--hfov", 70.5, "--heading", 240, "--near", "46.8428,-91.9942", "--radius", 15, "--json",
    )  # fmt: skip

    answer = _answer(result)
    assert result.exit_code == 1
    assert not answer["accepted"] and "was not located" in answer["reason"]
    assert "lat_deg" not in result.stdout
    assert "was not located" in result.stderr


def test_a_missing_photo_is_told(tmp_path: Path) -> None:
    seneca = shared_data("photos/seneca")

    result = _run(tmp_path / "none.jpg", "--pixel", "1,1", "--map", seneca / "map_passA_30cm.tif", "--hfov", 70)

    assert result.exit_code == 1
    assert "none.jpg" in result.stderr
    assert "Traceback" not in result.output


@pytest.mark.parametrize(("options", "problem"), [
    (("--pixel", "12"), "not U,V"),
    (("--pixel", "nan,3"), "not U,V"),
    (("--pixel", "1,1", "--target-height", "nan"), "--target-height is at most"),
    (("--pixel", "1,1", "--target-height-std", "-1"), "--target-height-std is 0 to"),
    (("--pixel", "1,1", "--pixel-std", "0"), "--pixel-std is a positive"),
    (("--pixel", "1,1", "--out", "a.kml"), "must end in"),
    (("--pixel", "1,1", "--near", "x"), "not LAT,LON"),
    (("--pixel", "1,1", "--method", "magic"), "registered"),
    ((), "--pixel"),
])  # fmt: skip
def test_misuse_ends_with_2(options: tuple[str, ...], problem: str) -> None:
    result = _run("a.jpg", "--map", "b.tif", *options)

    assert result.exit_code == 2
    assert problem in result.output
