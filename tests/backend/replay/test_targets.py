"""Recorded clicks become targets: where they must, and nowhere else."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from backend.replay.offline import replay_flight
from backend.replay.targets import ClickPictures
from geodata.flight import FlightFolder
from geodata.flight_tables import Click
from tests.backend.flight_maker import CAMERA, GROUND_M, HEIGHT_M, LON_DEG, T0_US
from tests.backend.replay.flown import EARTH_M, lat_deg_at, write_known_flight

CENTRE = (CAMERA.cx_px or 0.0, CAMERA.cy_px or 0.0)
AT_US = T0_US + 6_000_000


def located(folder: Path, *clicks: Click) -> dict[str, dict[str, str]]:
    flight = write_known_flight(folder / "f", clicks=clicks)
    replay_flight(flight, folder / "out")
    with (folder / "out" / "targets.csv").open(newline="") as file:
        return {row["target"]: row for row in csv.DictReader(file)}


def test_a_click_below_and_one_ahead_lie_where_the_ray_meets_the_ground(tmp_path: Path) -> None:
    """The camera looks straight down with its top forward: 60 px up at a focal length of 300 are 20 m ahead."""
    found = located(
        tmp_path, Click(AT_US, *CENTRE, "below"), Click(AT_US, CENTRE[0], CENTRE[1] - 60.0, "ahead"),
        Click(AT_US, CENTRE[0] + 60.0, CENTRE[1], "right"),
    )  # fmt: skip
    lat = lat_deg_at(AT_US)
    metre_deg = math.degrees(1.0 / EARTH_M)
    east_deg = metre_deg / math.cos(math.radians(lat))
    places = {
        "below": (lat, LON_DEG),
        "ahead": (lat + 20 * metre_deg, LON_DEG),
        "right": (lat, LON_DEG + 20 * east_deg),
    }

    assert set(found) == set(places)
    for name, (lat_deg, lon_deg) in places.items():
        # 0.1 m
        assert_allclose(float(found[name]["lat_deg"]), lat_deg, atol=0.1 * metre_deg)
        assert_allclose(float(found[name]["lon_deg"]), lon_deg, atol=0.1 * east_deg)
        assert_allclose(float(found[name]["alt_amsl_m"]), GROUND_M, atol=0.05)
        assert found[name]["method"] == "ray_terrain"
        assert 0.0 < float(found[name]["ce90_m"]) < HEIGHT_M / 5


@pytest.mark.parametrize("ground", ["terrain", "flat"])
def test_what_stands_above_the_ground_lies_nearer(tmp_path: Path, ground: str) -> None:
    """What is seen 20 m ahead on the ground, 100 m below, is 16 m ahead where it stands 20 m high."""
    found = located(tmp_path, Click(AT_US, CENTRE[0], CENTRE[1] - 60.0, "mast", 20.0, ground))["mast"]

    ahead_m = math.radians(float(found["lat_deg"]) - lat_deg_at(AT_US)) * EARTH_M
    assert ahead_m == pytest.approx(16.0, abs=0.1)
    assert float(found["alt_amsl_m"]) == pytest.approx(GROUND_M + 20.0, abs=0.05)


def test_more_clicks_on_one_target_are_counted_and_not_overrated(tmp_path: Path) -> None:
    """All share the pose's error: ten looks at once are not surer than the best of them."""
    once = located(tmp_path / "a", Click(AT_US, *CENTRE, "t"))
    often = located(tmp_path / "b", *[Click(AT_US, *CENTRE, "t")] * 10)

    assert often["t"]["observations"] == "10"
    assert float(often["t"]["ce90_m"]) == float(once["t"]["ce90_m"])
    assert_allclose(float(often["t"]["lat_deg"]), float(once["t"]["lat_deg"]), atol=1e-8)


@pytest.mark.parametrize(
    "click",
    [
        Click(T0_US - 5_000_000, *CENTRE, "before the flight"),
        Click(T0_US + 99_000_000, *CENTRE, "after the flight"),
        Click(AT_US, -3.0, 50.0, "outside the picture"),
        Click(AT_US, 50.0, 1e9, "far outside"),
    ],
)
def test_a_click_that_shows_nothing_known_makes_no_target(tmp_path: Path, click: Click) -> None:
    found = located(tmp_path, Click(AT_US, *CENTRE, "good"), click)

    assert set(found) == {"good"}


def test_without_a_camera_there_are_no_targets(tmp_path: Path) -> None:
    write_known_flight(tmp_path / "f", camera=None, clicks=(Click(AT_US, *CENTRE, "t"),))
    result = replay_flight(FlightFolder.open(tmp_path / "f"), tmp_path / "out")

    assert result.report["targets"] == 0
    assert (tmp_path / "out" / "targets.csv").read_text().startswith("target,lat_deg,lon_deg,alt_amsl_m,ce90_m")


def test_every_click_is_listed_by_every_method_and_the_refused_with_their_reason(tmp_path: Path) -> None:
    located(
        tmp_path, Click(AT_US, *CENTRE, "good"), Click(AT_US, -3.0, 50.0, "outside"), Click(T0_US - 9, 1, 1, "early")
    )
    with (tmp_path / "out" / "sightings.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))

    assert [(row["target"], row["method"]) for row in rows] == [
        ("good", "ray_terrain"), ("good", "fused"), ("outside", ""), ("early", ""),
    ]  # fmt: skip
    assert "outside the" in rows[2]["note"]
    assert rows[2]["lat_deg"] == rows[2]["ce90_m"] == ""
    assert "not known" in rows[3]["note"]
    assert rows[1]["note"] == "no picture of that time"


def test_pictures_of_clicks_are_kept_as_they_were_and_the_nearest_counts() -> None:
    rng = np.random.default_rng(1)
    first, second, third = (rng.integers(0, 255, (48, 64), dtype=np.uint8) for _ in range(3))
    kept = ClickPictures([Click(1_000_000, 1.0, 1.0, "a"), Click(2_000_000, 1.0, 1.0, "b")])

    for t_us, image in ((990_000, first), (1_001_000, second), (1_015_000, third), (1_500_000, third)):
        kept.offer(t_us, image)

    assert_array_equal(kept.at(1_000_000), second)
    assert kept.at(2_000_000) is None
    kept.offer(2_000_000, np.repeat(first[..., None], 3, axis=2))
    assert_array_equal(kept.at(2_000_000), first)
