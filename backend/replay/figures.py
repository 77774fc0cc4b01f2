"""Plots and maps as inline SVG, for a page that needs nothing else."""

from __future__ import annotations

import base64
import html
from dataclasses import dataclass, field

import numpy as np

from estimator.types import Float

WIDTH_PX, HEIGHT_PX, MARGIN_PX = 720, 420, 48
COLOURS = ("#0a6ebd", "#d1495b", "#3a7d44", "#e08e0b")
GAP_S = 3.0


@dataclass(frozen=True, slots=True, eq=False)
class MapPicture:
    """A JPEG whose edges are at these metres north and east of the page's frame."""

    jpeg: bytes
    north_m: float
    south_m: float
    east_m: float
    west_m: float


@dataclass(frozen=True, slots=True, eq=False)
class Drawing:
    """One figure: curves (n, 2) of x and y by name, points (n, 2) with a name each, ticks on the x axis by colour.

    ``equal`` draws x and y at one scale, over ``picture`` where there is one; ``low`` fixes the least y.
    """

    title: str
    curves: dict[str, Float]
    x_label: str
    y_label: str
    equal: bool = False
    points: dict[str, tuple[float, float]] = field(default_factory=dict)
    ticks: dict[str, Float] = field(default_factory=dict)
    picture: MapPicture | None = None
    low: float | None = None


def drawn(figure: Drawing) -> str:
    """The figure with its heading."""
    curves = {name: curve for name, curve in figure.curves.items() if np.isfinite(curve).all(axis=1).any()}
    every = [curve[np.isfinite(curve).all(axis=1)] for curve in curves.values()]
    every += [np.array([place]) for place in figure.points.values()]
    if not every:
        return ""
    together = np.concatenate(every)
    low, high = together.min(axis=0), together.max(axis=0)
    if figure.low is not None:
        low[1] = min(low[1], figure.low)
    span = np.maximum(high - low, 1e-6)
    size = np.array([WIDTH_PX - 2 * MARGIN_PX, HEIGHT_PX - 2 * MARGIN_PX])
    scale = size / span
    if figure.equal:
        scale = np.full(2, scale.min())
    parts = [_picture(figure.picture, low, scale)] if figure.picture is not None else []
    for row, ((name, curve), colour) in enumerate(zip(curves.items(), COLOURS, strict=False)):
        parts.append(_polylines(name, curve, low, scale, colour) + _key(name, colour, row))
    parts += [_point(name, (np.array(place) - low) * scale) for name, place in figure.points.items()]
    parts += [_ticks(at, low, scale, high, colour) for colour, at in figure.ticks.items()]
    return (
        f"<h2>{html.escape(figure.title)}</h2><svg viewBox='0 0 {WIDTH_PX} {HEIGHT_PX}' width='{WIDTH_PX}' "
        f"height='{HEIGHT_PX}' font-size='12'>{''.join(parts)}{_labels(figure, low, low + size / scale)}</svg>"
    )


def _labels(figure: Drawing, low: Float, high: Float) -> str:
    return (
        f"<text x='{MARGIN_PX}' y='{HEIGHT_PX - 28}'>{low[0]:.0f}</text>"
        f"<text x='{WIDTH_PX - MARGIN_PX}' y='{HEIGHT_PX - 28}' text-anchor='end'>{high[0]:.0f}</text>"
        f"<text x='4' y='{HEIGHT_PX - MARGIN_PX}'>{low[1]:.1f}</text><text x='4' y='{MARGIN_PX}'>{high[1]:.1f}</text>"
        f"<text x='{WIDTH_PX // 2}' y='{HEIGHT_PX - 8}'>{html.escape(figure.x_label)}</text>"
        f"<text x='4' y='20'>{html.escape(figure.y_label)}</text>"
    )


def _on_page(point: Float) -> tuple[float, float]:
    return MARGIN_PX + float(point[0]), HEIGHT_PX - MARGIN_PX - float(point[1])


def _polylines(name: str, curve: Float, low: Float, scale: Float, colour: str) -> str:
    """The curve, broken where a number is missing."""
    known: np.ndarray = np.asarray(np.isfinite(curve).all(axis=1))
    runs = np.split(np.arange(len(curve)), np.flatnonzero(np.diff(known.astype(int))) + 1)
    lines = []
    for run in runs:
        if len(run) == 0 or not known[run[0]]:
            continue
        points = " ".join(f"{x:.1f},{y:.1f}" for x, y in map(_on_page, (curve[run] - low) * scale))
        lines.append(
            f"<polyline data-name='{html.escape(name)}' points='{points}' fill='none' stroke='{colour}' "
            f"stroke-width='1.5'/>"
        )
    return "".join(lines)


def _key(name: str, colour: str, row: int) -> str:
    y = 20 + 16 * row
    return (
        f"<text x='{WIDTH_PX - 6}' y='{y}' fill='{colour}' text-anchor='end' stroke='#fff' stroke-width='3' "
        f"paint-order='stroke'>{html.escape(name)}</text>"
    )


def _point(name: str, place: Float) -> str:
    x, y = _on_page(place)
    return (
        f"<path d='M{x - 6:.1f} {y:.1f}h12M{x:.1f} {y - 6:.1f}v12' stroke='#c2185b' stroke-width='2'/>"
        f"<text x='{x + 8:.1f}' y='{y - 4:.1f}' fill='#c2185b' stroke='#fff' stroke-width='3' paint-order='stroke'>"
        f"{html.escape(name)}</text>"
    )


def _ticks(at: Float, low: Float, scale: Float, high: Float, colour: str) -> str:
    inside = at[(at >= low[0]) & (at <= high[0])]
    marks = "".join(f"M{MARGIN_PX + (x - low[0]) * scale[0]:.1f} {HEIGHT_PX - MARGIN_PX}v7" for x in inside)
    return f"<path d='{marks}' stroke='{html.escape(colour)}'/>" if marks else ""


def _picture(picture: MapPicture, low: Float, scale: Float) -> str:
    left, top = _on_page((np.array([picture.west_m, picture.north_m]) - low) * scale)
    right, bottom = _on_page((np.array([picture.east_m, picture.south_m]) - low) * scale)
    return (
        f"<image x='{left:.1f}' y='{top:.1f}' width='{right - left:.1f}' height='{bottom - top:.1f}' "
        f"preserveAspectRatio='none' href='{data_uri(picture.jpeg)}'/>"
    )


def data_uri(jpeg: bytes) -> str:
    """A JPEG inside the page."""
    return "data:image/jpeg;base64," + base64.b64encode(jpeg).decode()


def broken_at_gaps(t_s: Float, values: Float) -> Float:
    """(n, 2) of time and value, with a missing one wherever nothing was known for a while."""
    gaps = np.flatnonzero(np.diff(t_s) > GAP_S) + 1
    return np.column_stack((np.insert(t_s, gaps, np.nan), np.insert(values, gaps, np.nan)))
