"""Figures of a fault that comes and goes, from series whose answers are known."""

from __future__ import annotations

import math

import numpy as np
import pytest

from benchmarks.studies.series import Series, alarms_raised, recovery_s, series_figures
from estimator.types import Doubt, Mode

T_S = np.arange(-50, 620) / 10.0
STRETCH = (15.0, 45.0)
DENIED_S = 60.0


def series(
    *, wrong_until_s: float = 50.0, sigma_m: float = 4.0, mode_during: Mode = Mode.DEAD_RECKONING,
    doubts: tuple[Doubt, ...] = (Doubt.NO_TEXTURE,), frozen: bool = False,
) -> Series:  # fmt: skip
    bad = (STRETCH[0] <= T_S) & (STRETCH[1] > T_S)
    error = np.where(STRETCH[0] > T_S, 1.5, np.where(wrong_until_s > T_S, 12.0, 1.0))
    error = np.where(T_S >= DENIED_S, 99.0, error)
    modes = tuple(
        Mode.GPS if t < 0.0 or t >= DENIED_S else mode_during if b else Mode.VISION
        for t, b in zip(T_S, bad, strict=True)
    )
    return Series(T_S, error, error / sigma_m, modes, tuple(doubts if b else () for b in bad), bad & frozen)


def test_errors_are_told_before_during_and_after() -> None:
    figures = series_figures([series()], STRETCH, DENIED_S)

    assert figures["before"] == "1.5 / 1.5"
    assert figures["during"] == "12.0 / 12.0"
    # a third of the last fifteen seconds at 12 m, the rest at 1 m
    assert figures["rms_after_m"] == pytest.approx(math.sqrt((144.0 + 2.0) / 3.0), rel=0.02)
    assert figures["modes"] == "0 / 100 / 0"
    assert figures["recovered"] == "5.0 s"
    assert figures["largest_sigmas"] == 3.0
    assert figures["sure_and_wrong"] == 0.0


@pytest.mark.parametrize("end_s", [DENIED_S, math.inf])
def test_a_fault_that_lasts_has_neither_before_nor_after(end_s: float) -> None:
    figures = series_figures([series()], (0.0, end_s), DENIED_S)

    assert not {"before", "after", "recovered"} & figures.keys()
    assert figures["modes"] == "50 / 50 / 0"


def test_sure_and_wrong_is_in_vision_and_beyond_five_sigma() -> None:
    small = series_figures([series(sigma_m=2.0, mode_during=Mode.VISION)], STRETCH, DENIED_S)
    owned_up = series_figures([series(sigma_m=2.0, wrong_until_s=45.0)], STRETCH, DENIED_S)

    assert small["sure_and_wrong"] == pytest.approx(35.0 / 60.0, abs=0.01)
    assert owned_up["sure_and_wrong"] == 0.0


def test_some_flights_may_never_recover() -> None:
    never = series(wrong_until_s=1e3)

    assert recovery_s(never, *STRETCH) == math.inf
    assert series_figures([never], STRETCH, DENIED_S)["recovered"] == "never"
    assert series_figures([never, series()], STRETCH, DENIED_S)["recovered"] == "5.0 s (1 of 2)"


def test_alarms_are_the_station_s_own_with_their_hysteresis() -> None:
    assert alarms_raised(series()) == ["no_texture", "dead_reckoning"]
    assert alarms_raised(series(frozen=True, doubts=())) == ["video_frozen", "dead_reckoning"]
    assert alarms_raised(series(mode_during=Mode.VISION, doubts=())) == []
    figures = series_figures([series(), series(doubts=())], STRETCH, DENIED_S)
    assert figures["alarms"] == "no_texture 1, dead_reckoning 2"
