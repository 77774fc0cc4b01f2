"""Bodies about flying home by the estimate."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field

from backend.schemas.landing import PageName

Latitude = Annotated[float, Field(ge=-90.0, le=90.0, allow_inf_nan=False)]
Longitude = Annotated[float, Field(ge=-180.0, le=180.0, allow_inf_nan=False)]


class PlaceBody(BaseModel):
    """A place on WGS-84."""

    model_config = ConfigDict(extra="forbid")

    lat_deg: Latitude
    lon_deg: Longitude


class HomingRequest(BaseModel):
    """Fly home, see the way, or end it. A flight stands still when the page that began it goes away.

    Without ``home`` it is the vehicle's own. It is flown over the places of ``via`` in their order, at ``alt_amsl_m``;
    without that, at the present height, and ``clearance_m`` above the highest ground below and beside the way at least.
    ``land`` false has it stay over home. ``when_lost`` says what the autopilot is told where the estimate is lost and
    does not come back: hold by itself, or land where it is.
    """

    model_config = ConfigDict(extra="forbid")

    action: Literal["preview", "fly", "abort"]
    page: PageName | None = None
    home: PlaceBody | None = None
    via: Annotated[list[PlaceBody], Field(max_length=100)] = Field(default_factory=list)
    speed_m_s: Annotated[float, Field(ge=1.0, le=20.0, allow_inf_nan=False)] = 8.0
    alt_amsl_m: Annotated[float, Field(ge=-500.0, le=9000.0, allow_inf_nan=False)] | None = None
    clearance_m: Annotated[float, Field(ge=10.0, le=500.0, allow_inf_nan=False)] = 50.0
    land: bool = True
    when_lost: Literal["hold", "land"] = "hold"


class LineBody(BaseModel):
    """A GeoJSON line: longitude, latitude and height above mean sea level."""

    type: Literal["LineString"] = "LineString"
    coordinates: list[list[float]]


class WayBody(BaseModel):
    """The way home. ``ground_amsl_m`` is the highest ground below and beside it, null where none is known."""

    geometry: LineBody
    home: PlaceBody
    length_m: float
    seconds: float
    alt_amsl_m: float
    ground_amsl_m: float | None
    speed_m_s: float
    land: bool
    when_lost: Literal["hold", "land"]


class HomingBody(BaseModel):
    """The flight home of a vehicle, or its last; ``phase`` null and inactive where there was none.

    ``wait``: the estimate is not good enough to go on by, and the vehicle stands by its velocity. ``hold``: the flight
    was ended in the air, and the station keeps the vehicle still over the ground until that is ended too.
    """

    vehicle_id: str
    active: bool
    phase: (
        Literal["climb", "follow", "arrive", "descend", "touchdown", "wait", "landed", "abort", "hold"] | None
    )  # fmt: skip
    reason: str
    way: WayBody | None
    remaining_m: float | None
    to_home_m: float | None
    std_horizontal_m: float | None
    set_point_ned_m_s: list[float] | None
