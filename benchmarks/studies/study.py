"""What a study is: rows that differ in one thing each, flown and estimated over seeds."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

from benchmarks.studies.degraded import Degradation
from estimator.navigator import NavigatorConfig
from simulator.scenario import Scenario


@dataclass(frozen=True, slots=True)
class FlownRow:
    """A row that flies: a simulated scenario, and the estimator's configuration that replays it.

    ``change`` says in words what differs from the row before. With ``degrade`` the estimator is given that instead of
    what was recorded.
    """

    name: str
    change: str
    scenario: Scenario
    config: NavigatorConfig
    degrade: Degradation | None = None


@dataclass(frozen=True, slots=True)
class ComputedRow:
    """A row that needs no pictures: ``compute`` maps a seed to figures by name."""

    name: str
    change: str
    compute: Callable[[int], dict[str, float]]


Row = FlownRow | ComputedRow


@dataclass(frozen=True, slots=True)
class Column:
    """A figure of the table: how it is read from pooled figures, and how it is written."""

    title: str
    figure: str
    digits: int = 2
    percent: bool = False

    def cell(self, figures: dict[str, Any]) -> str:
        """The figure as text, or the text that it is; a dash where it was not measured."""
        value = figures.get(self.figure)
        if isinstance(value, str):
            return value
        if value is None or not math.isfinite(value):
            return "–"
        return f"{100.0 * value:.{self.digits}f} %" if self.percent else f"{value:.{self.digits}f}"


HEADLINE = (
    Column("rms, m", "rms_m"),
    Column("95 %, m", "p95_m"),
    Column("available", "availability", 1, percent=True),
    Column("by vision", "by_vision", 0, percent=True),
    Column("> 5 sigma", "wrong", 2, percent=True),
    Column("NEES / dof", "nees_per_dof"),
)
"""What every study of navigation shows first."""
HEADLINE_MEANING = (
    "Errors are horizontal, unaligned, while GPS is denied. Available: declared valid (not lost, its own 95 % ellipse "
    "within 10 m) and within 10 m. By vision: share of mode `vision`, a fix within six seconds."
)


@dataclass(frozen=True, slots=True)
class Study:
    """A named study: its rows, the figures of its table, the one that is plotted.

    ``segments_m`` are the lengths over which the drift is taken, empty where it is not.
    """

    name: str
    title: str
    about: str
    rows: tuple[Row, ...]
    columns: tuple[Column, ...]
    plotted: str
    plot_label: str
    segments_m: tuple[float, ...] = field(default=())
