"""``python -m benchmarks.eights``: targets from a small fixed wing in figures of eight, the experiment of chapter 7.

Conte's thesis (2009, section 7.5) flies a MAV of a few hundred grams in a figure of eight, 70 m above a truck, and
compares registration with the ray from the telemetered pose: 2.3 m against 22 m after some twenty sightings. Here a
fixed wing is computed (coordinated turns in wind, gusts) over the simulator's worlds and their pictures rendered; the
reference is the simulator's of 0.5 m/px in another season. No filter helps: each sighting has the pose that a consumer
unit telemeters, its tilt and heading wrong by three degrees each, constant in the body, with noise on top. As the
thesis had no compass, ``--course`` takes the heading from the course over ground, and ``--late`` stamps telemetry late.
"""

from __future__ import annotations

import json
import math
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.table import Table

from backend.navigation.setup import TERRAIN_STD_M, MapFiles, NavigationSetup, Place, build_setup, profile_of_flight
from backend.targeting import scene_of
from backend.uncertainty import circular_error_m
from benchmarks.studies.cli import default_cache, parse_seeds
from benchmarks.targets import Miss, summary
from estimator.errors import GeometryError
from estimator.geometry.rotation import matrix_from_euler, matrix_from_q, q_from_matrix, q_from_rotvec
from estimator.sighting import ClickPlaces, lay_on_map, locate_click
from estimator.targets.fusion import RAY, REGISTERED, FusedTarget, FusionConfig, fuse
from estimator.targets.line_of_sight import LineOfSightConfig, LineOfSightFilter, SightedTarget, View
from estimator.types import Float, Mode, NavigationState
from simulator.recording import flight_meta
from simulator.scenario import Scenario
from simulator.sensors.camera import CameraView
from simulator.visibility import Sight
from simulator.world.landmarks import Landmark
from simulator.world.world import World, world_for

HEIGHT_M, AIRSPEED_M_S, WIND_M_S = 70.0, 19.0, 4.0
HALF_LENGTH_M = 200.0
GUST_RAD, GUST_S = math.radians(2.0), 1.5
PITCH_RAD = math.radians(2.0)
GRAVITY_M_S2 = 9.81
LOOK_EVERY_S, LOOK_FOR_S = 0.2, 240.0
CLICK_STD_PX = 1.0
ATTITUDE_NOISE_RAD = math.radians(1.0)
POSITION_BIAS_M, POSITION_NOISE_M, HEIGHT_BIAS_M = 1.5, 0.5, 2.0
SIGHTINGS = 20
WIDE_M = 30.0


@dataclass(frozen=True, slots=True)
class Telemetry:
    """How the telemetered pose errs: constant tilt and heading errors (deg), heading from the course, seconds late."""

    bias_deg: float = 3.0
    course: bool = False
    late_s: float = 0.0


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """The true motion at times (n,) s: position (n, 3) in the world's NED, roll, pitch, yaw (n, 3), course (n,) rad."""

    t_s: Float
    pos_ned_m: Float
    angles_rad: Float
    course_rad: Float


@dataclass(frozen=True, slots=True, eq=False)
class Sighted:
    """One target with the places that each picture gave, at its true place (3,)."""

    places: tuple[ClickPlaces, ...]
    true_ned_m: Float
    by_lines: SightedTarget | None


def figure_of_eight(about_ned_m: Float, rng: np.random.Generator) -> Flown:
    """Figures of eight about a place (3,): Bernoulli's curve at constant airspeed in constant wind, banked in turns."""
    t_s = np.arange(0.0, LOOK_FOR_S, 0.05)
    azimuth, wind_from = rng.uniform(0.0, 2.0 * np.pi, 2)
    wind = WIND_M_S * np.array([np.cos(wind_from), np.sin(wind_from)])
    turned = np.array([[np.cos(azimuth), -np.sin(azimuth)], [np.sin(azimuth), np.cos(azimuth)]])
    phase = rng.uniform(0.0, 2.0 * np.pi)
    ne, velocity = np.zeros((len(t_s), 2)), np.zeros((len(t_s), 2))
    for n in range(len(t_s)):
        ne[n] = turned @ _lemniscate(phase)
        tangent = turned @ (_lemniscate(phase + 1e-4) - _lemniscate(phase - 1e-4)) / 2e-4
        along = tangent / np.linalg.norm(tangent)
        ahead = float(wind @ along)
        speed = ahead + math.sqrt(AIRSPEED_M_S**2 - float(wind @ wind) + ahead**2)
        velocity[n] = speed * along
        phase += 0.05 * speed / float(np.linalg.norm(tangent))
    air = velocity - wind
    yaw = np.unwrap(np.arctan2(air[:, 1], air[:, 0]))
    roll = np.arctan(np.gradient(yaw, t_s) * AIRSPEED_M_S / GRAVITY_M_S2)
    gusts = _wandering(rng, (len(t_s), 3), 0.05, GUST_S)
    angles = np.column_stack((roll, np.full(len(t_s), PITCH_RAD), yaw)) + GUST_RAD * gusts
    down = about_ned_m[2] - HEIGHT_M - 2.0 * _wandering(rng, (len(t_s), 1), 0.05, 10.0)[:, 0]
    pos = np.column_stack((about_ned_m[:2] + ne, down))
    return Flown(t_s, pos, angles, np.unwrap(np.arctan2(velocity[:, 1], velocity[:, 0])))


def _lemniscate(phase: float) -> Float:
    """Bernoulli's: the turns are tightest at the ends, where the radius is a third of the half length."""
    across_m = HALF_LENGTH_M * math.cos(phase) / (1.0 + math.sin(phase) ** 2)
    return np.array([across_m, across_m * math.sin(phase)])


def _wandering(rng: np.random.Generator, shape: tuple[int, int], step_s: float, time_s: float) -> Float:
    """Gauss-Markov noise of unit variance over the first axis."""
    keep = math.exp(-step_s / time_s)
    out = rng.normal(size=shape)
    for n in range(1, shape[0]):
        out[n] = keep * out[n - 1] + math.sqrt(1.0 - keep**2) * out[n]
    return out


class Reported:
    """What the aircraft says of its pose, with constant errors drawn once."""

    def __init__(self, telemetry: Telemetry, setup: NavigationSetup, rng: np.random.Generator) -> None:
        self._how, self._setup, self._rng = telemetry, setup, rng
        way, bias = rng.uniform(0.0, 2.0 * np.pi), math.radians(telemetry.bias_deg)
        self._bias_body = bias * np.array([math.cos(way), math.sin(way), rng.choice((-1.0, 1.0))])
        self._offset_ned_m = rng.normal(size=3) * np.array([POSITION_BIAS_M, POSITION_BIAS_M, HEIGHT_BIAS_M])

    def state(self, flown: Flown, index: int) -> NavigationState:
        """The state for the picture at ``index``, with the covariance that such a unit is known to have."""
        said = max(index - round(self._how.late_s / 0.05), 0)
        angles = flown.angles_rad[said].copy()
        if self._how.course:
            angles[2] = flown.course_rad[said]
        noise = ATTITUDE_NOISE_RAD * self._rng.normal(size=3)
        body = matrix_from_euler(*angles) @ matrix_from_q(q_from_rotvec(self._bias_body + noise))
        pos = flown.pos_ned_m[said] + self._offset_ned_m + POSITION_NOISE_M * self._rng.normal(size=3)
        bias = math.radians(self._how.bias_deg)
        tilt, heading = math.hypot(bias / math.sqrt(2.0), ATTITUDE_NOISE_RAD), math.hypot(bias, ATTITUDE_NOISE_RAD)
        if self._how.course:
            heading = math.hypot(heading, math.asin(WIND_M_S / AIRSPEED_M_S) / math.sqrt(2.0))
        late_m = self._how.late_s * AIRSPEED_M_S
        horizontal = math.hypot(math.hypot(POSITION_BIAS_M, POSITION_NOISE_M), late_m)
        std = np.array([horizontal, horizontal, math.hypot(HEIGHT_BIAS_M, POSITION_NOISE_M), tilt, tilt, heading])
        cov = np.diag(std**2)
        frame, ground = self._setup.frame, self._setup.ground
        lat, lon, alt = frame.geodetic_from_ned(pos)
        below = float(np.atleast_1d(ground.alt_amsl_m(pos[0:1], pos[1:2]))[0])
        return NavigationState(
            t_us=round(flown.t_s[index] * 1e6), mode=Mode.GPS, process_model="attitude", lat_rad=float(lat),
            lon_rad=float(lon), alt_amsl_m=float(alt), alt_agl_m=float(alt) - below, pos_ned_m=pos,
            vel_ned_m_s=np.zeros(3), q_ned_from_body=q_from_matrix(body),
            q_ned_from_camera=q_from_matrix(body @ self._setup.mount.body_from_camera), cov_pos_ned_m2=cov[:3, :3],
            cov_vel_ned_m2_s2=np.eye(3), cov_attitude_rad2=cov[3:, 3:], cov_camera_pose=cov,
            last_fix_age_s=math.inf, lever_ned_m=body @ self._setup.mount.lever_arm_frd_m,
        )  # fmt: skip


def setup_of(scenario: Scenario, world: World, folder: Path) -> NavigationSetup:
    """Camera, reference and elevation of a world as a station reads them from files."""
    world.reference.write(folder / "reference.tif")
    world.elevation.write(folder / "elevation.tif")
    lat, lon, alt = world.frame.geodetic_from_ned(np.zeros(3))
    profile = profile_of_flight(flight_meta(scenario, world, np.zeros(3), None))
    files = MapFiles(None, folder / "reference.tif", folder / "elevation.tif", None)
    return build_setup(profile, files, Place(float(lat), float(lon), float(alt)))


def sight(
    scenario: Scenario, world: World, setup: NavigationSetup, landmark: Landmark, telemetry: Telemetry, seed: int
) -> Sighted:
    """Fly about a landmark and locate it in pictures spread over the time that it is in view."""
    rng = np.random.default_rng([seed, 70, *landmark.name.encode()])
    true = np.array([landmark.north_m, landmark.east_m, -landmark.height_m])
    flown = figure_of_eight(true, rng)
    reported = Reported(telemetry, setup, rng)
    camera, mount = scenario.camera.intrinsics(), scenario.camera.mount()
    view = CameraView(world, camera, seed, scenario.camera.noise_std, scenario.camera.vignetting)
    seen = list(_in_view(flown, Sight(world, camera), mount.body_from_camera, mount.lever_arm_frd_m, landmark.name))
    chosen = [seen[k] for k in np.unique(np.linspace(0, len(seen) - 1, SIGHTINGS).round().astype(int))] if seen else []
    to_local = setup.frame.ned_from_geodetic(*world.frame.geodetic_from_ned(true))
    places, views, states = [], [], []
    for number, (index, uv_px, pos, ned_from_camera) in enumerate(chosen):
        image = cv2.cvtColor(view.render(pos, ned_from_camera), cv2.COLOR_BGR2GRAY)
        state = reported.state(flown, index)
        clicked = uv_px + CLICK_STD_PX * rng.normal(size=2)
        scene = scene_of(setup, state)
        placed = lay_on_map(np.asarray(image, dtype=np.uint8), state, scene)
        try:
            pixel = float(clicked[0]), float(clicked[1])
            places.append(locate_click(pixel, state, placed, scene, CLICK_STD_PX, number))
        except GeometryError:
            continue
        body = matrix_from_q(state.q_ned_from_body)
        views.append(View(state.lens_ned_m, body, mount.body_from_camera, camera.rays(clicked)))
        states.append(state)
    return Sighted(tuple(places), to_local, _by_lines(places, views, states))


def _by_lines(
    places: list[ClickPlaces], views: list[View], states: list[NavigationState]
) -> SightedTarget | None:  # fmt: skip
    """From where the first ray meets the ground, whose height is all that is taken of it."""
    first = next((p.ray for p in places if p.ray is not None), None)
    if first is None:
        return None
    std = np.sqrt(np.diag(states[0].cov_camera_pose))
    tilt, heading = (math.sqrt(max(s**2 - ATTITUDE_NOISE_RAD**2, 1e-6)) for s in (float(std[3]), float(std[5])))
    config = LineOfSightConfig(
        (tilt, tilt, heading), (float(std[0]), float(std[1]), float(std[2])),
        math.hypot(ATTITUDE_NOISE_RAD, CLICK_STD_PX / 500.0), POSITION_NOISE_M,
    )  # fmt: skip
    prior = np.diag([WIDE_M**2, WIDE_M**2, TERRAIN_STD_M**2])
    try:
        return LineOfSightFilter(first.pos_ned_m, prior, config).add(*views)
    except GeometryError:
        return None


def _in_view(
    flown: Flown, sight_: Sight, body_from_camera: Float, lever_frd_m: Float, name: str
) -> Iterator[tuple[int, Float, Float, Float]]:
    """Index, pixel (2,), camera (3,) and its rotation (3, 3) of every look at which a landmark is in the picture."""
    for index in range(0, len(flown.t_s), round(LOOK_EVERY_S / 0.05)):
        body = matrix_from_euler(*flown.angles_rad[index])
        pos, ned_from_camera = flown.pos_ned_m[index] + body @ lever_frd_m, body @ body_from_camera
        for what, uv_px in sight_.visible(pos, ned_from_camera):
            if what == name:
                yield index, uv_px, pos, ned_from_camera


def misses_of(sighted: Sighted) -> list[Miss]:
    """By each method, and of one sighting and of all: how far off."""
    found: list[Miss] = []

    def note(what: str, pos_ned_m: Float, cov_ned_m2: Float) -> None:
        d = pos_ned_m - sighted.true_ned_m
        found.append(Miss(what, float(d[0]), float(d[1]), circular_error_m(cov_ned_m2[:2, :2])))

    for places in sighted.places:
        for each in (places.ray, places.registered):
            if each is not None:
                kind = REGISTERED if each is places.registered else RAY
                note(f"1 sighting, {kind}", each.pos_ned_m, each.cov_ned_m2)
        note("1 sighting, fused", places.fused.pos_ned_m, places.fused.cov_ned_m2)
    if sighted.by_lines is not None:
        note(f"{SIGHTINGS} sightings, lines of sight", sighted.by_lines.pos_ned_m, sighted.by_lines.cov_ned_m2)
    for name, kinds in (("ray", {RAY}), ("registered", {REGISTERED}), ("fused", {RAY, REGISTERED})):
        all_of = _all(sighted, kinds)
        if all_of is not None:
            note(f"{SIGHTINGS} sightings, {name}", all_of.pos_ned_m, all_of.cov_ned_m2)
    return found


def _all(sighted: Sighted, kinds: set[str]) -> FusedTarget | None:
    sightings = [s for places in sighted.places for s in places.sightings if s.kind in kinds]
    return fuse(sightings, 0.0, FusionConfig()) if sightings else None


def run_seed(seed: int, targets: int, telemetry: Telemetry, cache: Path) -> list[Miss]:
    """Sight the landmarks of one world that lie far enough from its rim."""
    scenario = Scenario()
    world = world_for(scenario.world.spec(seed), cache / "worlds")
    limit_m = scenario.world.half_size_m - HALF_LENGTH_M - 60.0
    inside = [m for m in world.landmarks if max(abs(m.north_m), abs(m.east_m)) < limit_m]
    order = np.random.default_rng([seed, 71]).permutation(len(inside))[:targets]
    found: list[Miss] = []
    with tempfile.TemporaryDirectory(prefix="pilotage-eights-") as folder:
        setup = setup_of(scenario, world, Path(folder))
        for k in order:
            found += misses_of(sight(scenario, world, setup, inside[int(k)], telemetry, seed))
    return found


def main(
    seeds: Annotated[str, typer.Option(help="The first and the last seed.")] = "201-210",
    targets: Annotated[int, typer.Option(min=1, help="Targets of each seed.")] = 4,
    bias_deg: Annotated[float, typer.Option(min=0.0, help="Constant error of tilt and of heading.")] = 3.0,
    course: Annotated[bool, typer.Option("--course", help="Heading from the course over ground.")] = False,
    late_s: Annotated[float, typer.Option("--late", min=0.0, help="Telemetry is so late, unknown to all.")] = 0.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Locate targets from a simulated fixed wing in figures of eight and print how far off they are."""
    chosen = parse_seeds(seeds, short=False)
    console = Console(stderr=True)
    cv2.setNumThreads(1)
    telemetry = Telemetry(bias_deg, course, late_s)
    found: list[Miss] = []
    for seed in chosen:
        found += run_seed(seed, targets, telemetry, default_cache())
        console.print(f"seed {seed}")
    figures: dict[str, Any] = summary(found)
    if as_json:
        typer.echo(json.dumps({"seeds": seeds, "targets_per_seed": targets, "found": figures}, indent=1))
        return
    keys = ("ce50_m", "ce90_m", "worst_m", "stated_ce90_m", "inside_ce90")
    table = Table("by", "count", "CE50 m", "CE90 m", "worst m", "stated CE90 m", "inside CE90", box=None)
    for what, of in figures.items():
        table.add_row(what, f"{of['count']:.0f}", *(f"{of[k]:.2f}" for k in keys))
    Console(width=120).print(table)


if __name__ == "__main__":
    typer.run(main)
