"""Ways home: over what, how high, and which are refused."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from backend.errors import CommandRefusedError
from backend.homing.planning import Way, plan_way
from backend.navigation.setup import NavigationSetup, Place
from backend.schemas.homing import HomingRequest
from estimator.types import Float
from guidance.geofence import FenceCircle, Geofence, InclusionRule
from tests.backend.flight_maker import GROUND_M, LAT_DEG, LON_DEG, state
from tests.backend.landing.test_messages import setup

T_US = 1_760_000_000_000_000
M_PER_DEG = 6.368e6 * math.pi / 180.0
"""Metres of a degree of latitude here, to a few parts in a thousand."""


def north(metres: float) -> dict[str, float]:
    return {"lat_deg": LAT_DEG + metres / M_PER_DEG, "lon_deg": LON_DEG}


def planned(
    home_north_m: float = 500.0, fence: Geofence | None = None, base: NavigationSetup | None = None, **wish: Any
) -> Way:
    home = Place(math.radians(north(home_north_m)["lat_deg"]), math.radians(LON_DEG), GROUND_M)
    body = HomingRequest(action="preview", **wish)
    return plan_way(state(T_US), base or setup(), home, body, fence or Geofence(), InclusionRule.ALL)


class Hill:
    """Ground that rises by 200 m half way."""

    def alt_amsl_m(self, north_m: Float, east_m: Float) -> Float:
        rise: Float = GROUND_M + 200.0 * np.exp(-((north_m - 250.0) ** 2 + east_m**2) / 2.0 / 50.0**2)
        return rise


def test_it_leads_straight_home_at_the_present_height() -> None:
    way = planned().body

    assert way.length_m == pytest.approx(500.0, rel=5e-3)
    assert way.alt_amsl_m == pytest.approx(GROUND_M + 100.0)
    first, last = way.geometry.coordinates[0], way.geometry.coordinates[-1]
    assert first[:2] == pytest.approx([LON_DEG, LAT_DEG], abs=1e-6)
    assert last[1] == pytest.approx(north(500.0)["lat_deg"], abs=1e-6)
    assert all(point[2] == pytest.approx(GROUND_M + 100.0, abs=0.1) for point in way.geometry.coordinates)
    # A minute of way at 8 m/s, and a hundred metres down at 2 m/s and slower.
    assert 62.0 + 50.0 < way.seconds < 62.0 + 90.0


def test_a_hill_on_the_way_is_flown_over_with_the_clearance() -> None:
    hilly = replace(setup(), ground=Hill())

    assert planned(base=hilly, clearance_m=60.0).body.alt_amsl_m == pytest.approx(GROUND_M + 260.0, abs=1.0)
    with pytest.raises(CommandRefusedError, match="not 60 m above the ground"):
        planned(base=hilly, clearance_m=60.0, alt_amsl_m=GROUND_M + 150.0)
    assert planned(base=hilly, alt_amsl_m=GROUND_M + 300.0).body.alt_amsl_m == GROUND_M + 300.0


def test_it_leads_over_the_places_named() -> None:
    aside = {"lat_deg": LAT_DEG + 250.0 / M_PER_DEG, "lon_deg": LON_DEG + 0.004}
    points = np.array(planned(via=[aside]).body.geometry.coordinates)

    off_deg = np.hypot(points[:, 0] - aside["lon_deg"], points[:, 1] - aside["lat_deg"])
    assert off_deg.min() < 1e-6


def test_a_way_that_leaves_the_fence_is_refused() -> None:
    around = FenceCircle(True, LAT_DEG, LON_DEG, 1000.0)
    hole = FenceCircle(False, north(250.0)["lat_deg"], LON_DEG, 60.0)

    assert planned(fence=Geofence(circles=(around,))).body.length_m > 0.0
    with pytest.raises(CommandRefusedError, match="leaves the fence at"):
        planned(fence=Geofence(circles=(around, hole)))
    past = [{"lat_deg": north(250.0)["lat_deg"], "lon_deg": LON_DEG + 0.004}]
    assert planned(fence=Geofence(circles=(around, hole)), via=past).body.length_m > 500.0
    with pytest.raises(CommandRefusedError, match="home lies outside"):
        planned(fence=Geofence(circles=(FenceCircle(True, LAT_DEG - 1.0, LON_DEG, 100.0),)))


def test_over_home_there_is_a_metre_or_two_of_way_to_come_down_by() -> None:
    assert planned(home_north_m=0.0).body.length_m == pytest.approx(2.0)


def test_home_beyond_reach_is_refused() -> None:
    with pytest.raises(CommandRefusedError, match="farther than 50 km"):
        planned(home_north_m=60_000.0)
