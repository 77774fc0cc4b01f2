"""``python -m benchmarks.contour``: the published contour registration beside the station's own, on single pictures.

Pictures of simulated worlds at 70 m over a map of another season (``benchmarks.contour_scenes``), with telemetry whose
heading is up to 45 degrees wrong. Each method lays the same pictures on the map and carries a target's pixel there; a
match is false where the target comes to lie more than five metres off, or nowhere.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import typer
from rich.console import Console
from rich.progress import track

from benchmarks.contour_scenes import HEADING_MAX_RAD, TILT_STD_RAD, Ground, Place, Shot, Video, open_place, shots
from benchmarks.kept_lines import finite
from benchmarks.studies.cli import parse_seeds
from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.ports import GroundModel, ReferenceMap
from estimator.registration.alignment import NoMatch
from estimator.registration.contour import (
    Alignment,
    AlignmentConfig,
    ContourConfig,
    place_aligned,
    place_by_contours,
)
from estimator.registration.locate import Located, locate
from estimator.registration.placement import Placement, PlacementConfig, place
from estimator.registration.pose_prior import PosePrior, heading_of
from estimator.targets.registered import TargetErrors, locate_registered
from estimator.types import Image

FALSE_M = 5.0
SEARCH_M = 25.0
SURE_BELOW = 0.001
CHI2_90_2DOF = 4.605
ERRORS = TargetErrors(pixel_std_px=0.5, ground_std_m=0.5)
PICTURES, SHORT_PICTURES = 6, 3

Method = Callable[[Place, Shot], Placement | NoMatch]


@dataclass(frozen=True, slots=True)
class Answer:
    """What a method made of one picture.

    ``error_m`` is how far the target is off, infinite where there is no answer, whose ``reason`` is given;
    ``nees`` the error squared by its covariance, ``heading_deg`` what the placement's heading is off.
    """

    ground: str
    error_m: float
    nees: float
    heading_deg: float
    elapsed_ms: float
    reason: str = ""

    @property
    def is_false(self) -> bool:
        """More than five metres off, or none."""
        return not self.error_m <= FALSE_M


@dataclass(frozen=True, slots=True)
class Row:
    """A method's figures over all pictures.

    ``false`` counts wrong places and none; ``answered`` those with a place, of which ``wrong`` are false. Circular
    errors are of the answered, wrong ones included; ``inside90`` is the share of them in the stated 90 % ellipse, and
    ``median_m`` is over all pictures. ``false_by_ground`` counts by what lay under the camera.
    """

    video: str
    method: str
    pictures: int
    false: int
    answered: int
    wrong: int
    median_m: float
    ce50_m: float
    ce90_m: float
    inside90: float
    heading_median_deg: float
    false_by_ground: dict[str, int]
    elapsed_ms: float


def _contours(by: Alignment, judged: bool) -> Method:
    config = ContourConfig(alignment=AlignmentConfig(by=by))
    config = replace(config, placement=_taken(config.placement, judged))

    def method(where: Place, shot: Shot) -> Placement | NoMatch:
        return place_by_contours(*_scene(where, shot), shot.told, shot.cov_pose, shot.cov_pose, config)

    return method


def _registered(by: Alignment, judged: bool) -> Method:
    alignment, config = AlignmentConfig(by=by), _taken(PlacementConfig(), judged)

    def method(where: Place, shot: Shot) -> Placement | NoMatch:
        return place_aligned(*_scene(where, shot), shot.told, shot.cov_pose, shot.cov_pose, alignment, config)

    return method


def _taken(config: PlacementConfig, judged: bool) -> PlacementConfig:
    """Any place within the search's reach as the paper takes it, or what the outlier probability lets pass."""
    judgement = config.max_outlier_probability if judged else 1.0
    return replace(config, radius_m=SEARCH_M, max_outlier_probability=judgement)


def _scene(where: Place, shot: Shot) -> tuple[Image, Camera, ReferenceMap, GroundModel, float]:
    return shot.image, shot.camera, where.reference, where.elevation, where.frame.alt_m


def _located(where: Place, shot: Shot) -> Placement | NoMatch:
    """As ``pilotage target`` does it."""
    std = np.sqrt(np.diag(shot.cov_pose))
    prior = PosePrior(
        shot.told.pos_ned_m[:2], SEARCH_M, float(std[0]), float(shot.told.pos_ned_m[2]), float(std[2]),
        heading_of(shot.told.ned_from_camera), float(std[5]), tilt_std_rad=2.0 * TILT_STD_RAD,
    )  # fmt: skip
    scene = _scene(where, shot)
    found = locate(*scene, prior)
    if not isinstance(found, Located):
        return NoMatch(found.reason)
    if not found.accepted or found.outlier_probability > SURE_BELOW:
        return NoMatch(found.reason or "not surely enough for a coordinate")
    return place(*scene, found.pose, found.cov_pose, prior.covariance())


METHODS: dict[str, Method] = {
    "contours, telemetry's heading": _contours(Alignment.TELEMETRY, judged=False),
    "contours, algorithm 1": _contours(Alignment.LINES, judged=False),
    "contours, hypotheses": _contours(Alignment.HYPOTHESES, judged=False),
    "contours, sweep": _contours(Alignment.SWEEP, judged=False),
    "contours, hypotheses, judged": _contours(Alignment.HYPOTHESES, judged=True),
    "registered, telemetry's heading": _registered(Alignment.TELEMETRY, judged=False),
    "registered, hypotheses": _registered(Alignment.HYPOTHESES, judged=False),
    "registered, sweep": _registered(Alignment.SWEEP, judged=False),
    "registered, sweep, judged": _registered(Alignment.SWEEP, judged=True),
    "located and registered": _located,
}


def answer_of(method: Method, where: Place, shot: Shot) -> Answer:
    """One picture by one method, beside the truth."""
    started = time.perf_counter()
    placed = method(where, shot)
    elapsed_ms = (time.perf_counter() - started) * 1e3
    if isinstance(placed, NoMatch):
        return Answer(shot.ground, math.inf, math.nan, math.nan, elapsed_ms, placed.reason)
    try:
        found = locate_registered(placed, shot.camera, shot.uv_px, where.elevation, where.frame, ERRORS)
    except GeometryError as error:
        return Answer(shot.ground, math.inf, math.nan, math.nan, elapsed_ms, str(error))
    d = found.pos_ned_m[:2] - shot.target_ne_m
    nees = float(d @ np.linalg.solve(found.cov_on_map_ned_m2[:2, :2], d))
    made = heading_of(placed.ned_from_camera) + placed.correction[5]
    off = made - heading_of(shot.told.ned_from_camera) - shot.turn_rad
    heading_deg = math.degrees(abs((off + math.pi) % (2.0 * math.pi) - math.pi))
    return Answer(shot.ground, float(np.hypot(*d)), nees, heading_deg, elapsed_ms)


def row_of(video: str, method: str, answers: Sequence[Answer]) -> Row:
    """Figures of a method's answers; not a number where there is none to make them of."""
    error = np.array([a.error_m for a in answers])
    answered = [a for a in answers if math.isfinite(a.error_m)]
    by_ground = {str(g): sum(a.is_false for a in answers if a.ground == g) for g in Ground}
    return Row(
        video, method, len(answers), sum(a.is_false for a in answers), len(answered),
        sum(a.is_false for a in answered), float(np.median(error)),
        _percentile([a.error_m for a in answered], 50), _percentile([a.error_m for a in answered], 90),
        float(np.mean([a.nees <= CHI2_90_2DOF for a in answered])) if answered else math.nan,
        _percentile([a.heading_deg for a in answered], 50), by_ground,
        float(np.median([a.elapsed_ms for a in answers])),
    )  # fmt: skip


def _percentile(values: Sequence[float], percent: float) -> float:
    return float(np.percentile(values, percent)) if values else math.nan


def run(
    seeds: Sequence[int], pictures: int, heading_max_rad: float, only: Sequence[str], cache: Path | None,
    console: Console,
) -> dict[tuple[str, str], list[Answer]]:  # fmt: skip
    """Every method on every picture."""
    found: dict[tuple[str, str], list[Answer]] = {}
    for seed in track(seeds, "worlds", console=console, transient=True):
        where = open_place(seed, cache)
        for video in Video:
            for shot in shots(where, seed, pictures, video, heading_max_rad):
                for name in only:
                    found.setdefault((video, name), []).append(answer_of(METHODS[name], where, shot))
    return found


def markdown(rows: Sequence[Row]) -> str:
    """The table of the results page."""
    heads = (
        "video", "method", "pictures", "false", *(f"over {g}" for g in Ground), "answered", "of them wrong",
        "median, m", "CE50, m", "CE90, m", "inside 90 %", "heading, deg", "ms",
    )  # fmt: skip
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for r in rows:
        cells = (
            r.video, r.method, str(r.pictures), f"{r.false} ({r.false / r.pictures:.0%})",
            *(str(r.false_by_ground[g]) for g in Ground), str(r.answered), str(r.wrong), _metres(r.median_m),
            _metres(r.ce50_m), _metres(r.ce90_m),
            "" if math.isnan(r.inside90) else f"{r.inside90:.0%}",
            "" if math.isnan(r.heading_median_deg) else f"{r.heading_median_deg:.1f}", f"{r.elapsed_ms:.0f}",
        )  # fmt: skip
        lines.append("| " + " | ".join(cells) + " |")
    return "\n".join(lines) + "\n"


def _metres(value: float) -> str:
    return f"{value:.2f}" if math.isfinite(value) else "none"


def main(
    seeds: Annotated[str, typer.Option(help="Worlds, FIRST-LAST.")] = "201-220",
    pictures: Annotated[int | None, typer.Option(min=1, help=f"Of each world  [{PICTURES}]")] = None,
    heading_error: Annotated[float, typer.Option(min=0, max=90, help="The largest, degrees.")] = math.degrees(
        HEADING_MAX_RAD
    ),
    only: Annotated[list[str] | None, typer.Option(help="A method by its name; repeatable.")] = None,
    short: Annotated[bool, typer.Option("--short", help="One world, few pictures.")] = False,
    cache: Annotated[Path | None, typer.Option(help="Folder that keeps the worlds.")] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON, each answer included.")] = False,
) -> None:
    """Compare the published contour registration, with and without its alignment, with the station's own."""
    names = list(only or METHODS)
    unknown = [name for name in names if name not in METHODS]
    if unknown:
        raise typer.BadParameter(f"--only '{unknown[0]}': the methods are {', '.join(METHODS)}")
    chosen = parse_seeds(seeds, short)[: 1 if short else None]
    count = pictures or (SHORT_PICTURES if short else PICTURES)
    found = run(chosen, count, math.radians(heading_error), names, cache, Console(stderr=True))
    rows = [row_of(video, name, found[video, name]) for video in Video for name in names]
    if as_json:
        answers = {f"{video}, {name}": [asdict(a) for a in each] for (video, name), each in found.items()}
        about = {"seeds": chosen, "rows": [finite(asdict(r)) for r in rows]}
        answers = {key: [finite(a) for a in each] for key, each in answers.items()}
        typer.echo(json.dumps({**about, "answers": answers}, indent=1, allow_nan=False))
        return
    typer.echo(markdown(rows))


if __name__ == "__main__":
    typer.run(main)
