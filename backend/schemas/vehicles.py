"""Bodies about vehicles, recording, flights and replays."""

from __future__ import annotations

from typing import Annotated, Literal

from pydantic import BaseModel, ConfigDict, Field, model_validator


class _Body(BaseModel):
    model_config = ConfigDict(extra="forbid")


class VehicleBody(BaseModel):
    """A vehicle in the list."""

    model_config = ConfigDict(extra="allow")

    id: str
    vehicle_type: str | None
    simulated: bool
    connected: bool
    replay: bool
    video_source: str | None


class VideoClockBody(_Body):
    """The offset between the video's clock and the telemetry's; ``time_offset_s`` is added to frame times.

    ``std_s`` is None where nobody has measured it, both are while it is ``searching``; ``reason`` says what is lacking.
    """

    source: Literal["given", "stamped", "searching", "found"]
    time_offset_s: float | None
    std_s: float | None = Field(ge=0)
    reason: str


Axes = Annotated[list[float | None], Field(min_length=3, max_length=3)]


class StateBody(BaseModel):
    """The fields of the stream's ``state`` message; described here as far as they are not plain numbers.

    ``boresight_deg`` is from the stated mount to the true one, about x, y, z of the body or of the gimbal's frame.
    """

    model_config = ConfigDict(extra="allow")

    vehicle_id: str
    t_state_unix_us: int
    epoch: int
    mode: Literal["gps", "vision", "dead_reckoning", "lost"]
    gps_denied: bool
    video_clock: VideoClockBody | None
    boresight_deg: Axes | None
    boresight_std_deg: Axes | None


class NavigationBody(_Body):
    """What the estimator may use, and whether the autopilot is told where the vehicle is: what is named is changed.

    ``aiding`` ends with the ``page`` that began it, which names itself when it opens the stream.
    """

    gps_denied: bool | None = None
    aiding: Literal["off", "external_position", "odometry", "gps_input", "global_position_sensor"] | None = None
    page: str | None = Field(default=None, min_length=1, max_length=64)

    @model_validator(mode="after")
    def _says_something(self) -> NavigationBody:
        if self.gps_denied is None and self.aiding is None:
            message = "nothing to change: give gps_denied or aiding"
            raise ValueError(message)
        return self


class NavigationAnswer(_Body):
    """How it is now."""

    gps_denied: bool
    aiding: Literal["off", "external_position", "odometry", "gps_input", "global_position_sensor"]


class CommandBody(_Body):
    """A command to a vehicle; ``lat_deg``, ``lon_deg`` for goto and orbit, ``alt_rel_m`` for those and takeoff.

    ``orbit`` goes round the place at ``radius_m``, clockwise as seen from above unless ``clockwise`` is false.
    ``start_mission`` flies the mission that the vehicle holds, from its first item.

    ``track_point`` has a camera that can follow what a pixel (``u_px``, ``v_px``) of a frame (``frame_id``) shows;
    ``track_stop`` ends that.
    """

    command: Literal[
        "arm", "disarm", "takeoff", "goto", "orbit", "hold", "return", "land", "start_mission", "inject_failure",
        "track_point", "track_stop",
    ]  # fmt: skip
    unit: Literal["gps"] | None = None
    failure: Literal["off", "ok"] | None = None
    lat_deg: float | None = Field(default=None, ge=-90, le=90)
    lon_deg: float | None = Field(default=None, ge=-180, le=180)
    alt_rel_m: float | None = Field(default=None, ge=0, le=5000)
    radius_m: float | None = Field(default=None, ge=5, le=2000)
    clockwise: bool | None = None
    frame_id: int | None = Field(default=None, ge=0)
    u_px: float | None = Field(default=None, allow_inf_nan=False)
    v_px: float | None = Field(default=None, allow_inf_nan=False)


class CommandAccepted(BaseModel):
    """The command was sent; an ``ack`` message with its id follows on the stream."""

    command_id: str


class RecordingRequest(_Body):
    """Start or stop recording."""

    active: bool
    name: str | None = Field(default=None, max_length=100)


class RecordingBody(BaseModel):
    """What the recorder does."""

    active: bool
    flight_id: str | None
    duration_s: float
    bytes: int


class FlightBody(BaseModel):
    """A flight in the list; ``problem`` says why it cannot be used."""

    id: str
    name: str
    start_unix_us: int | None
    duration_s: float | None
    bytes: int
    has_video: bool
    has_truth: bool
    read_only: bool
    recording: bool
    warnings: list[str]
    problem: str | None


class ReplayRequest(_Body):
    """How to replay a flight."""

    speed: float = Field(default=1.0, ge=0.1, le=16)
    start_s: float = Field(default=0.0, ge=0, allow_inf_nan=False)


class ReplayChange(_Body):
    """What to change of a running replay."""

    paused: bool | None = None
    speed: float | None = Field(default=None, ge=0.1, le=16)
    seek_unix_us: int | None = Field(default=None, ge=0)


class ReplayBody(BaseModel):
    """Where a replay stands."""

    vehicle_id: str
    flight_id: str
    t_unix_us: int
    start_unix_us: int
    end_unix_us: int
    speed: float
    paused: bool
    ended: bool
    progress: float | None = None


class MapBounds(BaseModel):
    """Where a map lies."""

    south_deg: float
    west_deg: float
    north_deg: float
    east_deg: float


class MapBody(BaseModel):
    """A map of the library."""

    id: str
    name: str
    kind: str
    gsd_m: float | None
    bounds: MapBounds
    crs: str
    bands: int
    size: list[int]
    source_file: str | None


class MatchabilityRequest(BaseModel):
    """What a picture shows (its side on the ground) and how far off the position may be."""

    footprint_m: float = Field(default=100.0, ge=5.0, le=5000.0)
    radius_m: float = Field(default=40.0, ge=5.0, le=2000.0)


class MatchabilityBody(BaseModel):
    """How well a map can be matched; shares are of its places, sigma is along the worst axis."""

    map_id: str
    footprint_m: float
    radius_m: float
    step_m: float
    places: int
    median_sigma_m: float | None
    share_good: float
    share_ambiguous: float
    share_weak: float
