"""Landing pads as SVG and PDF of true size.

On paper the pad's x (forward) points up and its y to the right. The PDF has one page, paths and a line of
text.
"""

from __future__ import annotations

import math
from xml.sax.saxutils import escape

import cv2
import numpy as np

from estimator.errors import GeometryError
from estimator.landing.pad import Pad, TagPad

POINTS_PER_MM = 72.0 / 25.4
MAX_PDF_POINTS = 14_400
"""PDF 1.7, annex C: no page side may exceed 200 inches."""
_ARCS = 8
"""Eight cubic arcs make a circle good to 5e-6 of its radius."""


def sheet_mm(pad: Pad) -> tuple[float, float]:
    """Width and height of the sheet."""
    x_min, y_min, x_max, y_max = pad.bounds_m
    return (y_max - y_min) * 1000.0, (x_max - x_min) * 1000.0


def _discs_mm(pad: Pad) -> list[tuple[float, float, float, bool]]:
    """Discs in the order to paint: centre right and down from the sheet's corner, radius, and whether black."""
    if isinstance(pad, TagPad):
        return []
    _, y_min, x_max, _ = pad.bounds_m
    return [
        ((ring.y_m - y_min) * 1e3, (x_max - ring.x_m) * 1e3, radius * 1e3, black)
        for ring in pad.rings for radius, black in ((ring.outer_m, True), (ring.inner_m, False))
    ]  # fmt: skip


def _cells_mm(pad: Pad) -> list[tuple[float, float, float, float, bool]]:
    """Rectangles of tags in the order to paint: left, top, width, height, and whether black.

    White cells upon a black square, so that no seam between cells cuts the black border.
    """
    if not isinstance(pad, TagPad):
        return []
    _, y_min, x_max, _ = pad.bounds_m
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    found = []
    for tag in pad.tags:
        cells = cv2.aruco.generateImageMarker(dictionary, tag.number, 8) > 127
        cell = tag.side_m * 125.0
        left, top = (tag.y_m - tag.side_m / 2 - y_min) * 1e3, (x_max - tag.x_m - tag.side_m / 2) * 1e3
        found.append((left, top, 8 * cell, 8 * cell, True))
        found += [
            (left + int(col) * cell, top + int(row) * cell, cell, cell, False) for row, col in np.argwhere(cells)
        ]  # fmt: skip
    return found


def _label(pad: Pad) -> str:
    width, height = sheet_mm(pad)
    return f"{pad.name}: sheet {width:.1f} x {height:.1f} mm, print at 100 %; this edge is the rear"


def as_svg(pad: Pad) -> str:
    """The pad as SVG whose width and height are in millimetres, one unit a millimetre."""
    width, height = sheet_mm(pad)
    text = min(width, height) / 90.0
    lines = [
        '<?xml version="1.0" encoding="UTF-8"?>',
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.4f}mm" height="{height:.4f}mm" '
        f'viewBox="0 0 {width:.4f} {height:.4f}">',
        f'<rect width="{width:.4f}" height="{height:.4f}" fill="#fff"/>',
    ]
    lines += [
        f'<circle cx="{x:.4f}" cy="{y:.4f}" r="{r:.4f}" fill="{"#000" if black else "#fff"}"/>'
        for x, y, r, black in _discs_mm(pad)
    ]
    lines += [
        f'<rect x="{x:.4f}" y="{y:.4f}" width="{w:.4f}" height="{h:.4f}" fill="{"#000" if black else "#fff"}"/>'
        for x, y, w, h, black in _cells_mm(pad)
    ]
    lines.append(
        f'<text x="{text:.3f}" y="{height - text:.3f}" font-size="{text:.3f}" font-family="sans-serif" fill="#777">'
        f"{escape(_label(pad))}</text>"
    )
    return "\n".join((*lines, "</svg>", ""))


def as_pdf(pad: Pad) -> bytes:
    """The pad as a PDF of one page of the sheet's size.

    Raises ``GeometryError`` for a sheet larger than PDF allows.
    """
    width, height = (side * POINTS_PER_MM for side in sheet_mm(pad))
    if max(width, height) > MAX_PDF_POINTS:
        message = (
            f"pad '{pad.name}': a sheet of {sheet_mm(pad)[0]:.0f} x {sheet_mm(pad)[1]:.0f} mm is beyond the 5080 mm "
            "that a page of PDF may measure; use the SVG, or a smaller pad"
        )
        raise GeometryError(message)
    content = _page(pad, height).encode("latin-1", "replace")
    objects = [
        b"<< /Type /Catalog /Pages 2 0 R >>",
        b"<< /Type /Pages /Kids [3 0 R] /Count 1 >>",
        f"<< /Type /Page /Parent 2 0 R /MediaBox [0 0 {width:.4f} {height:.4f}] /Contents 4 0 R "
        "/Resources << /Font << /F1 5 0 R >> >> >>".encode(),
        b"<< /Length %d >>\nstream\n%s\nendstream" % (len(content), content),
        b"<< /Type /Font /Subtype /Type1 /BaseFont /Helvetica /Encoding /WinAnsiEncoding >>",
    ]
    out = bytearray(b"%PDF-1.4\n")
    places = []
    for number, body in enumerate(objects, 1):
        places.append(len(out))
        out += b"%d 0 obj\n%s\nendobj\n" % (number, body)
    table = len(out)
    out += b"xref\n0 %d\n0000000000 65535 f \n" % (len(objects) + 1)
    out += b"".join(b"%010d 00000 n \n" % place for place in places)
    out += b"trailer\n<< /Size %d /Root 1 0 R >>\nstartxref\n%d\n%%%%EOF\n" % (len(objects) + 1, table)
    return bytes(out)


def _page(pad: Pad, height: float) -> str:
    """The page's content stream, in points from the lower left corner."""
    scale = POINTS_PER_MM
    lines: list[str] = []
    for x, y, r, black in _discs_mm(pad):
        lines += ["0 g" if black else "1 g", _circle(x * scale, height - y * scale, r * scale)]
    lines += [
        f"{0 if black else 1} g {x * scale:.4f} {height - (y + h) * scale:.4f} {w * scale:.4f} {h * scale:.4f} re f"
        for x, y, w, h, black in _cells_mm(pad)
    ]
    text = min(sheet_mm(pad)) / 90.0 * scale
    words = _label(pad).replace("\\", r"\\").replace("(", r"\(").replace(")", r"\)")
    lines.append(f"0.5 g BT /F1 {text:.3f} Tf {text:.3f} {text:.3f} Td ({words}) Tj ET")
    return "\n".join(lines)


def _circle(x: float, y: float, r: float) -> str:
    step = 2.0 * math.pi / _ARCS
    handle = 4.0 / 3.0 * math.tan(step / 4.0) * r
    parts = [f"{x + r:.4f} {y:.4f} m"]
    for number in range(_ARCS):
        a, b = number * step, (number + 1) * step
        points = (
            x + r * math.cos(a) - handle * math.sin(a), y + r * math.sin(a) + handle * math.cos(a),
            x + r * math.cos(b) + handle * math.sin(b), y + r * math.sin(b) - handle * math.cos(b),
            x + r * math.cos(b), y + r * math.sin(b),
        )  # fmt: skip
        parts.append(" ".join(f"{value:.4f}" for value in points) + " c")
    return " ".join((*parts, "h f"))
