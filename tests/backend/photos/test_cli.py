"""``pilotage locate`` on real photos: answers against the truth, exports, and bad input."""

import csv
import json
import math
from pathlib import Path

import pytest
import typer
from typer.testing import CliRunner, Result

from backend.photos.cli import register
from tests.shared_data import shared_data

METRES_PER_DEGREE = 111_320.0


def _run(*arguments: object) -> Result:
    app = typer.Typer()
    register(app)
    app.command("other")(lambda: None)  # one command alone would lose its name
    return CliRunner().invoke(app, ["locate", *(str(a) for a in arguments)], env={"COLUMNS": "200"})


def _unwrapped(result: Result) -> str:
    """What was printed on one line: a table wraps its words by the length of the path among them."""
    return " ".join(result.output.split())


def _miss_m(lat_deg: float, lon_deg: float, true_lat_deg: float, true_lon_deg: float) -> float:
    north = (lat_deg - true_lat_deg) * METRES_PER_DEGREE
    east = (lon_deg - true_lon_deg) * METRES_PER_DEGREE * math.cos(math.radians(true_lat_deg))
    return math.hypot(north, east)


def _truth(folder: Path) -> dict[str, dict[str, str]]:
    with (folder / "truth.csv").open() as file:
        return {row["file"]: row for row in csv.DictReader(file)}


def test_photos_without_metadata_are_found_and_a_broken_one_is_told(tmp_path: Path) -> None:
    seneca = shared_data("photos/seneca")
    broken = tmp_path / "broken.jpg"
    broken.write_bytes(b"\xff\xd8 no more")
    photo = seneca / "photos" / "IMG_0533.jpg"

    result = _run(
        photo, broken, "--map", seneca / "map_passA_30cm.tif", "--near", "41.0353,-83.3049", "--radius", 100,
        "--agl", 63, "--hfov", 70.5, "--json", "--out", tmp_path / "places.geojson",
    )  # fmt: skip

    answers = [json.loads(line) for line in result.stdout.splitlines() if line.startswith("{")]
    true = _truth(seneca)["IMG_0533.jpg"]
    place = (float(true["cam_lat"]), float(true["cam_lon"]))
    assert result.exit_code == 1  # one of two could not be tried
    assert [a["accepted"] for a in answers] == [True, False]
    # level ground and no distortion were assumed, and the answer says what that costs
    miss_m = _miss_m(answers[0]["lat_deg"], answers[0]["lon_deg"], *place)
    assert miss_m < 5.0
    assert miss_m < 3.0 * answers[0]["std_n_m"] < 15.0
    assert answers[0]["heading_deg"] == pytest.approx(float(true["yaw_deg"]), abs=3.0)
    assert "broken.jpg" in answers[1]["reason"]
    assert {"photo", "score", "std_n_m", "std_e_m", "elapsed_ms", "outlier_probability"} <= answers[0].keys()
    features = json.loads((tmp_path / "places.geojson").read_text())["features"]
    assert [f["properties"]["photo"] for f in features] == ["IMG_0533.jpg"]
    lon_deg, lat_deg = features[0]["geometry"]["coordinates"][:2]
    assert _miss_m(lat_deg, lon_deg, *place) < 5.0


def test_a_photo_of_elsewhere_is_refused(tmp_path: Path) -> None:
    seneca, brighton = shared_data("photos/seneca"), shared_data("photos/brighton")

    result = _run(
        seneca / "photos" / "IMG_0533.jpg", "--map", brighton / "map_10cm.tif", "--agl", 63, "--hfov", 70.5,
        "--heading", 240, "--near", "46.8428,-91.9942", "--radius", 15, "--out", tmp_path / "places.csv",
    )  # fmt: skip

    assert result.exit_code == 0  # a refused answer is an answer
    assert "refused" in result.stdout
    with (tmp_path / "places.csv").open() as file:
        rows = list(csv.DictReader(file))
    assert [row["accepted"] for row in rows] == ["False"]
    assert rows[0]["reason"]


def test_a_drones_own_metadata_is_enough_even_upside_down() -> None:
    brighton = shared_data("photos/brighton")
    # stored turned by 180 degrees from what its XMP says
    photo = brighton / "photos" / "DJI_0024.JPG"

    result = _run(photo, "--map", brighton / "map_10cm.tif", "--use-exif-gps", "--json")

    answer = json.loads(result.stdout.splitlines()[-1])
    true = _truth(brighton)["DJI_0024.JPG"]
    assert answer["accepted"], answer
    # the truth is a consumer GPS of some metres
    assert _miss_m(answer["lat_deg"], answer["lon_deg"], float(true["gps_lat"]), float(true["gps_lon"])) < 6.0
    turn = (answer["heading_deg"] - float(true["image_up_azimuth_deg"]) + 180.0) % 360.0 - 180.0
    assert abs(turn) < 6.0


@pytest.mark.parametrize(("options", "problem"), [
    (("--near", "here"), "not LAT,LON"),
    (("--near", "41,-83", "--radius", "5", "--sigma", "5"), "not both"),
    (("--near", "141,-83"), "lat_deg is -90 to 90"),
    (("--out", "places.kml"), "must end in"),
    (("--hfov", "70", "--camera", "x.json"), "not both"),
])  # fmt: skip
def test_misuse_ends_with_2(options: tuple[str, ...], problem: str) -> None:
    seneca = shared_data("photos/seneca")

    result = _run(seneca / "photos" / "IMG_0533.jpg", "--map", seneca / "map_passA_30cm.tif", *options)

    assert result.exit_code == 2
    assert problem in result.output


def test_what_is_missing_is_asked_for(tmp_path: Path) -> None:
    seneca = shared_data("photos/seneca")
    photo, reference = seneca / "photos" / "IMG_0533.jpg", seneca / "map_passA_30cm.tif"

    no_lens = _run(photo, "--map", reference, "--agl", 63)
    no_ground = _run(photo, "--map", reference, "--alt-amsl", 284, "--hfov", 70)
    below = _run(photo, "--map", reference, "--alt-amsl", 184, "--hfov", 70, "--elevation", seneca / "dem_4m.tif")
    no_map = _run(photo, "--map", tmp_path / "none.tif", "--agl", 63, "--hfov", 70)
    nothing = _run(tmp_path, "--map", reference)

    assert "--hfov DEG or --camera" in _unwrapped(no_lens)
    assert "--elevation" in _unwrapped(no_ground)
    assert "below the ground" in _unwrapped(below)
    assert "no such file" in _unwrapped(no_map)
    assert "holds no pictures" in _unwrapped(nothing)
    assert {r.exit_code for r in (no_lens, no_ground, below, no_map, nothing)} == {1}
