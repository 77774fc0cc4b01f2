"""``landing.csv``: a replayed flight relative to its landing pad."""

from __future__ import annotations

from collections import Counter
from pathlib import Path

import numpy as np

from estimator.geometry.local import LocalFrame
from estimator.measurements.pad_tracking import SurveyedPlace
from estimator.types import NavigationState, PadRelative
from geodata.flight_pad import FlightPad
from geodata.flight_write import CsvAppender

LANDING_FILE = "landing.csv"
LANDING_COLUMNS = (
    "time_us", "north_m", "east_m", "down_m", "vn_mps", "ve_mps", "vd_mps", "std_n_m", "std_e_m", "std_d_m",
    "std_vn_mps", "std_ve_mps", "std_vd_mps", "mode", "age_s", "reason",
)  # fmt: skip
STEP_US = 20_000


class LandingTrack:
    """Places relative to the pad over a run, at most one in ``STEP_US``; empty where no pad was named."""

    def __init__(self) -> None:
        self.rows: list[tuple[int, PadRelative]] = []

    def note(self, state: NavigationState) -> None:
        """The run has come to a state."""
        if state.pad is not None and (not self.rows or state.t_us - self.rows[-1][0] >= STEP_US):
            self.rows.append((state.t_us, state.pad))

    def modes(self) -> dict[str, float]:
        """Which share of the rows was in which mode."""
        counts = Counter(str(pad.mode) for _, pad in self.rows)
        return {mode: count / len(self.rows) for mode, count in sorted(counts.items())}

    def write(self, path: Path) -> None:
        """Write the table; where there was no pad, none, and one of an earlier run is removed."""
        path.unlink(missing_ok=True)
        if not self.rows:
            return
        with CsvAppender(path, LANDING_COLUMNS) as table:
            for t_us, pad in self.rows:
                std = np.sqrt(np.concatenate((np.diag(pad.cov_pos_ned_m2), np.diag(pad.cov_vel_ned_m2_s2))))
                numbers = np.concatenate((pad.pos_ned_m, pad.vel_ned_m_s, std))
                cells = (None if np.isnan(number) else f"{number:.4f}" for number in numbers)
                age = f"{pad.age_s:.3f}" if np.isfinite(pad.age_s) else None
                table.write(t_us, *cells, str(pad.mode), age, pad.reason)


def surveyed_place(pad: FlightPad, frame: LocalFrame) -> SurveyedPlace | None:
    """Where a flight's pad lies in a local frame, if that was surveyed."""
    survey = pad.survey
    if survey is None:
        return None
    pos = frame.ned_from_geodetic(np.radians(survey.lat_deg), np.radians(survey.lon_deg), survey.alt_amsl_m)
    return SurveyedPlace(pos, survey.std_m)
