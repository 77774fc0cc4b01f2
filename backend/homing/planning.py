"""The way home: over which places, how high, and whether it may be flown."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from backend.errors import CommandRefusedError
from backend.navigation.setup import NavigationSetup, Place
from backend.schemas.homing import HomingRequest, LineBody, PlaceBody, WayBody
from estimator.types import Float, NavigationState
from guidance.geofence import Geofence, InclusionRule
from guidance.homing import HomingConfig
from guidance.path import PathSegment
from guidance.route import highest_ground_amsl_m, route_through

FARTHEST_M = 50_000.0
NEAREST_M = 2.0
FENCE_STEP_M = 5.0
_DRAWN = 12


@dataclass(frozen=True, slots=True, eq=False)
class Way:
    """A way home and what is told of it."""

    segments: tuple[PathSegment, ...]
    body: WayBody


def plan_way(
    state: NavigationState, setup: NavigationSetup, home: Place, wish: HomingRequest, fence: Geofence,
    rule: InclusionRule,
) -> Way:  # fmt: skip
    """The way from a state to ``home`` as an operator wishes it.

    Raises
    ------
    CommandRefusedError
        It is no way, leads too far or below the ground, or leaves the fence.
    """
    frame = setup.frame
    places = [frame.ned_from_geodetic(*_radians(place), home.alt_amsl_m) for place in wish.via]
    places.append(frame.ned_from_geodetic(home.lat_rad, home.lon_rad, home.alt_amsl_m))
    points = np.array([state.pos_ned_m, *places])
    if float(np.hypot(*(points[1:] - points[0])[:, :2].T).max()) > FARTHEST_M:
        raise CommandRefusedError(f"the way home leads farther than {FARTHEST_M / 1000:.0f} km from here")
    if len(points) == 2 and float(np.hypot(*(points[1] - points[0])[:2])) < NEAREST_M:
        # Over home already: a metre or two is way enough to come down by.
        points[0, :2] = points[1, :2] - (NEAREST_M, 0.0)
    ground_m = highest_ground_amsl_m(points, setup.ground.alt_amsl_m)
    alt_m = _height_m(state, wish, ground_m)
    lat, lon, _ = frame.geodetic_from_ned(points)
    points = np.asarray(frame.ned_from_geodetic(lat, lon, np.full(len(points), alt_m)))
    try:
        segments = route_through(points, wish.speed_m_s)
    except ValueError as error:
        raise CommandRefusedError(f"this is no way home: {error}") from None
    track = np.concatenate([_along(segment, FENCE_STEP_M) for segment in segments])
    _check_fence(track, setup, fence, rule)
    length_m = sum(segment.curve.length_m for segment in segments)
    drawn = np.concatenate([segment.curve.point(np.linspace(0.0, 1.0, _DRAWN)) for segment in segments])
    body = WayBody(
        geometry=LineBody(coordinates=_coordinates(drawn, setup)),
        home=PlaceBody(lat_deg=math.degrees(home.lat_rad), lon_deg=math.degrees(home.lon_rad)),
        length_m=length_m, seconds=_seconds(state, length_m, alt_m, wish), alt_amsl_m=alt_m,
        ground_amsl_m=ground_m if math.isfinite(ground_m) else None, speed_m_s=wish.speed_m_s, land=wish.land,
        when_lost=wish.when_lost,
    )  # fmt: skip
    return Way(segments, body)


def _radians(place: PlaceBody) -> tuple[float, float]:
    return math.radians(place.lat_deg), math.radians(place.lon_deg)


def _height_m(state: NavigationState, wish: HomingRequest, ground_m: float) -> float:
    if wish.alt_amsl_m is None:
        return max(state.alt_amsl_m, ground_m + wish.clearance_m) if math.isfinite(ground_m) else state.alt_amsl_m
    if wish.alt_amsl_m < ground_m + wish.clearance_m:
        raise CommandRefusedError(
            f"at {wish.alt_amsl_m:.0f} m above sea level the way is not {wish.clearance_m:.0f} m above the ground: "
            f"that rises to {ground_m:.0f} m below it or beside"
        )
    return wish.alt_amsl_m


def _seconds(state: NavigationState, length_m: float, alt_m: float, wish: HomingRequest) -> float:
    """About how long it takes, landing included where the height over ground is known."""
    config = HomingConfig()
    seconds = abs(alt_m - state.alt_amsl_m) / config.climb_m_s + length_m / wish.speed_m_s + 10.0
    above_m = state.alt_agl_m + alt_m - state.alt_amsl_m
    if wish.land and math.isfinite(above_m) and above_m > 0.0:
        slow_m = config.sink_m_s / config.sink_per_s
        low_m = min(above_m, slow_m)
        seconds += max(above_m - slow_m, 0.0) / config.sink_m_s
        seconds += math.log(max(low_m * config.sink_per_s / config.touchdown_sink_m_s, 1.0)) / config.sink_per_s
        seconds += 1.0 / config.sink_per_s
    return seconds


def _along(segment: PathSegment, step_m: float) -> Float:
    count = max(2, math.ceil(segment.curve.length_m / step_m) + 1)
    return segment.curve.point(np.linspace(0.0, 1.0, count))


def _check_fence(track_ned_m: Float, setup: NavigationSetup, fence: Geofence, rule: InclusionRule) -> None:
    """Refuse a way that leaves the fence; one that begins outside may come in."""
    if not fence.zones:
        return
    lat_deg, lon_deg, _ = _geodetic(track_ned_m, setup)
    outside = fence.left_by(lat_deg, lon_deg, rule) | fence.entered_by(lat_deg, lon_deg)
    if outside[-1]:
        raise CommandRefusedError("home lies outside of the fence")
    inside = np.flatnonzero(~outside)
    left = inside[0] + np.flatnonzero(outside[inside[0] :])
    if len(left):
        at = int(left[0])
        raise CommandRefusedError(
            f"the way leaves the fence at {lat_deg[at]:.6f}, {lon_deg[at]:.6f}: name places to fly over ('via') that "
            "keep inside"
        )


def _coordinates(points_ned_m: Float, setup: NavigationSetup) -> list[list[float]]:
    lat_deg, lon_deg, alt_m = (column.tolist() for column in _geodetic(points_ned_m, setup))
    return [[round(x, 7), round(y, 7), round(z, 2)] for x, y, z in zip(lon_deg, lat_deg, alt_m, strict=True)]


def _geodetic(points_ned_m: Float, setup: NavigationSetup) -> tuple[Float, Float, Float]:
    """Latitude and longitude in degrees, and altitude, (n,) each."""
    lat, lon, alt = setup.frame.geodetic_from_ned(points_ned_m)
    return np.degrees(lat), np.degrees(lon), alt
