"""Plan files: read, written, and refused with the place of what is wrong."""

from __future__ import annotations

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from backend.errors import NoPlanError, PlanFileError
from backend.link.events import Autopilot, VehicleType
from backend.missions.plan_file import MAX_BYTES, document_of, plan_of, read_plan, write_plan
from backend.missions.shelf import PlanShelf
from guidance.geofence import InclusionRule
from guidance.mission import Home
from tests.backend.missions.plans import WAYPOINTS, plan_document, simple


def as_file(document: Any) -> bytes:
    return json.dumps(document).encode()


def test_a_plan_of_qgroundcontrol() -> None:
    plan = read_plan(as_file(plan_document()))

    assert plan.mission.home == Home(47.39774, 8.545594, 488.0)
    assert [item.command for item in plan.mission.items] == [22, 16, 16, 177, 20]
    assert plan.mission.items[1].place_deg == (47.3981, 8.5461)
    assert math.isnan(plan.mission.items[0].params[3])
    (polygon,), (circle,) = plan.fence.polygons, plan.fence.circles
    assert (polygon.inclusion, len(polygon.vertices_deg), polygon.vertices_deg[1]) == (True, 4, (47.39, 8.55))
    assert (circle.inclusion, circle.lat_deg, circle.lon_deg, circle.radius_m) == (False, 47.405, 8.545, 60.5)
    assert plan.fence.breach_return == Home(47.3978, 8.5457, 540.0)
    assert [(p.lat_deg, p.lon_deg, p.alt_rel_m) for p in plan.rally] == [(47.396, 8.544, 30.0)]


def test_jumps_lead_where_their_ids_say() -> None:
    document = plan_document()
    document["mission"]["items"][2]["params"][0] = 8  # the id of the fifth item
    assert read_plan(as_file(document)).mission.items[3].params[0] == 5.0


def test_what_is_not_understood_survives() -> None:
    written = write_plan(read_plan(as_file(plan_document())))

    assert json.loads(written) == plan_document()
    assert write_plan(read_plan(written)) == written


def test_a_new_document_reads_as_what_it_was_made_of() -> None:
    plan = read_plan(as_file(plan_document()))
    document = document_of(plan.mission, plan.fence, plan.rally, Autopilot.PX4, VehicleType.MULTIROTOR)
    again = read_plan(as_file(document))

    assert (again.fence, again.rally, again.mission.home) == (plan.fence, plan.rally, plan.mission.home)
    for ours, its in zip(plan.mission.items, again.mission.items, strict=True):
        assert (ours.command, ours.frame) == (its.command, its.frame)
        assert its.params == pytest.approx(ours.params, nan_ok=True, rel=0)
    assert (document["mission"]["firmwareType"], document["mission"]["vehicleType"]) == (12, 2)


def _set(*path: Any, to: Any) -> Callable[[dict[str, Any]], None]:
    def change(document: dict[str, Any]) -> None:
        at: Any = document
        for step in path[:-1]:
            at = at[step]
        at[path[-1]] = to

    return change


ITEMS = ("mission", "items")
INNER = (*ITEMS, 1, "TransectStyleComplexItem", "Items")


@pytest.mark.parametrize(
    ("change", "where"),
    [
        (_set("fileType", to="Mission"), "fileType"), (_set("version", to=2), "version"),
        (_set("version", to=True), "version"), (_set("mission", to=None), "mission"),
        (_set("mission", "version", to=1), "mission.version"), (_set(*ITEMS, to={}), "mission.items"),
        (_set("mission", "plannedHomePosition", to=[47.0, 8.0]), "mission.plannedHomePosition"),
        (_set("mission", "plannedHomePosition", to=[97.0, 8.0, 0]), "mission.plannedHomePosition"),
        (_set(*ITEMS, 0, to=7), "mission.items[0]"), (_set(*ITEMS, 0, "type", to="Item"), "mission.items[0].type"),
        (_set(*ITEMS, 0, "command", to="16"), "mission.items[0].command"),
        (_set(*ITEMS, 0, "command", to=16.5), "mission.items[0].command"),
        (_set(*ITEMS, 0, "command", to=70000), "mission.items[0]"),
        (_set(*ITEMS, 0, "frame", to=None), "mission.items[0].frame"),
        (_set(*ITEMS, 0, "autoContinue", to=1), "mission.items[0].autoContinue"),
        (_set(*ITEMS, 0, "params", to=[0] * 6), "mission.items[0].params"),
        (_set(*ITEMS, 0, "params", to=[0] * 8), "mission.items[0].params"),
        (_set(*ITEMS, 0, "params", 4, to=190.0), "mission.items[0]"),
        (_set(*ITEMS, 0, "params", 4, to=True), "mission.items[0].params[4]"),
        (_set(*ITEMS, 0, "params", 4, to=10**400), "mission.items[0].params[4]"),
        (_set(*ITEMS, 2, "params", 0, to=6), "mission.items[2].params[0]"),
        (_set(*ITEMS, 3, "doJumpId", to=3), "mission.items[2].params[0]"),
        (_set(*ITEMS, 1, "TransectStyleComplexItem", to={}), "mission.items[1]"),
        (_set(*INNER, 1, "params", 5, to="east"), "mission.items[1].TransectStyleComplexItem.Items[1].params[5]"),
        (_set(*INNER, 0, "type", to="ComplexItem"), "mission.items[1].TransectStyleComplexItem.Items[0].type"),
        (_set("geoFence", "version", to=1), "geoFence.version"),
        (_set("geoFence", "polygons", 0, "inclusion", to=None), "geoFence.polygons[0].inclusion"),
        (_set("geoFence", "polygons", 0, "polygon", to=[[47, 8]]), "geoFence.polygons[0]"),
        (_set("geoFence", "polygons", 0, "polygon", 2, to=[47.0]), "geoFence.polygons[0].polygon[2]"),
        (_set("geoFence", "circles", 0, "circle", "radius", to=-3), "geoFence.circles[0].circle"),
        (_set("geoFence", "circles", 0, "circle", "center", to=[147, 8]), "geoFence.circles[0].circle"),
        (_set("geoFence", "breachReturn", to=[1, 2]), "geoFence.breachReturn"),
        (_set("rallyPoints", "points", 0, to=[47.0, 8.0]), "rallyPoints.points[0]"),
        (_set("rallyPoints", "version", to=None), "rallyPoints.version"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_told_with_its_place(change: Callable[[dict[str, Any]], None], where: str) -> None:
    document = plan_document()
    change(document)
    with pytest.raises(PlanFileError) as refused:
        read_plan(as_file(document))
    assert refused.value.where == where
    assert str(refused.value) == f"{where}: {refused.value.reason}"


@pytest.mark.parametrize(
    "data",
    [b"", b"{", b"[]", b"null", b"\xff\xfe", b'{"fileType": "Plan", "fileType": "Plan"}', b'{"a": NaN}',
     b'{"a": 1e999}', b"[" * 100_000, b'{"a": ' + b"9" * 5000 + b"}", b" " * (MAX_BYTES + 1), b"QGC WPL 120\n"],
)  # fmt: skip
def test_what_is_no_plan_at_all(data: bytes) -> None:
    with pytest.raises(PlanFileError):
        read_plan(data)


def test_limits() -> None:
    deep = '{"x": ' * 120 + "1" + "}" * 120
    text = json.dumps(plan_document())[:-1] + ', "deep": ' + deep + "}"
    with pytest.raises(PlanFileError, match="deeper than 100"):
        read_plan(text.encode())
    document = plan_document()
    document["mission"]["items"] = [simple(20, n, [0] * 7) for n in range(5001)]
    with pytest.raises(PlanFileError, match="at most 5000"):
        read_plan(as_file(document))


def test_a_waypoint_file() -> None:
    plan = read_plan(WAYPOINTS.replace("\n", "\r\n").encode())

    assert plan.mission.home == Home(47.39774, 8.545594, 488.0)
    assert [(item.command, item.frame) for item in plan.mission.items] == [(22, 3), (16, 3), (177, 2)]
    assert plan.mission.items[1].params[4:] == (47.4022336, 8.5522294, 80.0)
    assert plan.mission.items[2].params[0] == 2.0
    assert json.loads(write_plan(plan))["fileType"] == "Plan"


def test_a_waypoint_file_without_home_counts_from_its_first_item() -> None:
    lines = WAYPOINTS.splitlines()
    text = "\n".join(
        [lines[0], lines[2].replace("1", "0", 1), lines[4].replace("3", "1", 1).replace("177\t2", "177\t0")]
    )
    mission = read_plan(text.encode()).mission
    assert [(item.command, item.params[0]) for item in mission.items] == [(22, 15.0), (177, 1.0)]


@pytest.mark.parametrize(
    ("old", "new", "where"),
    [
        ("QGC WPL 110", "QGC WPL 100", "line 1"), ("\n2\t", "\n5\t", "line 4, column 1"),
        ("\t80\t1\n", "\t80\n", "line 4"), ("47.4022336", "north", "line 4, column 9"),
        ("47.4022336", "1_0", "line 4, column 9"), ("47.4022336", "147.4", "line 4"),
        ("\t22\t", "\t22.5\t", "line 3, column 4"),
        ("\t80\t1\n", "\t80\t2\n", "line 4"), ("177\t2", "177\t9", "line 5"), ("47.39774\t", "nan\t", "line 2"),
        ("60", "inf", "line 3, column 11"), ("60", "1e999", "line 3"),
    ],
)  # fmt: skip
def test_what_is_wrong_in_a_waypoint_file(old: str, new: str, where: str) -> None:
    assert old in WAYPOINTS
    with pytest.raises(PlanFileError) as refused:
        read_plan(WAYPOINTS.replace(old, new, 1).encode())
    assert refused.value.where == where


JSON_VALUES = st.recursive(
    st.none() | st.booleans() | st.floats() | st.integers() | st.text(max_size=5),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=5), inner, max_size=4),
)
PLACES = st.sampled_from([
    ("mission",), ITEMS, (*ITEMS, 0), (*ITEMS, 0, "params"), (*ITEMS, 1, "TransectStyleComplexItem"), ("geoFence",),
    ("geoFence", "polygons", 0), ("geoFence", "circles", 0, "circle"), ("rallyPoints",), ("rallyPoints", "points"),
])  # fmt: skip


@given(JSON_VALUES, PLACES)
@settings(deadline=None)
def test_no_value_anywhere_raises_anything_else(value: Any, path: tuple[Any, ...]) -> None:
    document = plan_document()
    _set(*path, to=value)(document)
    try:
        plan_of(document)
    except PlanFileError as error:
        assert error.where


def test_warnings_name_what_lies_outside_of_the_fence() -> None:
    document = plan_document()
    document["mission"]["items"][0]["params"][4] = 47.5
    document["rallyPoints"]["points"][0][:2] = [47.405, 8.545]
    polygon = document["geoFence"]["polygons"][0]["polygon"]
    found = plan_of(document).warnings(InclusionRule.ALL)
    assert [text.split(" lies")[0] for text in found] == ["item 1", "rally point 1"]
    polygon[1], polygon[2] = polygon[2], polygon[1]
    assert "crosses itself" in plan_of(document).warnings(InclusionRule.ALL)[0]


def test_plans_are_kept_over_a_restart_and_spoilt_ones_told(tmp_path: Path) -> None:
    shelf = PlanShelf(tmp_path / "plans")
    with pytest.raises(NoPlanError):
        shelf.get("1")
    plan = read_plan(as_file(plan_document()))
    shelf.keep("1", plan)
    assert PlanShelf(tmp_path / "plans").get("1").document == plan.document
    (tmp_path / "plans" / "vehicle-1.plan").write_bytes(b"{")
    with pytest.raises(PlanFileError, match=r"kept plan 'vehicle-1\.plan'"):
        shelf.get("1")
    shelf.remove("1")
    shelf.remove("1")
    assert shelf.find("1") is None
