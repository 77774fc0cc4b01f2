"""The study of the contour registration: its scenes are what they say, and its bookkeeping counts right."""

from __future__ import annotations

import json
import math

import cv2
import numpy as np
import pytest
import typer
from typer.testing import CliRunner, Result

from benchmarks.contour import Answer, main, row_of
from benchmarks.contour_scenes import Ground, Place, Shot, Video, analogue, open_place, shots
from estimator.registration.pose_prior import heading_of


@pytest.fixture(scope="module")
def place() -> Place:
    return open_place(151)


@pytest.fixture(scope="module")
def taken(place: Place) -> list[Shot]:
    return list(shots(place, 151, 4, Video.CLEAN))


def test_the_told_heading_lacks_the_stated_turn_and_no_more_than_45_degrees(taken: list[Shot]) -> None:
    assert [s.ground for s in taken] == [Ground.ROAD, Ground.HOUSES, Ground.FIELD, Ground.ROAD]
    for shot in taken:
        assert abs(shot.turn_rad) <= math.radians(45.0)
        assert 60.0 < -shot.told.pos_ned_m[2] < 130.0  # 70 m over ground up to some tens of metres high
    assert len({round(s.turn_rad, 6) for s in taken}) == 4


def test_a_target_is_seen_where_opencv_projects_it(place: Place, taken: list[Shot]) -> None:
    """With the heading put right, the told pose is off by some metres and two degrees of tilt: some tens of pixels."""
    for shot in taken:
        about_down = cv2.Rodrigues(np.array([0.0, 0.0, shot.turn_rad]))[0]
        rotation = about_down @ shot.told.ned_from_camera
        down = place.world.ground_down_m(shot.target_ne_m[0:1], shot.target_ne_m[1:2])[0]
        point = np.array([*shot.target_ne_m, down])
        uv = cv2.projectPoints(
            point.reshape(1, 1, 3), cv2.Rodrigues(rotation.T)[0], -rotation.T @ shot.told.pos_ned_m,
            shot.camera.matrix, np.zeros(5),
        )[0].ravel()  # fmt: skip
        assert np.hypot(*(uv - shot.uv_px)) < 150.0
        assert heading_of(rotation) == pytest.approx(
            (heading_of(shot.told.ned_from_camera) + shot.turn_rad) % (2.0 * math.pi), abs=0.01
        )


def test_the_same_seed_gives_the_same_pictures(place: Place, taken: list[Shot]) -> None:
    again = list(shots(place, 151, 2, Video.CLEAN))

    for first, second in zip(taken, again, strict=False):
        np.testing.assert_array_equal(first.image, second.image)
        assert first.uv_px == second.uv_px


def test_analogue_video_weaves_two_fields_and_is_noisy() -> None:
    first, second = np.full((400, 600), 90, np.uint8), np.full((400, 600), 150, np.uint8)

    seen = analogue(first, second, np.random.default_rng(5)).astype(np.float64)

    assert np.median(seen[1::2]) - np.median(seen[::2]) == pytest.approx(0.8 * 60.0, abs=1.5)
    assert 20.0 < np.median(seen[::2].std(axis=1)) < 28.0
    # the band correlates neighbours along a line, and not across
    line = seen[::2] - seen[::2].mean()
    assert np.mean(line[:, 1:] * line[:, :-1]) > 0.4 * line.var()
    assert abs(np.mean(line[1:] * line[:-1])) < 0.1 * line.var()


def test_a_row_counts_wrong_places_and_none_as_false() -> None:
    answers = [
        Answer("road", 1.0, 0.5, 0.2, 10.0), Answer("road", 3.0, 6.0, 0.4, 10.0),
        Answer("houses", 5.1, 30.0, 9.0, 10.0),
        Answer("field", math.inf, math.nan, math.nan, 10.0, "too weak"),
    ]  # fmt: skip

    row = row_of("clean", "m", answers)

    assert (row.pictures, row.false, row.answered, row.wrong) == (4, 2, 3, 1)
    assert row.false_by_ground == {"road": 0, "houses": 1, "field": 1}
    assert row.ce50_m == pytest.approx(3.0)
    assert row.inside90 == pytest.approx(1 / 3)
    assert math.isnan(row_of("clean", "m", answers[3:]).ce90_m)


def _run(*arguments: str) -> Result:
    app = typer.Typer()
    app.command()(main)
    return CliRunner().invoke(app, arguments, env={"COLUMNS": "200"})


def test_the_short_study_answers_for_every_picture() -> None:
    result = _run("--seeds", "151-152", "--short", "--only", "contours, algorithm 1", "--json")

    assert result.exit_code == 0, result.output
    found = json.loads(result.stdout)
    assert found["seeds"] == [151]
    assert [(r["video"], r["pictures"]) for r in found["rows"]] == [("clean", 3), ("analogue", 3)]


@pytest.mark.parametrize("options", [("--seeds", "9-3"), ("--seeds", "x"), ("--only", "magic")])
def test_misuse_ends_with_2(options: tuple[str, ...]) -> None:
    assert _run(*options).exit_code == 2
