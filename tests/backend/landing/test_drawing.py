"""Prints are of true size: circles and cells read back from the SVG and from the PDF's own content stream."""

import re
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest

from backend.landing.drawing import POINTS_PER_MM, as_pdf, as_svg, sheet_mm
from estimator.errors import GeometryError
from estimator.landing.pad import CirclePad, Pad, circle_pad, tag_pad

SVG = "{http://www.w3.org/2000/svg}"


def _wanted_mm(pad: CirclePad) -> list[tuple[float, float, float]]:
    """Centre right and down from the upper left corner and radius of every circle, outer then inner."""
    _, y_min, x_max, _ = pad.bounds_m
    return [
        (1e3 * (ring.y_m - y_min), 1e3 * (x_max - ring.x_m), 1e3 * radius)
        for ring in pad.rings for radius in (ring.outer_m, ring.inner_m)
    ]  # fmt: skip


def _content(pdf: bytes) -> str:
    found = re.search(rb"<< /Length (\d+) >>\nstream\n(.*?)\nendstream", pdf, re.DOTALL)
    assert found is not None and len(found[2]) == int(found[1])
    return found[2].decode("latin-1")


def test_svg_has_the_sheets_size_and_every_circle_in_place() -> None:
    pad = circle_pad("roof <1>", 1.5, 0.3)
    root = ElementTree.fromstring(as_svg(pad))  # noqa: S314 - our own text
    width, height = sheet_mm(pad)

    assert root.get("width") == f"{width:.4f}mm" and root.get("height") == f"{height:.4f}mm"
    assert root.get("viewBox") == f"0 0 {width:.4f} {height:.4f}"
    circles = [tuple(float(c.get(key, "nan")) for key in ("cx", "cy", "r")) for c in root.iter(f"{SVG}circle")]
    np.testing.assert_allclose(circles, _wanted_mm(pad), atol=1e-3)
    fills = [c.get("fill") for c in root.iter(f"{SVG}circle")]
    assert fills == ["#000", "#fff"] * 12
    # Paper's right is the pad's y: the second ring is right of the first.
    assert circles[2][0] > circles[0][0] > circles[4][0]


def test_pdf_has_the_sheets_size_and_every_circle_in_place() -> None:
    pad = circle_pad("roof (1)", 1.5, 0.3)
    pdf = as_pdf(pad)
    width, height = (side * POINTS_PER_MM for side in sheet_mm(pad))

    box = re.search(rb"/MediaBox \[0 0 ([\d.]+) ([\d.]+)\]", pdf)
    assert box is not None
    assert [float(box[1]), float(box[2])] == pytest.approx([width, height], abs=1e-3)
    circles = []
    for path in re.findall(r"([\d.]+) ([\d.]+) m ((?:[-\d. ]+ c ?)+)h f", _content(pdf)):
        ends = [piece.split()[-2:] for piece in path[2].split("c") if piece.strip()]
        on = np.array(ends, float)
        centre = on.mean(axis=0)
        circles.append((*centre, float(np.hypot(*(on - centre).T).mean())))
    wanted = [(x * POINTS_PER_MM, height - y * POINTS_PER_MM, r * POINTS_PER_MM) for x, y, r in _wanted_mm(pad)]
    np.testing.assert_allclose(circles, wanted, atol=1e-3)


def test_bezier_arcs_are_round() -> None:
    """The middle of every cubic lies on the circle to 1e-5 of the radius."""
    path = re.findall(r"([\d.]+) ([\d.]+) m ((?:[-\d. ]+ c ?)+)h f", _content(as_pdf(circle_pad("p", 1.5, 0.3))))[0]
    numbers = np.array([float(v) for v in re.findall(r"[-\d.]+", path[2])]).reshape(-1, 3, 2)
    starts = np.vstack(([float(path[0]), float(path[1])], numbers[:-1, 2]))
    centre = numbers[:, 2].mean(axis=0)
    middle = (starts + 3 * numbers[:, 0] + 3 * numbers[:, 1] + numbers[:, 2]) / 8
    radius = np.hypot(*(numbers[:, 2] - centre).T).mean()

    np.testing.assert_allclose(np.hypot(*(middle - centre).T), radius, rtol=1e-5)


def test_every_object_of_the_pdf_is_where_its_table_says() -> None:
    pdf = as_pdf(tag_pad("yard", 0.9))
    table = int(re.findall(rb"startxref\n(\d+)", pdf)[0])
    assert pdf[table : table + 4] == b"xref"
    for number, place in enumerate(re.findall(rb"(\d{10}) 00000 n", pdf[table:]), 1):
        assert pdf[int(place) :].startswith(b"%d 0 obj" % number)


@pytest.mark.parametrize("form", ["svg", "pdf"])
def test_a_printed_board_is_read_by_opencv(form: str) -> None:
    """Cells of the file, painted at two pixels a millimetre, show every tag where the pad has it."""
    pad = tag_pad("yard", 0.9, sizes=2)
    width, height = sheet_mm(pad)
    scale = 2.0
    picture = np.full((round(height * scale), round(width * scale)), 255, np.uint8)
    for x, y, w, h, grey in _cells(pad, form):
        picture[round(y * scale) : round((y + h) * scale), round(x * scale) : round((x + w) * scale)] = grey
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)

    quads, numbers, _ = cv2.aruco.ArucoDetector(dictionary).detectMarkers(picture)

    assert sorted(np.ravel(numbers).tolist()) == [t.number for t in pad.tags]
    _, y_min, x_max, _ = pad.bounds_m
    for number, quad in zip(np.ravel(numbers).tolist(), quads, strict=True):
        corners = pad.tags[number].corners_m
        wanted = np.column_stack((corners[:, 1] - y_min, x_max - corners[:, 0])) * 1e3 * scale
        np.testing.assert_allclose(quad.reshape(4, 2), wanted, atol=3.0)


def _cells(pad: Pad, form: str) -> list[tuple[float, float, float, float, int]]:
    if form == "svg":
        root = ElementTree.fromstring(as_svg(pad))  # noqa: S314 - our own text
        # The first is the sheet.
        rects = list(root.iter(f"{SVG}rect"))[1:]
        return [
            (
                float(r.get("x", "")),
                float(r.get("y", "")),
                float(r.get("width", "")),
                float(r.get("height", "")),
                0 if r.get("fill") == "#000" else 255,
            )
            for r in rects
        ]
    height = sheet_mm(pad)[1]
    cells = []
    for grey, line in re.findall(r"([01]) g ([\d.]+ [\d.]+ [\d.]+ [\d.]+) re f", _content(as_pdf(pad))):
        x, y, w, h = (float(v) / POINTS_PER_MM for v in line.split())
        cells.append((x, height - y - h, w, h, 255 * int(grey)))
    return cells


def test_a_sheet_beyond_pdf_is_refused_with_the_way_out() -> None:
    huge = circle_pad("field", 6.0, 1.2)

    with pytest.raises(GeometryError, match="use the SVG"):
        as_pdf(huge)
    assert 'width="9360' in as_svg(huge)
