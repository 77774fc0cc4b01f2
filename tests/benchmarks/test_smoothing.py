"""Parts of the smoothing benchmark: when the map is hidden, and the figures."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.smoothing import Errors, HiddenMap, Hiding, spans_of
from geodata.imagery import ImageryGrid
from tests.backend.flight_maker import T0_US
from tests.backend.replay.flown import write_known_flight


def test_the_map_is_hidden_only_while_gps_is_denied_and_seen_again_before_that_ends(tmp_path: Path) -> None:
    flight = write_known_flight(tmp_path / "f", gps_denied=((T0_US, T0_US + 100_000_000),))

    spans = spans_of(flight, 30.0)

    assert spans == [(T0_US + 10e6, T0_US + 40e6), (T0_US + 55e6, T0_US + 85e6)]
    assert spans_of(flight, 85.0) == []


def test_a_hidden_map_has_nothing_valid() -> None:
    grid = ImageryGrid(np.full((20, 20), 7, np.uint8), np.ones((20, 20), np.bool_), 10.0, -10.0, 1.0)
    hidden = HiddenMap(grid)

    assert hidden.window(-2.0, -2.0, 2.0, 2.0).valid.all()
    hidden.hidden = True
    assert not hidden.window(-2.0, -2.0, 2.0, 2.0).valid.any()
    assert hidden.window(-2.0, -2.0, 2.0, 2.0).image.shape == grid.window(-2.0, -2.0, 2.0, 2.0).image.shape
    assert Hiding([]).map is None


def test_figures_of_errors_as_large_as_stated() -> None:
    errors = Errors()
    for error in ([3.0, 4.0, 9.0], [0.0, 0.0, 0.0]):
        errors.add(np.array(error), 25.0 * np.eye(3))

    figures = errors.figures()

    assert figures["count"] == 2
    assert figures["rms_m"] == pytest.approx(np.sqrt(12.5))
    assert figures["nees_per_axis"] == pytest.approx(0.25)
    assert figures["stated_rms_m"] == pytest.approx(np.sqrt(50.0))
    assert Errors().figures() == {"count": 0}
