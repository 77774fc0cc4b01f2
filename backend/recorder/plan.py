"""What a recording says of its flight, from what the station knows when it begins."""

from __future__ import annotations

import math
from typing import Any

from backend.clock import unix_us
from backend.fleet.vehicle import LiveVehicle
from backend.navigation.setup import CameraProfile, MapFiles
from backend.recorder.folder import RecordingPlan
from estimator.landing.pad import Pad
from geodata.flight_meta import HomeMeta, VehicleMeta
from geodata.pad_file import as_description

KNOWN_TYPES = ("helicopter", "multirotor", "fixed_wing")


def plan_of(
    vehicle: LiveVehicle | None, profile: CameraProfile | None, files: MapFiles | None, gps_denied: bool,
    time_offset_s: float | None, pad: Pad | None = None,
) -> RecordingPlan:  # fmt: skip
    """The plan of a recording that begins now. None is what is not known; ``time_offset_s`` is as configured."""
    facts: dict[str, Any] = {} if vehicle is None else {"system_id": vehicle.system_id}
    if vehicle is not None and vehicle.telemetry.vehicle_type in KNOWN_TYPES:
        facts["type"] = vehicle.telemetry.vehicle_type
    home = None if vehicle is None else vehicle.home
    return RecordingPlan(
        vehicle=VehicleMeta(**facts),
        camera=None if profile is None else profile.camera,
        home=None if home is None else HomeMeta(
            lat_deg=math.degrees(home.lat_rad), lon_deg=math.degrees(home.lon_rad), alt_amsl_m=home.alt_amsl_m,
        ),
        reference=None if files is None else files.reference,
        elevation=None if files is None else files.elevation,
        map_offset_ne_m=(0.0, 0.0) if profile is None else profile.map.offset_ne_m,
        ground_alt_amsl_m=None if profile is None else profile.map.ground_alt_amsl_m,
        gps_denied=gps_denied,
        t_start_us=unix_us(),
        # what was configured is in the frame times already
        time_offset_s=None if time_offset_s is None else 0.0,
        pad=None if pad is None else as_description(pad),
    )  # fmt: skip
