"""Registrations of which the truth is known: right places with drawn pose errors, and wrong places.

Pictures are taken on simulated flights over several worlds, whose maps are of another season and sensor. The pose that
the matcher is told errs as a navigator's would, by more and by less; the wrong ones are other places of the same map
and the map of another world.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from benchmarks.kidnapped import Ground, ground_of
from estimator.geometry.camera import Camera
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from estimator.measurements.map_fix import MapFixConfig, symmetric_steps
from estimator.ports import Correlation, GroundModel
from estimator.registration.alignment import CameraPose, Match, MatcherConfig, NoMatch, Registrar
from estimator.registration.verify import Peak, features
from estimator.types import Float, Image
from simulator.random_streams import rng_for
from simulator.scenario import CameraSection, FlightSection, Scenario, WorldSection
from simulator.sensors.camera import CameraView
from simulator.simulation import STEP_US, Simulation
from simulator.world.world import World, world_for

HEIGHTS_M = ((100.0, 128.0), (60.0, 80.0), (230.0, 260.0))
"""Heights above ground of the flights, in turn over the seeds; the last are matched at half the map's resolution."""
JPEG_QUALITY = 90  # what a video codec leaves of a picture, roughly
WRONG_PEAK_M = 5.0
WRONG_PEAK_PX = 5.0
SIGMAS = {
    "position_m": (1.0, 25.0),
    "heading_rad": (0.008, 0.07),
    "tilt_rad": (0.004, 0.02),
    "height_m": (0.7, 4.0),
}
"""Between what the standard deviations of the drawn pose errors are, evenly over their logarithms."""


@dataclass(frozen=True, slots=True, eq=False)
class Shot:
    """A picture and the pose it was taken from."""

    image: Image
    pose: CameraPose
    agl_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Sample:
    """One registration.

    ``features`` are those of the outlier probability. ``displacement_ne_m`` (2,) is the truth, None at wrong places,
    whose surface is not kept either. ``wrong`` says that the peak is not where the truth is.
    """

    seed: int
    features: Float
    wrong: bool
    peak: Peak
    correlation: Correlation | None
    displacement_ne_m: Float | None

    @property
    def right_place(self) -> bool:
        """Whether the truth lies on the surface."""
        return self.displacement_ne_m is not None


@dataclass(frozen=True, slots=True, eq=False)
class PoseError:
    """What a told pose is off by, with the standard deviations that a navigator would state."""

    pos_ned_m: Float
    rotvec_ned_rad: Float
    radius_m: float
    heading_std_rad: float
    height_std_m: float

    def told(self, pose: CameraPose) -> CameraPose:
        """What the matcher is told of a pose."""
        turn = matrix_from_q(q_from_rotvec(self.rotvec_ned_rad))
        return CameraPose(pose.pos_ned_m + self.pos_ned_m, turn @ pose.ned_from_camera)


def draw_error(rng: np.random.Generator, agl_m: float, config: MapFixConfig) -> PoseError:
    """A pose error and the search that suits it."""
    std = {name: float(np.exp(rng.uniform(np.log(low), np.log(high)))) for name, (low, high) in SIGMAS.items()}
    position = np.array([std["position_m"], std["position_m"], std["height_m"]]) * rng.standard_normal(3)
    turn = np.array([std["tilt_rad"], std["tilt_rad"], std["heading_rad"]]) * rng.standard_normal(3)
    on_ground_m = float(np.hypot(std["position_m"], agl_m * std["tilt_rad"]))
    radius_m = min(config.search_sigmas * on_ground_m + config.min_search_m, config.max_search_m)
    return PoseError(position, turn, radius_m, std["heading_rad"], std["height_m"])


def collect(
    seeds: Sequence[int], config: MatcherConfig, pictures: int, folder: Path, tell: Callable[[str], None],
    section: WorldSection | None = None,
) -> list[Sample]:  # fmt: skip
    """Registrations of ``pictures`` of each seed's flight, at the right place and at a wrong one each."""
    samples: list[Sample] = []
    other: Ground | None = None
    for number, seed in enumerate(seeds):
        scenario = _scenario(seed, pictures, section or WorldSection())
        world = world_for(scenario.world.spec(seed), folder / "worlds")
        ground = ground_of(world, folder)
        if other is None:
            before = world_for(scenario.world.spec(seed - 1), folder / "worlds")
            other = ground_of(before, folder)
        samples += _over(world, scenario, seed, ground, other, config)
        other = ground
        tell(f"seed {seed} ({number + 1} of {len(seeds)}): {len(samples)} registrations")
    return samples


def _scenario(seed: int, pictures: int, section: WorldSection) -> Scenario:
    return Scenario(
        name="likelihood", duration_s=pictures + 1.0, gps_denied_s=(), camera=CameraSection(frames_per_s=1.0),
        flight=FlightSection(height_agl_m=HEIGHTS_M[seed % len(HEIGHTS_M)], hover_stops=0), world=section,
    )  # fmt: skip


def _shots(world: World, scenario: Scenario, seed: int) -> list[Shot]:
    simulation = Simulation(scenario, world, seed, scenario.start_unix_us)
    section = scenario.camera
    view = CameraView(world, section.intrinsics(), seed, section.noise_std, section.vignetting)
    shots = []
    for _ in range(round(scenario.duration_s * 1e6) // STEP_US):
        seen = simulation.step().exposure
        if seen is None:
            continue
        grey = cv2.cvtColor(view.render(seen.camera_pos_ned_m, seen.ned_from_camera), cv2.COLOR_BGR2GRAY)
        _, packed = cv2.imencode(".jpg", grey, [cv2.IMWRITE_JPEG_QUALITY, JPEG_QUALITY])
        image = np.asarray(cv2.imdecode(packed, cv2.IMREAD_GRAYSCALE), dtype=np.uint8)
        pos = seen.camera_pos_ned_m
        agl_m = float(world.ground_down_m(pos[0:1], pos[1:2])[0] - pos[2])
        shots.append(Shot(image, CameraPose(pos, seen.ned_from_camera), agl_m))
    return shots


def _over(
    world: World, scenario: Scenario, seed: int, ground: Ground, other: Ground, config: MatcherConfig
) -> list[Sample]:
    camera = scenario.camera.intrinsics()
    here, elsewhere = (
        Registrar(camera, g.reference, g.elevation, world.spec.alt_amsl_m, config) for g in (ground, other)
    )
    rng = rng_for(seed, "likelihood")
    samples: list[Sample] = []
    for number, shot in enumerate(_shots(world, scenario, seed)):
        error = draw_error(rng, shot.agl_m, MapFixConfig())
        match = _register(here, shot, shot.pose, error)
        if isinstance(match, Match):
            truth = true_displacement(match.centre_ned_m, shot.pose, error.told(shot.pose), camera, world.ground_down_m)
            samples.append(_right(seed, match, truth))
        error = draw_error(rng, shot.agl_m, MapFixConfig())
        on_other_map = bool(number % 2)
        terrain = other.elevation if on_other_map else ground.elevation
        place = shot.pose.pos_ned_m[:2] if on_other_map else _elsewhere(rng, shot, error, world)
        match = _register(elsewhere if on_other_map else here, shot, _above(shot, place, terrain, world), error)
        if isinstance(match, Match):
            samples.append(Sample(seed, features(match.evidence), True, match.peak, None, None))
    return samples


def _register(registrar: Registrar, shot: Shot, pose: CameraPose, error: PoseError) -> Match | NoMatch:
    matcher = registrar.config
    headings = symmetric_steps(2.5 * error.heading_std_rad, matcher.heading_step_rad, most=7)
    scales = symmetric_steps(2.5 * error.height_std_m / shot.agl_m, matcher.scale_step, most=2)
    return registrar.register(shot.image, error.told(pose), error.radius_m, headings, scales)


def true_displacement(
    centre_ned_m: Float, pose: CameraPose, told: CameraPose, camera: Camera,
    ground_down_m: Callable[[Float, Float], Float],
) -> Float:  # fmt: skip
    """Where the camera at ``pose`` sees what the told one would see at a point (3,), less that point: (2,) NE."""
    uv = camera.project(((centre_ned_m - told.pos_ned_m) @ told.ned_from_camera)[None])
    ray = pose.ned_from_camera @ camera.rays(uv)[0]
    down = float(centre_ned_m[2])
    for _ in range(8):
        # onto the plane at the height of the ground below the last point: relief is gentle and the ray steep
        point = pose.pos_ned_m + ray * ((down - pose.pos_ned_m[2]) / ray[2])
        down = float(ground_down_m(point[0:1], point[1:2])[0])
    displacement: Float = point[:2] - centre_ned_m[:2]
    return displacement


def _right(seed: int, match: Match, truth_ne_m: Float) -> Sample:
    off_m = float(np.hypot(*(match.displacement_ne_m - truth_ne_m)))
    wrong = off_m > max(WRONG_PEAK_M, WRONG_PEAK_PX * match.correlation.step_m)
    return Sample(seed, features(match.evidence), wrong, match.peak, match.correlation, truth_ne_m)


def _elsewhere(rng: np.random.Generator, shot: Shot, error: PoseError, world: World) -> Float:
    """A place (2,) of the map so far off that the right one is not on the surface."""
    reach = world.spec.half_size_m - 0.7 * shot.agl_m
    away_m = error.radius_m * 1.5 + 4.0 * float(np.abs(error.pos_ned_m[:2]).max()) + 20.0
    while True:
        place: Float = rng.uniform(-reach, reach, size=2)
        if np.abs(place - shot.pose.pos_ned_m[:2]).max() > away_m:
            return place


def _above(shot: Shot, place_ne_m: Float, terrain: GroundModel, world: World) -> CameraPose:
    """The picture's pose moved to another place (2,), as high above the ground there."""
    alt = float(terrain.alt_amsl_m(place_ne_m[0:1], place_ne_m[1:2])[0])
    return CameraPose(np.array([*place_ne_m, world.spec.alt_amsl_m - alt - shot.agl_m]), shot.pose.ned_from_camera)
