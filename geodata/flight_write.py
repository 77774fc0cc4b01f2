"""Writing the parts of a flight folder: whole files appear at once, growing ones lose at most their last line."""

from __future__ import annotations

import json
import math
import os
from collections.abc import Iterable, Sequence
from pathlib import Path
from types import TracebackType

from geodata.flight_meta import FlightMeta
from geodata.flight_tables import (
    CLICK_COLUMNS,
    FRAME_COLUMNS,
    POINTING_COLUMNS,
    TARGET_COLUMNS,
    TRUTH_COLUMNS,
    Click,
    FrameTimes,
    TargetTruth,
    Truth,
)

Cell = str | int | float | None


class CsvAppender:
    """Appends lines to a CSV file; each is with the operating system when :meth:`write` returns.

    The header is written when the file is new. A last line that a killed process cut off is removed first.
    """

    def __init__(self, path: str | os.PathLike[str], columns: Sequence[str]) -> None:
        self.path = Path(path)
        self.columns = tuple(columns)
        if self.path.exists():
            _drop_unfinished_line(self.path)
        self._file = self.path.open("ab", buffering=0)
        if self._file.tell() == 0:
            self._file.write(_line(self.columns))

    def write(self, *cells: Cell) -> None:
        """Append one line; None and NaN leave a cell empty."""
        if len(cells) != len(self.columns):
            message = f"{len(cells)} cells for the {len(self.columns)} columns of {self.path}"
            raise ValueError(message)
        self._file.write(_line(cells))

    def sync(self) -> None:
        """Have what was written on the disk, also through a power cut."""
        os.fsync(self._file.fileno())

    def close(self) -> None:
        """Close the file; closing twice does no harm."""
        self._file.close()

    def __enter__(self) -> CsvAppender:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        self.close()


def write_flight_json(folder: str | os.PathLike[str], meta: FlightMeta) -> Path:
    """Write ``flight.json``, with the keys that its author added; returns its path."""
    data = meta.model_dump(mode="json", by_alias=True)
    path = Path(folder) / "flight.json"
    write_atomically(path, (json.dumps(data, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode())
    return path


def write_frames_csv(path: str | os.PathLike[str], frames: FrameTimes) -> None:
    """Write ``frames.csv``."""
    _write_rows(path, FRAME_COLUMNS, zip(frames.frame.tolist(), frames.t_video_us.tolist(), strict=True))


def write_clicks_csv(path: str | os.PathLike[str], clicks: Iterable[Click]) -> None:
    """Write ``clicks.csv``."""
    rows = (
        (c.t_video_us, round(c.u_px, 3), round(c.v_px, 3), c.target, c.height_above_ground_m, c.ground) for c in clicks
    )
    _write_rows(path, (*CLICK_COLUMNS, *POINTING_COLUMNS), rows)


def write_targets_truth_csv(path: str | os.PathLike[str], targets: Iterable[TargetTruth]) -> None:
    """Write ``targets_truth.csv``."""
    rows = ((t.target, _degrees(t.lat_rad), _degrees(t.lon_rad), f"{t.alt_amsl_m:.3f}") for t in targets)
    _write_rows(path, TARGET_COLUMNS, rows)


def write_truth_csv(path: str | os.PathLike[str], truth: Truth) -> None:
    """Write ``truth.csv``; NaN leaves a cell empty."""

    def rows() -> Iterable[Sequence[Cell]]:
        for i, t_us in enumerate(truth.t_unix_us.tolist()):
            attitude = (truth.roll_rad[i], truth.pitch_rad[i], truth.yaw_rad[i])
            yield (
                t_us,
                _degrees(truth.lat_rad[i]),
                _degrees(truth.lon_rad[i]),
                f"{truth.alt_amsl_m[i]:.4f}",
                *("" if math.isnan(angle) else f"{math.degrees(angle):.5f}" for angle in attitude),
                *("" if math.isnan(v) else f"{v:.4f}" for v in truth.vel_ned_m_s[i]),
            )

    _write_rows(path, TRUTH_COLUMNS, rows())


def write_atomically(path: Path, content: bytes) -> None:
    """Write a file so that it is either the old one or the whole new one, also through a power cut."""
    partial = path.with_name(f".{path.name}.{os.getpid()}.partial")
    try:
        with partial.open("wb") as file:
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        partial.replace(path)
    finally:
        partial.unlink(missing_ok=True)


def _drop_unfinished_line(path: Path) -> None:
    with path.open("r+b") as file:
        size = file.seek(0, os.SEEK_END)
        file.seek(max(0, size - 65536))
        tail = file.read()
        if not tail.endswith(b"\n"):
            file.truncate(size - len(tail) + tail.rfind(b"\n") + 1)


def _write_rows(path: str | os.PathLike[str], columns: Sequence[str], rows: Iterable[Sequence[Cell]]) -> None:
    write_atomically(Path(path), b"".join([_line(columns), *(_line(row) for row in rows)]))


def _degrees(angle_rad: float) -> str:
    # Ten decimals are a hundredth of a millimetre.
    return f"{math.degrees(angle_rad):.10f}"


def _line(cells: Sequence[Cell]) -> bytes:
    return (",".join(_cell(cell) for cell in cells) + "\n").encode()


def _cell(cell: Cell) -> str:
    if cell is None or (isinstance(cell, float) and math.isnan(cell)):
        return ""
    text = str(cell)
    return '"' + text.replace('"', '""').replace("\n", " ") + '"' if any(mark in text for mark in ',"\n\r') else text
