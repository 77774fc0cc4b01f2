"""GeoJSON and its neighbours, and how targets look in it."""

from __future__ import annotations

import math
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from backend.coordinates import dms_of, mgrs_of, utm_of
from backend.fleet.tracks import TrackPoint
from backend.pointing import HIGHEST_HEIGHT_M, LOWEST_HEIGHT_M, GroundKind
from backend.store.targets import Target, TrackUpdate
from backend.uncertainty import circular_error_m, ellipse95
from estimator.types import Float

HeightAboveGround: Any = Field(default=None, ge=LOWEST_HEIGHT_M, le=HIGHEST_HEIGHT_M, allow_inf_nan=False)


class EllipseBody(BaseModel):
    """A horizontal 95 % error ellipse; azimuth of the major axis from north."""

    semi_major_m: float
    semi_minor_m: float
    azimuth_deg: float


class PointGeometry(BaseModel):
    """RFC 7946: longitude first; the third coordinate is height above mean sea level."""

    type: Literal["Point"] = "Point"
    coordinates: list[float]


class TrackBody(BaseModel):
    """What following a target says of it; what is not known is null.

    ``status`` is ``seen`` in the newest picture, ``lost``, or ``stopped``: no longer followed; ``reason`` says why. The
    place and the velocity are of ``seen_unix_us``, the exposure of the last sighting. ``moving`` is null until that is
    known, and so is the velocity; speed and course are those of a moving target only.
    """

    status: Literal["seen", "lost", "stopped"]
    reason: str | None
    seen_unix_us: int | None
    moving: bool | None
    vel_n_m_s: float | None
    vel_e_m_s: float | None
    std_vel_n_m_s: float | None
    std_vel_e_m_s: float | None
    cov_vel_ne_m2_s2: float | None
    speed_m_s: float | None
    course_deg: float | None


class TargetProperties(BaseModel):
    """A target's properties; uncertainties are null where nobody knows them, grids where they do not reach.

    ``registration`` says how the picture that was clicked fits the map, ``refined`` how often the coordinate has become
    better since it was first told.
    """

    name: str
    mgrs: str | None
    utm: str | None
    dms: str
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float | None
    method: str
    vehicle_id: str | None
    frame_id: int | None
    t_unix_us: int | None
    u_px: float | None
    v_px: float | None
    std_n_m: float | None
    std_e_m: float | None
    std_d_m: float | None
    cov_ne_m2: float | None
    ce90_m: float | None
    ellipse95: EllipseBody | None
    height_above_ground_m: float | None
    ground: GroundKind | None
    track: TrackBody | None
    registration: str | None
    refined: int
    created_unix_us: int
    updated_unix_us: int
    version: int


class TargetFeature(BaseModel):
    """A target as a GeoJSON feature."""

    type: Literal["Feature"] = "Feature"
    id: str
    geometry: PointGeometry
    properties: TargetProperties


class TargetCollection(BaseModel):
    """All targets."""

    type: Literal["FeatureCollection"] = "FeatureCollection"
    features: list[TargetFeature]


class TrackGeometry(BaseModel):
    """A piece of a track: [lon, lat, alt AMSL] each."""

    type: Literal["LineString"] = "LineString"
    coordinates: list[list[float]]


class TrackProperties(BaseModel):
    """When each point of a track was."""

    source: str
    vehicle_id: str
    epoch: int
    times_unix_us: list[int]


class TrackFeature(BaseModel):
    """A piece of a track without a gap."""

    type: Literal["Feature"] = "Feature"
    geometry: TrackGeometry
    properties: TrackProperties


class TrackCollection(BaseModel):
    """A vehicle's track, cut where nothing was known for a while."""

    type: Literal["FeatureCollection"] = "FeatureCollection"
    features: list[TrackFeature]


class NewTarget(BaseModel):
    """A click on a frame (vehicle_id, frame_id, u_px, v_px), or typed-in coordinates (lat_deg, lon_deg).

    What is clicked stands ``height_above_ground_m`` above the terrain, or above level ground at the height below the
    vehicle ("flat"); at the terrain itself when neither is said. With ``track`` it is followed from that frame on.
    """

    model_config = ConfigDict(extra="forbid")

    name: str | None = Field(default=None, max_length=200)
    vehicle_id: str | None = None
    frame_id: int | None = Field(default=None, ge=0)
    u_px: float | None = Field(default=None, allow_inf_nan=False)
    v_px: float | None = Field(default=None, allow_inf_nan=False)
    lat_deg: float | None = Field(default=None, ge=-90, le=90)
    lon_deg: float | None = Field(default=None, ge=-180, le=180)
    alt_amsl_m: float | None = Field(default=None, ge=-1000, le=20000)
    height_above_ground_m: float | None = HeightAboveGround
    ground: GroundKind | None = None
    track: bool | None = None


class TargetPatch(BaseModel):
    """What to change. A position needs both of lat_deg and lon_deg, and ends following, as ``track`` false does."""

    model_config = ConfigDict(extra="forbid")

    name: str | None = Field(default=None, min_length=1, max_length=200)
    lat_deg: float | None = Field(default=None, ge=-90, le=90)
    lon_deg: float | None = Field(default=None, ge=-180, le=180)
    alt_amsl_m: float | None = Field(default=None, ge=-1000, le=20000)
    track: bool | None = None


def feature_of_target(target: Target) -> TargetFeature:
    """The GeoJSON feature of a target."""
    coordinates = [target.lon_deg, target.lat_deg]
    if target.alt_amsl_m is not None:
        coordinates.append(target.alt_amsl_m)
    spread = spread_of(target.var_n_m2, target.var_e_m2, target.cov_ne_m2)
    return TargetFeature(
        id=target.id,
        geometry=PointGeometry(coordinates=coordinates),
        properties=TargetProperties(
            name=target.name, mgrs=mgrs_of(target.lat_deg, target.lon_deg),
            utm=utm_of(target.lat_deg, target.lon_deg), dms=dms_of(target.lat_deg, target.lon_deg),
            lat_deg=target.lat_deg, lon_deg=target.lon_deg, alt_amsl_m=target.alt_amsl_m, method=target.method,
            vehicle_id=target.vehicle_id, frame_id=target.frame_id, t_unix_us=target.t_unix_us,
            u_px=target.u_px, v_px=target.v_px, std_n_m=_root(target.var_n_m2), std_e_m=_root(target.var_e_m2),
            std_d_m=_root(target.var_d_m2),
            cov_ne_m2=target.cov_ne_m2, ce90_m=spread[0], ellipse95=spread[1],
            height_above_ground_m=target.height_above_ground_m, ground=_ground(target.ground),
            track=track_of(target),
            registration=target.registration, refined=target.refined or 0,
            created_unix_us=target.created_unix_us, updated_unix_us=target.updated_unix_us, version=target.version,
        ),
    )  # fmt: skip


def track_of(target: Target) -> TrackBody | None:
    """What following says of a target; None for one that never was followed."""
    if target.track_status is None:
        return None
    return _track_body(target, target.track_status, target.track_reason)


def track_body_of(update: TrackUpdate) -> TrackBody:
    """The same of an update of a target."""
    return _track_body(update, update.status, update.reason)


def _track_body(of: Target | TrackUpdate, status: str, reason: str | None) -> TrackBody:
    going = of.moving is True and of.vel_n_m_s is not None and of.vel_e_m_s is not None
    north, east = (of.vel_n_m_s or 0.0, of.vel_e_m_s or 0.0)
    return TrackBody(
        status="seen" if status == "seen" else "lost" if status == "lost" else "stopped", reason=reason,
        seen_unix_us=of.seen_unix_us, moving=of.moving, vel_n_m_s=of.vel_n_m_s, vel_e_m_s=of.vel_e_m_s,
        std_vel_n_m_s=_root(of.var_vel_n_m2_s2), std_vel_e_m_s=_root(of.var_vel_e_m2_s2),
        cov_vel_ne_m2_s2=of.cov_vel_ne_m2_s2, speed_m_s=math.hypot(north, east) if going else None,
        course_deg=math.degrees(math.atan2(east, north)) % 360.0 if going else None,
    )  # fmt: skip


def spread_of(
    var_n_m2: float | None, var_e_m2: float | None, cov_ne_m2: float | None
) -> tuple[float | None, EllipseBody | None]:
    """CE90 in metres and the 95 % ellipse of a horizontal covariance; None where that is not known."""
    if var_n_m2 is None or var_e_m2 is None or cov_ne_m2 is None:
        return None, None
    cov = np.array([[var_n_m2, cov_ne_m2], [cov_ne_m2, var_e_m2]])
    return circular_error_m(cov), ellipse_of(cov)


def ellipse_of(cov_ne_m2: Float) -> EllipseBody:
    """The 95 % ellipse of a covariance (2, 2) over north and east."""
    found = ellipse95(cov_ne_m2)
    return EllipseBody(semi_major_m=found.semi_major_m, semi_minor_m=found.semi_minor_m, azimuth_deg=found.azimuth_deg)


def collection_of_targets(targets: list[Target]) -> TargetCollection:
    """The GeoJSON collection of targets."""
    return TargetCollection(features=[feature_of_target(target) for target in targets])


def collection_of_tracks(pieces: list[list[TrackPoint]], source: str, vehicle_id: str) -> TrackCollection:
    """The GeoJSON collection of a track's pieces; RFC 7946: a LineString has two positions or more."""
    return TrackCollection(features=[
        TrackFeature(
            geometry=TrackGeometry(coordinates=[[p.lon_deg, p.lat_deg, p.alt_amsl_m] for p in piece]),
            properties=TrackProperties(
                source=source, vehicle_id=vehicle_id, epoch=piece[0].epoch, times_unix_us=[p.t_us for p in piece]
            ),
        )
        for piece in pieces if len(piece) > 1
    ])  # fmt: skip


def _ground(kind: str | None) -> GroundKind | None:
    return "flat" if kind == "flat" else None if kind is None else "terrain"


def _root(variance: float | None) -> float | None:
    return None if variance is None else math.sqrt(max(variance, 0.0))
