"""What is flown: built-in scenarios and TOML files, checked at the edge."""

from __future__ import annotations

import tomllib
from pathlib import Path
from typing import Annotated, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera, Mount
from estimator.landing.pad import CirclePad, circle_pad
from simulator.errors import ScenarioError
from simulator.world.world import WorldSpec

Positive = Annotated[float, Field(gt=0, allow_inf_nan=False)]
NotNegative = Annotated[float, Field(ge=0, allow_inf_nan=False)]
Finite = Annotated[float, Field(allow_inf_nan=False)]
Interval = tuple[NotNegative, Positive]


class _Section(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class WorldSection(_Section):
    """Where the world lies and how it is made."""

    lat_deg: Annotated[float, Field(ge=-75, le=75)] = 58.49
    lon_deg: Annotated[float, Field(ge=-179, le=179)] = 15.62
    alt_amsl_m: Annotated[float, Field(ge=-400, le=4000)] = 84.0
    half_size_m: Annotated[float, Field(ge=150, le=900)] = 600.0
    gsd_m: Annotated[float, Field(ge=0.1, le=1.0)] = 0.2
    relief_m: Annotated[float, Field(ge=0, le=120)] = 26.0
    changed_share: Annotated[float, Field(ge=0, le=1)] = 0.08
    reference_gsd_m: Annotated[float, Field(ge=0.2, le=4)] = 0.5

    def spec(self, seed: int) -> WorldSpec:
        """The specification of this world for a seed."""
        return WorldSpec(seed=seed, **self.model_dump())


class CameraSection(_Section):
    """The camera: ``fixed`` to the airframe, or in a gimbal.

    A ``pan_tilt`` gimbal starts at the mount's angles; in a ``stabilised`` one the mount's roll and pitch are relative
    to the horizon and its yaw to the body.
    """

    gimbal: Literal["fixed", "stabilised", "pan_tilt"] = "fixed"

    width_px: Annotated[int, Field(ge=64, le=4096, multiple_of=2)] = 640
    height_px: Annotated[int, Field(ge=64, le=4096, multiple_of=2)] = 480
    hfov_deg: Annotated[float, Field(ge=10, le=100)] = 60.0
    distortion: tuple[Finite, Finite, Finite, Finite, Finite] = (-0.09, 0.03, 0.0004, -0.0003, 0.0)
    frames_per_s: Annotated[float, Field(ge=1, le=50)] = 25.0
    bitrate: Annotated[int, Field(ge=100_000, le=50_000_000)] = 2_500_000
    mount_rpy_deg: tuple[Finite, Finite, Finite] = (0.0, -90.0, 0.0)
    lever_arm_frd_m: tuple[Finite, Finite, Finite] = (0.35, 0.0, 0.15)
    noise_std: NotNegative = 2.4
    vignetting: Annotated[float, Field(ge=0, le=0.9)] = 0.28

    def intrinsics(self) -> Camera:
        """The lens without the mount."""
        plain = Camera.from_hfov(self.width_px, self.height_px, float(np.radians(self.hfov_deg)))
        return Camera(
            *(plain.width_px, plain.height_px, plain.fx_px, plain.fy_px, plain.cx_px, plain.cy_px), self.distortion
        )

    def mount(self) -> Mount:
        """How the camera sits on the airframe."""
        roll, pitch, yaw = np.radians(self.mount_rpy_deg).tolist()
        return Mount(roll, pitch, yaw, np.array(self.lever_arm_frd_m))


class VehicleSection(_Section):
    """What flies. ``airframe`` is of a fixed wing, which flies at its own airspeed, whatever the flight's speed."""

    type: Literal["helicopter", "multirotor", "fixed_wing", "rmax"] = "helicopter"
    airframe: Literal["osprey", "ping_wing"] = "osprey"


class FlightSection(_Section):
    """The closed route and the air it is flown in."""

    speed_m_s: Annotated[float, Field(gt=0, le=20)] = 11.0
    height_agl_m: tuple[Positive, Positive] = (100.0, 128.0)
    waypoints: Annotated[int, Field(ge=4, le=40)] = 11
    hover_stops: Annotated[int, Field(ge=0, le=10)] = 3
    hover_s: NotNegative = 7.0
    wind_m_s: NotNegative = 3.5
    gust_std_m_s: NotNegative = 0.9
    by_belief: bool = False
    """Guided flight, loiter and landing go by the autopilot's own position and velocity, which drift without GPS."""

    @model_validator(mode="after")
    def _heights_rise(self) -> FlightSection:
        if self.height_agl_m[0] > self.height_agl_m[1]:
            message = f"height_agl_m {list(self.height_agl_m)} runs from high to low"
            raise ValueError(message)
        return self


class PadSection(_Section):
    """A landing pad on the ground near the world's middle, and the approach to it.

    The flight then is a circle of ``circle_m`` radius that comes by the pad at ``height_m`` and ``away_m`` beside it,
    and waits there.
    """

    side_m: Annotated[float, Field(ge=0.1, le=20)] = 1.5
    radius_m: Annotated[float, Field(ge=0.02, le=5)] = 0.3
    triples: Annotated[int, Field(ge=1, le=4)] = 4
    height_m: Annotated[float, Field(ge=3, le=60)] = 20.0
    away_m: NotNegative = 4.0
    circle_m: Annotated[float, Field(ge=8, le=80)] = 12.0

    @model_validator(mode="after")
    def _can_be_printed(self) -> PadSection:
        try:
            self.pad()
        except GeometryError as error:
            raise ValueError(str(error)) from error
        return self

    def pad(self) -> CirclePad:
        """What is on the print."""
        return circle_pad("pad", self.side_m, self.radius_m, self.triples)


class SensorSection(_Section):
    """Errors of the sensors; the inertial ones default to table 5.1 of Conte (2009)."""

    accelerometer_bias_max_m_s2: NotNegative = 0.127
    accelerometer_noise_m_s2: NotNegative = 0.05
    accelerometer_walk_m_s2_sqrt_s: NotNegative = 2e-4
    gyro_bias_max_rad_s: NotNegative = 1.7e-3
    gyro_noise_rad_s: NotNegative = 3.5e-3
    gyro_walk_rad_s_sqrt_s: NotNegative = 1e-5
    barometer_noise_m: NotNegative = 0.15
    barometer_drift_m: NotNegative = 1.2
    weather_offset_m: Finite = 21.0
    gnss_horizontal_m: NotNegative = 0.8
    gnss_vertical_m: NotNegative = 1.5
    tilt_error_deg: NotNegative = 0.5
    heading_error_deg: NotNegative = 1.5


class Scenario(_Section):
    """A whole scenario; times of intervals are seconds from its start."""

    name: str = "demo"
    duration_s: Positive = 660.0
    start_unix_us: Annotated[int, Field(ge=0)] = 1_760_000_000_000_000
    vehicle_clock_offset_s: Finite = 0.0
    system_id: Annotated[int, Field(ge=1, le=254)] = 1
    gps_denied_s: tuple[Interval, ...] = ((30.0, 630.0),)
    gps_cut_s: tuple[Interval, ...] = ()
    vehicle: VehicleSection = VehicleSection()
    world: WorldSection = WorldSection()
    camera: CameraSection = CameraSection()
    flight: FlightSection = FlightSection()
    sensors: SensorSection = SensorSection()
    pad: PadSection | None = None

    @model_validator(mode="after")
    def _intervals_run_forward(self) -> Scenario:
        for start, end in (*self.gps_denied_s, *self.gps_cut_s):
            if start >= end:
                message = f"interval [{start}, {end}] does not end after its start"
                raise ValueError(message)
        if self.world.half_size_m < 1.35 * self.flight.height_agl_m[1]:
            message = (
                f"a world of {2 * self.world.half_size_m:.0f} m is too small for a flight at "
                f"{self.flight.height_agl_m[1]:.0f} m above ground"
            )
            raise ValueError(message)
        if self.pad is not None and self.vehicle.type in ("fixed_wing", "rmax"):
            message = f"a {self.vehicle.type} cannot stand on a pad: use a helicopter or a multirotor"
            raise ValueError(message)
        return self


_PAD = Scenario(
    name="pad",
    duration_s=120.0,
    # Long enough to find north and the biases; from then on GPS is off for good.
    gps_denied_s=((14.0, 1e6),),
    gps_cut_s=((14.0, 1e6),),
    world=WorldSection(half_size_m=200.0),
    camera=CameraSection(hfov_deg=43.6, gimbal="pan_tilt"),
    flight=FlightSection(
        speed_m_s=3.0, height_agl_m=(20.0, 26.0), hover_stops=1, hover_s=3600.0, wind_m_s=4.0, gust_std_m_s=1.5,
        by_belief=True,
    ),
    pad=PadSection(),
)  # fmt: skip

SCENARIOS: dict[str, Scenario] = {"demo": Scenario(), "pad": _PAD}


def load_scenario(name_or_path: str) -> Scenario:
    """A built-in scenario by name, or one from a TOML file.

    Raises
    ------
    ScenarioError
        Neither exists, or the file says something that cannot be flown.
    """
    if name_or_path in SCENARIOS:
        return SCENARIOS[name_or_path]
    path = Path(name_or_path)
    known = ", ".join(sorted(SCENARIOS))
    if not path.is_file():
        raise ScenarioError(name_or_path, "no such scenario or file", f"use one of: {known}, or a TOML file")
    try:
        data = tomllib.loads(path.read_text(encoding="utf-8"))
        return Scenario.model_validate({"name": path.stem, **data})
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise ScenarioError(name_or_path, f"is not TOML ({error})", "correct the line it names") from error
    except OSError as error:
        raise ScenarioError(name_or_path, f"cannot be read ({error.strerror})", "check the file's rights") from error
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"]) or "scenario"
        raise ScenarioError(name_or_path, f"{place}: {first['msg']}", "correct this value") from error
