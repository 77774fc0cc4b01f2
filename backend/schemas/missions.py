"""Bodies about mission plans."""

from __future__ import annotations

import math
from typing import Literal

from pydantic import BaseModel, ConfigDict, Field

from backend.link.dialect import command_name
from backend.missions.plan import Plan
from guidance.geofence import InclusionRule
from guidance.mission import MissionItem, MissionType

PartName = Literal["mission", "fence", "rally"]


class HomeBody(BaseModel):
    """A place on WGS-84."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


class MissionItemBody(BaseModel):
    """An item: ``params`` are parameters 1 to 7, null where the vehicle chooses; ``alt_m`` counts from ``datum``."""

    number: int
    command: int
    name: str
    frame: int
    params: list[float | None]
    auto_continue: bool
    lat_deg: float | None
    lon_deg: float | None
    alt_m: float | None
    datum: Literal["amsl", "home", "ground"] | None


class VertexBody(BaseModel):
    """A corner of a polygon."""

    lat_deg: float
    lon_deg: float


class FencePolygonBody(BaseModel):
    """A polygon to stay inside of, or outside of."""

    inclusion: bool
    vertices: list[VertexBody]


class FenceCircleBody(BaseModel):
    """A circle to stay inside of, or outside of."""

    inclusion: bool
    lat_deg: float
    lon_deg: float
    radius_m: float


class RallyPointBody(BaseModel):
    """A place to wait or land at instead of home."""

    lat_deg: float
    lon_deg: float
    alt_rel_m: float


class PlanBody(BaseModel):
    """The plan kept for a vehicle; ``warnings`` are what an operator should look at before it is sent."""

    vehicle_id: str
    home: HomeBody | None
    items: list[MissionItemBody]
    polygons: list[FencePolygonBody]
    circles: list[FenceCircleBody]
    breach_return: HomeBody | None
    rally: list[RallyPointBody]
    warnings: list[str]


class UploadRequest(BaseModel):
    """What to send of the plan: all that it has when ``parts`` is not given. A part that is named and empty clears."""

    model_config = ConfigDict(extra="forbid")

    parts: list[PartName] | None = Field(default=None, min_length=1, max_length=3)


class DownloadRequest(BaseModel):
    """Whether what the vehicle holds may replace the kept plan."""

    model_config = ConfigDict(extra="forbid")

    replace: bool = False


def kinds_of(parts: list[PartName]) -> list[MissionType]:
    """Parts as MAVLink numbers them, in its order."""
    named = {MissionType[name.upper()] for name in parts}
    return [kind for kind in MissionType if kind in named]


def plan_body(vehicle_id: str, plan: Plan, rule: InclusionRule) -> PlanBody:
    """A plan as the API shows it."""
    home, breach = (
        None if at is None else HomeBody(lat_deg=at.lat_deg, lon_deg=at.lon_deg, alt_amsl_m=at.alt_amsl_m)
        for at in (plan.mission.home, plan.fence.breach_return)
    )
    return PlanBody(
        vehicle_id=vehicle_id, home=home, breach_return=breach, warnings=plan.warnings(rule),
        items=[_item_body(item, number) for number, item in enumerate(plan.mission.items, 1)],
        polygons=[
            FencePolygonBody(
                inclusion=zone.inclusion,
                vertices=[VertexBody(lat_deg=lat_deg, lon_deg=lon_deg) for lat_deg, lon_deg in zone.vertices_deg],
            )
            for zone in plan.fence.polygons
        ],
        circles=[
            FenceCircleBody(
                inclusion=zone.inclusion, lat_deg=zone.lat_deg, lon_deg=zone.lon_deg, radius_m=zone.radius_m
            )
            for zone in plan.fence.circles
        ],
        rally=[RallyPointBody(lat_deg=p.lat_deg, lon_deg=p.lon_deg, alt_rel_m=p.alt_rel_m) for p in plan.rally],
    )  # fmt: skip


def _item_body(item: MissionItem, number: int) -> MissionItemBody:
    lat_deg, lon_deg = item.place_deg or (None, None)
    datum = item.datum
    return MissionItemBody(
        number=number, command=item.command, name=command_name(item.command), frame=item.frame,
        params=[None if math.isnan(value) else value for value in item.params], auto_continue=item.auto_continue,
        lat_deg=lat_deg, lon_deg=lon_deg, alt_m=item.alt_m, datum=None if datum is None else datum.value,
    )  # fmt: skip
