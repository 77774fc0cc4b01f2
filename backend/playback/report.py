"""The page of a flight of the shelf: what it holds, with the targets that the station keeps of it."""

from __future__ import annotations

import math
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from backend.errors import ConflictError
from backend.fleet.history import VehicleHistory
from backend.playback.estimate import EstimateTable
from backend.playback.history import fill_fixes
from backend.playback.recording import FlightRecording, read_recording
from backend.replay.report import MAX_PICTURES, Flown, FlownStates, Places, ShownTarget, cutout, report_page
from backend.store.targets import Target
from backend.uncertainty import circular_error_m
from backend.video.errors import VideoError
from geodata.flight_tables import Click


def page_of_flight(path: Path, table: EstimateTable, fixes: Path | None, targets: Sequence[Target]) -> str:
    """The page; reads the whole flight and takes seconds: not for the event loop.

    Raises
    ------
    ConflictError
        The flight has no estimate.
    FlightFolderError, VideoError
        It cannot be read.
    """
    if not len(table.t_us):
        raise ConflictError("the flight has no estimate to report on")
    recording = read_recording(path, lambda _: None)
    values = table.values
    at = Places(table.t_us, np.radians(values[:, 0]), np.radians(values[:, 1]), values[:, 2])
    states = FlownStates(at, values[:, 9:11], values[:, 6:9], [str(mode) for mode in table.modes])
    readings = [reading for reading in recording.gps if reading.has_fix]
    gps = Places(
        np.array([reading.t_us for reading in readings]),
        np.radians([reading.lat_deg or 0.0 for reading in readings]),
        np.radians([reading.lon_deg or 0.0 for reading in readings]),
        np.array([reading.alt_amsl_m or 0.0 for reading in readings]),
    )
    history = VehicleHistory()
    if fixes is not None and recording.setup is not None:
        fill_fixes(history, fixes, recording.setup)
    t_us, numbers = history.fixes.since(-1)
    accepted = numbers[:, history.fixes.columns.index("accepted")] == 1.0
    figures = {
        "flight": recording.folder.name,
        "duration_s": (recording.end_us - recording.start_us) / 1e6,
        "fixes": {"accepted": int(accepted.sum()), "refused": int((~accepted).sum())} if len(t_us) else "not recorded",
        "warnings": list(recording.folder.warnings),
    }
    shown = [_shown(recording, click, targets, n < MAX_PICTURES) for n, click in enumerate(recording.folder.clicks())]
    return report_page(Flown(recording.folder, states, gps, (t_us[accepted], t_us[~accepted]), shown, figures))


def _shown(recording: FlightRecording, click: Click, targets: Sequence[Target], pictured: bool) -> ShownTarget:
    """A recorded click as the station keeps it; one that is deleted has no coordinate any more."""
    kept = next((target for target in targets if _is_of(target, click)), None)
    jpeg = _picture(recording, click) if pictured else None
    if kept is None:
        return ShownTarget(click.target, None, None, None, "no longer kept", click.t_video_us, jpeg)
    ce90_m = None
    if kept.var_n_m2 is not None and kept.var_e_m2 is not None and kept.cov_ne_m2 is not None:
        cov = np.array([[kept.var_n_m2, kept.cov_ne_m2], [kept.cov_ne_m2, kept.var_e_m2]])
        ce90_m = float(circular_error_m(cov))
    return ShownTarget(kept.name, kept.lat_deg, kept.lon_deg, ce90_m, kept.method, click.t_video_us, jpeg)


def _is_of(target: Target, click: Click) -> bool:
    if target.u_px is None or target.v_px is None or target.t_unix_us is None:
        return False
    # The exposure lies beside the picture's time by what the clocks are apart.
    near = abs(target.t_unix_us - click.t_video_us) < 1_000_000
    return near and math.hypot(target.u_px - click.u_px, target.v_px - click.v_px) < 0.01


def _picture(recording: FlightRecording, click: Click) -> bytes | None:
    if recording.video is None or not recording.frame_index:
        return None
    # Clicks are by the video's clock, frames by that of the telemetry.
    t_us = click.t_video_us + (recording.folder.time_offset_us or 0)
    try:
        image = recording.video.frame(recording.frame_at(t_us + 1000)).image
    except VideoError:
        return None
    return cutout(image, click.u_px, click.v_px)
