"""What a photo's pixels show: the photo is located, laid on the map, and each pixel carried there."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from enum import StrEnum
from pathlib import Path
from typing import Any

import numpy as np

from backend.coordinates import mgrs_of
from backend.errors import StationError
from backend.navigation.setup import FLAT_GROUND_STD_M, TERRAIN_STD_M, UNKNOWN_SLOPE_STD
from backend.photos.hints import Hints
from backend.photos.session import Attempt, PhotoAnswer, PhotoSession
from backend.pointing import CLICK_STD_PX
from backend.uncertainty import circular_error_m, ellipse95
from estimator.errors import GeometryError
from estimator.ports import ReferenceMap
from estimator.registration.alignment import NoMatch
from estimator.registration.contour import ContourConfig, place_by_contours
from estimator.registration.locate import Located, NotLocated
from estimator.registration.placement import Placement, PlacementConfig, place, place_by_keypoints
from estimator.targets.ray import RayTarget, cut_ray
from estimator.targets.registered import RegisteredTarget, TargetErrors, locate_registered
from estimator.types import Float

MAX_RANGE_M = 3000.0
TARGET_HEIGHT_SHARE = 0.25
SURE_BELOW = 0.001
"""Outlier probability of the photo's place above which it is no ground for a coordinate, though a photo is accepted up
to more: its ellipse is of metres, and says nothing of a place that is wrong altogether."""


class Method(StrEnum):
    """By which registration a located photo is laid on the map.

    ``registered`` is the station's own, ``contour`` the published one (``estimator.registration.contour``).
    """

    REGISTERED = "registered"
    CONTOUR = "contour"


class PhotoTargetError(StationError):
    """A photo that cannot be laid on the map: no pixel of it has a coordinate."""


@dataclass(frozen=True, slots=True)
class TargetOptions:
    """How sure the click is, how high its target stands, and what is known of the map's errors.

    ``target_height_std_m`` is a quarter of the height where None; ``map_std_m`` what the matcher's calibration states;
    ``map_offset_std_m`` unknown and left out where None.
    """

    height_m: float = 0.0
    height_std_m: float | None = None
    pixel_std_px: float = CLICK_STD_PX
    map_std_m: float | None = None
    map_offset_std_m: float | None = None
    method: Method = Method.REGISTERED


@dataclass(frozen=True, slots=True, eq=False)
class PhotoTarget:
    """What one pixel shows, or why that is not known.

    ``found`` is by registration, ``ray`` by the pose alone, for comparison; ``apart_m`` and ``apart_sigmas`` say how
    far they differ. ``has_datum`` says whether ``found``'s altitude is above sea level.
    """

    uv_px: tuple[float, float]
    reason: str = ""
    found: RegisteredTarget | None = None
    ray: RayTarget | None = None
    apart_m: float | None = None
    apart_sigmas: float | None = None
    has_datum: bool = False
    map_offset_known: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class PhotoTargets:
    """A located photo with its pixels."""

    located: PhotoAnswer
    placement: Placement
    targets: tuple[PhotoTarget, ...]


def locate_pixels(
    session: PhotoSession, path: Path, pixels: Sequence[tuple[float, float]], hints: Hints, options: TargetOptions,
    use_exif_gps: bool = False,
) -> PhotoTargets:  # fmt: skip
    """Coordinates of what pixels of one photo show.

    Raises
    ------
    PhotoTargetError
        The photo was not located, not surely enough, or cannot be laid on the map.
    PhotoError, RasterError, HintError
        Photo, map or hints cannot be used.
    """
    attempt, located = session.found(path, hints, use_exif_gps)
    if attempt is None or isinstance(located, NotLocated) or not located.accepted:
        reason = located.reason if isinstance(located, NotLocated | Located) else ""
        raise PhotoTargetError(f"{path}: the photo was not located: {reason}")
    if located.outlier_probability > SURE_BELOW:
        raise PhotoTargetError(
            f"{path}: the photo was located, but not surely enough for a coordinate: its place is wrong with"
            f" probability {located.outlier_probability:.1%}, at most {SURE_BELOW:.1%} is taken; say more of where and"
            " how it was taken (--near with --radius, --heading, --pitch, --roll, --agl)"
        )
    placed = _laid(session, attempt, located, options)
    if isinstance(placed, NoMatch):
        raise PhotoTargetError(f"{path}: the photo was located, but cannot be laid on the map: {placed.reason}")
    answer = session.in_degrees(path.name, located, 0.0)
    targets = tuple(_target(session, attempt, located, placed, uv, options) for uv in pixels)
    return PhotoTargets(answer, placed, targets)


def _laid(session: PhotoSession, attempt: Attempt, located: Located, options: TargetOptions) -> Placement | NoMatch:
    """A located photo on the map, by the method chosen."""
    scene = attempt.image, attempt.camera, attempt.reference, attempt.terrain, session.frame.alt_m
    pose = located.pose, located.cov_pose, attempt.prior.covariance()
    if options.method is Method.CONTOUR:
        config = ContourConfig()
        placement = replace(config.placement, map_std_m=options.map_std_m)
        return place_by_contours(*scene, *pose, replace(config, placement=placement))
    config_of_match = PlacementConfig(map_std_m=options.map_std_m)
    placed = place(*scene, *pose, config_of_match)
    strength = attempt.config.confirm.sure_strength
    if isinstance(placed, NoMatch) and located.source != "correlation" and located.evidence.pairs >= strength:
        placed = place_by_keypoints(
            attempt.terrain, session.frame.alt_m, located.pose, located.cov_pose, config_of_match
        )
    return placed


def _target(
    session: PhotoSession, attempt: Attempt, located: Located, placed: Placement, uv_px: tuple[float, float],
    options: TargetOptions,
) -> PhotoTarget:  # fmt: skip
    height_std_m = options.height_std_m
    if height_std_m is None:
        height_std_m = TARGET_HEIGHT_SHARE * abs(options.height_m)
    errors = TargetErrors(
        options.pixel_std_px, TERRAIN_STD_M if session.has_elevation else 0.0,
        0.0 if session.has_elevation else UNKNOWN_SLOPE_STD, height_std_m, options.map_offset_std_m or 0.0,
        0.0 if session.has_elevation else FLAT_GROUND_STD_M,
    )  # fmt: skip
    try:
        found = locate_registered(
            placed, attempt.camera, uv_px, attempt.terrain, session.frame, errors, options.height_m, MAX_RANGE_M
        )
    except GeometryError as error:
        return PhotoTarget(uv_px, str(error))
    found = replace(found, method=options.method)
    if not _on_map(attempt.reference, found.pos_ned_m):
        return PhotoTarget(uv_px, "what the pixel shows lies beyond the map, where no match supports it")
    ray, apart_m, apart_sigmas = None, None, None
    try:
        ray = cut_ray(
            located.pose.pos_ned_m, located.pose.ned_from_camera, located.cov_pose, attempt.camera, uv_px,
            attempt.terrain, session.frame, math.hypot(TERRAIN_STD_M if session.has_elevation else 0.0, height_std_m),
            options.pixel_std_px, options.height_m, MAX_RANGE_M,
        )  # fmt: skip
    except GeometryError:
        pass  # the comparison has nothing to say, the answer stands
    else:
        d = (ray.pos_ned_m - found.pos_ned_m)[:2]
        both = (found.cov_on_map_ned_m2 + ray.cov_ned_m2)[:2, :2]
        apart_m, apart_sigmas = float(np.hypot(*d)), float(np.sqrt(d @ np.linalg.solve(both, d)))
    return PhotoTarget(
        uv_px, "", found, ray, apart_m, apart_sigmas, session.has_datum, options.map_offset_std_m is not None
    )


def _on_map(reference: ReferenceMap, pos_ned_m: Float) -> bool:
    north, east = float(pos_ned_m[0]), float(pos_ned_m[1])
    south, west, top, right = reference.bounds_ne_m
    if not (south <= north <= top and west <= east <= right):
        return False
    half = 0.5 * reference.gsd_m
    return bool(reference.window(north - half, east - half, north + half, east + half).valid.all())


def as_object(target: PhotoTarget) -> dict[str, Any]:
    """One pixel's answer for JSON; a refused one has its reason and no place."""
    found = target.found
    if found is None:
        return {"pixel": list(target.uv_px), "accepted": False, "reason": target.reason}
    cov, on_map = found.cov_ned_m2, found.cov_on_map_ned_m2
    ellipse = ellipse95(cov[:2, :2])
    lat_deg, lon_deg = math.degrees(found.lat_rad), math.degrees(found.lon_rad)
    std_major_m = math.sqrt(float(np.linalg.eigvalsh(cov[:2, :2])[-1]))
    return {
        "pixel": list(target.uv_px), "accepted": True, "reason": "", "method": found.method,
        "lat_deg": round(lat_deg, 8), "lon_deg": round(lon_deg, 8),
        "mgrs": mgrs_of(lat_deg, lon_deg, std_major_m),
        "alt_amsl_m": round(found.alt_amsl_m, 2) if target.has_datum else None,
        "ce90_m": round(circular_error_m(cov[:2, :2]), 3),
        "ellipse95": {
            "semi_major_m": round(ellipse.semi_major_m, 3), "semi_minor_m": round(ellipse.semi_minor_m, 3),
            "azimuth_deg": round(ellipse.azimuth_deg, 1),
        },
        "cov_ned_m2": _rounded(cov), "cov_on_map_ned_m2": _rounded(on_map),
        "map_offset_std_m": found.map_offset_std_m if target.map_offset_known else None,
        "lever_m": round(found.lever_m, 2), "off_nadir_deg": round(math.degrees(found.off_nadir_rad), 2),
        "std_by_source_m": {k: round(getattr(found.budget, k), 3) for k in found.budget.__dataclass_fields__},
        "ray": _ray_object(target),
    }  # fmt: skip


def _ray_object(target: PhotoTarget) -> dict[str, Any] | None:
    ray = target.ray
    if ray is None or target.apart_m is None or target.apart_sigmas is None:
        return None
    return {
        "method": ray.method, "lat_deg": round(math.degrees(ray.lat_rad), 8),
        "lon_deg": round(math.degrees(ray.lon_rad), 8), "ce90_m": round(circular_error_m(ray.cov_ned_m2[:2, :2]), 3),
        "apart_m": round(target.apart_m, 3), "apart_sigmas": round(target.apart_sigmas, 3),
    }  # fmt: skip


def _rounded(matrix: Float) -> list[list[float]]:
    return [[round(float(value), 5) for value in row] for row in matrix]


def as_geojson(photo: str, targets: Sequence[PhotoTarget]) -> dict[str, Any]:
    """A FeatureCollection of the pixels that have a coordinate (RFC 7946: longitude first)."""
    features = []
    for target in targets:
        if target.found is None:
            continue
        properties = {"photo": photo, **as_object(target)}
        coordinates = [properties.pop("lon_deg"), properties.pop("lat_deg")]
        if properties["alt_amsl_m"] is not None:
            coordinates.append(properties["alt_amsl_m"])
        geometry = {"type": "Point", "coordinates": coordinates}
        features.append({"type": "Feature", "geometry": geometry, "properties": properties})
    return {"type": "FeatureCollection", "features": features}
