"""A budget, what was measured, and the verdict."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from typing import Any

from rich.console import Console
from rich.table import Table


@dataclass(frozen=True, slots=True)
class Measurement:
    """One quantity of design section 8 beside its budget.

    ``value`` is NaN where it could not be measured, and ``note`` then says why. ``limit`` is None for what is only
    reported. ``at_least`` turns the comparison round.
    """

    name: str
    value: float
    unit: str
    limit: float | None = None
    at_least: bool = False
    note: str = ""

    @property
    def verdict(self) -> str:
        """``ok``, ``MISSED``, ``not measured``, or nothing for what has no budget."""
        if math.isnan(self.value):
            return "not measured"
        if self.limit is None:
            return ""
        holds = self.value >= self.limit if self.at_least else self.value <= self.limit
        return "ok" if holds else "MISSED"

    def as_dict(self) -> dict[str, Any]:
        """For JSON, which has neither NaN nor infinity."""
        fields = asdict(self)
        return {**fields, "value": self.value if math.isfinite(self.value) else None, "verdict": self.verdict}


def unmeasured(names: Sequence[str], why: str) -> list[Measurement]:
    """What could not be measured, and why."""
    return [Measurement(name, math.nan, "", note=why) for name in names]


def percentile(values: Sequence[float], part: float) -> float:
    """The nearest-rank percentile; NaN of nothing."""
    ordered = sorted(values)
    return ordered[max(0, math.ceil(part * len(ordered)) - 1)] if ordered else math.nan


def print_table(measurements: Sequence[Measurement], console: Console) -> None:
    """One line a quantity."""
    table = Table("quantity", "budget", "measured", "verdict", "note", box=None, header_style="bold")
    for m in measurements:
        sign = "" if m.limit is None else ("≥ " if m.at_least else "≤ ")
        limit = "" if m.limit is None else f"{sign}{m.limit:g} {m.unit}"
        value = "" if math.isnan(m.value) else f"{m.value:.3g} {m.unit}"
        table.add_row(m.name, limit, value, m.verdict, m.note, style="red" if m.verdict == "MISSED" else None)
    console.print(table)


def missed(measurements: Sequence[Measurement]) -> bool:
    """Whether any budget was missed."""
    return any(m.verdict == "MISSED" for m in measurements)
