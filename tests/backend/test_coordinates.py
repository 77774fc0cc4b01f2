"""Grid references and sexagesimal degrees, against GeoTrans (the mgrs package), which shares no code with PROJ."""

from __future__ import annotations

import re
from concurrent.futures import ThreadPoolExecutor

import mgrs
import pytest

from backend.coordinates import dms_of, mgrs_digits, mgrs_of, utm_of, utm_zone

PLACES = [
    (47.3769, 8.5417), (-33.86, 151.21), (60.39, 5.32), (78.22, 15.65), (72.5, 8.9), (83.99, 41.99), (0.0, 180.0),
    (0.0, -180.0), (-0.0001, 3.0), (-79.9, -0.001), (58.4108, 15.6214), (55.99, 2.999), (71.99, 33.0),
]  # fmt: skip


@pytest.mark.parametrize(("lat_deg", "lon_deg"), PLACES)
def test_utm_agrees_with_geotrans(lat_deg: float, lon_deg: float) -> None:
    converter = mgrs.MGRS()
    reference = mgrs_of(lat_deg, lon_deg)
    assert reference is not None
    zone, _, east_m, north_m = converter.MGRSToUTM(reference)
    found = re.fullmatch(r"(\d+)([C-X]) (\d+) (\d+)", utm_of(lat_deg, lon_deg) or "")

    assert found is not None
    assert int(found[1]) == zone == int(reference[:2])
    assert found[2] == reference[2]
    # MGRS truncates to the metre, UTM is rounded to it.
    assert abs(int(found[3]) - east_m) <= 1.01
    assert abs(int(found[4]) - north_m) <= 1.01


@pytest.mark.parametrize("lat_deg", [84.01, 90.0, -80.01, -90.0])
def test_there_is_no_utm_near_the_poles(lat_deg: float) -> None:
    assert utm_of(lat_deg, 10.0) is None
    assert utm_zone(lat_deg, 10.0) is None


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "zone"),
    [(47.3769, 8.5417, "32T"), (-33.86, 151.21, "56H"), (90.0, 0.0, "Z"), (-90.0, 0.0, "B"), (0.0, 180.0, "01N")],
)
def test_grid_references_reach_everywhere(lat_deg: float, lon_deg: float, zone: str) -> None:
    found = mgrs_of(lat_deg, lon_deg)

    assert found is not None
    assert found.startswith(zone)


@pytest.mark.parametrize(
    ("std_m", "digits"),
    [(0.0, 5), (1.0, 5), (1.01, 4), (10.0, 4), (10.1, 3), (99.0, 3), (5e3, 1), (9e4, 0), (1e9, 0), (float("inf"), 0)],
)
def test_no_more_digits_than_the_sigma_supports(std_m: float, digits: int) -> None:
    assert mgrs_digits(std_m) == digits


def test_a_shorter_reference_names_the_cell_that_the_place_is_in() -> None:
    assert mgrs_of(47.3769, 8.5417, 0.4) == "32TMT6540347150"
    assert mgrs_of(47.3769, 8.5417, 3.1) == "32TMT65404715"
    assert mgrs_of(47.3769, 8.5417, 20.0) == "32TMT654471"
    assert mgrs_of(90.0, 0.0, 3.1) == "ZAH00000000"


@pytest.mark.parametrize(
    ("lat_deg", "lon_deg", "text"),
    [
        (47.3769, 8.5417, "47°22′36.84″N 008°32′30.12″E"),
        (-33.86, -151.21, "33°51′36.00″S 151°12′36.00″W"),
        (9.9999999, 59.9999999, "10°00′00.00″N 060°00′00.00″E"),  # no 60 seconds
        (-1e-9, 180.0, "00°00′00.00″N 180°00′00.00″E"),  # no south of the equator by rounding
    ],
)
def test_degrees_minutes_seconds(lat_deg: float, lon_deg: float, text: str) -> None:
    assert dms_of(lat_deg, lon_deg) == text


def test_threads_do_not_disturb_each_other() -> None:
    """Files are written in threads; neither library may mix up the zones of two places."""
    expected = [(mgrs_of(*place), utm_of(*place)) for place in PLACES]

    def work(turn: int) -> bool:
        order = [(turn + step) % len(PLACES) for step in range(len(PLACES))] * 300
        return all((mgrs_of(*PLACES[i]), utm_of(*PLACES[i])) == expected[i] for i in order)

    with ThreadPoolExecutor(8) as pool:
        assert all(pool.map(work, range(8)))
