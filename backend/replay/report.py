"""``report.html``: a flight as one page without scripts: map, errors, targets with pictures, plots, figures."""

from __future__ import annotations

import html
import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from backend.replay.figures import Drawing, MapPicture, broken_at_gaps, data_uri, drawn
from backend.video.jpeg import encode_jpeg
from estimator.geometry.local import LocalFrame
from estimator.types import Float, Image, NavigationState
from geodata.errors import GeodataError
from geodata.flight import FlightFolder
from geodata.radiometry import Radiometry
from geodata.raster import open_raster
from geodata.resample import resample

MAX_POINTS = 1500
MAP_PX = 900
MAP_QUALITY = 72
AROUND_M = 40.0
CUT_PX = 160
MAX_PICTURES = 100
GOOD, BAD = "#3a7d44", "#d1495b"


@dataclass(frozen=True, slots=True, eq=False)
class Places:
    """Geodetic positions (n,) at times (n,), radians and metres."""

    t_us: np.ndarray
    lat_rad: Float
    lon_rad: Float
    alt_amsl_m: Float


@dataclass(frozen=True, slots=True, eq=False)
class FlownStates:
    """An estimate: where, one sigma north and east (n, 2), velocity NED (n, 3), mode of each."""

    at: Places
    std_ne_m: Float
    vel_ned_m_s: Float
    modes: Sequence[str]

    @classmethod
    def of(cls, states: Sequence[NavigationState]) -> FlownStates:
        """Out of the estimator's own states."""
        numbers = np.array([(s.lat_rad, s.lon_rad, s.alt_amsl_m) for s in states]).reshape(-1, 3)
        variances = np.array([np.diag(s.cov_pos_ned_m2)[:2] for s in states]).reshape(-1, 2)
        return cls(
            Places(np.array([s.t_us for s in states]), *numbers.T), np.sqrt(np.maximum(variances, 0.0)),
            np.array([s.vel_ned_m_s for s in states]).reshape(-1, 3), [str(s.mode) for s in states],
        )  # fmt: skip


@dataclass(frozen=True, slots=True, eq=False)
class ShownTarget:
    """A target of the flight; numbers are None, and the picture is, where nobody knows them."""

    name: str
    lat_deg: float | None
    lon_deg: float | None
    ce90_m: float | None
    method: str
    t_us: int | None
    jpeg: bytes | None


@dataclass(frozen=True, slots=True, eq=False)
class Flown:
    """Everything a page shows. ``fixes`` are times of accepted and of refused ones."""

    folder: FlightFolder
    states: FlownStates
    gps: Places | None
    fixes: tuple[np.ndarray, np.ndarray]
    targets: Sequence[ShownTarget]
    figures: dict[str, Any]


def write_report(path: Path, flown: Flown) -> None:
    """Write the page."""
    path.write_text(report_page(flown), encoding="utf-8")


def report_page(flown: Flown) -> str:
    """The page; it asks nothing of any network. ValueError for a flight without a single state."""
    states = flown.states
    if not len(states.at.t_us):
        raise ValueError("a flight without an estimate has no report")
    frame = LocalFrame(float(states.at.lat_rad[0]), float(states.at.lon_rad[0]), float(states.at.alt_amsl_m[0]))
    start_us = int(states.at.t_us[0])
    places = {"estimate": states.at}
    truth = flown.folder.truth()
    if truth is not None and len(truth.t_unix_us) > 1:
        places["truth"] = Places(truth.t_unix_us, truth.lat_rad, truth.lon_rad, truth.alt_amsl_m)
    if flown.gps is not None and len(flown.gps.t_us):
        places["GPS"] = flown.gps
    ned = {name: _ned(frame, place) for name, place in places.items()}
    title = html.escape(f"Flight {flown.folder.name}")
    figures = html.escape(json.dumps(flown.figures, indent=1, default=str))
    drawings = [_map(flown, frame, places, ned), *_curves(flown, places, ned, start_us)]
    parts = [*(drawn(drawing) for drawing in drawings), _modes(states.modes), _targets(flown.targets, start_us)]
    body = "\n".join(parts)
    return (
        f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{title}</title><style>"
        "body{font:15px sans-serif;margin:2em auto;max-width:60em;color:#1b2530}svg{background:#fff;"
        "border:1px solid #ccc;max-width:100%;height:auto}pre{background:#f4f4f4;padding:1em;overflow:auto}"
        "table{border-collapse:collapse}"
        "td,th{padding:4px 10px;border-bottom:1px solid #ddd;text-align:left}td img{display:block}"
        f"</style><h1>{title}</h1>{body}<h2>Figures</h2><pre>{figures}</pre></html>\n"
    )


def cutout(image: Image, u_px: float, v_px: float) -> bytes:
    """JPEG of the square about a pixel, with a cross on it; what lies outside the picture is black."""
    half = CUT_PX // 2
    picture = image if image.ndim == 3 else np.repeat(image[..., None], 3, axis=2)
    padded = np.pad(picture, ((half, half), (half, half), (0, 0)))
    row, col = math.floor(v_px + 0.5), math.floor(u_px + 0.5)
    row, col = min(max(row, 0), image.shape[0] - 1), min(max(col, 0), image.shape[1] - 1)
    square = padded[row : row + CUT_PX, col : col + CUT_PX].copy()
    for arm in (slice(half - 14, half - 4), slice(half + 5, half + 15)):
        square[half, arm] = square[arm, half] = (154, 107, 255)
    return encode_jpeg(square)


def _ned(frame: LocalFrame, at: Places) -> Float:
    return frame.ned_from_geodetic(at.lat_rad, at.lon_rad, at.alt_amsl_m)


def _thinned(curve: Float) -> Float:
    return curve[:: max(1, len(curve) // MAX_POINTS)]


def _map(flown: Flown, frame: LocalFrame, places: dict[str, Places], ned: dict[str, Float]) -> Drawing:
    tracks = {}
    for name, place in places.items():
        t_s = (place.t_us - place.t_us[0]) / 1e6
        east, north = (broken_at_gaps(t_s, ned[name][:, axis])[:, 1] for axis in (1, 0))
        tracks[name] = _thinned(np.column_stack((east, north)))
    points = {}
    for target in flown.targets:
        if target.lat_deg is not None and target.lon_deg is not None:
            at = frame.ne_from_geodetic(np.radians(target.lat_deg), np.radians(target.lon_deg))
            points[target.name] = (float(at[1]), float(at[0]))
    shown = [*tracks.values(), *(np.array([place]) for place in points.values())]
    return Drawing(
        "Track, east and north of the start", tracks, "east, m", "north, m", equal=True, points=points,
        picture=_map_picture(flown.folder, frame, shown),
    )  # fmt: skip


def _map_picture(folder: FlightFolder, frame: LocalFrame, drawn_en_m: Sequence[Float]) -> MapPicture | None:
    """What the reference shows about everything that is drawn; None without one that can be read."""
    if folder.reference_path is None:
        return None
    places = np.concatenate(drawn_en_m)
    places = places[np.isfinite(places).all(axis=1)]
    (west, south), (east, north) = places.min(axis=0) - AROUND_M, places.max(axis=0) + AROUND_M
    gsd_m = max(east - west, north - south) / MAP_PX
    rows, cols = math.ceil((north - south) / gsd_m), math.ceil((east - west) / gsd_m)
    off_n_m, off_e_m = folder.meta.map.offset_ne_m

    def geodetic_at(row: Float, col: Float) -> tuple[Float, Float]:
        ne = np.stack((north - (row + 0.5) * gsd_m - off_n_m, west + (col + 0.5) * gsd_m - off_e_m), axis=-1)
        return frame.geodetic_from_ne(ne)

    try:
        with open_raster(folder.reference_path) as raster:
            colour = Radiometry.of(raster).colour
            planes, valid = resample(raster, colour, geodetic_at, rows, cols, node_step_px=16)
    except GeodataError as error:
        folder.warn(f"the report has no map: {error}")
        return None
    if not valid.any():
        return None
    picture = np.full((rows, cols, 3), 255, dtype=np.uint8)
    picture[valid] = np.moveaxis(np.rint(planes[::-1]), 0, -1).astype(np.uint8)[valid]
    return MapPicture(encode_jpeg(picture, MAP_QUALITY), north, north - rows * gsd_m, west + cols * gsd_m, west)


def _curves(flown: Flown, places: dict[str, Places], ned: dict[str, Float], start_us: int) -> list[Drawing]:
    states = flown.states
    seconds = (states.at.t_us - start_us) / 1e6
    accepted, refused = ((np.asarray(times, dtype=np.float64) - start_us) / 1e6 for times in flown.fixes)
    ticks = {GOOD: accepted, BAD: refused}
    std = np.hypot(*states.std_ne_m.T)

    def over_time(values: Float) -> Float:
        return _thinned(broken_at_gaps(seconds, values))

    errors = {"stated sigma": over_time(std)}
    if "truth" in places:
        errors["horizontal error"] = over_time(_distance_to(places["truth"], ned["truth"], states.at, ned["estimate"]))
    drawings = [Drawing("Horizontal error and its stated sigma", errors, "time, s", "m", ticks=ticks, low=0.0)]
    if "GPS" in places:
        away = {"GPS minus estimate": over_time(_distance_to(places["GPS"], ned["GPS"], states.at, ned["estimate"]))}
        drawings.append(Drawing("Distance between GPS and the estimate", away, "time, s", "m", ticks=ticks, low=0.0))
    speed = {"speed over ground": over_time(np.hypot(states.vel_ned_m_s[:, 0], states.vel_ned_m_s[:, 1]))}
    return [
        *drawings,
        Drawing("Height", {"AMSL": over_time(states.at.alt_amsl_m)}, "time, s", "m"),
        Drawing("Speed over ground", speed, "time, s", "m/s", low=0.0),
    ]


def _distance_to(other: Places, other_ned_m: Float, at: Places, ned_m: Float) -> Float:
    """Horizontal distance (n,) of positions to another track at their times; NaN outside it and in its gaps."""
    t_us = at.t_us.astype(np.float64)
    there = np.stack([np.interp(t_us, other.t_us, other_ned_m[:, axis]) for axis in (0, 1)], axis=-1)
    after = np.clip(np.searchsorted(other.t_us, at.t_us), 1, max(len(other.t_us) - 1, 1))
    known = (t_us >= other.t_us[0]) & (t_us <= other.t_us[-1])
    if len(other.t_us) > 1:
        known &= other.t_us[after] - other.t_us[after - 1] <= 2_000_000
    return np.where(known, np.hypot(*(there - ned_m[:, :2]).T), np.nan)


def _modes(modes: Sequence[str]) -> str:
    shares = {mode: list(modes).count(mode) / len(modes) for mode in sorted(set(modes))}
    words = ", ".join(f"{html.escape(mode.replace('_', ' '))} {100 * share:.1f} %" for mode, share in shares.items())
    return f"<p>Modes: {words}. Ticks under the errors: fixes by vision, green accepted, red refused.</p>"


def _targets(targets: Sequence[ShownTarget], start_us: int) -> str:
    if not targets:
        return "<h2>Targets</h2><p>None was clicked.</p>"
    rows = []
    for target in targets:
        known = target.lat_deg is not None and target.lon_deg is not None
        place = f"{target.lat_deg:.7f}, {target.lon_deg:.7f}" if known else "not located"
        ce90 = "–" if target.ce90_m is None else f"{target.ce90_m:.1f} m"
        at = "–" if target.t_us is None else f"{(target.t_us - start_us) / 1e6:.1f} s"
        picture = "" if target.jpeg is None else f"<img alt='' width='{CUT_PX}' src='{data_uri(target.jpeg)}'>"
        cells = (picture, html.escape(target.name), place, ce90, html.escape(target.method), at)
        rows.append("<tr>" + "".join(f"<td>{cell}</td>" for cell in cells) + "</tr>")
    head = "".join(f"<th>{name}</th>" for name in ("Picture", "Target", "Coordinate", "CE90", "Method", "Time"))
    return f"<h2>Targets</h2><table><tr>{head}</tr>{''.join(rows)}</table>"
