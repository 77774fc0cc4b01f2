"""An operator's recorded clicks, located with the replayed states and combined per target."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from backend.navigation.setup import NavigationSetup
from estimator.errors import GeometryError
from estimator.geometry.earth import Float
from estimator.targets.ray import RayTarget, locate_ray
from estimator.types import NavigationState
from geodata.flight import FlightFolder
from geodata.flight_write import CsvAppender

COLUMNS = ("target", "lat_deg", "lon_deg", "alt_amsl_m", "ce90_m", "method", "observations")
# two-dimensional Gaussian: 90 % lie within 2.1460 sigma of a circle
CE90_SIGMAS = 2.1460


@dataclass(frozen=True, slots=True, eq=False)
class LocatedTarget:
    """One target from all its clicks."""

    target: str
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    ce90_m: float
    method: str
    observations: int


def locate_clicks(
    folder: FlightFolder, setup: NavigationSetup, state_at: Callable[[int], NavigationState | None], offset_us: int
) -> list[LocatedTarget]:
    """Locate each click of ``clicks.csv`` and weigh those of one target by their covariances."""
    if not setup.has_camera:
        return []
    sightings: dict[str, list[RayTarget]] = {}
    for click in folder.clicks():
        state = state_at(click.t_video_us + offset_us)
        if state is None:
            continue
        try:
            found = locate_ray(
                state, setup.camera, (click.u_px, click.v_px), setup.ground, setup.frame, setup.ground_std_m
            )
        except GeometryError:
            continue  # above the horizon or off the lens: nothing to add for this target
        sightings.setdefault(click.target, []).append(found)
    return [_combined(name, found, setup) for name, found in sorted(sightings.items())]


def _combined(name: str, found: list[RayTarget], setup: NavigationSetup) -> LocatedTarget:
    weights = np.array([np.linalg.inv(ray.cov_ned_m2) for ray in found])
    cov = np.linalg.inv(weights.sum(axis=0))
    pos: Float = cov @ np.einsum("nij,nj->i", weights, np.array([ray.pos_ned_m for ray in found]))
    # sightings of one pass share the pose's error: the combination is not surer than its best member
    horizontal = min((ray.cov_ned_m2[:2, :2] for ray in found), key=np.trace)
    lat, lon, alt = setup.frame.geodetic_from_ned(pos)
    ce90 = CE90_SIGMAS * float(np.sqrt(0.5 * np.trace(horizontal)))
    return LocatedTarget(
        name, float(np.degrees(lat)), float(np.degrees(lon)), float(alt), ce90, found[0].method, len(found)
    )


def write_targets(path: Path, targets: list[LocatedTarget]) -> None:
    """Write ``targets.csv`` (design, section 4)."""
    path.unlink(missing_ok=True)
    with CsvAppender(path, COLUMNS) as table:
        for t in targets:
            table.write(
                t.target, f"{t.lat_deg:.8f}", f"{t.lon_deg:.8f}", f"{t.alt_amsl_m:.2f}", f"{t.ce90_m:.2f}", t.method,
                t.observations,
            )  # fmt: skip
