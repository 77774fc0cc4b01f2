"""The CSV tables of a flight folder: tolerant reading.

Read are: a byte-order mark, CRLF, blank and comment lines, semicolons or tabs for commas, columns in any order, columns
nobody knows. A last line that was cut off is left out with a warning.
"""

from __future__ import annotations

import csv
import math
from bisect import bisect_left
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator.types import Float
from geodata.errors import FlightFolderError

FRAME_COLUMNS = ("frame", "time_us")
CLICK_COLUMNS = ("time_us", "u_px", "v_px", "target")
POINTING_COLUMNS = ("height_above_ground_m", "ground")
"""Of ``clicks.csv``, where they are not all at the terrain."""
GROUNDS = ("terrain", "flat")
TRUTH_COLUMNS = (
    *("time_us", "lat_deg", "lon_deg", "alt_amsl_m"),
    *("roll_deg", "pitch_deg", "yaw_deg", "vn_mps", "ve_mps", "vd_mps"),
)
TARGET_COLUMNS = ("target", "lat_deg", "lon_deg", "alt_amsl_m")

_MAX_BYTES = 1 << 30

Times = NDArray[np.int64]
Item = TypeVar("Item")


@dataclass(frozen=True, slots=True, eq=False)
class FrameTimes:
    """When each frame was taken on the video clock: ``frame`` (n,) ascending, ``t_video_us`` (n,) strictly ascending.

    Exposure on the station's time base is ``t_video_us`` plus the video's time offset.
    """

    frame: Times
    t_video_us: Times

    def of_frame(self, frame: int) -> int | None:
        """Time of one frame, None when the table does not list it."""
        at = int(np.searchsorted(self.frame, frame))
        return int(self.t_video_us[at]) if at < len(self.frame) and self.frame[at] == frame else None


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """The true trajectory, ascending in time; arrays (n,), velocity (n, 3); NaN in columns that the file lacks."""

    t_unix_us: Times
    lat_rad: Float
    lon_rad: Float
    alt_amsl_m: Float
    roll_rad: Float
    pitch_rad: Float
    yaw_rad: Float
    vel_ned_m_s: Float


@dataclass(frozen=True, slots=True)
class Click:
    """One click on the recorded video; ``t_video_us`` is the frame's time on the video clock.

    What was clicked stands ``height_above_ground_m`` above the ``ground``: the terrain, or level ground ("flat").
    """

    t_video_us: int
    u_px: float
    v_px: float
    target: str
    height_above_ground_m: float = 0.0
    ground: str = "terrain"


@dataclass(frozen=True, slots=True)
class TargetTruth:
    """Where a target truly is."""

    target: str
    lat_rad: float
    lon_rad: float
    alt_amsl_m: float


@dataclass(frozen=True, slots=True)
class TableRow:
    """One line of a table: its number in the file, from 1, and its cells by column name."""

    line: int
    cells: Mapping[str, str]


@dataclass(frozen=True, slots=True)
class Table:
    """The rows of a table that have enough cells.

    ``cut_off`` names the last line when it was incomplete; ``is_open_ended`` says that no line end follows the last.
    """

    path: Path
    columns: tuple[str, ...]
    rows: tuple[TableRow, ...]
    cut_off: int | None
    is_open_ended: bool


def read_table(path: Path, required: Sequence[str]) -> Table:
    """Read a CSV file.

    Raises
    ------
    FlightFolderError
        It cannot be read, lacks a required column, or a line other than the last has too few cells.
    """
    try:
        if path.stat().st_size > _MAX_BYTES:
            raise FlightFolderError(path, "is larger than 1 GB", "is this the right file?")
        text = path.read_bytes().decode("utf-8-sig")
    except UnicodeDecodeError as error:
        raise FlightFolderError(path, f"is not UTF-8 text (byte {error.start})", "save it as CSV in UTF-8") from error
    except OSError as error:
        raise FlightFolderError(path, f"cannot be read ({error.strerror})", "check the file and its rights") from error
    lines = [
        (number, line)
        for number, line in enumerate(text.splitlines(), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise FlightFolderError(path, "is empty", f"its first line must be {','.join(required)}")
    header = lines[0][1]
    delimiter = max(",;\t", key=header.count)
    columns = tuple(cell.strip().lower() for cell in _cells(header, delimiter))
    missing = [column for column in required if column not in columns]
    if missing:
        raise FlightFolderError(
            path,
            f"has no column {', '.join(missing)} (its first line is {header.strip()[:120]!r})",
            f"its first line must name {','.join(required)}",
        )
    needed = 1 + max(columns.index(column) for column in required)
    is_open_ended = not text.endswith(("\n", "\r"))
    rows: list[TableRow] = []
    for number, line in lines[1:]:
        cells = [cell.strip() for cell in _cells(line, delimiter)]
        if len(cells) < needed:
            if number == lines[-1][0] and is_open_ended:
                return Table(path, columns, tuple(rows), number, True)
            raise FlightFolderError(
                path,
                f"line {number} has {len(cells)} cells, not {needed}",
                "complete or delete it",
                field=f"line {number}",
            )
        rows.append(TableRow(number, dict(zip(columns, cells, strict=False))))
    return Table(path, columns, tuple(rows), None, is_open_ended)


def parse_time_us(table: Table, row: TableRow, column: str) -> int:
    """A time in microseconds, also where a spreadsheet made ``1.7953E+15`` or ``….0`` of it."""
    cell = row.cells[column]
    try:
        return int(cell)
    except ValueError:
        value = parse_number(table, row, column)
    if not value.is_integer() or "e" in cell.lower():
        raise FlightFolderError(
            table.path,
            f"{cell!r} is not a whole number of microseconds",
            "write times as integers in Unix microseconds",
            field=f"line {row.line}, column {column}",
        )
    return int(value)


def parse_number(table: Table, row: TableRow, column: str) -> float:
    """A finite number."""
    cell = row.cells[column]
    try:
        value = float(cell)
    except ValueError:
        value = math.nan
    if not math.isfinite(value):
        raise FlightFolderError(
            table.path,
            f"{cell!r} is not a number",
            "correct or delete the line",
            field=f"line {row.line}, column {column}",
        )
    return value


def parse_frames(table: Table, warn: Callable[[str], None]) -> FrameTimes:
    """Frame numbers, which must rise, and times; frames whose time does not run forward are left out with a warning.

    What is kept is the longest run of rising times, so that one wrong time costs one frame, wherever it lies.
    """
    rows: list[tuple[int, int, int]] = []
    for row in table.rows:
        try:
            frame, t_us = _frame_row(table, row)
            if rows:
                _check_order(table, row, rows[-1][1], frame)
        except FlightFolderError as error:
            # A recorder that was killed leaves its last line unfinished, perhaps in the middle of a number.
            if row is table.rows[-1] and table.is_open_ended:
                warn(f"{error}; the line is unfinished and left out")
                break
            raise
        if row is table.rows[-1] and table.is_open_ended and rows and t_us <= rows[-1][2]:
            warn(f"{table.path}: line {row.line}: the line is unfinished and left out")
            break
        rows.append((row.line, frame, t_us))
    if not rows:
        raise FlightFolderError(table.path, "lists no frame", "fill it, or delete it to use video.start_time_us")
    lines, frames, times = np.array(rows, dtype=np.int64).T
    kept = _longest_rise(times)
    if len(kept) < len(rows):
        left_out = np.setdiff1d(np.arange(len(rows)), kept)
        first, count = left_out[0], len(left_out)
        more = f" (and {count - 1} more)" if count > 1 else ""
        warn(
            f"{table.path}: line {lines[first]}: time {times[first]} of frame {frames[first]} does not fit between its "
            f"neighbours: frame times must run forward; left out{more}"
        )
    return FrameTimes(frames[kept], times[kept])


def _longest_rise(values: Times) -> NDArray[np.intp]:
    """Indices of a longest strictly rising subsequence, by patience sorting (Fredman 1975)."""
    tails: list[int] = []  # the smallest value that ends a rise of each length
    ends: list[int] = []
    before = np.full(len(values), -1, dtype=np.intp)
    for index, value in enumerate(values.tolist()):
        length = bisect_left(tails, value)
        if length == len(tails):
            tails.append(value)
            ends.append(index)
        else:
            tails[length], ends[length] = value, index
        before[index] = ends[length - 1] if length else -1
    kept = np.empty(len(ends), dtype=np.intp)
    index = ends[-1]
    for place in range(len(ends) - 1, -1, -1):
        kept[place] = index
        index = int(before[index])
    return kept


def _frame_row(table: Table, row: TableRow) -> tuple[int, int]:
    number = parse_number(table, row, "frame")
    if number < 0 or not number.is_integer():
        raise FlightFolderError(
            table.path,
            f"{row.cells['frame']!r} is not a frame number",
            "number frames from 0",
            field=f"line {row.line}",
        )
    return int(number), parse_time_us(table, row, "time_us")


def _check_order(table: Table, row: TableRow, before: int, now: int) -> None:
    if now <= before:
        raise FlightFolderError(
            table.path,
            f"frame {now} follows frame {before}",
            "list each frame once, in the order of the video",
            field=f"line {row.line}",
        )


def parse_rows(table: Table, parse: Callable[[Table, TableRow], Item], warn: Callable[[str], None]) -> list[Item]:
    """What ``parse`` makes of each row; a row it refuses is left out with a warning."""
    items: list[Item] = []
    refused: list[FlightFolderError] = []
    for row in table.rows:
        try:
            items.append(parse(table, row))
        except FlightFolderError as error:
            refused.append(error)
    if refused:
        more = f" (and {len(refused) - 1} more lines)" if len(refused) > 1 else ""
        warn(f"{refused[0]}; left out{more}")
    return items


def parse_click(table: Table, row: TableRow) -> Click:
    """One click; columns of ``POINTING_COLUMNS`` may be missing or empty."""
    height, ground = (row.cells.get(column, "") for column in POINTING_COLUMNS)
    if ground not in ("", *GROUNDS):
        where = f"line {row.line}, column ground"
        raise FlightFolderError(table.path, f"{ground!r} is no ground", f"use {' or '.join(GROUNDS)}", field=where)
    return Click(
        parse_time_us(table, row, "time_us"),
        parse_number(table, row, "u_px"),
        parse_number(table, row, "v_px"),
        row.cells["target"],
        parse_number(table, row, "height_above_ground_m") if height else 0.0,
        ground or "terrain",
    )


def parse_target(table: Table, row: TableRow) -> TargetTruth:
    """One target's true position."""
    lat_rad, lon_rad = _position(table, row)
    return TargetTruth(row.cells["target"], lat_rad, lon_rad, parse_number(table, row, "alt_amsl_m"))


def parse_truth(table: Table, warn: Callable[[str], None]) -> Truth:
    """The trajectory, put in order of time; the last of equal times counts."""
    rows = parse_rows(table, _truth_row, warn)
    if not rows:
        raise FlightFolderError(table.path, "holds no usable line", "correct or delete it")
    times = np.array([t_us for t_us, _ in rows], dtype=np.int64)
    values = np.array([numbers for _, numbers in rows], dtype=np.float64)
    if np.any(np.diff(times) <= 0):
        warn(f"{table.path}: its times do not run forward; put in order")
        unique, last_reversed = np.unique(times[::-1], return_index=True)
        times, values = unique, values[::-1][last_reversed]
    lat_rad, lon_rad, alt_m, roll_rad, pitch_rad, yaw_rad = values[:, :6].T
    return Truth(times, lat_rad, lon_rad, alt_m, roll_rad, pitch_rad, yaw_rad, values[:, 6:9])


def _truth_row(table: Table, row: TableRow) -> tuple[int, list[float]]:
    lat_rad, lon_rad = _position(table, row)
    numbers = [lat_rad, lon_rad, parse_number(table, row, "alt_amsl_m")]
    for column in TRUTH_COLUMNS[4:]:
        known = row.cells.get(column, "") != ""
        value = parse_number(table, row, column) if known else math.nan
        numbers.append(math.radians(value) if column.endswith("_deg") else value)
    return parse_time_us(table, row, "time_us"), numbers


def _position(table: Table, row: TableRow) -> tuple[float, float]:
    lat_deg, lon_deg = parse_number(table, row, "lat_deg"), parse_number(table, row, "lon_deg")
    if abs(lat_deg) > 90 or abs(lon_deg) > 180:
        raise FlightFolderError(
            table.path, f"({lat_deg}, {lon_deg}) is no position", "give degrees", field=f"line {row.line}"
        )
    return math.radians(lat_deg), math.radians(lon_deg)


def _cells(line: str, delimiter: str) -> list[str]:
    return next(csv.reader([line], delimiter=delimiter), [])
