"""The whole of a replayed flight as the history of its vehicle: states, GPS and fixes by the flight's time."""

from __future__ import annotations

import csv
import math
from pathlib import Path

import numpy as np

from backend.fleet.history import (
    FIXES_KEPT,
    MODES,
    STATE_NUMBERS,
    STATES_KEPT,
    STEP_US,
    VehicleHistory,
)
from backend.navigation.setup import NavigationSetup
from backend.playback.estimate import EstimateTable
from backend.playback.recording import FlightRecording

# The order of `NUMBER_COLUMNS` of the table.
_TABLE = (
    "lat_deg", "lon_deg", "alt_amsl_m", "roll_deg", "pitch_deg", "heading_deg", "vn_m_s", "ve_m_s", "vd_m_s",
    "std_n_m", "std_e_m", "std_d_m", "cov_ne_m2",
)  # fmt: skip


def recorded_history(recording: FlightRecording, table: EstimateTable | None, fixes: Path | None) -> VehicleHistory:
    """Rings of a flight, its states thinned where it is longer than they hold; ``fixes`` is a ``fixes.csv``."""
    history = VehicleHistory()
    step_us = max(STEP_US, (recording.end_us - recording.start_us) // STATES_KEPT + 1)
    if table is not None and len(table.t_us):
        _fill_states(history, recording, table, step_us)
    due_us = -math.inf
    for reading in recording.gps:
        if reading.has_fix and reading.t_us >= due_us:
            due_us = reading.t_us + step_us
            history.gps.add(reading.t_us, {
                "lat_deg": reading.lat_deg, "lon_deg": reading.lon_deg, "alt_amsl_m": reading.alt_amsl_m,
                "std_horizontal_m": reading.std_horizontal_m,
                "used": not recording.folder.is_gps_denied(reading.t_us),
            })  # fmt: skip
    if fixes is not None and recording.setup is not None:
        fill_fixes(history, fixes, recording.setup)
    return history


def _fill_states(history: VehicleHistory, recording: FlightRecording, table: EstimateTable, step_us: int) -> None:
    ground_m = np.full(len(table.t_us), np.nan)
    setup = recording.setup
    if setup is not None:
        lat_rad, lon_rad = np.radians(table.values[:, 0]), np.radians(table.values[:, 1])
        pos = setup.frame.ned_from_geodetic(lat_rad, lon_rad, table.values[:, 2])
        ground_m = setup.ground.alt_amsl_m(pos[:, 0], pos[:, 1]) - np.nan_to_num(table.ground_bias_m)
    due_us = -math.inf
    for index, t_us in enumerate(table.t_us.tolist()):
        if t_us < due_us:
            continue
        due_us = t_us + step_us
        values = dict(zip(_TABLE, table.values[index].tolist(), strict=True))
        values["heading_deg"] %= 360.0
        row = {name: values.get(name) for name in STATE_NUMBERS}
        row |= {
            "alt_agl_m": values["alt_amsl_m"] - float(ground_m[index]), "epoch": 1,
            "mode": MODES.index(str(table.modes[index])), "gps_denied": recording.folder.is_gps_denied(t_us),
        }  # fmt: skip
        history.states.add(t_us, row)


def fill_fixes(history: VehicleHistory, path: Path, setup: NavigationSetup) -> None:
    """The lines of a ``fixes.csv``; one that is cut off or makes no sense is left out, and so is a missing file."""
    try:
        with path.open(newline="", encoding="utf-8", errors="replace") as file:
            rows = list(csv.DictReader(file))[-FIXES_KEPT:]
    except OSError:
        return
    for row in rows:
        try:
            t_us, accepted = int(row["time_us"]), bool(int(row["accepted"]))
            numbers = [float(row[name]) for name in ("north_m", "east_m", "std_n_m", "std_e_m", "score", "elapsed_ms")]
            kind, reason = str(row["kind"]), str(row["reason"])
        except (KeyError, TypeError, ValueError):
            continue
        north_m, east_m, std_n_m, std_e_m, score, elapsed_ms = numbers
        values: dict[str, float | None] = {"score": score, "elapsed_ms": elapsed_ms, "accepted": accepted}
        if math.isfinite(north_m) and math.isfinite(east_m):
            lat_rad, lon_rad = setup.frame.geodetic_from_ne(np.array([north_m, east_m]))
            values |= {"lat_deg": math.degrees(float(lat_rad)), "lon_deg": math.degrees(float(lon_rad))}
            values |= {"var_n_m2": std_n_m**2, "var_e_m2": std_e_m**2}
        if history.fixes.add(t_us, values):
            history.fix_words.append((t_us, kind, reason))
