"""Bodies about the landing pad and landing on it."""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import BaseModel, ConfigDict, Field

Point = tuple[float, float]
PageName = Annotated[str, Field(min_length=1, max_length=64)]


class RingBody(BaseModel):
    """A ring of the pad: centre in the pad's frame (x ahead, y right), radii, and which triple, 0 the largest."""

    x_m: float
    y_m: float
    outer_m: float
    inner_m: float
    triple: int


class TagBody(BaseModel):
    """A tag of the pad: centre in the pad's frame and the side of its black square."""

    number: int
    x_m: float
    y_m: float
    side_m: float


class PadBody(BaseModel):
    """The landing pad that is looked for; ``description`` is its file."""

    name: str
    kind: Literal["circles", "tags"]
    rings: list[RingBody]
    tags: list[TagBody]
    description: dict[str, Any]


class SeenBody(BaseModel):
    """The pad in one picture: where its outlines lie in a picture of ``width_px`` by ``height_px``.

    ``triple`` is the largest that was used, -1 for tags; ``seen_share`` of the edges foretold was there.
    """

    frame_id: int
    t_frame_unix_us: int
    width_px: int
    height_px: int
    triple: int
    seen_share: float
    outlines_px: list[list[Point]]


class AidingBody(BaseModel):
    """LANDING_TARGET to the autopilot: asked for, in which form, whether it goes out now, and else why not."""

    on: bool
    form: Literal["body", "local"] | None
    sending: bool
    sent: int
    reason: str


class GazeBody(BaseModel):
    """A pan-tilt camera kept on the pad: asked for, and why it is not pointed; null where the camera cannot turn."""

    on: bool
    reason: str


class DescentBody(BaseModel):
    """The landing that the station flies, or flew last: how far, and why it holds or has ended.

    ``hold``: it was ended in the air, and the station keeps the vehicle still over the ground until that is ended too.
    """

    active: bool
    phase: Literal["approach", "descend", "touchdown", "landed", "abort", "hold"]
    reason: str
    set_point_ned_m_s: tuple[float, float, float] | None


class LandingBody(BaseModel):
    """Where a vehicle is relative to the pad; null where it is not known.

    ``north_m``, ``east_m`` and ``height_m`` lead from the pad's centre to the vehicle, ``ahead_m`` and ``right_m`` from
    the vehicle to the pad as the vehicle heads; ``x_m``, ``y_m`` are the vehicle's place in the pad's frame.
    ``outlines_px`` is where the estimate has the pad's outlines in a picture of this time, of the size in ``seen``.
    Standard deviations are one sigma, ``std_horizontal_m`` along the worst direction. ``age_s`` counts from the last
    picture that showed the pad; ``reason`` says why the newest was not used. ``coast_left_s`` is how long dead
    reckoning stays good enough to land by, if the velocity stays as wrong as it may be.
    """

    model_config = ConfigDict(extra="forbid")

    vehicle_id: str
    t_state_unix_us: int | None
    pad: str | None
    mode: Literal["searching", "tracking", "dead_reckoning", "lost"] | None
    reason: str
    age_s: float | None
    north_m: float | None
    east_m: float | None
    height_m: float | None
    sink_m_s: float | None
    speed_m_s: float | None
    ahead_m: float | None
    right_m: float | None
    x_m: float | None
    y_m: float | None
    heading_on_pad_deg: float | None
    std_horizontal_m: float | None
    std_height_m: float | None
    std_velocity_m_s: float | None
    outlines_px: list[list[Point]] | None
    seen: SeenBody | None
    coast_left_s: float | None
    aiding: AidingBody
    descent: DescentBody | None
    gaze: GazeBody | None


class LandingRequest(BaseModel):
    """What to begin or to end. What is begun ends with the page: ``page`` is the name it opened the stream under."""

    model_config = ConfigDict(extra="forbid")

    page: PageName | None = None
    aiding: bool | None = None
    gaze: bool | None = None
    land: Literal[True] | None = None
    abort: Literal[True] | None = None
