"""The page of a replay: one file, well-formed, with the figures in it and nothing that runs."""

from __future__ import annotations

import json
import re
from pathlib import Path
from xml.etree import ElementTree as ET

from backend.replay.offline import replay_flight
from geodata.flight import FlightFolder
from tests.backend.replay.flown import write_known_flight


def page_of(tmp_path: Path, flight: FlightFolder) -> str:
    replay_flight(flight, tmp_path / "out")
    return (tmp_path / "out" / "report.html").read_text()


def curves(page: str) -> list[list[tuple[float, float]]]:
    found = []
    for svg in re.findall(r"<svg.*?</svg>", page, re.DOTALL):
        for line in ET.fromstring(svg).iter("polyline"):  # noqa: S314  our own page
            points = [point.split(",") for point in line.attrib["points"].split()]
            found.append([(float(x), float(y)) for x, y in points])
    return found


def test_track_and_errors_are_drawn_inside_their_frames(tmp_path: Path) -> None:
    page = page_of(tmp_path, write_known_flight(tmp_path / "f"))
    estimate, truth, sigma, error = curves(page)

    assert len(estimate) == len(truth) == len(sigma) == len(error) > 50
    assert all(0.0 <= x <= 720.0 and 0.0 <= y <= 420.0 for line in (estimate, truth, sigma, error) for x, y in line)
    # north is up, and the flight went north: the page's y falls
    assert estimate[-1][1] < estimate[0][1] - 100.0
    assert all(abs(a[1] - b[1]) < 2.0 for a, b in zip(estimate, truth, strict=True))


def test_without_truth_the_page_shows_what_there_is(tmp_path: Path) -> None:
    page = page_of(tmp_path, write_known_flight(tmp_path / "f", truth=False))

    assert len(curves(page)) == 2
    assert "stated sigma" in page
    assert "horizontal error" not in page


def test_a_flights_name_cannot_put_anything_into_the_page(tmp_path: Path) -> None:
    flight = write_known_flight(tmp_path / "f")
    meta = json.loads((flight.path / "flight.json").read_text())
    meta["name"] = "<script>alert(1)</script> & 'co'"
    (flight.path / "flight.json").write_text(json.dumps(meta))
    page = page_of(tmp_path, FlightFolder.open(flight.path))

    assert "<script" not in page
    assert "&lt;script&gt;" in page
    assert "http" not in page.replace("http-equiv", "")
