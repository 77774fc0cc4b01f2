"""``python -m benchmarks.following``: targets clicked once, followed, lost from view and found again, over seeds.

For each seed one flight over a parked car and one over a car that drives, both among twins of it: see
``following_scenes``. The tracker and the motion filter get pictures and a navigation that errs; truth only judges.
"""

from __future__ import annotations

import json
import time
from collections.abc import Sequence
from dataclasses import asdict, dataclass, field, replace
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from benchmarks.following_scenes import (
    FRAMES_PER_S,
    TARGET_HEIGHT_M,
    Disturbance,
    FollowScene,
    NavigationErrors,
    Pose,
    world_of,
)  # fmt: skip
from benchmarks.studies.cli import parse_seeds
from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.geometry.ground import ground_point_covariance, intersect_terrain
from estimator.targets.motion import MotionState, PlaceSighting, TargetMotion
from estimator.targets.ray import pixel_ray
from estimator.targets.tracker import CannotFollowError, Sighting, TargetTracker
from estimator.targets.view import ExpectedView, Motion, expected_view
from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.scenario import CameraSection
from simulator.world.world import World

LEVELS = {
    "poor": Disturbance(1.5, 1.0),
    "own": Disturbance(1.1, 0.5),  # as the station's own estimate without GPS errs: docs/results/navigation.md
    "fair": Disturbance(0.7, 0.4),
}
CLICK_STD_PX = 1.5
WRONG_M, GONE_S, BACK_S, MARGIN_PX = 2.5, 1.0, 3.0, 20.0
WARM_UP_S, FAST_M_S = 4.0, 8.0
GROUND_STD_M = 0.5


@dataclass(slots=True)
class Outcome:
    """What came of one flight; errors in metres and m/s while followed, squared errors over covariances (2 numbers)."""

    seed: int
    moving: bool
    level: str
    returns: int = 0
    found_again: int = 0
    wrong_again: int = 0
    wrong_out_of_view: int = 0
    absences_s: list[float] = field(default_factory=list)
    seconds_to_find: list[float] = field(default_factory=list)
    sightings: int = 0
    wrong_sightings: int = 0
    in_view: int = 0
    pixel_px: list[float] = field(default_factory=list)
    pixel_nees: list[float] = field(default_factory=list)
    pos_m: list[float] = field(default_factory=list)
    vel_m_s: list[float] = field(default_factory=list)
    pos_nees: list[float] = field(default_factory=list)
    vel_nees: list[float] = field(default_factory=list)
    fast: list[bool] = field(default_factory=list)
    unseen_pos_m: list[float] = field(default_factory=list)
    verdicts: list[int] = field(default_factory=list)
    ms: list[float] = field(default_factory=list)
    search_ms: list[float] = field(default_factory=list)
    start_ms: float = 0.0
    refused: str = ""


def run_flight(world: World, seed: int, moving: bool, level: str, duration_s: float, say: Console | None) -> Outcome:
    """One flight over one target."""
    section = CameraSection()
    scene = FollowScene(world, seed, moving, duration_s, section.intrinsics(), section.mount())
    return _Run(scene, seed, level, say).run()


class _Run:
    def __init__(self, scene: FollowScene, seed: int, level: str, say: Console | None) -> None:
        self.scene, self.camera, self.say = scene, scene.camera, say
        self.errors = NavigationErrors(seed, LEVELS[level])
        self.rng = rng_for(seed, "following", "click")
        self.out = Outcome(seed, scene.moving, level)
        self.tracker: TargetTracker | None = None
        self.motion = TargetMotion()
        self.clicked = np.zeros(2)  # of the target's middle, in its own axes
        self.began_s = 0.0
        self.gone_since: float | None = 0.0
        self.away_s = 0.0
        self.back: tuple[float, str] | None = None

    def run(self) -> Outcome:
        for k in range(round(self.scene.duration_s * FRAMES_PER_S)):
            t_s = k / FRAMES_PER_S
            pose = self.scene.pose(t_s)
            believed = self.errors.believed(pose, 1.0 / FRAMES_PER_S)
            if self.tracker is None:
                if not self._click(t_s, pose, believed):
                    return self.out
            else:
                self._follow(self.tracker, t_s, pose, believed)
        self._close()
        return self.out

    def _click(self, t_s: float, pose: Pose, believed: Pose) -> bool:
        """Start as soon as the target is well in the picture; False where the tracker refuses it."""
        place, yaw, _ = self.scene.target_ned_m(t_s)
        uv = self.camera.project((place - pose.pos_ned_m) @ pose.ned_from_camera)
        if not _inside(uv, self.camera, 70.0):
            return True
        picture = self.scene.picture(t_s, pose)
        click = uv + CLICK_STD_PX * self.rng.standard_normal(2)
        true_view = expected_view(pose.pos_ned_m, pose.ned_from_camera, self.camera, place, np.eye(2))
        self.clicked = _turn(-yaw) @ np.linalg.solve(true_view.px_per_m, click - uv)
        try:
            sighting = self._place(t_s, believed, click, np.eye(2))
            view = self._view_of(believed, sighting.pos_ned_m, np.eye(2))
            began = time.process_time()
            self.tracker = TargetTracker.start(picture, click, _us(t_s), view.px_per_m)
            self.out.start_ms = 1e3 * (time.process_time() - began)
        except CannotFollowError as error:
            self.out.refused = str(error)
            return False
        self.motion.update(sighting)
        self.began_s, self.gone_since = t_s, None
        return True

    def _follow(self, tracker: TargetTracker, t_s: float, pose: Pose, believed: Pose) -> None:
        place, yaw, speed = self.scene.target_ned_m(t_s)
        true_uv = self.camera.project((place - pose.pos_ned_m) @ pose.ned_from_camera)
        state = self.motion.at(_us(t_s))
        found: Sighting | None = None
        view = self._expected(believed, state)
        if view is not None:
            picture = self.scene.picture(t_s, pose)
            lost = tracker.lost
            began = time.process_time()
            answer = tracker.update(picture, _us(t_s), view)
            ms = 1e3 * (time.process_time() - began)
            (self.out.search_ms if lost else self.out.ms).append(ms)
            found = answer if isinstance(answer, Sighting) else None
        wrong = False
        if found is not None:
            wrong = self._judge_pixel(found, pose, place, yaw, true_uv)
            place_seen = self._place(t_s, believed, found.uv_px, found.cov_px2)
            state = self.motion.update(replace(place_seen, vel_ne_m_s=found.vel_ne_m_s, vel_std_m_s=found.vel_std_m_s))
        self._judge_returns(t_s, true_uv, found, wrong)
        self._judge_motion(t_s, state, place, yaw, speed, found is not None)

    def _expected(self, believed: Pose, state: MotionState) -> ExpectedView | None:
        place = np.array([*state.seen_ne_m, state.pos_ned_m[2]])
        motion = Motion(state.seen_vel_ne_m_s, state.cov_seen_vel_ne_m2_s2, *state.course, state.moving)
        try:
            return expected_view(
                believed.pos_ned_m, believed.ned_from_camera, self.camera, place, state.cov_seen_ne_m2, motion
            )
        except GeometryError:
            return None

    def _view_of(self, believed: Pose, place: Float, cov: Float) -> ExpectedView:
        return expected_view(believed.pos_ned_m, believed.ned_from_camera, self.camera, place, cov)

    def _place(self, t_s: float, believed: Pose, uv: Float, cov_px2: Float) -> PlaceSighting:
        """The pixel's ray cut with the ground as navigation has it."""
        ray = believed.ned_from_camera @ pixel_ray(self.camera, (float(uv[0]), float(uv[1])))
        ground = self.scene.world.terrain

        def down_at(north: Float, east: Float) -> Float:
            return -ground.at(north, east) - TARGET_HEIGHT_M

        point = intersect_terrain(believed.pos_ned_m, ray, down_at)
        if not np.isfinite(point).all():
            point = believed.pos_ned_m + ray * (down_at(*believed.pos_ned_m[:2]) - believed.pos_ned_m[2]) / ray[2]
        std_px = float(np.sqrt(np.linalg.eigvalsh(cov_px2)[-1]))
        where = believed.pos_ned_m, ray, point, np.zeros(2)
        slow = ground_point_covariance(*where, self.errors.cov, CLICK_STD_PX / self.camera.fx_px, GROUND_STD_M)
        white = np.diag([LEVELS[self.out.level].white_pos_std_m ** 2] * 3 + [
            np.radians(LEVELS[self.out.level].white_attitude_std_deg) ** 2] * 3)  # fmt: skip
        own = ground_point_covariance(*where, white, std_px / self.camera.fx_px, 0.0)
        return PlaceSighting(_us(t_s), point, own[:2, :2], slow[:2, :2], GROUND_STD_M)

    def _judge_pixel(self, found: Sighting, pose: Pose, place: Float, yaw: float, true_uv: Float) -> bool:
        self.out.sightings += 1
        view = expected_view(pose.pos_ned_m, pose.ned_from_camera, self.camera, place, np.eye(2))
        if not np.hypot(*np.linalg.solve(view.px_per_m, found.uv_px - true_uv)) <= WRONG_M:
            self.out.wrong_sightings += 1
            return True
        miss = found.uv_px - (true_uv + view.px_per_m @ _turn(yaw) @ self.clicked)
        self.out.pixel_px.append(float(np.hypot(*miss)))
        self.out.pixel_nees.append(float(miss @ np.linalg.solve(found.cov_px2, miss)))
        return False

    def _judge_returns(self, t_s: float, true_uv: Float, found: Sighting | None, wrong: bool) -> None:
        inside = _inside(true_uv, self.camera, 0.0)
        well_inside = _inside(true_uv, self.camera, MARGIN_PX)
        self.out.in_view += well_inside
        if found is not None and found.found_again and wrong:
            self.out.wrong_out_of_view += not inside
        if not inside:
            self._close(t_s)
            self.gone_since = t_s if self.gone_since is None else self.gone_since
            return
        if well_inside and self.gone_since is not None and self.back is None and t_s - self.gone_since >= GONE_S:
            self.back = (t_s, "waiting")
            self.away_s = t_s - self.gone_since
        if well_inside and self.back is None:
            self.gone_since = None
        if self.back is not None and found is not None and self.back[1] != "found":
            if not wrong:
                self.out.seconds_to_find.append(t_s - self.back[0])
                self.back = (self.back[0], "found")
            elif found.found_again and self.back[1] == "waiting":
                self.back = (self.back[0], "wrong")

    def _close(self, t_s: float | None = None) -> None:
        """A return ends as the target leaves again, or the flight ends; short ones do not count unless it was found."""
        if self.back is None:
            return
        since, how = self.back
        end = self.scene.duration_s if t_s is None else t_s
        if end - since >= BACK_S or how != "waiting":
            self.out.returns += 1
            self.out.absences_s.append(self.away_s)
            self.out.found_again += how == "found"
            self.out.wrong_again += how == "wrong"
        if self.say is not None:
            self.say.print(f"  back at {since:.1f} s after {self.away_s:.1f} s for {end - since:.1f} s: {how}")
        self.back, self.gone_since = None, t_s

    def _judge_motion(self, t_s: float, state: MotionState, place: Float, yaw: float, speed: float, seen: bool) -> None:
        if t_s - self.began_s < WARM_UP_S:
            return
        miss = state.pos_ned_m[:2] - place[:2]
        miss_vel = state.vel_ne_m_s - speed * np.array([np.cos(yaw), np.sin(yaw)])
        if not seen:
            self.out.unseen_pos_m.append(float(np.hypot(*miss)))
            return
        self.out.pos_m.append(float(np.hypot(*miss)))
        self.out.vel_m_s.append(float(np.hypot(*miss_vel)))
        self.out.pos_nees.append(float(miss @ np.linalg.solve(state.cov_pos_ne_m2, miss)))
        vel_cov = state.cov_vel_ne_m2_s2 + 1e-9 * np.eye(2)
        self.out.vel_nees.append(float(miss_vel @ np.linalg.solve(vel_cov, miss_vel)))
        self.out.fast.append(speed >= FAST_M_S)
        self.out.verdicts.append(-1 if state.moving is None else int(state.moving))


def _turn(angle: float) -> Float:
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def _inside(uv: Float, camera: Camera, margin_px: float) -> bool:
    limit = np.array([camera.width_px - 1, camera.height_px - 1])
    return bool(np.isfinite(uv).all() and (uv >= margin_px).all() and (uv <= limit - margin_px).all())


def _us(t_s: float) -> int:
    return round(t_s * 1e6)


def summary(rows: Sequence[Outcome]) -> dict[str, float | int]:
    """The table's figures over flights of one kind."""
    fast = np.concatenate([r.fast for r in rows]) if rows[0].moving else np.concatenate([r.fast for r in rows]) < 1

    def all_of(name: str) -> Float:
        return np.concatenate([np.asarray(getattr(r, name), dtype=np.float64) for r in rows])

    def rms(values: Float) -> float:
        return float(np.sqrt(np.mean(values**2))) if values.size else float("nan")

    def middle(values: Float, q: float) -> float:
        return float(np.quantile(values, q)) if values.size else float("nan")

    fast = fast.astype(bool)
    verdicts = all_of("verdicts")
    returns, sightings = sum(r.returns for r in rows), sum(r.sightings for r in rows)
    wrong = sum(r.wrong_again + r.wrong_out_of_view for r in rows)
    claims = wrong + sum(r.found_again for r in rows)
    return {
        "flights": len(rows),
        "refused": sum(bool(r.refused) for r in rows),
        "returns": returns,
        "absence_median_s": middle(all_of("absences_s"), 0.5),
        "absence_most_s": middle(all_of("absences_s"), 1.0),
        "found_again_share": sum(r.found_again for r in rows) / max(returns, 1),
        "wrong_returns": wrong,
        "wrong_return_share": wrong / max(claims, 1),
        "seconds_to_find_median": middle(all_of("seconds_to_find"), 0.5),
        "sightings": sightings,
        "seen_share": (sightings - sum(r.wrong_sightings for r in rows)) / max(sum(r.in_view for r in rows), 1),
        "wrong_sighting_share": sum(r.wrong_sightings for r in rows) / max(sightings, 1),
        "pixel_rms_px": rms(all_of("pixel_px")),
        "pixel_nees": float(np.mean(all_of("pixel_nees"))),
        "pos_rms_m": rms(all_of("pos_m")),
        "vel_rms_m_s": rms(all_of("vel_m_s")),
        "pos_rms_fast_m": rms(all_of("pos_m")[fast]),
        "vel_rms_fast_m_s": rms(all_of("vel_m_s")[fast]),
        "pos_nees": float(np.mean(all_of("pos_nees"))),
        "vel_nees": float(np.mean(all_of("vel_nees"))),
        "unseen_pos_median_m": middle(all_of("unseen_pos_m"), 0.5),
        "said_moving_share": float(np.mean(verdicts == 1)),
        "said_standing_share": float(np.mean(verdicts == 0)),
        "follow_ms_median": middle(all_of("ms"), 0.5),
        "follow_ms_p95": middle(all_of("ms"), 0.95),
        "search_ms_median": middle(all_of("search_ms"), 0.5),
        "search_ms_p95": middle(all_of("search_ms"), 0.95),
        "start_ms_median": middle(np.array([r.start_ms for r in rows]), 0.5),
    }


def main(
    seeds: Annotated[str, typer.Option(help="First and last seed; those from 201 on have chosen nothing.")] = "201-220",
    duration_s: Annotated[float, typer.Option(min=20.0, help="Of each flight.")] = 120.0,
    level: Annotated[str, typer.Option(help=f"Errors of navigation: {', '.join(LEVELS)}.")] = "poor",
    kind: Annotated[str, typer.Option(help="standing, moving or both.")] = "both",
    short: Annotated[bool, typer.Option("--short", help="One flight of each kind, 30 s.")] = False,
    work: Annotated[Path, typer.Option(help="Folder for worlds.")] = Path("following"),
    out: Annotated[
        Path | None, typer.Option(help="File for the figures so far, written anew after each flight.")
    ] = None,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
    verbose: Annotated[bool, typer.Option("--verbose", help="Say what came of each return.")] = False,
) -> None:
    """Follow parked and driving cars among their twins through simulated flights. Hours for twenty seeds."""
    cv2.setNumThreads(1)
    numbers = parse_seeds(seeds, short)[: 1 if short else None]
    if level not in LEVELS:
        message = f"--level is one of {', '.join(LEVELS)}"
        raise typer.BadParameter(message)
    kinds = {"both": (False, True), "standing": (False,), "moving": (True,)}.get(kind)
    if kinds is None:
        message = "--kind is standing, moving or both"
        raise typer.BadParameter(message)
    errors = Console(stderr=True)
    outcomes: list[Outcome] = []
    for seed in numbers:
        world = world_of(seed, work)
        for moving in kinds:
            began = time.monotonic()
            one = run_flight(world, seed, moving, level, 30.0 if short else duration_s, errors if verbose else None)
            outcomes.append(one)
            errors.print(
                f"{seed} {'moving' if moving else 'standing'}: {one.found_again} of {one.returns} found again, "
                f"{one.wrong_again + one.wrong_out_of_view} wrong, {one.wrong_sightings} of {one.sightings} sightings "
                f"wrong {one.refused} ({time.monotonic() - began:.0f} s)"
            )
            if out is not None:
                out.write_text(json.dumps(_figures(outcomes), indent=1))
    if as_json:
        typer.echo(json.dumps(_figures(outcomes), indent=1))
        return
    tables = {name: summary(rows) for name, rows in _groups(outcomes).items() if rows}
    table = Table("", *tables)
    for key in next(iter(tables.values())):
        table.add_row(key, *(f"{t[key]:.3g}" for t in tables.values()))
    Console().print(table)


def _figures(outcomes: list[Outcome]) -> dict[str, object]:
    tables = {name: summary(rows) for name, rows in _groups(outcomes).items() if rows}
    return {"summary": tables, "flights": [_brief(one) for one in outcomes]}


def _groups(outcomes: list[Outcome]) -> dict[str, list[Outcome]]:
    return {
        "standing": [o for o in outcomes if not o.moving and not o.refused],
        "moving": [o for o in outcomes if o.moving and not o.refused],
    }


def _brief(one: Outcome) -> dict[str, object]:
    return {k: v for k, v in asdict(one).items() if not isinstance(v, list)}


if __name__ == "__main__":
    typer.run(main)
