"""An operator's recorded clicks, located with the replayed states and pictures, and fused per target."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from backend.navigation.setup import UNKNOWN_SLOPE_STD, NavigationSetup
from backend.pointing import CLICK_STD_PX, STATED_HEIGHT_SHARE, Pointing, ground_for
from backend.targeting import scene_of
from backend.uncertainty import circular_error_m
from estimator.errors import GeometryError
from estimator.geometry.local import LocalFrame
from estimator.registration.alignment import NoMatch
from estimator.registration.placement import Placement
from estimator.sighting import ClickPlaces, Scene, lay_on_map, locate_click
from estimator.targets.fusion import TargetFusion
from estimator.types import Float, Image, Mode, NavigationState
from geodata.elevation import FlatGround
from geodata.flight import FlightFolder
from geodata.flight_tables import Click
from geodata.flight_write import CsvAppender

COLUMNS = ("target", "lat_deg", "lon_deg", "alt_amsl_m", "ce90_m", "method", "observations")
SIGHTING_COLUMNS = ("time_us", "target", "u_px", "v_px", "method", "lat_deg", "lon_deg", "alt_amsl_m", "ce90_m", "note")
FUSED = "fused"
# clicks carry the time of their picture; a table of times may round it
SAME_PICTURE_US = 20_000


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


@dataclass(frozen=True, slots=True, eq=False)
class LocatedClick:
    """One click by one method; without a place, ``note`` says why."""

    click: Click
    method: str
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    ce90_m: float
    note: str = ""


class ClickPictures:
    """Keeps the pictures that were clicked on while a flight goes by, packed without loss."""

    def __init__(self, clicks: Sequence[Click]) -> None:
        self._times = np.unique([click.t_video_us for click in clicks]).astype(np.int64)
        self._kept: dict[int, tuple[int, Image]] = {}

    def offer(self, t_video_us: int, image: Image) -> None:
        """A picture (rows, cols) or (rows, cols, 3) of the video's clock ``t_video_us``."""
        first, last = np.searchsorted(self._times, (t_video_us - SAME_PICTURE_US, t_video_us + SAME_PICTURE_US + 1))
        for time_us in self._times[first:last].tolist():
            away_us = abs(time_us - t_video_us)
            if time_us in self._kept and self._kept[time_us][0] <= away_us:
                continue
            grey = image if image.ndim == 2 else image.mean(axis=2).astype(np.uint8)
            self._kept[time_us] = away_us, np.asarray(cv2.imencode(".png", grey)[1])

    def at(self, t_video_us: int) -> Image | None:
        """The grey picture (rows, cols) of a click's time; None where none came."""
        kept = self._kept.get(t_video_us)
        return None if kept is None else np.asarray(cv2.imdecode(kept[1], cv2.IMREAD_GRAYSCALE), dtype=np.uint8)


def locate_clicks(
    folder: FlightFolder, setup: NavigationSetup, state_at: Callable[[int], NavigationState | None], offset_us: int,
    pictures: ClickPictures,
) -> tuple[list[LocatedTarget], list[LocatedClick]]:  # fmt: skip
    """Locate each click of ``clicks.csv`` by every method, and fuse those of one target."""
    if not setup.has_camera:
        return [], []
    placed: dict[int, Placement | NoMatch] = {}
    fusions: dict[str, TargetFusion] = {}
    found: dict[str, list[ClickPlaces]] = {}
    located: list[LocatedClick] = []
    numbers: dict[tuple[int, float, float], int] = {}  # the same pixel of the same picture again tells nothing new
    for click in folder.clicks():
        number = numbers.setdefault((click.t_video_us, click.u_px, click.v_px), len(numbers))
        state = state_at(click.t_video_us + offset_us)
        if state is None or state.mode is Mode.LOST:
            located.append(_nowhere(click, "where the vehicle was then is not known"))
            continue
        scene = scene_of(setup, state)
        if click.t_video_us not in placed:
            image = pictures.at(click.t_video_us)
            placed[click.t_video_us] = (
                NoMatch("no picture of that time") if image is None else lay_on_map(image, state, scene)
            )
        uv_px = (click.u_px, click.v_px)
        try:
            places = locate_click(
                uv_px, state, placed[click.t_video_us], _pointed(scene, setup, click, state), CLICK_STD_PX, number,
                click.height_above_ground_m,
            )  # fmt: skip
        except GeometryError as error:
            located.append(_nowhere(click, str(error)))  # above the horizon or off the lens: adds nothing
            continue
        located += _by_method(click, places, setup.frame)
        fusions.setdefault(click.target, TargetFusion(scene.map_offset_std_m, scene.fusion)).add(*places.sightings)
        found.setdefault(click.target, []).append(places)
    return [_combined(name, fusions[name], found[name], setup.frame) for name in sorted(fusions)], located


def _pointed(scene: Scene, setup: NavigationSetup, click: Click, state: NavigationState) -> Scene:
    """The scene for a click, with the ground that it is on and what may be wrong with the height it stands at."""
    std_m = math.hypot(scene.ground_std_m, STATED_HEIGHT_SHARE * click.height_above_ground_m)
    if click.ground != "flat":
        return replace(scene, ground_std_m=std_m)
    ground = ground_for(setup, Pointing(click.height_above_ground_m, "flat"), state)
    slope_std = scene.slope_std if isinstance(setup.ground, FlatGround) else UNKNOWN_SLOPE_STD
    return replace(scene, ground=ground, ground_std_m=std_m, slope_std=slope_std)


def _combined(name: str, fusion: TargetFusion, found: list[ClickPlaces], frame: LocalFrame) -> LocatedTarget:
    fused = fusion.result()
    methods = {places.method for places in found}
    method = methods.pop() if len(methods) == 1 else FUSED
    place = _degrees(fused.pos_ned_m, frame)
    return LocatedTarget(name, *place, circular_error_m(fused.cov_ned_m2[:2, :2]), method, len(found))


def _by_method(click: Click, places: ClickPlaces, frame: LocalFrame) -> list[LocatedClick]:
    rows = [
        LocatedClick(click, each.method, *_degrees(each.pos_ned_m, frame), circular_error_m(each.cov_ned_m2[:2, :2]))
        for each in (places.ray, places.registered)
        if each is not None
    ]
    fused = places.fused
    ce90_m = circular_error_m(fused.cov_ned_m2[:2, :2])
    rows.append(LocatedClick(click, FUSED, *_degrees(fused.pos_ned_m, frame), ce90_m, places.refusal))
    return rows


def _nowhere(click: Click, note: str) -> LocatedClick:
    nan = float("nan")
    return LocatedClick(click, "", nan, nan, nan, nan, note)


def _degrees(pos_ned_m: Float, frame: LocalFrame) -> tuple[float, float, float]:
    lat, lon, alt = frame.geodetic_from_ned(pos_ned_m)
    return float(np.degrees(lat)), float(np.degrees(lon)), float(alt)


def write_targets(path: Path, targets: list[LocatedTarget]) -> None:
    """Write ``targets.csv`` (design, section 4)."""
    path.unlink(missing_ok=True)
    with CsvAppender(path, COLUMNS) as table:
        for t in targets:
            table.write(
                t.target, f"{t.lat_deg:.8f}", f"{t.lon_deg:.8f}", f"{t.alt_amsl_m:.2f}", f"{t.ce90_m:.2f}", t.method,
                t.observations,
            )  # fmt: skip


def write_sightings(path: Path, located: list[LocatedClick]) -> None:
    """Write ``sightings.csv``: every click by every method, empty where it has no place."""
    path.unlink(missing_ok=True)
    with CsvAppender(path, SIGHTING_COLUMNS) as table:
        for s in located:
            known = np.isfinite(s.ce90_m)
            place = (f"{s.lat_deg:.8f}", f"{s.lon_deg:.8f}", f"{s.alt_amsl_m:.2f}", f"{s.ce90_m:.2f}")
            table.write(
                s.click.t_video_us, s.click.target, f"{s.click.u_px:.2f}", f"{s.click.v_px:.2f}", s.method,
                *(place if known else ("",) * 4), s.note,
            )  # fmt: skip
