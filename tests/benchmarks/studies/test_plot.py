"""The plot is well-formed and its bars are as long as their figures say."""

from __future__ import annotations

from xml.etree import ElementTree

from numpy.testing import assert_allclose

from benchmarks.studies.plot import AREA_PX, bars_svg

SVG = "{http://www.w3.org/2000/svg}"


def test_bars_are_logarithmic_between_powers_of_ten() -> None:
    picture = ElementTree.fromstring(bars_svg("a < b", "m", [("one", 1.0), ("ten & more", 10.0), ("none", None)]))  # noqa: S314
    widths = [float(bar.get("width", "")) for bar in picture.iter(f"{SVG}rect") if bar.get("fill") == "#0a6ebd"]
    texts = [text.text for text in picture.iter(f"{SVG}text")]

    assert_allclose(widths, [0.0, AREA_PX], atol=0.1)
    assert "a < b" in texts
    assert "none" in texts


def test_nothing_known_is_still_a_picture() -> None:
    bars = [("none", None), ("zero", 0.0), ("endless", float("inf"))]
    ElementTree.fromstring(bars_svg("t", "m", bars))  # noqa: S314
