"""Where a clicked pixel lies by the ray and by its picture's registration together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import cv2
import numpy as np

from backend.evidence.collect import RegisteredPart, Sighting
from backend.evidence.ground import WatchedGround
from backend.targeting import scene_of
from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.measurements.camera_attitude import Gimbal
from estimator.registration.alignment import NoMatch
from estimator.registration.placement import Placement
from estimator.sighting import lay_on_map, locate_click
from estimator.smoothing import Smoothed
from estimator.types import Image, NavigationState

ASPECT_TOLERANCE = 0.01
FUSED = "fused"
MOVED_SIGMAS, MOVED_M, LEAST_MOVED_M = 0.3, 0.5, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """A click located again. ``sighting`` has the new coordinate, None where it stays; ``registration`` says why."""

    sighting: Sighting | None
    placed: Placement | NoMatch
    registration: str


def grey_picture(jpeg: bytes, camera: Camera) -> Image | None:
    """The kept picture at the calibrated size, grey (rows, cols); None where it is none or of another shape.

    It is the JPEG of the evidence that is registered, so that whoever has the evidence can do it again.
    """
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    if image is None:
        return None
    rows, cols = image.shape
    if abs((cols / rows) / (camera.width_px / camera.height_px) - 1.0) > ASPECT_TOLERANCE:
        return None
    if (cols, rows) != (camera.width_px, camera.height_px):
        way = cv2.INTER_AREA if cols > camera.width_px else cv2.INTER_LINEAR
        image = cv2.resize(image, (camera.width_px, camera.height_px), interpolation=way)
    return np.asarray(image, dtype=np.uint8)


def registered(sighting: Sighting, picture: bytes | None) -> Placement | NoMatch:
    """How the picture lies on the map. Takes some tenths of a second: not for the event loop."""
    if sighting.setup.reference is None:
        return NoMatch("there is no map")
    image = None if picture is None else grey_picture(picture, sighting.setup.camera)
    if image is None:
        return NoMatch("the picture was no longer held, or could not be decoded")
    return lay_on_map(image, sighting.state, scene_of(sighting.setup, sighting.state))


def corrected_state(sighting: Sighting, smoothed: Smoothed) -> NavigationState | None:
    """The state at a click's exposure as later fixes have it; None where it has hardly moved, or is not known."""
    old = sighting.state
    fixed = sighting.setup.gimbal == Gimbal.FIXED
    new = smoothed.at(old.t_us, sighting.setup.frame, camera_is_fixed=fixed)
    if new is None:
        return None
    moved_m = float(np.linalg.norm(new.pos_ned_m - old.pos_ned_m))
    std_m = float(np.sqrt(np.linalg.eigvalsh(old.cov_pos_ned_m2[:2, :2])[-1]))
    return new if moved_m > max(min(MOVED_SIGMAS * std_m, MOVED_M), LEAST_MOVED_M) else None


def refine(sighting: Sighting, placed: Placement | NoMatch, state: NavigationState) -> Refined:
    """The click of ``sighting`` by ``state`` at its exposure and by how its picture lies on the map.

    Without a match it is the ray of ``state``; where that is the state it had, nothing is new.
    """
    ground = WatchedGround(sighting.ground.ground)
    scene = replace(
        scene_of(sighting.setup, state), ground=ground, reference=None, ground_std_m=sighting.ground_std_m,
        slope_std=sighting.slope_std,
    )  # fmt: skip
    problem = f"no match: {placed.reason}" if isinstance(placed, NoMatch) else ""
    try:
        places = locate_click(
            sighting.camera_uv_px, state, placed, scene, sighting.pixel_std_px, 0, sighting.height_above_ground_m
        )
    except GeometryError as error:
        return Refined(None, placed, problem or f"no coordinate: {error}")
    if places.ray is None or places.ray.method != sighting.found.method:
        return Refined(None, placed, problem or "the ray from the pose meets no known ground")
    if places.registered is None and state is sighting.state:
        return Refined(None, placed, problem or f"no coordinate: {places.refusal}")
    geodetic = sighting.setup.frame.geodetic_from_ned(places.fused.pos_ned_m)
    lat, lon, alt = (float(value) for value in geodetic)
    cov = places.fused.cov_ned_m2
    method, part = sighting.ray_method, None
    if places.registered is None or isinstance(placed, NoMatch):
        lat, lon, alt, cov = places.ray.lat_rad, places.ray.lon_rad, places.ray.alt_amsl_m, places.ray.cov_ned_m2
    else:
        method, part = FUSED, RegisteredPart(placed, scene.map_offset_std_m, scene.fusion, places.fused)
        problem = f"matched by {placed.by}"
    if sighting.assumption is not None:
        method = f"{method}, {sighting.assumption}"
    target = replace(
        sighting.target, lat_deg=math.degrees(lat), lon_deg=math.degrees(lon), alt_amsl_m=float(alt), method=method,
        var_n_m2=float(cov[0, 0]), var_e_m2=float(cov[1, 1]), var_d_m2=float(cov[2, 2]), cov_ne_m2=float(cov[0, 1]),
        registration=problem,
    )  # fmt: skip
    again = replace(
        sighting,
        target=target,
        state=state,
        ground=ground,
        found=places.ray,
        registered=part,
        corrected=sighting.corrected or state is not sighting.state,
    )
    return Refined(again, placed, problem)
