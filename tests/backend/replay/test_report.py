"""The page of a replay: one file, well-formed, with the figures in it and nothing that runs."""

from __future__ import annotations

import base64
import json
import re
from pathlib import Path
from xml.etree import ElementTree as ET

import cv2
import numpy as np

from backend.replay.offline import replay_flight
from backend.replay.report import Flown, FlownStates, Places, ShownTarget, cutout, report_page
from geodata.flight import FlightFolder
from geodata.raster import write_geotiff
from tests.backend.flight_maker import LAT_DEG, LON_DEG, T0_US
from tests.backend.replay.flown import write_known_flight


def page_of(tmp_path: Path, flight: FlightFolder) -> str:
    replay_flight(flight, tmp_path / "out")
    return (tmp_path / "out" / "report.html").read_text()


def curves(page: str) -> dict[str, list[tuple[float, float]]]:
    found: dict[str, list[tuple[float, float]]] = {}
    for svg in re.findall(r"<svg.*?</svg>", page, re.DOTALL):
        for line in ET.fromstring(svg).iter("polyline"):  # noqa: S314  our own page
            points = [point.split(",") for point in line.attrib["points"].split()]
            # of the map the first, of a plot the only one
            found.setdefault(line.attrib["data-name"], [(float(x), float(y)) for x, y in points])
    return found


def test_track_and_errors_are_drawn_inside_their_frames(tmp_path: Path) -> None:
    page = page_of(tmp_path, write_known_flight(tmp_path / "f"))
    found = curves(page)
    estimate, truth, sigma, error = (found[n] for n in ("estimate", "truth", "stated sigma", "horizontal error"))

    assert len(truth) >= len(estimate) == len(sigma) == len(error) > 50
    assert all(0.0 <= x <= 720.0 and 0.0 <= y <= 420.0 for line in (estimate, truth, sigma, error) for x, y in line)
    # north is up, and the flight went north: the page's y falls
    assert estimate[-1][1] < estimate[0][1] - 100.0
    # the truth is told every half metre, which is less than three of the page's pixels
    assert all(min(np.hypot(x - u, y - v) for u, v in truth) < 3.0 for x, y in estimate)


def test_without_truth_the_page_shows_what_there_is(tmp_path: Path) -> None:
    page = page_of(tmp_path, write_known_flight(tmp_path / "f", truth=False))

    shown = {"estimate", "GPS", "stated sigma", "GPS minus estimate", "AMSL", "speed over ground"}
    assert set(curves(page)) == shown


def test_a_flights_name_cannot_put_anything_into_the_page(tmp_path: Path) -> None:
    flight = write_known_flight(tmp_path / "f")
    meta = json.loads((flight.path / "flight.json").read_text())
    meta["name"] = "<script>alert(1)</script> & 'co'"
    (flight.path / "flight.json").write_text(json.dumps(meta))
    page = page_of(tmp_path, FlightFolder.open(flight.path))

    assert "<script" not in page
    assert "&lt;script&gt;" in page
    assert "http" not in page.replace("http-equiv", "")


def test_the_map_and_the_pictures_of_targets_are_inside_the_page(tmp_path: Path) -> None:
    folder = write_known_flight(tmp_path / "f").path
    meta = json.loads((folder / "flight.json").read_text())
    meta["map"]["reference"] = "reference.tif"
    (folder / "flight.json").write_text(json.dumps(meta))
    step_deg = 1.0 / 111_200.0
    transform = (1.46 * step_deg, 0.0, LON_DEG - 0.002, 0.0, -step_deg, LAT_DEG + 0.002)
    pixels = np.random.default_rng(3).integers(0, 255, (400, 300), dtype=np.uint8)
    write_geotiff(folder / "reference.tif", pixels, transform, "EPSG:4326")
    times = np.array([T0_US, T0_US + 1_000_000])
    at = Places(times, np.radians([LAT_DEG, LAT_DEG + 1e-4]), np.radians([LON_DEG, LON_DEG]), np.array([500.0, 501.0]))
    states = FlownStates(at, np.ones((2, 2)), np.ones((2, 3)), ["gps", "vision"])
    picture = cutout(np.full((480, 640, 3), 90, np.uint8), 639.0, 0.0)
    targets = [ShownTarget("<car>", LAT_DEG, LON_DEG, 2.5, "ray", T0_US, picture)]
    page = report_page(Flown(FlightFolder.open(folder), states, None, (times[:1], times[1:]), targets, {}))

    images = re.findall(r"data:image/jpeg;base64,([A-Za-z0-9+/=]+)", page)
    map_picture, cut = (cv2.imdecode(np.frombuffer(base64.b64decode(i), np.uint8), cv2.IMREAD_COLOR) for i in images)
    assert max(map_picture.shape) >= 900
    assert float(map_picture.std()) > 5.0  # imagery, and no empty paper
    assert cut.shape == (160, 160, 3)
    assert int(cut[:60, 100:].max()) < 8  # black outside the video, as JPEG keeps it
    assert "&lt;car&gt;" in page
    assert "<car>" not in page
    assert not re.search(r"(href|src)='(?!data:)", page)
