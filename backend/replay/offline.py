"""Offline replay of a flight folder: as fast as it goes, deterministic, through the same link and estimator as live."""

from __future__ import annotations

import json
import math
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Protocol

import numpy as np

from backend.errors import StationError
from backend.fleet.cameras import fitted
from backend.link.events import SampleEvent, TelemetryGps
from backend.link.tlog import LinkReplay, running_forward
from backend.navigation.setup import MapFiles, NavigationSetup, Place, build_setup, middle_of_map, profile_of_flight
from backend.recorder.alignments import AlignmentFeed
from backend.replay.hindsight import SMOOTHED_FILE, Hindsight, write_states
from backend.replay.landing import LANDING_FILE, LandingTrack, surveyed_place
from backend.replay.report import MAX_PICTURES, Flown, FlownStates, Places, ShownTarget, cutout, write_report
from backend.replay.targets import ClickPictures, LocatedTarget, locate_clicks, write_sightings, write_targets
from backend.video.recorded import RecordedFrame, RecordedVideo
from estimator.evaluate import Evaluation, evaluate
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import euler_from_q, wrap_pi
from estimator.history import Corrected
from estimator.navigator import Navigator, NavigatorConfig
from estimator.types import FixReport, Float, FrameSample, GnssSample, HomeSample, Image, NavigationState, Sample
from geodata.flight import FlightFolder
from geodata.flight_pad import pad_of_flight
from geodata.flight_write import CsvAppender

# a sample may be logged this long after the picture that it belongs with was taken
LOOKAHEAD_US = 250_000
STATE_INTERVAL_US = 100_000
FIX_COLUMNS = (
    "time_us", "kind", "accepted", "reason", "north_m", "east_m", "std_n_m", "std_e_m", "score", "outlier_probability",
    "heading_correction_deg", "scale_correction", "frame", "elapsed_ms",
)  # fmt: skip


class ReplayError(StationError):
    """A flight that cannot be replayed."""


class Alteration(Protocol):
    """What is changed between a recording and the estimator, to see what it makes of it."""

    def setup(self, setup: NavigationSetup) -> NavigationSetup:
        """Camera, mount and map as the estimator is told they are."""

    def sample(self, sample: Sample) -> Sample | None:
        """A sample as the estimator gets it, None where it does not."""


@dataclass(frozen=True, slots=True)
class ReplayOptions:
    """``leave_out`` names MAVLink messages that are taken out of the log; ``time_offset_s`` overrides the folder's.

    The offset is searched where neither says it, or where ``config`` asks for that. ``alignments`` are the operator's,
    which are measurements: without them it is as if nobody had helped.
    """

    leave_out: frozenset[int] = frozenset()
    time_offset_s: float | None = None
    config: NavigatorConfig = field(default_factory=NavigatorConfig)
    alteration: Alteration | None = None
    alignments: bool = True


@dataclass(frozen=True, slots=True, eq=False)
class ReplayResult:
    """What a replay found; ``evaluation`` is None without truth, ``corrected`` is for `estimator.smoothing`."""

    states: list[NavigationState]
    fixes: list[FixReport]
    evaluation: Evaluation | None
    report: dict[str, Any]
    corrected: list[Corrected] = field(default_factory=list)


def replay_flight(
    folder: FlightFolder, out: Path, progress: Callable[[float], None] | None = None,
    options: ReplayOptions | None = None,
) -> ReplayResult:  # fmt: skip
    """Run the estimator over a flight and write its tables (``docs/howto/record-and-replay.md``) and the report.

    Raises
    ------
    ReplayError
        The folder lacks what the estimator cannot do without.
    """
    options = options or ReplayOptions()
    started = time.perf_counter()
    setup = navigation_setup(folder)
    if options.alteration is not None:
        setup = options.alteration.setup(setup)
    run = _Run(folder, setup, options)
    run.go(progress)
    if not run.states:
        waiting = run.navigator.waiting_for or "anything to work on"
        raise ReplayError(f"{folder.path}: no estimate: the estimator was still waiting for {waiting} at the end")
    evaluation = evaluate_against_truth(folder, run.states)
    offset_us = run.navigator.exposure_us(run.time_offset_us)
    targets, sightings = locate_clicks(folder, setup, run.navigator_states, offset_us, run.clicked)
    elapsed_s = time.perf_counter() - started
    report = _report(folder, run, evaluation, elapsed_s)
    out.mkdir(parents=True, exist_ok=True)
    write_states(out / "estimate.csv", run.states)
    write_states(out / SMOOTHED_FILE, run.hindsight.states)
    run.landing.write(out / LANDING_FILE)
    _write_fixes(out / "fixes.csv", run.fixes)
    write_targets(out / "targets.csv", targets)
    write_sightings(out / "sightings.csv", sightings)
    report["targets"] = len(targets)
    (out / "report.json").write_text(json.dumps(report, indent=1, allow_nan=False, default=_plain) + "\n")
    write_report(out / "report.html", _flown(folder, run, targets, report))
    return ReplayResult(run.states, run.fixes, evaluation, report, run.navigator.corrected())


def navigation_setup(folder: FlightFolder) -> NavigationSetup:
    """Camera, map, ground and landing pad of a flight folder."""
    pad = pad_of_flight(folder)
    place = _place(folder)
    files = MapFiles(None, folder.reference_path, folder.elevation_path, None)
    setup = build_setup(profile_of_flight(folder.meta), files, place)
    if pad is None:
        return setup
    return replace(setup, pad=pad.pad, pad_at=surveyed_place(pad, setup.frame))


def _place(folder: FlightFolder) -> Place:
    home = folder.meta.home
    if home is not None:
        return Place(math.radians(home.lat_deg), math.radians(home.lon_deg), home.alt_amsl_m)
    for sample in _samples(folder, frozenset()):
        if isinstance(sample, HomeSample | GnssSample):
            return Place(sample.lat_rad, sample.lon_rad, sample.alt_amsl_m)
    if folder.reference_path is None:
        raise ReplayError(
            f"{folder.path}: neither a home in flight.json, nor a position in the telemetry, nor a map to search"
        )
    folder.warn(f"{folder.path}: no home in flight.json and no position in the telemetry: the map is searched")
    return middle_of_map(folder.reference_path, folder.elevation_path, folder.meta.map.ground_alt_amsl_m)


def _samples(
    folder: FlightFolder, leave_out: frozenset[int], show_gps: Callable[[TelemetryGps], None] = lambda _: None
) -> Iterator[Sample]:
    """The estimator's samples in the order of the log, with nothing from GPS inside the denied intervals.

    What the receiver said, denied or not, goes to ``show_gps``, for people to compare with.
    """
    link = LinkReplay()
    wanted = folder.meta.vehicle.system_id
    entries = running_forward(folder.telemetry(), lambda what: folder.warn(f"{folder.telemetry_path}: {what}"))
    for t_us, packet in entries:
        if leave_out and _message_id(packet) in leave_out:
            continue
        for event in link.feed(t_us, packet):
            if isinstance(event, TelemetryGps) and wanted in (None, event.system_id):
                show_gps(event)
            if not isinstance(event, SampleEvent) or (wanted is not None and event.system_id != wanted):
                continue
            if isinstance(event.sample, GnssSample) and (
                folder.is_gps_denied(t_us) or folder.is_gps_denied(event.sample.t_us)
            ):
                continue
            yield event.sample


def _message_id(packet: bytes) -> int:
    """Message id of a framed packet, -1 where it is too short to hold one."""
    if len(packet) >= 10 and packet[0] == 0xFD:
        return int.from_bytes(packet[7:10], "little")
    return packet[5] if len(packet) >= 6 else -1


class _Run:
    """One pass over a flight."""

    def __init__(self, folder: FlightFolder, setup: NavigationSetup, options: ReplayOptions) -> None:
        self.folder = folder
        offset_s = options.time_offset_s
        unknown = (offset_s is None and folder.time_offset_us is None) or options.config.find_video_offset
        self.navigator: Navigator = whole_flight_navigator(setup, replace(options.config, find_video_offset=unknown))
        self.time_offset_us = (folder.time_offset_us or 0) if offset_s is None else round(offset_s * 1e6)
        self.states: list[NavigationState] = []
        self.navigator_states = self.navigator.state_at
        self.fixes: list[FixReport] = []
        self.hindsight = Hindsight(setup, self.navigator.config.noise)
        self.clicked = ClickPictures(folder.clicks())
        self.landing = LandingTrack()
        self.frames = 0
        self.frames_untimed = 0
        self.frames_misshapen = 0
        self.decode_s = 0.0
        self._setup = setup
        self._alter = options.alteration.sample if options.alteration is not None else _unaltered
        self._alignments = AlignmentFeed(folder, setup.frame, self._exposure_us) if options.alignments else None
        self.gps: list[tuple[float, float, float, float]] = []
        self._samples = _samples(folder, options.leave_out, self._show_gps)
        self._next: Sample | None = next(self._samples, None)

    def go(self, progress: Callable[[float], None] | None) -> None:
        first_us, last_us = self.folder.telemetry_span()
        told = -1.0
        for frame in self._timed_frames():
            self._offer_until(frame.t_us + LOOKAHEAD_US)
            if frame.image.size:
                self._offer(frame)
            self._advance(frame.t_us)
            done = min(max((frame.t_us - first_us) / max(last_us - first_us, 1), 0.0), 1.0)
            if progress is not None and done - told > 0.005:
                progress(done)
                told = done
        # telemetry goes on after the last picture
        while self._next is not None:
            t_us = self._next.t_us + STATE_INTERVAL_US
            self._offer_until(t_us)
            self._advance(t_us - STATE_INTERVAL_US)
        self.hindsight.finish(self.navigator.corrected())
        if progress is not None:
            progress(1.0)

    def _show_gps(self, said: TelemetryGps) -> None:
        newer = not self.gps or said.t_us > self.gps[-1][0]
        if newer and said.fix_type >= 3 and said.lat_rad is not None and said.lon_rad is not None:
            self.gps.append((said.t_us, said.lat_rad, said.lon_rad, said.alt_amsl_m or 0.0))

    def _offer_until(self, t_us: int) -> None:
        while self._next is not None and self._next.t_us <= t_us:
            self._offer(self._next)
            self._next = next(self._samples, None)
        for told in [] if self._alignments is None else self._alignments.until(t_us):
            self._offer(told)

    def _exposure_us(self, t_video_us: int) -> int:
        return self.navigator.exposure_us(t_video_us + self.time_offset_us)

    def _offer(self, sample: Sample) -> None:
        altered = self._alter(sample)
        if altered is not None:
            self.navigator.offer(altered)

    def _advance(self, t_us: int) -> None:
        self.fixes += self.navigator.advance(t_us)
        self.hindsight.note(t_us, self.navigator.corrected)
        state = self.navigator.state
        if state is not None:
            self.landing.note(state)
        if state is None or (self.states and state.t_us - self.states[-1].t_us < STATE_INTERVAL_US):
            return
        self.states.append(state)

    def _timed_frames(self) -> Iterator[FrameSample]:
        """Pictures with their exposure times; gaps in the video are bridged by empty pictures that only pass time."""
        path = self.folder.video_path
        if path is None or not self._setup.has_camera:
            return
        last_us: int | None = None
        frames = RecordedVideo.open(path).frames()
        while True:
            started = time.perf_counter()
            frame: RecordedFrame | None = next(frames, None)
            self.decode_s += time.perf_counter() - started
            if frame is None:
                return
            pts_s = None if math.isnan(frame.pts_s) else frame.pts_s
            t_us = self.folder.frame_time_us(frame.index, pts_s)
            if t_us is None:
                self.frames_untimed += 1
                continue
            image = self._at_size(frame)
            if image is None:
                continue
            self.clicked.offer(t_us, image)
            t_us += self.time_offset_us
            if last_us is None:
                last_us = min(t_us, self._next.t_us if self._next is not None else t_us)
            while t_us - last_us > 2 * STATE_INTERVAL_US:
                last_us += STATE_INTERVAL_US
                yield FrameSample(last_us, -1, np.empty((0, 0), dtype=np.uint8))
            last_us = max(last_us, t_us)
            self.frames += 1
            yield FrameSample(t_us, frame.index, image)

    def _at_size(self, frame: RecordedFrame) -> Image | None:
        """The picture at the camera's size, as live; None where its shape contradicts the camera in mid-flight."""
        camera, meta = self._setup.camera, self.folder.camera
        if not self.frames and frame.image.shape[:2] != (camera.height_px, camera.width_px):
            rows, cols = frame.image.shape[:2]
            raise ReplayError(
                f"{self.folder.path}: the video's pictures are {cols} x {rows} px but camera in flight.json says "
                f"{camera.width_px} x {camera.height_px} px; give the camera of this video"
            )
        image, problem = fitted(frame.image, meta)
        if problem is not None:
            if not self.frames_misshapen:
                self.folder.warn(f"{self.folder.path}: from picture {frame.index} on {problem}")
            self.frames_misshapen += 1
        return image


def _unaltered(sample: Sample) -> Sample | None:
    return sample


def whole_flight_navigator(setup: NavigationSetup, config: NavigatorConfig) -> Navigator:
    """A Navigator of the setup with a configuration of its own; history long enough for a whole flight."""
    return setup.navigator(replace(config, history_s=1e6))


@dataclass(frozen=True, slots=True, eq=False)
class TruthErrors:
    """States against truth at times (n,): error NED (n, 3), covariance north/east (n, 2, 2), true position (n, 3).

    Positions are in the local frame of the first truth. ``heading_error_rad`` (n,) is within half a turn, NaN where the
    truth has no heading; ``spans_us`` are the times that count.
    """

    t_us: Float
    error_ned_m: Float
    cov_ne_m2: Float
    true_ned_m: Float
    heading_error_rad: Float
    spans_us: list[tuple[int, int]]


def errors_against_truth(folder: FlightFolder, states: list[NavigationState]) -> TruthErrors | None:
    """Errors of the states, to count inside the denied intervals or else everywhere; None without truth."""
    truth = folder.truth()
    if truth is None or len(truth.t_unix_us) < 2:
        return None
    inside = [s for s in states if truth.t_unix_us[0] <= s.t_us <= truth.t_unix_us[-1]]
    if not inside:
        return None
    from_truth = LocalFrame(float(truth.lat_rad[0]), float(truth.lon_rad[0]), float(truth.alt_amsl_m[0]))
    t_us = np.array([s.t_us for s in inside], dtype=np.float64)
    true_ned = from_truth.ned_from_geodetic(truth.lat_rad, truth.lon_rad, truth.alt_amsl_m)
    here = from_truth.ned_from_geodetic(*(np.array([getattr(s, n) for s in inside]) for n in _GEODETIC))
    at: Float = np.stack([np.interp(t_us, truth.t_unix_us, true_ned[:, axis]) for axis in range(3)], axis=-1)
    cov = np.array([s.cov_pos_ned_m2[:2, :2] for s in inside])
    spans = [(max(a, int(truth.t_unix_us[0])), min(b, int(truth.t_unix_us[-1]))) for a, b in folder.meta.gps_denied]
    spans = [span for span in spans if span[0] < span[1]]
    # by its sine and cosine: north is no jump, and a gap in the truth stays a gap
    yaw = np.arctan2(*(np.interp(t_us, truth.t_unix_us, part(truth.yaw_rad)) for part in (np.sin, np.cos)))
    turned: Float = wrap_pi(np.array([euler_from_q(s.q_ned_from_body)[2] for s in inside]) - yaw)
    return TruthErrors(t_us, here - at, cov, at, turned, spans or [(int(t_us[0]), int(t_us[-1]))])


def evaluate_against_truth(folder: FlightFolder, states: list[NavigationState]) -> Evaluation | None:
    """Errors of states inside the denied intervals, or of all where nothing was denied; None without truth."""
    errors = errors_against_truth(folder, states)
    if errors is None:
        return None
    return evaluate(errors.t_us, errors.error_ned_m, errors.cov_ne_m2, errors.spans_us)


_GEODETIC = ("lat_rad", "lon_rad", "alt_amsl_m")


def _report(folder: FlightFolder, run: _Run, evaluation: Evaluation | None, elapsed_s: float) -> dict[str, Any]:
    span_s = (run.states[-1].t_us - run.states[0].t_us) / 1e6
    accepted = sum(report.accepted for report in run.fixes)
    modes = [str(state.mode) for state in run.states]
    return {
        "flight": folder.name,
        "estimator": {
            "process_models": sorted({s.process_model for s in run.states}),
            "calibration": run.navigator.config.matcher.calibrated().version,
        },
        "errors": None if evaluation is None else evaluation.as_dict(),
        "frames": {"used": run.frames, "without_time": run.frames_untimed, "of_another_shape": run.frames_misshapen},
        "fixes": {"attempted": len(run.fixes), "accepted": accepted, "refused": _reasons(run.fixes)},
        "samples": run.navigator.counts,
        "innovations": {
            what: {"numbers": tally.numbers, "nis_per_dof": tally.nis_per_dof}
            for what, tally in sorted(run.navigator.innovations.items())
        },
        "video_clock": _video_clock(run.navigator),
        "modes": {mode: modes.count(mode) / len(modes) for mode in sorted(set(modes))},
        "landing": {"modes": run.landing.modes()} if run.landing.rows else None,
        "timing": {
            "elapsed_s": elapsed_s,
            "flight_s": span_s,
            "times_real_time": span_s / elapsed_s if elapsed_s > 0 else 0.0,
            "stages_s": {**run.navigator.stage_seconds, "decode": run.decode_s},
        },
        "warnings": list(folder.warnings),
    }


def _flown(folder: FlightFolder, run: _Run, targets: Sequence[LocatedTarget], report: dict[str, Any]) -> Flown:
    """What the page shows of a pass."""
    gps = np.array(run.gps, dtype=np.float64).reshape(-1, 4)
    pictures: dict[str, tuple[int, bytes]] = {}
    for click in folder.clicks():
        picture = run.clicked.at(click.t_video_us)
        if picture is not None and click.target not in pictures and len(pictures) < MAX_PICTURES:
            pictures[click.target] = click.t_video_us, cutout(picture, click.u_px, click.v_px)
    shown = [
        ShownTarget(
            found.target, found.lat_deg, found.lon_deg, found.ce90_m, found.method,
            *pictures.get(found.target, (None, None)),
        )
        for found in targets
    ]  # fmt: skip
    accepted, refused = (np.array([f.t_us for f in run.fixes if f.accepted is wanted]) for wanted in (True, False))
    return Flown(
        folder, FlownStates.of(run.states), Places(gps[:, 0].astype(np.int64), *gps[:, 1:].T), (accepted, refused),
        shown, report,
    )  # fmt: skip


def _video_clock(navigator: Navigator) -> dict[str, Any] | None:
    """What was found of the video's clock and the camera's misalignment; None where the offset was given."""
    clock = navigator.video_clock
    if clock is None:
        return None
    found = clock.estimate
    if found is None or not found.observable:
        return {"observable": False, "reason": found.reason if found else "no video", "time_offset_s": None}
    std_deg = np.degrees(np.sqrt(np.diag(found.cov_boresight_rad2)))
    return {
        "observable": True,
        "time_offset_s": round(clock.offset_us / 1e6, 4),
        "std_s": round(found.std_s, 4),
        "boresight_deg": np.degrees(found.boresight_rad).round(3).tolist(),
        "boresight_std_deg": std_deg.round(3).tolist(),
    }


def _reasons(fixes: list[FixReport]) -> dict[str, int]:
    counts: dict[str, int] = {}
    for report in fixes:
        if not report.accepted:
            key = report.reason.split(" (")[0]
            counts[key] = counts.get(key, 0) + 1
    return counts


def _plain(value: Any) -> Any:
    if isinstance(value, np.generic):
        return value.item()
    raise TypeError(f"{type(value).__name__} does not belong in a report")


def _write_fixes(path: Path, fixes: list[FixReport]) -> None:
    path.unlink(missing_ok=True)
    with CsvAppender(path, FIX_COLUMNS) as table:
        for fix in fixes:
            std = np.sqrt(np.diag(fix.cov_ne_m2))
            table.write(
                fix.t_us, fix.kind, int(fix.accepted), fix.reason, f"{fix.north_m:.3f}", f"{fix.east_m:.3f}",
                f"{std[0]:.3f}", f"{std[1]:.3f}", f"{fix.score:.4f}", f"{fix.outlier_probability:.4f}",
                f"{math.degrees(fix.heading_correction_rad):.4f}", f"{fix.scale_correction:.5f}", fix.frame_id,
                f"{fix.elapsed_ms:.2f}",
            )  # fmt: skip
