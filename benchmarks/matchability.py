"""``python -m benchmarks.matchability``: does the predicted matchability of places rank the errors of real matches?

Pictures of a recorded flight are rectified with the true pose, cropped to a footprint and searched within a radius of
it; what is left is the error of matching. Spearman's rank correlation between predicted sigma and error says whether
the layer knows good ground from bad; it uses the reference map alone.
"""

from __future__ import annotations

import json
import math
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.table import Table
from scipy.stats import spearmanr

from backend.navigation.setup import NavigationSetup
from backend.replay.offline import navigation_setup
from estimator.geometry.rotation import matrix_from_euler
from estimator.registration.alignment import CameraPose
from estimator.registration.candidates import camera_places
from estimator.registration.channels import double_angle_gradients
from estimator.registration.correlation import SearchArea
from estimator.registration.matchability import MatchabilityConfig, at_place, matchability
from estimator.registration.ortho import Ground, map_area, rectify
from estimator.types import Float, Image
from geodata.flight import FlightFolder
from geodata.imagery import ImageryGrid

WRONG_M = 5.0


@dataclass(frozen=True, slots=True)
class Ranking:
    """How predictions and errors of one footprint go together.

    ``error_*`` are medians of the best and the worst predicted third, ``wrong_*`` the shares beyond five metres.
    """

    footprint_m: float
    pictures: int
    spearman: float
    p_value: float
    error_best_third_m: float
    error_worst_third_m: float
    wrong_best_third: float
    wrong_worst_third: float


def pictures(flight: FlightFolder, setup: NavigationSetup, every: int) -> list[tuple[Image, CameraPose]]:
    """Grey pictures with their true poses."""
    truth = flight.truth()
    if truth is None or flight.video_path is None:
        message = f"{flight.path}: needs a truth.csv and a video"
        raise typer.BadParameter(message)
    video = cv2.VideoCapture(str(flight.video_path))
    found: list[tuple[Image, CameraPose]] = []
    number = -1
    while True:
        more, picture = video.read()
        number += 1
        if not more:
            break
        t_us = flight.frame_time_us(number) if number % every == 0 else None
        if t_us is None:
            continue
        at = int(np.argmin(np.abs(truth.t_unix_us - t_us)))
        if abs(int(truth.t_unix_us[at]) - t_us) > 60_000:
            continue
        position = setup.frame.ned_from_geodetic(truth.lat_rad[at], truth.lon_rad[at], truth.alt_amsl_m[at])
        body = matrix_from_euler(truth.roll_rad[at], truth.pitch_rad[at], truth.yaw_rad[at])
        pose = CameraPose(position, np.asarray(body @ setup.mount.body_from_camera, dtype=np.float64))
        found.append((np.asarray(cv2.cvtColor(picture, cv2.COLOR_BGR2GRAY), dtype=np.uint8), pose))
    video.release()
    return found


def match_error(
    image: Image, pose: CameraPose, setup: NavigationSetup, grid: ImageryGrid, footprint_m: float, radius_m: float
) -> tuple[Float, float] | None:
    """Centre of the ground compared (2,), and how far from the truth the best place within the radius is."""
    ground = Ground(setup.ground, setup.frame.alt_m, pose.pos_ned_m[:2], 200.0)
    side = 2 * round(0.5 * footprint_m / grid.gsd_m) + 1
    ortho = rectify(image, setup.camera, pose, ground, grid.gsd_m, side, 1.2, (side, side))
    if ortho is None or ortho.mask.mean() < 0.6:
        return None
    centre = ortho.points_ned_m[side // 2, side // 2, :2]
    around = map_area(grid, centre, np.full(2, radius_m + (0.5 * side + 1.0) * grid.gsd_m), grid.gsd_m)
    if around is None or not around.valid.all():
        return None
    area = SearchArea(double_angle_gradients(around.image), around.valid, (side, side))
    surface = area.correlate(double_angle_gradients(ortho.image), ortho.mask)
    north, east = camera_places(ortho, around.corner_ne_m, pose, surface.shape)
    away = np.hypot(north - pose.pos_ned_m[0], east - pose.pos_ned_m[1])
    row, col = np.unravel_index(int(np.argmax(np.where(away <= radius_m, surface, -2.0))), surface.shape)
    return centre, float(away[row, col])


def rank(setup: NavigationSetup, shots: list[tuple[Image, CameraPose]], footprint_m: float, radius_m: float) -> Ranking:
    """Errors of all pictures beside what the map predicts for their ground."""
    grid = setup.reference
    if not isinstance(grid, ImageryGrid):
        message = "the flight has no reference map"
        raise typer.BadParameter(message)
    predicted = matchability(
        grid.image, grid.valid, grid.gsd_m, MatchabilityConfig(footprint_m=footprint_m, radius_m=radius_m)
    )
    matched = [m for m in (match_error(*shot, setup, grid, footprint_m, radius_m) for shot in shots) if m is not None]
    places, errors = np.array([m[0] for m in matched]), np.array([m[1] for m in matched])
    row, col = (grid.north_max_m - places[:, 0]) / grid.gsd_m, (places[:, 1] - grid.east_min_m) / grid.gsd_m
    sigma = at_place(predicted.sigma_m, predicted, row, col)
    known = np.isfinite(sigma)
    sigma, errors = sigma[known], errors[known]
    third = max(1, len(sigma) // 3)
    order = np.argsort(sigma, kind="stable")
    best, worst = errors[order[:third]], errors[order[-third:]]
    test = spearmanr(sigma, errors)
    return Ranking(
        footprint_m, len(sigma), float(test.statistic), float(test.pvalue), float(np.median(best)),
        float(np.median(worst)), float((best > WRONG_M).mean()), float((worst > WRONG_M).mean()),
    )  # fmt: skip


def main(
    flight: Annotated[Path, typer.Argument(help="A flight folder with truth, video and reference map.")],
    footprint: Annotated[list[float] | None, typer.Option(help="Side compared, metres; repeatable  [30 45 60]")] = None,
    radius: Annotated[float, typer.Option(help="How far to search, metres.")] = 40.0,
    every: Annotated[int, typer.Option(min=1, help="Every so many frames.")] = 5,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Compare the predicted matchability of places with the errors of real matches there."""
    folder = FlightFolder.open(flight)
    setup = navigation_setup(folder)
    shots = pictures(folder, setup, every)
    found = [rank(setup, shots, side, radius) for side in footprint or [30.0, 45.0, 60.0]]
    if as_json:
        typer.echo(json.dumps([asdict(r) for r in found], indent=1))
        return
    table = Table("footprint m", "pictures", "Spearman", "p", "median m, best / worst third", "beyond 5 m", box=None)
    for r in found:
        shown = f"{r.p_value:.0e}" if math.isfinite(r.p_value) else ""
        table.add_row(
            f"{r.footprint_m:g}", str(r.pictures), f"{r.spearman:.2f}", shown,
            f"{r.error_best_third_m:.2f} / {r.error_worst_third_m:.2f}",
            f"{r.wrong_best_third:.0%} / {r.wrong_worst_third:.0%}",
        )  # fmt: skip
    Console().print(table)


if __name__ == "__main__":
    typer.run(main)
