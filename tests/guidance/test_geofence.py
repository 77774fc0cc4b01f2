"""Fences: what is inside. The authority for distances is PROJ's geodesic."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from pyproj import Geod

from guidance.geofence import FenceCircle, FencePolygon, Geofence, InclusionRule

SQUARE = ((47.0, 8.0), (47.0, 8.1), (47.1, 8.1), (47.1, 8.0))
# An L: the square without its north-east quarter.
CORNER = ((47.0, 8.0), (47.0, 8.1), (47.05, 8.1), (47.05, 8.05), (47.1, 8.05), (47.1, 8.0))


@pytest.mark.parametrize("turned", [False, True])
@pytest.mark.parametrize(
    ("place", "inside"),
    [((47.02, 8.09), True), ((47.09, 8.02), True), ((47.08, 8.08), False), ((46.99, 8.05), False),
     ((47.05, 7.99), False), ((47.05, -171.95), False)],
)  # fmt: skip
def test_inside_of_a_polygon(place: tuple[float, float], inside: bool, turned: bool) -> None:
    corners = CORNER[::-1] if turned else CORNER
    assert FencePolygon(True, corners).holds(*place) is inside


def test_a_polygon_over_the_antimeridian() -> None:
    zone = FencePolygon(True, ((-17.0, 179.9), (-17.0, -179.9), (-16.8, -179.9), (-16.8, 179.9)))
    assert zone.holds(-16.9, 180.0)
    assert zone.holds(-16.9, -179.95)
    assert zone.holds(-16.9, 179.95)
    assert not zone.holds(-16.9, 179.8)
    assert not zone.holds(-16.9, 0.0)


@given(st.floats(-80, 80), st.floats(-180, 180), st.floats(0, 360), st.floats(10, 20_000))
def test_a_circle_has_its_radius_everywhere(
    lat_deg: float, lon_deg: float, azimuth_deg: float, radius_m: float
) -> None:
    circle = FenceCircle(True, lat_deg, lon_deg, radius_m)
    # a chord is shorter than its arc by 8 mm at 20 km
    for share, inside in ((0.999, True), (1.001, False)):
        lon, lat, _ = Geod(ellps="WGS84").fwd(lon_deg, lat_deg, azimuth_deg, radius_m * share)
        assert circle.holds(lat, lon) is inside


def test_zones_together() -> None:
    west, east = FenceCircle(True, 47.0, 8.0, 1000.0), FenceCircle(True, 47.0, 8.01, 1000.0)
    hole = FenceCircle(False, 47.0, 8.005, 50.0)
    fence = Geofence((), (west, east, hole))

    assert fence.allows(47.003, 8.005)
    assert not fence.allows(47.0, 8.005, InclusionRule.ANY)
    assert not fence.allows(47.0, 7.99)
    assert fence.allows(47.0, 7.99, InclusionRule.ANY)
    assert not fence.allows(48.0, 8.0, InclusionRule.ANY)
    for rule in InclusionRule:
        assert Geofence((), (hole,)).allows(48.0, 8.0, rule)
        assert Geofence().allows(0.0, 0.0, rule)
    assert Geofence().empty
    assert not fence.empty


def test_a_polygon_that_crosses_itself() -> None:
    assert not FencePolygon(True, SQUARE).crosses_itself()
    assert not FencePolygon(True, CORNER).crosses_itself()
    assert FencePolygon(True, (SQUARE[0], SQUARE[2], SQUARE[1], SQUARE[3])).crosses_itself()


def test_what_is_no_zone() -> None:
    for corners in (SQUARE[:2], SQUARE * 64, ((91.0, 0.0), *SQUARE), ((math.nan, 0.0), *SQUARE)):
        with pytest.raises(ValueError, match=r"vertices|latitude|not a place"):
            FencePolygon(True, corners)
    for radius_m in (0.0, -1.0, math.nan, math.inf):
        with pytest.raises(ValueError, match="radius"):
            FenceCircle(True, 47.0, 8.0, radius_m)
    with pytest.raises(ValueError, match="zones"):
        Geofence((), (FenceCircle(True, 47.0, 8.0, 1.0),) * 256)


@given(
    st.lists(st.tuples(st.floats(-0.02, 0.02), st.floats(-0.02, 0.02)), min_size=3, max_size=8),
    st.sampled_from([8.0, 180.0, -179.99]), st.integers(0, 2**32 - 1), st.sampled_from(list(InclusionRule)),
)  # fmt: skip
def test_many_places_at_once_are_judged_as_one_by_one(
    corners: list[tuple[float, float]], lon_deg: float, seed: int, rule: InclusionRule
) -> None:
    def wrapped(lon: float) -> float:
        return (lon + 180.0) % 360.0 - 180.0

    shape = tuple((47.0 + lat, wrapped(lon_deg + lon)) for lat, lon in corners)
    fence = Geofence(
        (FencePolygon(True, shape), FencePolygon(False, shape[:3])),
        (FenceCircle(True, 47.0, wrapped(lon_deg), 1500.0), FenceCircle(False, 47.005, wrapped(lon_deg), 300.0)),
    )  # fmt: skip
    offsets = np.random.default_rng(seed).uniform(-0.03, 0.03, (40, 2))
    lat, lon = 47.0 + offsets[:, 0], np.array([wrapped(lon_deg + east) for east in offsets[:, 1]])
    allowed = [fence.allows(float(a), float(b), rule) for a, b in zip(lat, lon, strict=True)]

    assert (~fence.left_by(lat, lon, rule) & ~fence.entered_by(lat, lon)).tolist() == allowed
    free = Geofence()
    assert not free.left_by(lat, lon, rule).any()
    assert not free.entered_by(lat, lon).any()
