"""``python -m benchmarks.pad``: the landing pad in rendered pictures: found, false, how far off, how long it takes.

Pads are drawn on the ground of simulated worlds (``benchmarks.pad_scenes``) through a lens with distortion, with blur,
noise and compression. Worlds and draws follow from the seeds.
"""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import cv2
import numpy as np
import typer
from rich.console import Console
from rich.progress import track

from benchmarks.kept_lines import finite
from benchmarks.pad_figure import Line, lines_svg
from benchmarks.pad_methods import METHODS, bound_m
from benchmarks.pad_scenes import HD, VGA, Look, PadScene, compressed, ground_of, looking_at_pad
from benchmarks.studies.cli import parse_seeds
from estimator.landing.detector import detect_circles
from estimator.landing.pad import circle_pad, tag_pad
from estimator.landing.pose import PadPose, TiltPrior
from estimator.landing.sighting import NoPad, PadSighting
from estimator.types import Image
from simulator.random_streams import rng_for

PAD = circle_pad("benchmark", 1.5, 0.3)
TAGS = tag_pad("benchmark", 0.9)
TILT_STD_RAD = math.radians(0.3)
RANGES_M = (20.0, 15.0, 10.0, 5.0)
CONDITIONS = {
    "plain": Look(jpeg=80),
    "30 % in shade": Look(jpeg=80, shaded=0.3),
    "30 % under patches": Look(jpeg=80, littered=0.3),
    "30 % under from one side": Look(jpeg=80, covered=0.3),
    "glare": Look(jpeg=80, glare=200.0),
    "blur of 4 px, noise of 6": Look(jpeg=80, motion_px=4.0, noise=6.0),
    "dark, JPEG of 40": Look(jpeg=40, gain=0.4),
}


@dataclass(frozen=True, slots=True)
class Found:
    """How often the pad was found at 20 m: alone, and where a filter expects it to 10 cm and 0.2 degrees."""

    condition: str
    pictures: int
    found: int
    expected: int
    wrong: int
    ambiguous: int
    ms: float


@dataclass(frozen=True, slots=True)
class Accuracy:
    """Errors of one method at one range: rms across (each axis) and along down, NEES (3 is right), flips."""

    method: str
    range_m: float
    pictures: int
    answered: int
    across_m: float
    down_m: float
    nees: float
    flips: int
    bound_across_m: float
    bound_down_m: float


@dataclass(frozen=True, slots=True)
class Descents:
    """Landings from 15 m beside the pad to above its centre, through the cylinder over its circle."""

    descents: int
    pictures: int
    seen: int
    flips: int
    nees: float
    worst_m: float


@dataclass(frozen=True, slots=True)
class Negatives:
    """Pictures of ground without a pad."""

    pictures: int
    false: int
    ms: float
    ms_p95: float


@dataclass(frozen=True, slots=True)
class Timing:
    """Processor time of detection and pose on one thread, over ranges from 20 m to 0.3 m."""

    size: str
    pictures: int
    median_ms: float
    p95_ms: float
    tracked_ms: float


def told(pose: PadPose, rng: np.random.Generator) -> TiltPrior:
    """Down as inertial sensors would give it."""
    down = pose.camera_from_pad[:, 2] + rng.normal(0.0, TILT_STD_RAD, 3)
    return TiltPrior(down / np.linalg.norm(down), TILT_STD_RAD)


def _somewhere(range_m: float, rng: np.random.Generator) -> PadPose:
    """A view from this height, about ten degrees off the vertical, the pad near the middle."""
    about, off = rng.uniform(0.0, 2.0 * math.pi), range_m * math.tan(rng.normal(math.radians(10.0), math.radians(4.0)))
    away = (off * math.cos(about), off * math.sin(about))
    return looking_at_pad(range_m, away, rng.uniform(0.0, 2.0 * math.pi), tuple(rng.normal(0.0, 0.03, 2).tolist()))


def _smeared(look: Look, rng: np.random.Generator) -> Look:
    """The same with a smear of up to 1.5 pixels where none is asked for, in a random direction."""
    length = look.motion_px or float(rng.uniform(0.0, 1.5))
    return Look(**{**asdict(look), "motion_px": length, "motion_rad": float(rng.uniform(0.0, math.pi))})


def detection(grounds: Sequence[Image], pictures: int, seed: int) -> Iterator[Found]:
    """Each condition at 20 m."""
    for condition, look in CONDITIONS.items():
        rng = rng_for(seed, "pad", condition)
        found = expected = wrong = ambiguous = 0
        spent = []
        for number in range(pictures):
            scene = PadScene(grounds[number % len(grounds)], VGA, PAD)
            pose = _somewhere(20.0, rng)
            image, prior = scene.render(pose, _smeared(look, rng), rng), told(pose, rng)
            started = time.process_time()
            seen = detect_circles(image, VGA, PAD, prior)
            spent.append((time.process_time() - started) * 1e3)
            guess = pose.moved(np.array((*rng.normal(0.0, 0.0035, 3), *rng.normal(0.0, 0.1, 3))))
            again = detect_circles(image, VGA, PAD, prior, guess)
            found += isinstance(seen, PadSighting)
            expected += isinstance(again, PadSighting)
            wrong += any(_is_wrong(one, pose) for one in (seen, again))
            ambiguous += isinstance(seen, PadSighting) and seen.ambiguous
        yield Found(condition, pictures, found, expected, wrong, ambiguous, float(np.median(spent)))


def _is_wrong(seen: PadSighting | NoPad, pose: PadPose) -> bool:
    """An accepted pose more than a twentieth of the range off, at its best."""
    if isinstance(seen, NoPad):
        return False
    off = [float(np.linalg.norm(one.pose.pos_pad_m - pose.pos_pad_m)) for one in seen.solutions]
    return min(off) > 0.05 * abs(float(pose.pos_pad_m[2]))


def accuracy(grounds: Sequence[Image], pictures: int, seed: int) -> Iterator[Accuracy]:
    """Every method at every range, on pictures of its own pad from the same places."""
    for range_m in RANGES_M:
        off: dict[str, list[tuple[np.ndarray[Any, Any], float, bool]]] = {name: [] for name in METHODS}
        bounds: dict[str, list[tuple[float, float]]] = {name: [] for name in METHODS}
        for number in range(pictures):
            ground = grounds[number % len(grounds)]
            rng = rng_for(seed, "accuracy", f"{range_m:g}", str(number))
            pose = _somewhere(range_m, rng)
            prior, look = told(pose, rng), _smeared(Look(jpeg=80), rng)
            pictured = {
                pad.name + type(pad).__name__: PadScene(ground, VGA, pad).render(pose, look, rng_for(seed, str(number)))
                for pad in (PAD, TAGS)
            }
            for name, method in METHODS.items():
                bounds[name].append(bound_m(method, VGA, PAD, TAGS, pose, TILT_STD_RAD))
                pad = TAGS if method.tags else PAD
                answer = method.run(pictured[pad.name + type(pad).__name__], VGA, pad, prior)
                if answer is None:
                    continue
                error = answer.pose.pos_pad_m - pose.pos_pad_m
                nees = float(error @ np.linalg.solve(answer.cov, error)) if answer.cov is not None else math.nan
                turned = float(answer.pose.camera_from_pad[:, 2] @ pose.camera_from_pad[:, 2]) < math.cos(0.1)
                off[name].append((error, nees, turned))
        for name, answers in off.items():
            errors = np.array([error for error, _, _ in answers]).reshape(-1, 3)
            bound = np.sqrt(np.mean(np.square(bounds[name]), axis=0))
            yield Accuracy(
                name, range_m, pictures, len(answers), _rms(errors[:, :2]), _rms(errors[:, 2]),
                float(np.mean([nees for _, nees, _ in answers])) if answers else math.nan,
                sum(turned for _, _, turned in answers), float(bound[0]), float(bound[1]),
            )  # fmt: skip


def _rms(values: np.ndarray[Any, Any]) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if values.size else math.nan


def descents(grounds: Sequence[Image], count: int, steps: int, kbit_s: int, seed: int) -> Descents:
    """Through the cylinder over the circle of the three centres; pictures as H.264 sends them.

    A flip is a best pose whose plane is more than six degrees off.
    """
    seen = flips = total = 0
    nees: list[float] = []
    worst = 0.0
    for number in track(range(count), "descents", transient=True, console=Console(stderr=True)):
        rng = rng_for(seed, "descent", str(number))
        scene = PadScene(grounds[number % len(grounds)], VGA, PAD)
        poses = list(_descent(steps, rng))
        look = _smeared(Look(), rng)
        images = compressed([scene.render(pose, look, rng) for pose in poses], kbit_s)
        for pose, image in zip(poses, images, strict=True):
            total += 1
            found = detect_circles(image, VGA, PAD, told(pose, rng))
            if isinstance(found, NoPad):
                continue
            seen += 1
            best = found.best
            error = best.pose.pos_pad_m - pose.pos_pad_m
            nees.append(float(error @ np.linalg.solve(best.cov_pos_pad_m2, error)))
            flips += float(best.pose.camera_from_pad[:, 2] @ pose.camera_from_pad[:, 2]) < math.cos(0.1)
            worst = max(worst, float(np.linalg.norm(error)) / abs(float(pose.pos_pad_m[2])))
    return Descents(count, total, seen, flips, float(np.mean(nees)), worst)


def _descent(steps: int, rng: np.random.Generator) -> Iterator[PadPose]:
    """From 15 m and some metres beside to 0.5 m above the centre, through the cylinder of radius 0.87 m."""
    about, heading = rng.uniform(0.0, 2.0 * math.pi), rng.uniform(0.0, 2.0 * math.pi)
    beside = rng.uniform(2.0, 4.0)
    off = tuple(rng.normal(0.0, 0.02, 2).tolist())
    for part in np.linspace(0.0, 1.0, steps):
        height = 15.0 * (0.5 / 15.0) ** part
        reach = beside * (1.0 - part)
        yield looking_at_pad(float(height), (reach * math.cos(about), reach * math.sin(about)), heading, off)


def negatives(grounds: Sequence[Image], pictures: int, seed: int) -> Negatives:
    """Ground at many scales, as if grass, gravel, roads and houses of every size were below; no prior half the time."""
    false, spent = 0, []
    scenes = [PadScene(ground, VGA, None) for ground in grounds]
    for number in track(range(pictures), "ground", transient=True, console=Console(stderr=True)):
        rng = rng_for(seed, "ground", str(number))
        # The ground's raster is laid out at 2 cm; from 100 m its houses and cars are as small as they really look.
        pose = _somewhere(float(np.exp(rng.uniform(math.log(2.0), math.log(100.0)))), rng)
        look = _smeared(Look(jpeg=int(rng.integers(40, 95)), noise=float(rng.uniform(0.0, 6.0))), rng)
        image = scenes[number % len(scenes)].render(pose, look, rng)
        started = time.process_time()
        found = detect_circles(image, VGA, PAD, told(pose, rng) if number % 2 else None)
        spent.append((time.process_time() - started) * 1e3)
        false += isinstance(found, PadSighting)
    return Negatives(pictures, false, float(np.median(spent)), float(np.percentile(spent, 95)))


def timing(grounds: Sequence[Image], pictures: int, seed: int) -> Iterator[Timing]:
    """At both sizes, one thread."""
    cv2.setNumThreads(1)
    for camera in (VGA, HD):
        rng = rng_for(seed, "timing")
        first, again = [], []
        for number in range(pictures):
            pose = _somewhere(float(np.exp(rng.uniform(math.log(0.3), math.log(20.0)))), rng)
            image = PadScene(grounds[number % len(grounds)], camera, PAD).render(
                pose, _smeared(Look(jpeg=80), rng), rng
            )
            prior = told(pose, rng)
            first.append(_ms(partial(detect_circles, image, camera, PAD, prior)))
            guess = pose.moved(rng.normal(0.0, 0.01, 6) * np.array((1, 1, 1, *[abs(pose.pos_pad_m[2])] * 3)))
            again.append(_ms(partial(detect_circles, image, camera, PAD, prior, guess)))
        yield Timing(
            f"{camera.width_px}x{camera.height_px}", pictures, float(np.median(first)),
            float(np.percentile(first, 95)), float(np.median(again)),
        )  # fmt: skip


def _ms(work: Callable[[], object]) -> float:
    started = time.process_time()
    work()
    return (time.process_time() - started) * 1e3


def markdown(rows: Sequence[Any]) -> str:
    """A table of equal dataclasses."""
    heads = list(asdict(rows[0]))
    lines = ["| " + " | ".join(head.replace("_", " ") for head in heads) + " |", "|" + "---|" * len(heads)]
    lines += ["| " + " | ".join(_cell(value) for value in asdict(row).values()) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _cell(value: object) -> str:
    if isinstance(value, float):
        return "" if math.isnan(value) else f"{value:.3g}"
    return str(value)


def figure(rows: Sequence[Accuracy]) -> str:
    """Errors across over range, each method beside its Cramér-Rao bound."""
    lines = []
    for name in METHODS:
        mine = [r for r in rows if r.method == name and r.answered]
        lines.append(Line(name, [(r.range_m, r.across_m) for r in mine], [(r.range_m, r.bound_across_m) for r in mine]))
    return lines_svg("Position across, rms per axis (dashed: Cramér-Rao bound)", "height, m", "m", lines)


def main(
    seeds: Annotated[str, typer.Option(help="Worlds, FIRST-LAST.")] = "401-405",
    short: Annotated[bool, typer.Option("--short", help="One world, few pictures.")] = False,
    share: Annotated[float, typer.Option(min=0.01, max=1.0, help="So much of the pictures only.")] = 1.0,
    only: Annotated[list[str] | None, typer.Option(help="detection, accuracy, descents, ground or timing.")] = None,
    out: Annotated[Path | None, typer.Option(help="Folder for landing.json and landing.svg.")] = None,
    cache: Annotated[Path | None, typer.Option(help="Folder that keeps the worlds.")] = None,
) -> None:
    """Measure the landing pad: detection, accuracy by method, descents, false pads, time."""
    parts = ("detection", "accuracy", "descents", "ground", "timing")
    wanted = list(only or parts)
    unknown = [name for name in wanted if name not in parts]
    if unknown:
        raise typer.BadParameter(f"--only '{unknown[0]}': the parts are {', '.join(parts)}")
    chosen = parse_seeds(seeds, short)[: 1 if short else None]
    grounds = [ground_of(seed, cache) for seed in track(chosen, "worlds", console=Console(stderr=True), transient=True)]
    seed = chosen[0]

    def count(few: int, many: int) -> int:
        return few if short else max(few, round(share * many))

    measured: dict[str, list[Any]] = {}
    work: dict[str, Callable[[], list[Any]]] = {
        "detection": lambda: list(detection(grounds, count(6, 150), seed)),
        "accuracy": lambda: list(accuracy(grounds, count(4, 60), seed)),
        "descents": lambda: [descents(grounds, count(2, 200), 12, 1500, seed)],
        "ground": lambda: [negatives(grounds, count(20, 5000), seed)],
        "timing": lambda: list(timing(grounds, count(5, 60), seed)),
    }
    for name in parts:
        if name in wanted:
            measured[name] = work[name]()
            typer.echo(f"\n{name}\n\n{markdown(measured[name])}")
    if out is not None:
        out.mkdir(parents=True, exist_ok=True)
        rows = {name: [finite(asdict(row)) for row in each] for name, each in measured.items()}
        (out / "landing.json").write_text(json.dumps({"seeds": chosen, **rows}, indent=1, allow_nan=False) + "\n")
        if "accuracy" in measured:
            (out / "landing.svg").write_text(figure(measured["accuracy"]))


if __name__ == "__main__":
    typer.run(main)
