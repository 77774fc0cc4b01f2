"""Where a clicked pixel lies by the ray and by its picture's registration together."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from backend.evidence.collect import RegisteredPart, Sighting
from backend.evidence.ground import WatchedGround
from backend.evidence.registering import Registered, register_picture
from backend.refining.later import Hindsight
from backend.targeting import scene_of
from estimator.errors import GeometryError
from estimator.registration.alignment import NoMatch
from estimator.robust import largest_std
from estimator.sighting import locate_click
from estimator.types import NavigationState

FUSED = "fused"
MOVED_SIGMAS, MOVED_M, LEAST_MOVED_M = 0.3, 0.5, 0.1


@dataclass(frozen=True, slots=True, eq=False)
class Refined:
    """A click located again. ``sighting`` has the new coordinate, None where it stays; ``registration`` says why."""

    sighting: Sighting | None
    registration: str


def registered(sighting: Sighting, picture: bytes | None) -> Registered:
    """How the picture lies on the map. Takes some tenths of a second: not for the event loop."""
    scene = scene_of(sighting.setup, sighting.state)
    return register_picture(picture, sighting.state, scene, corrected=sighting.corrected)


def corrected_state(sighting: Sighting, known: Hindsight) -> NavigationState | None:
    """The state at a click's exposure as later fixes have it; None where it has hardly moved, or is not known."""
    old = sighting.state
    new = known.at(old.t_us)
    if new is None:
        return None
    moved_m = float(np.linalg.norm(new.pos_ned_m - old.pos_ned_m))
    std_m = largest_std(old.cov_pos_ned_m2[:2, :2])
    return new if moved_m > max(min(MOVED_SIGMAS * std_m, MOVED_M), LEAST_MOVED_M) else None


def refine(sighting: Sighting, search: Registered, state: NavigationState) -> Refined:
    """The click of ``sighting`` by ``state`` at its exposure and by how its picture lies on the map.

    Without a match it is the ray of ``state``; where that is the state it had, nothing is new.
    """
    placed = search.placed
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
        return Refined(None, problem or f"no coordinate: {error}")
    if places.ray is None or places.ray.method != sighting.found.method:
        return Refined(None, problem or "the ray from the pose meets no known ground")
    if places.registered is None and state is sighting.state:
        return Refined(None, problem or f"no coordinate: {places.refusal}")
    geodetic = sighting.setup.frame.geodetic_from_ned(places.fused.pos_ned_m)
    lat, lon, alt = (float(value) for value in geodetic)
    cov = places.fused.cov_ned_m2
    method, part = sighting.ray_method, None
    if places.registered is None or isinstance(placed, NoMatch):
        lat, lon, alt, cov = places.ray.lat_rad, places.ray.lon_rad, places.ray.alt_amsl_m, places.ray.cov_ned_m2
    else:
        method, part = FUSED, RegisteredPart(placed, search, scene.map_offset_std_m, scene.fusion, places.fused)
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
    return Refined(again, problem)
