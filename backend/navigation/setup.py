"""What a vehicle's estimator is built from: camera, map, ground, local frame."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import ValidationError

from backend.errors import StartError
from backend.settings import describe_validation
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.local import LocalFrame
from estimator.landing.pad import Pad
from estimator.measurements.pad_tracking import SurveyedPlace
from estimator.navigator import Navigator, NavigatorConfig
from estimator.ports import GroundModel, ReferenceMap
from estimator.types import NavigationState
from geodata.elevation import ElevationGrid, FlatGround
from geodata.flight_meta import CameraMeta, FlightMeta, MapMeta, VehicleMeta
from geodata.imagery import NeBounds, ReferenceImagery
from geodata.raster import open_raster

MAX_REFERENCE_PIXELS = 64_000_000
REACH_M = 6_000.0  # how far from the local frame's origin a large map is read
FLAT_GROUND_STD_M = 10.0
FLAT_GROUND_LENGTH_M = 400.0  # land that is taken for flat rolls over such distances
TERRAIN_STD_M = 2.0
UNKNOWN_SLOPE_STD = 0.03  # of land that is taken for level
POSTING_SHARE = 0.1  # of an elevation model's posting is its own error: 3 m at 30 m


@dataclass(frozen=True, slots=True)
class CameraProfile:
    """What ``--camera`` says: the camera with its mount, and the map section if the file has one."""

    camera: CameraMeta
    map: MapMeta
    vehicle: VehicleMeta | None


@dataclass(frozen=True, slots=True)
class Place:
    """A position that is known roughly."""

    lat_rad: float
    lon_rad: float
    alt_amsl_m: float


@dataclass(frozen=True, slots=True)
class FileUsed:
    """A map or elevation file as it was when it was read; another size or time later is another file."""

    role: Literal["reference", "elevation"]
    path: Path
    size_bytes: int
    mtime_ns: int

    @classmethod
    def of(cls, role: Literal["reference", "elevation"], path: Path | None) -> FileUsed | None:
        """A file as it is now, None when there is none."""
        try:
            now = None if path is None else path.stat()
        except OSError:
            return None
        return None if path is None or now is None else cls(role, path, now.st_size, now.st_mtime_ns)


@dataclass(frozen=True, slots=True, eq=False)
class NavigationSetup:
    """Everything a Navigator is built from, shared with whoever turns its states into coordinates.

    ``has_camera`` is False when the camera is a stand-in: then no picture may be offered. ``ground_std_m`` is what a
    single point of the ground may be off; ``ground_bias_std_m`` over ``ground_bias_length_m`` what the filter is to
    learn of it, None what it assumes. ``time_offset_s`` is what was added to the times of pictures without stamps;
    where it is None the Navigator finds it. ``place_known`` is False where the local frame was laid into the map's
    middle for want of a position: then the Navigator searches the map. ``files`` are those it was read from;
    ``map_offset_ne_m`` was added to every position read off the map. ``pad`` is the landing pad to look for, if any.
    ``pad_at`` is where that was surveyed to lie.
    """

    camera: Camera
    mount: Mount
    gimbal: str
    has_camera: bool
    frame: LocalFrame
    reference: ReferenceMap | None
    ground: GroundModel
    ground_std_m: float
    map_id: str | None
    time_offset_s: float | None = 0.0
    ground_bias_std_m: float | None = None
    ground_bias_length_m: float | None = None
    place_known: bool = True
    files: tuple[FileUsed, ...] = ()
    map_offset_ne_m: tuple[float, float] = (0.0, 0.0)
    pad: Pad | None = None
    pad_at: SurveyedPlace | None = None

    def ground_errors(self, state: NavigationState) -> tuple[float, float]:
        """Errors of the ground's height at a point (m) and of its slope, beside the bias that a state has learned.

        Where land is taken for level, nearly all of its error is common to what is in sight: that is the bias.
        """
        if state.cov_ground_bias is None or not isinstance(self.ground, FlatGround):
            return self.ground_std_m, 0.0
        return 0.0, UNKNOWN_SLOPE_STD

    def navigator(self, config: NavigatorConfig | None = None) -> Navigator:
        """A fresh Navigator, by a configuration of its own or the one that suits."""
        if config is None:
            config = NavigatorConfig(find_video_offset=self.has_camera and self.time_offset_s is None)
        noise = config.noise
        std_m = max(noise.ground_bias_std_m[1], self.ground_bias_std_m or 0.0)
        length_m = self.ground_bias_length_m or noise.ground_bias_length_m[1]
        noise = replace(
            noise,
            ground_bias_std_m=(noise.ground_bias_std_m[0], std_m),
            ground_bias_length_m=(noise.ground_bias_length_m[0], length_m),
        )
        config = replace(config, noise=noise)
        return Navigator(
            config, self.camera, self.mount, self.gimbal, self.frame, self.reference, self.ground, pad=self.pad,
            pad_at=self.pad_at,
        )  # fmt: skip


def read_camera_profile(path: Path) -> CameraProfile:
    """Read a camera file: a whole ``flight.json``, an object with its ``camera`` section, or that section alone.

    Raises
    ------
    StartError
        The file cannot be read or is not such a thing.
    """
    try:
        data = json.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StartError(f"camera file '{path}' cannot be read: {error.strerror or error}") from None
    except ValueError as error:
        raise StartError(f"camera file '{path}' is not JSON: {error}") from None
    if not isinstance(data, dict):
        raise StartError(f"camera file '{path}' holds no JSON object")
    section = data if "width_px" in data else data.get("camera")
    try:
        camera = CameraMeta.model_validate(section)
        map_meta = MapMeta.model_validate(data.get("map") or {})
        vehicle = VehicleMeta.model_validate(data["vehicle"]) if data.get("vehicle") else None
    except ValidationError as error:
        raise StartError(
            f"camera file '{path}': {describe_validation(error)}; it needs the 'camera' section of a flight.json"
        ) from None
    return CameraProfile(camera, map_meta, vehicle)


def profile_of_flight(meta: FlightMeta) -> CameraProfile | None:
    """The camera profile of a flight folder, None when it has no camera."""
    return None if meta.camera is None else CameraProfile(meta.camera, meta.map, meta.vehicle)


def camera_of(meta: CameraMeta) -> Camera:
    """The pinhole of a camera section."""
    return Camera(meta.width_px, meta.height_px, meta.fx_px, meta.fy_px, meta.cx_px, meta.cy_px, meta.distortion)


def mount_of(meta: CameraMeta) -> Mount:
    """The mount of a camera section."""
    mount = meta.mount
    return Mount(
        math.radians(mount.roll_deg), math.radians(mount.pitch_deg), math.radians(mount.yaw_deg),
        np.array(mount.lever_arm_frd_m, dtype=np.float64),
    )  # fmt: skip


@dataclass(frozen=True, slots=True)
class MapFiles:
    """Files of imagery and elevation to use; ``bounds_deg`` of the imagery are (south, west, north, east)."""

    map_id: str | None
    reference: Path | None
    elevation: Path | None
    bounds_deg: tuple[float, float, float, float] | None


def build_setup(
    profile: CameraProfile | None,
    maps: MapFiles,
    here: Place,
    video_size_px: tuple[int, int] | None = None,
    time_offset_s: float | None = 0.0,
) -> NavigationSetup:
    """Read the map about a place and put everything together. Takes seconds for a large map: not for the event loop.

    ``here`` is where the vehicle is or was; its altitude is taken for the ground's where nothing better is known.
    """
    frame = _frame(maps.bounds_deg, here)
    # Before they are read: what replaces them meanwhile must not pass for them.
    files = FileUsed.of("reference", maps.reference), FileUsed.of("elevation", maps.elevation)
    offset_ne_m = profile.map.offset_ne_m if profile else (0.0, 0.0)
    reference = None if maps.reference is None else reference_of(maps.reference, frame, offset_ne_m)
    ground: GroundModel
    bias_length_m: float | None
    if maps.elevation is not None:
        terrain = ElevationGrid.open(maps.elevation, frame)
        ground, ground_std_m = terrain, TERRAIN_STD_M
        bias_std_m, bias_length_m = min(POSTING_SHARE * terrain.gsd_m, FLAT_GROUND_STD_M), None
    else:
        known = profile.map.ground_alt_amsl_m if profile else None
        ground, ground_std_m = FlatGround(here.alt_amsl_m if known is None else known), FLAT_GROUND_STD_M
        bias_std_m, bias_length_m = FLAT_GROUND_STD_M, FLAT_GROUND_LENGTH_M
    if profile is not None:
        camera, mount, gimbal = camera_of(profile.camera), mount_of(profile.camera), profile.camera.gimbal
    else:
        width_px, height_px = video_size_px or (640, 480)
        camera = Camera.from_hfov(width_px, height_px, math.radians(60.0))
        mount, gimbal = Mount(0.0, -math.pi / 2, 0.0, np.zeros(3)), "fixed"
    return NavigationSetup(
        camera,
        mount,
        str(gimbal),
        profile is not None,
        frame,
        reference,
        ground,
        ground_std_m,
        maps.map_id,
        time_offset_s,
        bias_std_m,
        bias_length_m,
        files=tuple(file for file in files if file is not None),
        map_offset_ne_m=offset_ne_m,
    )


def middle_of_map(reference: Path, elevation: Path | None, ground_alt_amsl_m: float | None) -> Place:
    """Where to lay the local frame when nobody knows where the vehicle is: the map's middle, at its ground.

    Raises
    ------
    geodata.errors.RasterError
        A file cannot be read.
    """
    with open_raster(reference) as raster:
        lat_rad, lon_rad = raster.bounds.middle_rad
    alt_m = 0.0 if ground_alt_amsl_m is None else ground_alt_amsl_m
    if elevation is not None:
        grid = ElevationGrid.open(elevation, LocalFrame(lat_rad, lon_rad, alt_m)).alt_amsl_grid_m
        known = grid[np.isfinite(grid)]
        alt_m = float(known.mean()) if known.size else alt_m
    return Place(lat_rad, lon_rad, alt_m)


def _frame(bounds_deg: Sequence[float] | None, here: Place) -> LocalFrame:
    if bounds_deg is not None:
        south, west, north, east = bounds_deg
        lat_rad, lon_rad = math.radians((south + north) / 2), math.radians((west + east) / 2)
        half_m = math.radians(max(north - south, (east - west) * math.cos(lat_rad))) / 2 * 6.4e6
        if half_m <= REACH_M:
            return LocalFrame(lat_rad, lon_rad, here.alt_amsl_m)
    return LocalFrame(here.lat_rad, here.lon_rad, here.alt_amsl_m)


def reference_of(path: Path, frame: LocalFrame, offset_ne_m: tuple[float, float]) -> ReferenceMap:
    """The map about a local frame's origin as the estimator has it; errors are those of `geodata`."""
    imagery = ReferenceImagery.open(path, offset_ne_m)
    try:
        whole = imagery.bounds_ne(frame)
        bounds = NeBounds(
            max(whole.north_min_m, -REACH_M), max(whole.east_min_m, -REACH_M),
            min(whole.north_max_m, REACH_M), min(whole.east_max_m, REACH_M),
        )  # fmt: skip
        area_m2 = (bounds.north_max_m - bounds.north_min_m) * (bounds.east_max_m - bounds.east_min_m)
        gsd_m = max(imagery.gsd_m, math.sqrt(area_m2 / MAX_REFERENCE_PIXELS))
        return imagery.grid(frame, gsd_m, bounds)
    finally:
        imagery.close()
