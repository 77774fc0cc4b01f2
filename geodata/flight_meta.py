"""The schema of ``flight.json``: what a flight folder says about itself.

Unknown keys are kept, null counts as absent except for ``video.time_offset_s``, where it means unknown.
"""

from __future__ import annotations

from typing import Annotated, Any, ClassVar, Literal

from pydantic import BaseModel, ConfigDict, Field, field_validator, model_validator

SCHEMA = "pilotage.flight/1"

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]


class _Section(BaseModel):
    model_config = ConfigDict(extra="allow", frozen=True, populate_by_name=True)

    null_means_unknown: ClassVar[frozenset[str]] = frozenset()

    @model_validator(mode="before")
    @classmethod
    def _null_is_absent(cls, data: Any) -> Any:
        if not isinstance(data, dict):
            return data
        return {key: value for key, value in data.items() if value is not None or key in cls.null_means_unknown}


class VehicleMeta(_Section):
    """The aircraft; ``system_id`` is its MAVLink system, absent when any will do."""

    type: Literal["helicopter", "multirotor", "fixed_wing"] = "multirotor"
    system_id: Annotated[int, Field(ge=1, le=255)] | None = None


class MountMeta(_Section):
    """Euler angles (z-y-x) of the gimbal frame relative to the body, and where the camera sits."""

    roll_deg: Finite = 0.0
    pitch_deg: Finite = -90.0
    yaw_deg: Finite = 0.0
    lever_arm_frd_m: tuple[Finite, Finite, Finite] = (0.0, 0.0, 0.0)


class CameraMeta(_Section):
    """A pinhole with Brown-Conrady distortion (k1, k2, p1, p2, k3); pixel (0, 0) is the centre of the first one."""

    width_px: Annotated[int, Field(ge=16, le=16384)]
    height_px: Annotated[int, Field(ge=16, le=16384)]
    fx_px: Positive
    fy_px: Positive
    cx_px: Finite
    cy_px: Finite
    distortion: tuple[Finite, Finite, Finite, Finite, Finite] = (0.0, 0.0, 0.0, 0.0, 0.0)
    mount: MountMeta = MountMeta()
    gimbal: Literal["fixed", "stabilised", "pan_tilt"] = "fixed"

    @model_validator(mode="before")
    @classmethod
    def _centre_and_square_pixels(cls, data: Any) -> Any:
        """Without a principal point it is the picture's centre; without fy the pixels are square."""
        if not isinstance(data, dict):
            return data
        data = {key: value for key, value in data.items() if value is not None}
        for centre, size in (("cx_px", "width_px"), ("cy_px", "height_px")):
            if isinstance(data.get(size), int):
                data.setdefault(centre, (data[size] - 1) / 2)
        if "fx_px" in data:
            data.setdefault("fy_px", data["fx_px"])
        return data

    @field_validator("distortion", mode="before")
    @classmethod
    def _short_distortion(cls, value: Any) -> Any:
        if isinstance(value, (list, tuple)) and len(value) < 5:
            return [*value, *([0.0] * (5 - len(value)))]
        return value

    @model_validator(mode="after")
    def _centre_in_picture(self) -> CameraMeta:
        if not (-self.width_px < self.cx_px < 2 * self.width_px and -self.height_px < self.cy_px < 2 * self.height_px):
            message = (
                f"principal point ({self.cx_px}, {self.cy_px}) lies far outside the "
                f"{self.width_px} x {self.height_px} picture"
            )
            raise ValueError(message)
        return self


class VideoMeta(_Section):
    """The video; ``time_offset_s`` is added to frame times, None when it is unknown and to be estimated."""

    null_means_unknown: ClassVar[frozenset[str]] = frozenset({"time_offset_s"})

    file: str | None = None
    start_time_us: Annotated[int, Field(ge=0)] | None = None
    time_offset_s: Annotated[float, Field(ge=-3600, le=3600, allow_inf_nan=False)] | None = 0.0


class MapMeta(_Section):
    """The reference map; ``offset_ne_m`` is added to every position read off the picture."""

    reference: str | None = None
    offset_ne_m: tuple[Finite, Finite] = (0.0, 0.0)
    elevation: str | None = None
    ground_alt_amsl_m: Annotated[float, Field(ge=-1000, le=10000, allow_inf_nan=False)] | None = None


class HomeMeta(_Section):
    """Where the autopilot calls home."""

    lat_deg: Annotated[float, Field(ge=-90, le=90, allow_inf_nan=False)]
    lon_deg: Annotated[float, Field(ge=-180, le=180, allow_inf_nan=False)]
    alt_amsl_m: Annotated[float, Field(ge=-1000, le=20000, allow_inf_nan=False)]


class FlightMeta(_Section):
    """The whole of ``flight.json``.

    ``camera`` is None where a flight was recorded without one; ``gps_denied`` holds (start, end) in Unix microseconds.
    """

    schema_version: Literal["pilotage.flight/1"] = Field(default="pilotage.flight/1", alias="schema")
    name: str = ""
    vehicle: VehicleMeta = VehicleMeta()
    camera: CameraMeta | None = None
    video: VideoMeta = VideoMeta()
    map: MapMeta = MapMeta()
    gps_denied: tuple[tuple[int, int], ...] = ()
    home: HomeMeta | None = None
    pad: dict[str, Any] | None = None

    @model_validator(mode="before")
    @classmethod
    def _schema_is_named(cls, data: Any) -> Any:
        if isinstance(data, dict) and not ({"schema", "schema_version"} & data.keys()):
            message = f'no "schema" key: expected "schema": "{SCHEMA}"'
            raise ValueError(message)
        return data

    @field_validator("gps_denied")
    @classmethod
    def _intervals_run_forward(cls, intervals: tuple[tuple[int, int], ...]) -> tuple[tuple[int, int], ...]:
        for start_us, end_us in intervals:
            if start_us >= end_us:
                message = f"interval [{start_us}, {end_us}] does not end after its start"
                raise ValueError(message)
        return intervals
