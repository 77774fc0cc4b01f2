"""A plan's path, and what is found wrong with it."""

from __future__ import annotations

import math
import re
from typing import Any

import numpy as np
import pytest

from backend.link.events import VehicleType
from backend.missions.path import PlanPath, ProblemKind, path_of
from backend.missions.plan_file import plan_of
from backend.schemas.plan_path import no_path, path_feature
from guidance.geofence import InclusionRule

LAT, LON = 58.5, 15.6
NORTH_M, EAST_M = 111_377.0, 58_300.0  # a degree there, to a tenth of a per cent


def at(north_m: float, east_m: float) -> list[float]:
    return [LAT + north_m / NORTH_M, LON + east_m / EAST_M]


def item(command: int, place: list[float] | None, alt_m: float, frame: int = 3, p: tuple[float, ...] = ()) -> Any:
    params = [*p, *[0.0] * (4 - len(p)), *(place or [0.0, 0.0]), alt_m]
    return {"type": "SimpleItem", "command": command, "frame": frame, "params": params, "autoContinue": True}


def planned(
    *items: Any, polygons: Any = (), circles: Any = (), kind: VehicleType = VehicleType.MULTIROTOR, **mission: Any
) -> PlanPath:
    document = {
        "fileType": "Plan", "version": 1,
        "mission": {"version": 2, "items": list(items), "plannedHomePosition": [LAT, LON, 80.0], **mission},
        "geoFence": {"version": 2, "polygons": list(polygons), "circles": list(circles)},
    }  # fmt: skip
    return path_of(plan_of(document), kind, InclusionRule.ALL)


def circle(inclusion: bool, place: list[float], radius_m: float) -> Any:
    return {"inclusion": inclusion, "version": 1, "circle": {"center": place, "radius": radius_m}}


def kinds(path: PlanPath) -> list[ProblemKind]:
    return [problem.kind for problem in path.problems]


def test_up_along_home_and_down() -> None:
    path = planned(
        item(22, None, 30.0), item(16, at(100, 0), 30.0), item(178, None, 0.0, 2, (1, 8.0)),
        item(16, at(100, 150), 110.0, 0, (4.0,)), item(20, None, 0.0, 2), item(16, at(900, 900), 30.0),
        hoverSpeed=4.0,
    )  # fmt: skip
    assert path.problems == ()
    assert path.items == (None, 1, 2, 4, 5, None)
    assert path.path is not None
    points = path.path.pos_ned_m[path.path.arrivals]
    expected = [[0, 0, 0], [0, 0, -30], [100, 0, -30], [100, 150, -30], [0, 0, -30], [0, 0, 0]]
    np.testing.assert_allclose(points, expected, atol=0.3)  # 110 m above the sea are 30 m above home
    speeds = [float(path.path.speed_m_s[path.path.leg == leg].max()) for leg in range(5)]
    assert speeds == pytest.approx([2.5, 4.0, 8.0, 8.0, 1.5], abs=0.05)
    feature = path_feature("1", "tag", ["look"], path)
    told = feature.properties
    assert feature.geometry is not None
    assert feature.geometry.coordinates[0] == pytest.approx((LON, LAT), abs=1e-7)
    assert [arrival.item for arrival in told.arrivals] == [None, 1, 2, 4, 5, None]
    assert told.duration_s == told.arrivals[-1].time_s
    # Four seconds of stay at item 4.
    assert told.arrivals[4].time_s - told.arrivals[3].time_s > 4.0 + 180.0 / 8.0
    lengths = {len(told.speed_m_s), len(told.turn_radius_m), len(told.alt_rel_m), len(told.time_s)}
    assert lengths == {len(feature.geometry.coordinates)}


def test_a_leg_that_leaves_the_fence_between_two_places_that_are_inside() -> None:
    corners = [
        at(-50, -50),
        at(-50, 250),
        at(150, 250),
        at(150, 120),
        at(20, 120),
        at(20, 80),
        at(150, 80),
        at(150, -50),
    ]
    across = [item(16, at(100, 0), 40.0), item(16, at(100, 200), 40.0)]
    path = planned(*across, polygons=[{"inclusion": True, "polygon": corners, "version": 1}])
    (problem,) = path.problems
    assert (problem.kind, problem.from_item, problem.to_item) == (ProblemKind.FENCE, 1, 2)
    assert problem.text == "the leg from item 1 to item 2 leaves the fence"
    assert problem.place_deg == pytest.approx(at(100, 80), abs=3e-5)  # within a sample of two metres
    assert kinds(planned(*across, circles=[circle(False, at(100, 100), 20.0)])) == [ProblemKind.EXCLUSION]
    assert kinds(planned(*across, circles=[circle(False, at(140, 100), 20.0), circle(True, at(100, 100), 130)])) == []


def test_steep_legs_and_tight_bends() -> None:
    steep = planned(item(16, at(0, 100), 20.0), item(16, at(0, 130), 60.0), item(16, at(0, 160), 30.0))
    assert ProblemKind.CLIMB in kinds(steep)
    assert ProblemKind.DESCENT in kinds(steep)
    climb = next(p for p in steep.problems if p.kind is ProblemKind.CLIMB)
    said = re.fullmatch(r"the leg from item 1 to item 2 climbs at (\d+)°, more than 45°", climb.text)
    assert said is not None
    assert 53 <= int(said[1]) < 75  # straight it would be 53, and it begins or ends level
    tight = planned(*(item(16, at(*place), 30.0) for place in ((0, 0), (8, 0), (6, 3), (-2, 3))))
    bend = next(p for p in tight.problems if p.kind is ProblemKind.BEND)
    assert "m radius: no faster than" in bend.text
    wide = [item(16, at(0, 0), 30.0), item(16, at(80, 0), 30.0), item(16, at(80, 80), 30.0)]
    assert kinds(planned(*wide)) == []
    # An aeroplane flies it at 20 m/s or not at all.
    assert ProblemKind.BEND in kinds(planned(*wide, kind=VehicleType.FIXED_WING, cruiseSpeed=20.0))


def test_landing_is_straight_down_and_no_problem() -> None:
    path = planned(item(16, at(0, 0), 50.0), item(16, at(60, 0), 50.0), item(21, at(120, 0), 0.0))
    assert kinds(path) == []
    assert path.path is not None
    assert path.path.climb_rad[-1] == pytest.approx(-math.pi / 2)


def test_what_cannot_be_drawn_is_said() -> None:
    ground = planned(item(16, at(0, 0), 50.0), item(16, at(60, 0), 50.0, 10))
    assert ["counts its height from the ground" in p.text for p in ground.problems] == [True]
    far = planned(item(16, at(0, 0), 50.0), item(16, [59.9, 15.6], 50.0))
    assert far.path is None
    assert "km from home" in far.problems[0].text
    for nothing in (planned(), planned(item(16, at(0, 0), 50.0)), planned(item(178, None, 0.0, 2, (1, 5.0)))):
        assert (nothing.path, nothing.problems) == (None, ())
        assert path_feature("1", "tag", [], nothing).geometry is None
    assert (no_path("1").geometry, no_path("1").properties.etag) == (None, None)


@pytest.mark.parametrize("speed", ["fast", -3.0, 0.0, 1e9, True, None])
def test_a_speed_that_cannot_be_meant_is_not_used(speed: object) -> None:
    path = planned(item(16, at(0, 0), 50.0), item(16, at(300, 0), 50.0), hoverSpeed=speed)
    assert path.path is not None
    assert path.path.speed_m_s.max() == pytest.approx(5.0)
