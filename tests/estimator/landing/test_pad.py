"""Pads: rings where they are said to be, and descriptions that no detector could use are refused."""

import math

import numpy as np
import pytest

from estimator.errors import GeometryError
from estimator.landing.pad import CODES, CirclePad, Tag, TagPad, Triple, circle_pad, tag_pad


def test_rings_of_a_triple_are_a_side_apart_and_run_clockwise_from_ahead() -> None:
    pad = circle_pad("p", 1.5, 0.3)

    for triple in range(4):
        at = np.array([(r.x_m, r.y_m) for r in pad.rings[3 * triple : 3 * triple + 3]])
        sides = [float(np.hypot(*(at[i] - at[j]))) for i, j in ((0, 1), (1, 2), (2, 0))]
        assert sides == pytest.approx([1.5 / 3**triple] * 3)
        assert at[0] == pytest.approx([1.5 / 3**triple / math.sqrt(3), 0.0])
        # Seen from above x points up the sheet and y right, so clockwise is a positive turn from x to y.
        (ax, ay), (bx, by) = at[1] - at[0], at[2] - at[0]
        assert ax * by - ay * bx > 0.0
        ratios = [r.ratio for r in pad.rings[3 * triple : 3 * triple + 3]]
        assert ratios == pytest.approx(list(CODES[triple])) and ratios == sorted(ratios)


def test_the_sheet_holds_every_ring_with_its_quiet_zone() -> None:
    pad = circle_pad("p", 1.2, 0.2)
    x_min, y_min, x_max, y_max = pad.bounds_m

    for ring in pad.rings:
        margin = 1.4 * ring.outer_m - 1e-12
        assert x_min <= ring.x_m - margin and ring.x_m + margin <= x_max
        assert y_min <= ring.y_m - margin and ring.y_m + margin <= y_max


@pytest.mark.parametrize(
    ("side_m", "radius_m", "ratios", "words"),
    [
        (1.0, 0.45, CODES[0], "make the side longer"),
        (1.0, 0.2, (0.45, 0.32, 0.71), "rise by 0.1"),
        (1.0, 0.2, (0.1, 0.45, 0.71), "between 0.2 and 0.8"),
        (-1.0, 0.2, CODES[0], "positive side"),
        (math.nan, 0.2, CODES[0], "positive side"),
    ],
)
def test_a_triple_that_cannot_be_told_is_refused(
    side_m: float, radius_m: float, ratios: tuple[float, float, float], words: str
) -> None:
    with pytest.raises(GeometryError, match=words):
        Triple(side_m, radius_m, ratios)


def test_triples_that_touch_or_look_alike_are_refused() -> None:
    with pytest.raises(GeometryError, match="well smaller"):
        circle_pad("p", 1.5, 0.3, shrink=2.0)
    with pytest.raises(GeometryError, match="same ratios"):
        CirclePad("p", (Triple(1.5, 0.3, CODES[0]), Triple(0.4, 0.08, CODES[0])))
    with pytest.raises(GeometryError, match="1 to 4 triples"):
        circle_pad("p", 1.5, 0.3, triples=5)


def test_boards_of_tags_keep_a_cell_of_white_and_are_centred() -> None:
    pad = tag_pad("t", 0.9, sizes=3)
    x_min, y_min, x_max, y_max = pad.bounds_m

    assert [t.number for t in pad.tags] == list(range(7))
    assert (x_min + x_max, y_min + y_max) == pytest.approx((0.0, 0.0), abs=1e-9)
    with pytest.raises(GeometryError, match="less than a cell"):
        TagPad("t", (Tag(0, 0.0, 0.0, 0.5), Tag(1, 0.0, 0.53, 0.5)))
    with pytest.raises(GeometryError, match="number twice"):
        TagPad("t", (Tag(0, 0.0, 0.0, 0.5), Tag(0, 0.0, 2.0, 0.5)))
    with pytest.raises(GeometryError, match="0 to 586"):
        TagPad("t", (Tag(587, 0.0, 0.0, 0.5),))
