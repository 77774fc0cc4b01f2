"""The flight folder: the unit of recording, replay, evaluation and exchange.

What cannot be used raises a :class:`FlightFolderError` that names file, field and remedy; what can be done without is
collected in ``FlightFolder.warnings``.
"""

from __future__ import annotations

import json
import os
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, TypeVar

from pydantic import ValidationError

from geodata.errors import FlightFolderError
from geodata.flight_meta import SCHEMA, CameraMeta, FlightMeta
from geodata.flight_tables import (
    CLICK_COLUMNS,
    FRAME_COLUMNS,
    TARGET_COLUMNS,
    Click,
    FrameTimes,
    TargetTruth,
    Truth,
    parse_click,
    parse_frames,
    parse_rows,
    parse_target,
    parse_truth,
    read_table,
)
from geodata.flight_write import (
    CsvAppender,
    write_clicks_csv,
    write_flight_json,
    write_frames_csv,
    write_targets_truth_csv,
    write_truth_csv,
)
from geodata.tlog import TlogWriter, iter_tlog, tlog_span

VIDEO_NAMES = ("video.mp4", "video.ts", "video.mkv", "video.avi", "frames")
IMAGE_SUFFIXES = (".jpg", ".jpeg", ".png", ".bmp", ".tif", ".tiff", ".webp")

_MAX_JSON_BYTES = 16 << 20

Value = TypeVar("Value")


class FlightFolder:
    """A checked flight folder; made by :meth:`open`. Paths are None for what the flight does not have."""

    def __init__(self, path: Path, meta: FlightMeta) -> None:
        self.path = path
        self.meta = meta
        self.warnings: list[str] = []
        self.telemetry_path = path / "telemetry.tlog"
        self.video_path = self._find_video()
        self.reference_path = self.named("map.reference", meta.map.reference)
        self.elevation_path = self.named("map.elevation", meta.map.elevation)
        self._frame_times: FrameTimes | None = None

    @classmethod
    def open(cls, path: str | os.PathLike[str]) -> FlightFolder:
        """Read ``flight.json`` and check that the folder holds together.

        Raises
        ------
        FlightFolderError
            Something needed is missing, malformed or contradicts something else.
        """
        folder = Path(path).expanduser().resolve()
        if folder.name == "flight.json" and folder.is_file():
            folder = folder.parent
        if not folder.is_dir():
            what = "is not a folder" if folder.exists() else "no such flight folder"
            raise FlightFolderError(folder, what, "give the folder that holds flight.json")
        flight = cls(folder, _read_meta(folder))
        flight._check_telemetry()
        flight._check_frames()
        return flight

    @property
    def name(self) -> str:
        """The flight's name, else the folder's."""
        return self.meta.name or self.path.name

    @property
    def camera(self) -> CameraMeta:
        """The camera; a :class:`FlightFolderError` where the flight was recorded without one."""
        if self.meta.camera is None:
            raise FlightFolderError(
                self.path / "flight.json",
                "is missing",
                "give at least width_px, height_px and fx_px, so that pixels become directions",
                field="camera",
            )
        return self.meta.camera

    @property
    def time_offset_us(self) -> int | None:
        """What is added to frame times, None when it is unknown."""
        offset_s = self.meta.video.time_offset_s
        return None if offset_s is None else round(offset_s * 1e6)

    def frame_times(self) -> FrameTimes | None:
        """``frames.csv``, or None when the folder has none and frames are timed by start time and PTS."""
        path = self.path / "frames.csv"
        if self._frame_times is None and path.exists():
            table = read_table(path, FRAME_COLUMNS)
            if table.cut_off is not None:
                self.warn(f"{path}: line {table.cut_off} is cut off; left out")
            self._frame_times = parse_frames(table, self.warn)
        return self._frame_times

    def frame_time_us(self, frame: int, pts_s: float | None = None) -> int | None:
        """Time of a frame on the video clock, before the time offset; None when the folder cannot say.

        ``frames.csv`` wins over ``video.start_time_us`` plus ``pts_s`` from the first frame.
        """
        times = self.frame_times()
        if times is not None:
            return times.of_frame(frame)
        start_us = self.meta.video.start_time_us
        return None if start_us is None or pts_s is None else start_us + round(pts_s * 1e6)

    def frame_files(self) -> dict[int, Path]:
        """The pictures of a ``frames`` folder by frame number, ascending; numbers may have gaps."""
        if self.video_path is None or not self.video_path.is_dir():
            return {}
        found: dict[int, Path] = {}
        for file in sorted(self.video_path.iterdir()):
            number = re.search(r"(\d+)$", file.stem)
            if file.suffix.lower() not in IMAGE_SUFFIXES or file.name.startswith(".") or number is None:
                continue
            frame = int(number.group(1))
            if frame in found:
                raise FlightFolderError(
                    self.video_path,
                    f"both {found[frame].name} and {file.name} are frame {frame}",
                    "remove one of them",
                    field="video.file",
                )
            found[frame] = file
        return dict(sorted(found.items()))

    def truth(self) -> Truth | None:
        """``truth.csv``; None, with a warning, when it is there but cannot be used."""
        columns = ("time_us", "lat_deg", "lon_deg", "alt_amsl_m")
        return self._optional("truth.csv", lambda path: parse_truth(read_table(path, columns), self.warn))

    def clicks(self) -> list[Click]:
        """``clicks.csv``; unusable lines are left out with a warning."""
        return (
            self._optional(
                "clicks.csv", lambda path: parse_rows(read_table(path, CLICK_COLUMNS), parse_click, self.warn)
            )
            or []
        )

    def targets_truth(self) -> dict[str, TargetTruth]:
        """``targets_truth.csv`` by target; unusable lines are left out with a warning."""
        targets = self._optional(
            "targets_truth.csv", lambda path: parse_rows(read_table(path, TARGET_COLUMNS), parse_target, self.warn)
        )
        return {target.target: target for target in targets or []}

    def telemetry(self) -> Iterator[tuple[int, bytes]]:
        """Packets of the telemetry log with their Unix microseconds."""
        return iter_tlog(self.telemetry_path)

    def telemetry_span(self) -> tuple[int, int]:
        """First and last time of the telemetry, Unix microseconds, the earlier of its two ends first."""
        span = tlog_span(self.telemetry_path)
        if span is None:
            raise FlightFolderError(
                self.telemetry_path,
                "holds no MAVLink packet",
                "it must be repeated [uint64 big-endian Unix microseconds][packet]",
            )
        return min(span), max(span)

    def is_gps_denied(self, t_unix_us: int) -> bool:
        """Whether GPS is withheld at a time."""
        return any(start_us <= t_unix_us <= end_us for start_us, end_us in self.meta.gps_denied)

    def warn(self, message: str) -> None:
        """Add a warning, once."""
        if message not in self.warnings:
            self.warnings.append(message)

    def _optional(self, name: str, read: Callable[[Path], Value]) -> Value | None:
        path = self.path / name
        if not path.exists():
            return None
        try:
            return read(path)
        except FlightFolderError as error:
            self.warn(f"{error} (done without it)")
            return None

    def named(self, field: str, name: str | None) -> Path | None:
        """The file of this folder that ``flight.json`` names, which must be there."""
        if not name:
            return None
        path = Path(os.path.normpath(self.path / name))
        if not path.is_relative_to(self.path) or path == self.path:
            raise FlightFolderError(
                self.path / "flight.json", f"{name!r} lies outside the folder", "copy it into the folder", field=field
            )
        if not path.exists():
            there = sorted(entry.name for entry in self.path.iterdir() if not entry.name.startswith("."))
            listing = ", ".join(there[:12]) + (", …" if len(there) > 12 else "")
            raise FlightFolderError(
                self.path / "flight.json",
                f"names {name!r}, but the folder does not hold it (it holds {listing})",
                "add the file, correct the name or set it to null",
                field=field,
            )
        return path

    def _find_video(self) -> Path | None:
        named = self.named("video.file", self.meta.video.file)
        if named is not None:
            return named
        for name in VIDEO_NAMES:
            if (self.path / name).exists():
                return self.path / name
        return None

    def _check_telemetry(self) -> None:
        if not self.telemetry_path.is_file():
            raise FlightFolderError(
                self.telemetry_path, "is missing", "a flight needs its telemetry; copy it under this name"
            )
        try:
            start_us, end_us = self.telemetry_span()
        except OSError as error:
            raise FlightFolderError(
                self.telemetry_path, f"cannot be read ({error.strerror})", "check the file and its rights"
            ) from error
        for denied_start_us, denied_end_us in self.meta.gps_denied:
            if denied_start_us > end_us or denied_end_us < start_us:
                self.warn(
                    f"{self.path / 'flight.json'}: gps_denied: [{denied_start_us}, {denied_end_us}] lies outside the "
                    f"telemetry, which runs from {start_us} to {end_us}"
                )

    def _check_frames(self) -> None:
        times = self.frame_times()
        if self.video_path is None:
            self.warn(f"{self.path}: has no video")
            return
        pictures = self.frame_files()
        if self.video_path.is_dir() and not pictures:
            raise FlightFolderError(
                self.video_path, "holds no pictures named by frame number", "name them 000000.jpg, 000001.jpg, …"
            )
        if times is None:
            self._check_start_time(bool(pictures))
            return
        if pictures:
            self._compare_pictures(times, pictures)
        self._check_overlap("frames.csv", int(times.t_video_us[0]), int(times.t_video_us[-1]))

    def _check_start_time(self, is_pictures: bool) -> None:
        start_us = self.meta.video.start_time_us
        if is_pictures or start_us is None:
            why = "pictures carry no time of their own" if is_pictures else "video.start_time_us is null"
            raise FlightFolderError(
                self.path / "frames.csv",
                f"is missing, and {why}",
                "add frames.csv with the columns frame,time_us"
                + ("" if is_pictures else " or give video.start_time_us"),
                field="video.start_time_us",
            )
        self._check_overlap("flight.json: video.start_time_us", start_us, None)

    def _check_overlap(self, what: str, first_us: int, last_us: int | None) -> None:
        start_us, end_us = self.telemetry_span()
        # An unknown video delay moves the two ends by some seconds; hours mean another clock or another unit.
        offset_us = self.time_offset_us or 0
        if first_us + offset_us <= end_us and (last_us is None or last_us + offset_us >= start_us):
            if last_us is None and first_us + offset_us < start_us - 86_400_000_000:
                self.warn(f"{self.path}: {what} is more than a day before the telemetry")
            return
        ratio = first_us / max(start_us, 1)
        unit = next((name for name, size in (("seconds", 1e-6), ("milliseconds", 1e-3)) if 0.5 < ratio / size < 2), "")
        raise FlightFolderError(
            self.path / what.split(":", maxsplit=1)[0],
            f"frames run from {first_us}{f' to {last_us}' if last_us is not None else ''} but the telemetry from "
            f"{start_us} to {end_us}, in Unix microseconds: they do not overlap",
            f"the frame times look like {unit}; write microseconds" if unit else "put both on one clock",
            field="time_us" if last_us is not None else "video.start_time_us",
        )

    def _compare_pictures(self, times: FrameTimes, pictures: dict[int, Path]) -> None:
        listed, there = set(times.frame.tolist()), set(pictures)
        if not listed & there:
            raise FlightFolderError(
                self.path / "frames.csv",
                f"lists frames {times.frame[0]} to {times.frame[-1]}, but {self.video_path} holds "
                f"{min(there)} to {max(there)}",
                "number both alike",
                field="frame",
            )
        if listed - there:
            self.warn(f"{self.video_path}: {len(listed - there)} pictures that frames.csv lists are missing")
        if there - listed:
            self.warn(f"{self.path / 'frames.csv'}: {len(there - listed)} pictures have no time and are left out")


def _read_meta(folder: Path) -> FlightMeta:
    path = folder / "flight.json"
    if not path.is_file():
        raise FlightFolderError(path, "is missing", "a flight folder is described by this file")
    try:
        if path.stat().st_size > _MAX_JSON_BYTES:
            raise FlightFolderError(path, "is larger than 16 MB", "is this the right file?")
        data: Any = json.loads(path.read_bytes().decode("utf-8-sig"))
    except json.JSONDecodeError as error:
        raise FlightFolderError(
            path, f"is not JSON ({error.msg})", "correct it", field=f"line {error.lineno}, column {error.colno}"
        ) from error
    except (UnicodeDecodeError, RecursionError) as error:
        raise FlightFolderError(path, "is not JSON in UTF-8", "save it as UTF-8") from error
    except OSError as error:
        raise FlightFolderError(path, f"cannot be read ({error.strerror})", "check the file and its rights") from error
    if not isinstance(data, dict):
        raise FlightFolderError(path, "holds no JSON object", f'it must begin with {{"schema": "{SCHEMA}"')
    try:
        return FlightMeta.model_validate(data)
    except ValidationError as error:
        first = error.errors(include_url=False, include_context=False)[0]
        given = first["input"]
        shown = "" if isinstance(given, dict) else f" (it is {str(given)[:60]!r})"
        more = f"; {error.error_count() - 1} more fields are wrong" if error.error_count() > 1 else ""
        raise FlightFolderError(
            path,
            f"{first['msg'].removeprefix('Value error, ')}{shown}{more}",
            "correct it",
            field=".".join(str(part) for part in first["loc"]) or "schema",
        ) from error


__all__ = [
    "Click",
    "CsvAppender",
    "FlightFolder",
    "FlightFolderError",
    "FlightMeta",
    "FrameTimes",
    "TargetTruth",
    "TlogWriter",
    "Truth",
    "iter_tlog",
    "tlog_span",
    "write_clicks_csv",
    "write_flight_json",
    "write_frames_csv",
    "write_targets_truth_csv",
    "write_truth_csv",
]
