"""Lines over two logarithmic axes, by hand in SVG: no plotting library is among the dependencies."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence
from dataclasses import dataclass

LEFT, TOP, WIDE, HIGH, KEY = 70, 40, 460, 320, 260
COLOURS = ("#0a6ebd", "#d1495b", "#2e8b57", "#8a4fbf", "#b8860b", "#555555")


@dataclass(frozen=True, slots=True)
class Line:
    """Points (x, y), and a bound beside them that is drawn dashed."""

    name: str
    points: Sequence[tuple[float, float]]
    bound: Sequence[tuple[float, float]]


def lines_svg(title: str, x_label: str, y_label: str, lines: Sequence[Line]) -> str:
    """A line for each, its points marked; what is not above zero is left out."""
    every = [p for line in lines for p in (*line.points, *line.bound) if min(p) > 0.0 and math.isfinite(sum(p))]
    xs, ys = [math.log10(x) for x, _ in every] or [0.0, 1.0], [math.log10(y) for _, y in every] or [0.0, 1.0]
    x_low, x_high, y_low, y_high = min(xs), max(xs), math.floor(min(ys)), math.ceil(max(ys))
    across, up = WIDE / max(x_high - x_low, 1e-9), HIGH / max(y_high - y_low, 1e-9)

    def place(x: float, y: float) -> tuple[float, float]:
        return LEFT + (math.log10(x) - x_low) * across, TOP + HIGH - (math.log10(y) - y_low) * up

    parts = [
        f"<svg xmlns='http://www.w3.org/2000/svg' width='{LEFT + WIDE + KEY}' height='{TOP + HIGH + 50}' "
        "font-family='sans-serif' font-size='12'><rect width='100%' height='100%' fill='#fff'/>",
        f"<text x='10' y='22' font-size='15'>{html.escape(title)}</text>",
    ]
    for exponent in range(y_low, y_high + 1):
        _, y = place(10.0**x_low, 10.0**exponent)
        parts.append(f"<line x1='{LEFT}' x2='{LEFT + WIDE}' y1='{y:.1f}' y2='{y:.1f}' stroke='#ddd'/>")
        parts.append(f"<text x='{LEFT - 6}' y='{y + 4:.1f}' text-anchor='end'>{10.0**exponent:g}</text>")
    for tick in sorted({x for x, _ in every}):
        x, _ = place(tick, 10.0**y_low)
        parts.append(f"<text x='{x:.1f}' y='{TOP + HIGH + 18}' text-anchor='middle'>{tick:g}</text>")
    for number, line in enumerate(lines):
        colour = COLOURS[number % len(COLOURS)]
        for points, style in ((line.points, ""), (line.bound, " stroke-dasharray='5 4'")):
            at = [place(*p) for p in points if min(p) > 0.0 and math.isfinite(sum(p))]
            path = " ".join(f"{x:.1f},{y:.1f}" for x, y in at)
            parts.append(f"<polyline points='{path}' fill='none' stroke='{colour}'{style}/>")
            if not style:
                parts += [f"<circle cx='{x:.1f}' cy='{y:.1f}' r='3' fill='{colour}'/>" for x, y in at]
        y_key = TOP + 14 + 18 * number
        parts.append(f"<text x='{LEFT + WIDE + 14}' y='{y_key}' fill='{colour}'>{html.escape(line.name)}</text>")
    parts.append(
        f"<text x='{LEFT + WIDE / 2}' y='{TOP + HIGH + 40}' text-anchor='middle'>{html.escape(x_label)}</text>"
    )
    parts.append(f"<text x='{LEFT - 50}' y='{TOP - 4}'>{html.escape(y_label)}</text>")
    return "\n".join(parts) + "</svg>\n"
