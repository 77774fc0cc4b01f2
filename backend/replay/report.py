"""``report.html``: the figures of a replay with plots of the track and its errors, one file without scripts."""

from __future__ import annotations

import html
import json
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from estimator.geometry.local import LocalFrame
from estimator.types import NavigationState
from geodata.flight import FlightFolder

WIDTH_PX, HEIGHT_PX, MARGIN_PX = 720, 420, 48
MAX_POINTS = 1500


def write_report(path: Path, folder: FlightFolder, report: dict[str, Any], states: list[NavigationState]) -> None:
    """Write the page."""
    first = states[0]
    frame = LocalFrame(first.lat_rad, first.lon_rad, first.alt_amsl_m)
    every = max(1, len(states) // MAX_POINTS)
    shown = states[::every]
    t_us = np.array([s.t_us for s in shown])
    estimate = frame.ned_from_geodetic(*(np.array([getattr(s, n) for s in shown]) for n in _GEODETIC))
    tracks = {"estimate": estimate[:, [1, 0]]}
    plots = []
    truth = folder.truth()
    seconds = (t_us - t_us[0]) / 1e6
    std = np.array([np.sqrt(np.trace(s.cov_pos_ned_m2[:2, :2])) for s in shown])
    curves = {"stated sigma": np.column_stack((seconds, std))}
    if truth is not None and len(truth.t_unix_us) > 1:
        true_ned = frame.ned_from_geodetic(truth.lat_rad, truth.lon_rad, truth.alt_amsl_m)
        at = np.stack([np.interp(t_us, truth.t_unix_us, true_ned[:, axis]) for axis in range(3)], axis=-1)
        tracks["truth"] = at[:, [1, 0]]
        curves["horizontal error"] = np.column_stack((seconds, np.hypot(*(estimate - at)[:, :2].T)))
    plots.append(_plot("Track, east and north of the start", tracks, "east, m", "north, m", equal=True))
    plots.append(_plot("Horizontal error and its stated sigma", curves, "time, s", "m"))
    body = "\n".join(plots)
    figures = html.escape(json.dumps(report, indent=1, default=str))
    title = html.escape(f"Replay of {folder.name}")
    path.write_text(
        f"<!doctype html><html lang='en'><meta charset='utf-8'><title>{title}</title>"
        "<style>body{font:15px sans-serif;margin:2em;max-width:60em}svg{background:#fff;border:1px solid #ccc}"
        f"pre{{background:#f4f4f4;padding:1em}}</style><h1>{title}</h1>{body}<h2>Figures</h2><pre>{figures}</pre></html>\n"
    )


_GEODETIC = ("lat_rad", "lon_rad", "alt_amsl_m")
_COLOURS = ("#0a6ebd", "#d1495b", "#3a7d44")


def _plot(title: str, curves: dict[str, np.ndarray], x_label: str, y_label: str, equal: bool = False) -> str:
    every = np.concatenate([curve[np.isfinite(curve).all(axis=1)] for curve in curves.values()])
    low, high = every.min(axis=0), every.max(axis=0)
    span = np.maximum(high - low, 1e-6)
    size = np.array([WIDTH_PX - 2 * MARGIN_PX, HEIGHT_PX - 2 * MARGIN_PX])
    scale = size / span
    if equal:
        scale = np.full(2, scale.min())
    lines = [
        _polyline((curve - low) * scale, colour) + _key(name, colour, row)
        for row, ((name, curve), colour) in enumerate(zip(curves.items(), _COLOURS, strict=False))
    ]
    ticks = (
        f"<text x='{MARGIN_PX}' y='{HEIGHT_PX - 28}'>{low[0]:.0f}</text>"
        f"<text x='{WIDTH_PX - MARGIN_PX - 30}' y='{HEIGHT_PX - 28}'>{low[0] + size[0] / scale[0]:.0f}</text>"
        f"<text x='4' y='{HEIGHT_PX - MARGIN_PX}'>{low[1]:.1f}</text>"
        f"<text x='4' y='{MARGIN_PX}'>{low[1] + size[1] / scale[1]:.1f}</text>"
        f"<text x='{WIDTH_PX // 2}' y='{HEIGHT_PX - 8}'>{x_label}</text><text x='4' y='20'>{y_label}</text>"
    )
    return (
        f"<h2>{html.escape(title)}</h2><svg width='{WIDTH_PX}' height='{HEIGHT_PX}' font-size='12'>"
        f"{ticks}{''.join(lines)}</svg>"
    )


def _polyline(points: np.ndarray, colour: str) -> str:
    kept: Sequence[str] = [
        f"{MARGIN_PX + x:.1f},{HEIGHT_PX - MARGIN_PX - y:.1f}" for x, y in points if np.isfinite(x) and np.isfinite(y)
    ]
    return f"<polyline points='{' '.join(kept)}' fill='none' stroke='{colour}' stroke-width='1.5'/>"


def _key(name: str, colour: str, row: int) -> str:
    y = 20 + 16 * row
    return f"<text x='{WIDTH_PX - 170}' y='{y}' fill='{colour}'>{html.escape(name)}</text>"
