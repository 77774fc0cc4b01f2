"""A bar for each row, by hand in SVG: no plotting library is among the dependencies."""

from __future__ import annotations

import html
import math
from collections.abc import Sequence

BAR_PX, GAP_PX, LABEL_PX, AREA_PX, FIGURE_PX = 18, 8, 300, 360, 80


def bars_svg(title: str, label: str, rows: Sequence[tuple[str, float | None]]) -> str:
    """Bars over a logarithmic axis, whose ends are powers of ten: figures of a ladder differ by orders of magnitude.

    A row without a figure, or with one that is not above zero, has no bar.
    """
    known = [value for _, value in rows if value is not None and value > 0.0 and math.isfinite(value)]
    low = math.floor(math.log10(min(known))) if known else 0
    high = max(math.ceil(math.log10(max(known))), low + 1) if known else 1
    height = 60 + len(rows) * (BAR_PX + GAP_PX) + 30
    parts = [
        f"<svg xmlns='http://www.w3.org/2000/svg' width='{LABEL_PX + AREA_PX + FIGURE_PX}' height='{height}' "
        "font-family='sans-serif' font-size='12'><rect width='100%' height='100%' fill='#fff'/>",
        f"<text x='10' y='22' font-size='15'>{html.escape(title)}</text>",
    ]
    for exponent in range(low, high + 1):
        x = LABEL_PX + AREA_PX * (exponent - low) / (high - low)
        parts.append(f"<line x1='{x:.1f}' x2='{x:.1f}' y1='40' y2='{height - 30}' stroke='#ddd'/>")
        parts.append(f"<text x='{x:.1f}' y='{height - 14}' text-anchor='middle'>{10.0**exponent:g}</text>")
    for number, (name, value) in enumerate(rows):
        y = 46 + number * (BAR_PX + GAP_PX)
        parts.append(f"<text x='{LABEL_PX - 8}' y='{y + BAR_PX - 5}' text-anchor='end'>{html.escape(name)}</text>")
        if value is None or not (value > 0.0 and math.isfinite(value)):
            continue
        width = AREA_PX * (math.log10(value) - low) / (high - low)
        parts.append(f"<rect x='{LABEL_PX}' y='{y}' width='{width:.1f}' height='{BAR_PX}' fill='#0a6ebd'/>")
        parts.append(f"<text x='{LABEL_PX + width + 6:.1f}' y='{y + BAR_PX - 5}'>{value:.3g}</text>")
    parts.append(
        f"<text x='{LABEL_PX + AREA_PX / 2}' y='{height - 1}' text-anchor='middle'>{html.escape(label)}</text>"
    )
    return "\n".join(parts) + "</svg>\n"
