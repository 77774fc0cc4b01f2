"""The study of the landing pad: rings stand where OpenCV projects them, and bounds are those of theory."""

import math
from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
import typer

from benchmarks.pad import PAD, TAGS, Accuracy, detection, figure, main, markdown
from benchmarks.pad_methods import METHODS, bound_m
from benchmarks.pad_scenes import VGA, Look, PadScene, looking_at_pad

CLEAN = Look(defocus_px=0.0, noise=0.0)


def test_rings_are_drawn_where_opencv_projects_them() -> None:
    ground = np.full((300, 300), 205, np.uint8)
    pose = looking_at_pad(9.0, (1.5, -1.0), 0.7, (0.02, 0.01))

    image = PadScene(ground, VGA, PAD).render(pose, CLEAN, np.random.default_rng(1))

    angle = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
    for ring in PAD.rings[:3]:
        circle = np.column_stack((np.cos(angle), np.sin(angle), np.zeros(400)))
        outer, inner = (
            cv2.projectPoints(
                (ring.x_m, ring.y_m, 0.0) + radius * circle, cv2.Rodrigues(pose.camera_from_pad)[0],
                pose.pad_in_camera_m, VGA.matrix, np.array(VGA.distortion),
            )[0].reshape(-1, 2)
            for radius in (ring.outer_m, ring.inner_m)
        )  # fmt: skip
        low, high = np.floor(outer.min(axis=0)).astype(int) - 2, np.ceil(outer.max(axis=0)).astype(int) + 3
        dark = (205.0 - image[low[1] : high[1], low[0] : high[0]]) / (205.0 - 22.0)
        area = cv2.contourArea(outer.astype(np.float32)) - cv2.contourArea(inner.astype(np.float32))
        # Sixteen rays a pixel: half a percent of a ring's area, a fiftieth of a pixel in its middle.
        assert float(dark.sum()) == pytest.approx(area, rel=0.006)
        v, u = np.mgrid[low[1] : high[1], low[0] : high[0]]
        wanted = _centroid(outer, inner)
        assert (float((dark * u).sum() / dark.sum()), float((dark * v).sum() / dark.sum())) == pytest.approx(
            wanted, abs=0.03
        )


def _centroid(outer: np.ndarray, inner: np.ndarray) -> tuple[float, float]:
    moments = [cv2.moments(points.astype(np.float32)) for points in (outer, inner)]
    area, u, v = (moments[0][key] - moments[1][key] for key in ("m00", "m10", "m01"))
    return u / area, v / area


def test_bounds_are_those_of_the_published_table() -> None:
    """At 15 m and ten degrees: 25 and 8.5 cm for three centres, 5.6 and 1.8 cm for edges with the tilt known to 0.3."""
    pose = looking_at_pad(15.0, (15.0 * math.tan(math.radians(10.0)), 0.0), 0.4)

    centres = bound_m(METHODS["three centres, P3P"], VGA, PAD, TAGS, pose, math.radians(0.3))
    edges = bound_m(METHODS["circle edges, tilt known"], VGA, PAD, TAGS, pose, math.radians(0.3))

    # Samples of circles are counted a little differently there.
    assert centres == pytest.approx((0.25, 0.085), rel=0.35)
    assert edges == pytest.approx((0.056, 0.018), rel=0.35)


def test_detection_counts_and_tables() -> None:
    ground = np.random.default_rng(2).normal(105.0, 12.0, (300, 300)).clip(0, 255).astype(np.uint8)

    rows = list(detection([ground], 1, 301))

    assert [row.condition for row in rows][:2] == ["plain", "30 % in shade"]
    assert rows[0].found == 1 and rows[0].wrong == 0
    assert markdown(rows).count("\n") == len(rows) + 2


def test_the_figure_has_a_line_and_a_bound_for_each_method() -> None:
    rows = [
        Accuracy(name, r, 4, 4, 0.01 * r, 0.003 * r, 3.0, 0, 0.008 * r, 0.002 * r)
        for name in METHODS for r in (20.0, 10.0)
    ]  # fmt: skip
    root = ElementTree.fromstring(figure(rows))  # noqa: S314 - our own text

    assert len([e for e in root if e.tag.endswith("polyline")]) == 2 * len(METHODS)


def test_an_unknown_part_is_named() -> None:
    with pytest.raises(typer.BadParameter, match="nothing"):
        main(only=["nothing"])
