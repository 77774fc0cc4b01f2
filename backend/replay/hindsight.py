"""A flight's states with what later fixes say of them, smoothed piece by piece while the estimator runs over it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path

from backend.navigation.setup import NavigationSetup
from backend.recorder.estimate import ESTIMATE_COLUMNS, estimate_cells
from estimator.filters.eskf import ProcessNoise
from estimator.history import Corrected
from estimator.measurements.camera_attitude import Gimbal
from estimator.smoothing import smooth
from estimator.types import NavigationState
from geodata.flight_write import CsvAppender

SMOOTHED_FILE = "smoothed.csv"
STEP_US = 100_000
# The estimator keeps ten minutes of predictions. What came two minutes later moves a state no more that is looked at
# again every four.
EVERY_US, LAG_US = 240_000_000, 120_000_000


class Hindsight:
    """The smoothed ``states`` of a run, at most one in ``STEP_US``, in order of time."""

    def __init__(self, setup: NavigationSetup, noise: ProcessNoise) -> None:
        self.states: list[NavigationState] = []
        self._frame, self._camera_is_fixed = setup.frame, setup.gimbal == Gimbal.FIXED
        self._noise = noise
        self._due_us: int | None = None

    def note(self, t_us: int, corrected: Callable[[], Sequence[Corrected]]) -> None:
        """The run has come to a time."""
        if self._due_us is None:
            self._due_us = t_us + EVERY_US
        elif t_us >= self._due_us:
            self._due_us = t_us + EVERY_US
            self._take(corrected(), t_us - LAG_US)

    def finish(self, corrected: Sequence[Corrected]) -> None:
        """The run has ended."""
        self._take(corrected, None)

    def _take(self, corrected: Sequence[Corrected], until_us: int | None) -> None:
        smoothed = smooth(corrected, self._noise)
        for after in smoothed.after:
            last_us = self.states[-1].t_us if self.states else None
            if (last_us is not None and after.t_us - last_us < STEP_US) or (
                until_us is not None and after.t_us > until_us
            ):
                continue
            state = smoothed.at(after.t_us, self._frame, camera_is_fixed=self._camera_is_fixed)
            if state is not None:
                self.states.append(state)


def write_states(path: Path, states: Sequence[NavigationState]) -> None:
    """Write ``estimate.csv`` or ``smoothed.csv``: the columns are the same."""
    path.unlink(missing_ok=True)
    with CsvAppender(path, ESTIMATE_COLUMNS) as table:
        for state in states:
            table.write(*estimate_cells(state))
