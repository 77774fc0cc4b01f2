"""The table ``alignments.csv`` of a recorded flight: where the operator laid pictures on the map, as measurements."""

from __future__ import annotations

import bisect
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator.geometry.local import LocalFrame
from estimator.types import AlignmentSample
from geodata.errors import FlightFolderError
from geodata.flight import FlightFolder
from geodata.flight_tables import Table, TableRow, parse_number, parse_rows, parse_time_us, read_table
from geodata.flight_write import Cell

ALIGNMENTS_FILE = "alignments.csv"
ALIGNMENT_COLUMNS = (
    "time_us", "frame_time_us", "system_id", "lat_deg", "lon_deg", "std_n_m", "std_e_m", "cov_ne_m2", "north_m",
    "east_m", "std_m", "by",
)  # fmt: skip
OPERATOR = "operator"
# A picture may be half a minute old when it is aligned, and its clock some seconds off.
MOST_AGE_US, MOST_AHEAD_US = 60_000_000, 10_000_000
STD_M = (0.1, 10_000.0)
FARTHEST_M = 100_000.0


@dataclass(frozen=True, slots=True)
class AlignmentRow:
    """One line: told at ``t_us`` of the frame of ``t_frame_us`` (of the recorded video, as in ``clicks.csv``).

    ``lat_deg`` and ``lon_deg`` are where the vehicle was at that frame by the operator, with the covariance that the
    estimator was given. They are what counts. ``north_m``, ``east_m`` and ``std_m`` are how far the frame was dragged
    from where the estimate of then had it, and how well; ``by`` says who did it.
    """

    t_us: int
    t_frame_us: int
    system_id: int
    lat_deg: float
    lon_deg: float
    std_ne_m: tuple[float, float]
    cov_ne_m2: float
    north_m: float
    east_m: float
    std_m: float
    by: str = OPERATOR

    @classmethod
    def of(
        cls, sample: AlignmentSample, t_frame_us: int, system_id: int, frame: LocalFrame,
        dragged: tuple[float, float, float], by: str,
    ) -> AlignmentRow:  # fmt: skip
        """What was told the estimator of a ``frame``; ``dragged`` is north, east and their sigma, metres."""
        lat_rad, lon_rad = frame.geodetic_from_ne(sample.pos_ne_m)
        (var_n, cov_ne), (_, var_e) = sample.cov_ne_m2.tolist()
        return cls(
            sample.t_us, t_frame_us, system_id, math.degrees(float(lat_rad)), math.degrees(float(lon_rad)),
            (math.sqrt(var_n), math.sqrt(var_e)), cov_ne, *dragged, by,
        )  # fmt: skip

    def cells(self) -> tuple[Cell, ...]:
        """As `ALIGNMENT_COLUMNS`."""
        return (
            self.t_us, self.t_frame_us, self.system_id, f"{self.lat_deg:.9f}", f"{self.lon_deg:.9f}",
            *(f"{std:.4f}" for std in self.std_ne_m), f"{self.cov_ne_m2:.6f}", round(self.north_m, 3),
            round(self.east_m, 3), self.std_m, self.by,
        )  # fmt: skip

    def sample(self, frame: LocalFrame, frame_id: int, exposure_us: int) -> AlignmentSample | None:
        """The measurement, of a picture exposed at ``exposure_us``; None where it is not of the ``frame``'s region."""
        pos_ne_m = frame.ne_from_geodetic(math.radians(self.lat_deg), math.radians(self.lon_deg))
        if not float(np.hypot(*pos_ne_m)) <= FARTHEST_M:
            return None
        std_n, std_e = self.std_ne_m
        cov = np.array([[std_n**2, self.cov_ne_m2], [self.cov_ne_m2, std_e**2]])
        return AlignmentSample(self.t_us, min(exposure_us, self.t_us), frame_id, np.asarray(pos_ne_m), cov)


def read_alignments(folder: FlightFolder) -> list[AlignmentRow]:
    """The alignments of a flight's vehicle in order of time; what cannot be used is left out with a warning."""
    path = folder.path / ALIGNMENTS_FILE
    if not path.exists():
        return []
    try:
        rows = parse_rows(read_table(path, ALIGNMENT_COLUMNS[:8]), _parse, folder.warn)
    except FlightFolderError as error:
        folder.warn(f"{error} (done without it)")
        return []
    wanted = folder.meta.vehicle.system_id
    return sorted((row for row in rows if wanted in (None, row.system_id)), key=lambda row: row.t_us)


class AlignmentFeed:
    """Gives a flight's alignments to an estimator, each at its time.

    ``exposure_us`` makes the exposure of a frame's time, as is known by then.
    """

    def __init__(self, folder: FlightFolder, frame: LocalFrame, exposure_us: Callable[[int], int]) -> None:
        self._folder, self._frame = folder, frame
        self._exposure_us = exposure_us
        self._rows = read_alignments(folder)
        self._next = 0

    def until(self, t_us: int) -> list[AlignmentSample]:
        """Those told up to a time that were not given before."""
        first, self._next = self._next, bisect.bisect_right(self._rows, t_us, key=lambda row: row.t_us)
        found = []
        for row in self._rows[first : self._next]:
            sample = row.sample(self._frame, self._number(row.t_frame_us), self._exposure_us(row.t_frame_us))
            if sample is None:
                self._folder.warn(f"{self._folder.path / ALIGNMENTS_FILE}: ({row.lat_deg:g}, {row.lon_deg:g}) lies "
                                  "beyond 100 km of the flight; left out")  # fmt: skip
            else:
                found.append(sample)
        return found

    def _number(self, t_frame_us: int) -> int:
        """The frame of a time, -1 where the folder does not tell the times of its frames."""
        times = self._folder.frame_times()
        if times is None:
            return -1
        at = int(np.argmin(np.abs(times.t_video_us - t_frame_us)))
        return int(times.frame[at])


def _parse(table: Table, row: TableRow) -> AlignmentRow:
    t_us, t_frame_us = (parse_time_us(table, row, column) for column in ALIGNMENT_COLUMNS[:2])
    lat, lon, std_n, std_e, cov = (parse_number(table, row, column) for column in ALIGNMENT_COLUMNS[3:8])
    system_id = parse_number(table, row, "system_id")
    checks = (
        ("frame_time_us", -MOST_AHEAD_US <= t_us - t_frame_us <= MOST_AGE_US, "give a frame of the minute before"),
        ("system_id", system_id.is_integer() and 1 <= system_id <= 255, "give the MAVLink system, 1 to 255"),
        ("lat_deg", -90.0 <= lat <= 90.0, "give a latitude in degrees"),
        ("lon_deg", -180.0 <= lon <= 180.0, "give a longitude in degrees"),
        ("std_n_m", STD_M[0] <= std_n <= STD_M[1], f"give a sigma of {STD_M[0]:g} to {STD_M[1]:g} m"),
        ("std_e_m", STD_M[0] <= std_e <= STD_M[1], f"give a sigma of {STD_M[0]:g} to {STD_M[1]:g} m"),
        ("cov_ne_m2", abs(cov) < std_n * std_e, "the covariance is smaller than the product of the sigmas"),
    )
    for column, is_right, remedy in checks:
        if not is_right:
            where = f"line {row.line}, column {column}"
            raise FlightFolderError(table.path, f"{row.cells[column]!r} cannot be", remedy, field=where)
    north, east, std = (_optional(row, column) for column in ALIGNMENT_COLUMNS[8:11])
    by = row.cells.get("by") or OPERATOR
    return AlignmentRow(t_us, t_frame_us, int(system_id), lat, lon, (std_n, std_e), cov, north, east, std, by)


def _optional(row: TableRow, column: str) -> float:
    """A number that is for people only: NaN where it is missing or none."""
    try:
        return float(row.cells.get(column, "nan"))
    except ValueError:
        return math.nan
