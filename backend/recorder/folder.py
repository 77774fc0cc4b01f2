"""A flight folder that grows: whatever moment the process dies, what was written opens as a flight."""

from __future__ import annotations

import os
import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from backend.recorder.alignments import ALIGNMENT_COLUMNS, ALIGNMENTS_FILE, AlignmentRow
from backend.recorder.estimate import ESTIMATE_COLUMNS, estimate_cells
from backend.recorder.followed import FOLLOWED_COLUMNS, FollowedRow
from backend.video.frames import EncodedFrame
from backend.video.writer import TsWriter
from estimator.types import NavigationState, OffsetSource
from geodata.flight import CsvAppender, TlogWriter, write_flight_json
from geodata.flight_meta import CameraMeta, FlightMeta, HomeMeta, MapMeta, VehicleMeta, VideoMeta
from geodata.flight_tables import CLICK_COLUMNS, FRAME_COLUMNS, POINTING_COLUMNS

VIDEO_FILE = "video.ts"
PICTURE_FOLDER = "frames"
ESTIMATE_STEP_US = 90_000


@dataclass(frozen=True, slots=True)
class RecordingPlan:
    """What is known when a recording starts; ``time_offset_s`` is to be added to frame times, None while unknown.

    ``pad`` is the description of the landing pad that is looked for, if any.
    """

    vehicle: VehicleMeta
    camera: CameraMeta | None
    home: HomeMeta | None
    reference: Path | None
    elevation: Path | None
    map_offset_ne_m: tuple[float, float]
    ground_alt_amsl_m: float | None
    gps_denied: bool
    t_start_us: int
    time_offset_s: float | None = 0.0
    pad: dict[str, Any] | None = None


@dataclass(frozen=True, slots=True)
class ClickRow:
    """One line of ``clicks.csv``: frame time, pixel of the recorded video, the target's id, and where it stands."""

    t_us: int
    u_px: float
    v_px: float
    target: str
    height_above_ground_m: float = 0.0
    ground: str = "terrain"


class FlightWriter:
    """Writes one flight folder. One thread at a time; OSError where the disk does not take it.

    Everything but the video is with the operating system when a call returns, so that a killed process loses none of
    it; the video follows at the next `flush`.
    """

    def __init__(self, folder: Path, plan: RecordingPlan, name: str) -> None:
        self.folder = folder
        self._denied: list[tuple[int, int]] = []
        self._denied_since_us = plan.t_start_us if plan.gps_denied else None
        self._last_us = plan.t_start_us
        self._last_state_us = 0
        self._frames: CsvAppender | None = None
        self._frame_count = 0
        self._last_frame_us: int | None = None
        self._video: TsWriter | None = None
        self._picture_codec = False
        self._small_bytes = 0
        self._time_offset_s = plan.time_offset_s
        self._told_offset_s = plan.time_offset_s
        self._meta = FlightMeta(
            schema="pilotage.flight/1",
            name=name,
            vehicle=plan.vehicle,
            camera=plan.camera,
            home=plan.home,
            map=MapMeta(
                reference=_bring(plan.reference, folder / "reference.tif"),
                elevation=_bring(plan.elevation, folder / "elevation.tif"),
                offset_ne_m=plan.map_offset_ne_m,
                ground_alt_amsl_m=plan.ground_alt_amsl_m,
            ),
            pad=plan.pad,
        )
        write_flight_json(folder, self._meta)
        self._tlog = TlogWriter(folder / "telemetry.tlog")
        self._estimate = CsvAppender(folder / "estimate.csv", ESTIMATE_COLUMNS)
        self._clicks = CsvAppender(folder / "clicks.csv", (*CLICK_COLUMNS, *POINTING_COLUMNS))
        self._followed: CsvAppender | None = None
        self._alignments: CsvAppender | None = None

    @property
    def bytes_written(self) -> int:
        """Size of telemetry, tables and video so far."""
        return self._small_bytes

    def packet(self, t_unix_us: int, data: bytes) -> None:
        """Append a packet as received."""
        self._tlog.write(t_unix_us, data)
        self._small_bytes += 8 + len(data)
        self._last_us = max(self._last_us, t_unix_us)

    def frame(self, frame: EncodedFrame) -> None:
        """Append a frame; the first must be a key frame, others before it are left out.

        A frame is listed with its time only where that is after those before it: when a smaller delay of the video
        shows that the first frames were earlier than thought, the next ones lie before them; so do bidirectional
        frames, which come in the order of decoding. The video keeps them all.
        """
        if self._frames is None:
            if not frame.key:
                return
            self._begin_video(frame)
        if (frame.codec == "jpeg") != self._picture_codec or self._frames is None:
            return  # another codec in mid-flight: one folder holds one kind of video
        if self._picture_codec:
            target = self.folder / PICTURE_FOLDER / f"{self._frame_count:06d}.jpg"
            target.write_bytes(frame.payload)
        elif self._video is not None:
            self._video.write(frame)
        if self._last_frame_us is None or frame.t_us > self._last_frame_us:
            self._frames.write(self._frame_count, frame.t_us)
            self._last_frame_us = frame.t_us
        self._frame_count += 1
        self._small_bytes += len(frame.payload) + 24
        self._last_us = max(self._last_us, frame.t_us)

    def state(self, state: NavigationState) -> None:
        """Append a line of ``estimate.csv``, at most ten a second."""
        if state.t_us - self._last_state_us < ESTIMATE_STEP_US:
            return
        if state.video_offset is not None and state.video_offset.source is OffsetSource.FOUND:
            self._time_offset_s = state.video_offset.offset_s
        self._last_state_us = state.t_us
        self._estimate.write(*estimate_cells(state))
        self._small_bytes += 480

    def click(self, row: ClickRow) -> None:
        """Append a line of ``clicks.csv``."""
        self._clicks.write(
            row.t_us, round(row.u_px, 3), round(row.v_px, 3), row.target, row.height_above_ground_m, row.ground
        )

    def followed(self, row: FollowedRow) -> None:
        """Append a line of ``followed.csv``, which a flight without followed targets does not have."""
        if self._followed is None:
            self._followed = CsvAppender(self.folder / "followed.csv", FOLLOWED_COLUMNS)
        self._followed.write(*row.cells())

    def alignment(self, row: AlignmentRow) -> None:
        """Append a line of ``alignments.csv``, which a flight that nobody aligned does not have."""
        if self._alignments is None:
            self._alignments = CsvAppender(self.folder / ALIGNMENTS_FILE, ALIGNMENT_COLUMNS)
        self._alignments.write(*row.cells())

    def gps_denied(self, t_unix_us: int, denied: bool) -> None:
        """Note from when to when GPS was kept from the estimator."""
        if denied and self._denied_since_us is None:
            self._denied_since_us = t_unix_us
        elif not denied and self._denied_since_us is not None:
            if t_unix_us > self._denied_since_us:
                self._denied.append((self._denied_since_us, t_unix_us))
            self._denied_since_us = None
        self._write_meta()

    def flush(self) -> None:
        """Hand everything to the operating system, and GPS denial that still lasts into ``flight.json``."""
        if self._video is not None:
            self._video.flush()
        if self._denied_since_us is not None or self._time_offset_s != self._told_offset_s:
            self._write_meta()

    def close(self) -> None:
        """Write everything out and close all files."""
        closing = [
            self._write_meta,
            self._tlog.close,
            self._estimate.close,
            self._clicks.close,
        ]
        closing += [table.close for table in (self._followed, self._alignments, self._frames) if table is not None]
        if self._video is not None:
            closing.append(self._video.close)
        for close in closing:
            close()

    def _begin_video(self, frame: EncodedFrame) -> None:
        self._picture_codec = frame.codec == "jpeg"
        if self._picture_codec:
            (self.folder / PICTURE_FOLDER).mkdir(exist_ok=True)
        else:
            self._video = TsWriter(self.folder / VIDEO_FILE)
        self._frames = CsvAppender(self.folder / "frames.csv", FRAME_COLUMNS)
        if frame.stamped:
            self._time_offset_s = 0.0
        video = VideoMeta(file=PICTURE_FOLDER if self._picture_codec else None, start_time_us=frame.t_us)
        self._meta = self._meta.model_copy(update={"video": video})
        self._write_meta()

    def _write_meta(self) -> None:
        intervals = list(self._denied)
        if self._denied_since_us is not None and self._last_us > self._denied_since_us:
            intervals.append((self._denied_since_us, self._last_us))
        self._told_offset_s = self._time_offset_s
        video = self._meta.video.model_copy(update={"time_offset_s": self._time_offset_s})
        meta = self._meta.model_copy(update={"gps_denied": tuple(intervals), "video": video})
        if self._video is not None and (self.folder / VIDEO_FILE).exists():
            # Named only once it is there: a folder that names a missing file is broken.
            meta = meta.model_copy(update={"video": meta.video.model_copy(update={"file": VIDEO_FILE})})
        write_flight_json(self.folder, meta)


def _bring(source: Path | None, target: Path) -> str | None:
    """Link a file into the folder, or copy it where the two lie on different disks; returns its name there."""
    if source is None:
        return None
    try:
        os.link(source, target)
    except OSError:
        shutil.copy2(source, target)
    return target.name
