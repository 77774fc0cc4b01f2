"""The navigator: samples in, state out.

It runs at a delayed horizon: samples wait, sorted by time, until ``advance`` says how far to go, so that a picture that
arrives late is fused at the time it was taken. ``predict`` carries the state on from there to now.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from contextlib import AbstractContextManager, nullcontext
from dataclasses import replace
from functools import partial

import numpy as np

from estimator.ahead import Ahead
from estimator.filters.eskf import ErrorStateFilter, InnovationTally
from estimator.filters.initialise import FirstEstimate, InitialConditions, aligned
from estimator.filters.nominal import PAD_GROUPS, Layout
from estimator.filters.strapdown import EarthModel, Motion
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec, q_multiply, q_normalise
from estimator.history import AttitudeTrack, InertialTrack, SampleQueue, SampleRate, StateHistory
from estimator.integrity.picture import grey
from estimator.landing.pad import Pad
from estimator.measurements import barometer, gnss, heading, operator_fix
from estimator.measurements.camera_attitude import CameraAttitude, CameraAttitudeModel, Gimbal
from estimator.measurements.global_fix import FoundPose, GlobalFixer
from estimator.measurements.innovation import Innovation
from estimator.measurements.map_fix import MapFixer
from estimator.measurements.pad_tracking import PadTracker, SurveyedPlace
from estimator.measurements.picture_to_picture import VisualOdometry
from estimator.measurements.self_watch import SelfWatch
from estimator.measurements.video_clock import VideoClock, offset_of
from estimator.navigator_config import GROUPS, NavigatorConfig
from estimator.ports import GroundModel, ReferenceMap
from estimator.registration.alignment import Registrar
from estimator.snapshot import Given, carried_on, horizontal_std_m, snapshot
from estimator.types import (
    AlignmentSample,
    AttitudeSample,
    BarometerSample,
    CameraAttitudeSample,
    FixReport,
    Float,
    FrameSample,
    GnssSample,
    Image,
    InertialSample,
    Mode,
    NavigationState,
    Sample,
    VideoOffset,
)  # fmt: skip

Outlook = Callable[[int, Sequence[Sample]], NavigationState | None]
__all__ = ["GROUPS", "Navigator", "NavigatorConfig", "Outlook"]


class Navigator:
    """Fuses the samples of one vehicle. Not thread-safe: one owner calls it.

    ``corrected`` gives any thread the past, for `estimator.smoothing`. ``while_busy`` is entered with an `Outlook` for
    as long as a picture is worked on, tens of milliseconds. With a ``pad`` that is sought in every picture;
    ``pad_at`` says where it lies, if anybody knows.
    """

    def __init__(
        self, config: NavigatorConfig, camera: Camera, mount: Mount, gimbal: str, frame: LocalFrame,
        reference: ReferenceMap | None, ground: GroundModel, clock_s: Callable[[], float] = time.perf_counter,
        pad: Pad | None = None, pad_at: SurveyedPlace | None = None,
    ) -> None:  # fmt: skip
        self.config = config
        self.frame = frame
        self.camera = camera
        self.gps_denied = False
        self.while_busy: Callable[[Outlook], AbstractContextManager[None]] = lambda _: nullcontext()
        self._ground = ground
        self._camera_attitude = CameraAttitudeModel(mount, Gimbal(gimbal))
        self._queue = SampleQueue()
        self._attitudes = AttitudeTrack()
        self._history = StateHistory(config.history_s)
        self.corrected = self._history.corrected
        self._guess, self._noise = config.initial, config.noise
        if Gimbal(gimbal) is not Gimbal.FIXED:
            self._guess = replace(self._guess, boresight_std_rad=self._guess.gimbal_error_std_rad)
            self._noise = replace(self._noise, boresight_rad_rt_s=self._noise.gimbal_rad_rt_s)
        self._initial = InitialConditions(self._guess, frame)
        self._eskf: ErrorStateFilter | None = None
        self._earth = EarthModel.at(frame.lat_rad, frame.alt_m)
        self._odometry = VisualOdometry(camera, config.odometry)
        self._fixer: MapFixer | None = None
        self._search: GlobalFixer | None = None
        self._searching = False
        self._watch = SelfWatch(config.watch)
        self._pressure_alt_m: float | None = None
        self._turn = np.array([1.0, 0.0, 0.0, 0.0])  # takes the reported attitude to the true one, about the vertical
        if reference is not None:
            registrar = Registrar(camera, reference, ground, frame.alt_m, config.matcher)
            self._fixer = MapFixer(registrar, config.map_fix)
            if config.global_fix.enabled:
                self._search = GlobalFixer(camera, reference, ground, frame.alt_m, config.global_fix)
        self._pad = None if pad is None else PadTracker(camera, pad, config.pad, pad_at)
        self._groups = config.groups if pad is None else (*config.groups, *PAD_GROUPS)
        self._video_clock = VideoClock(camera, mount, gimbal, config.video_clock) if config.find_video_offset else None
        self._video_epoch: int | None = None
        self._video_stamped = False
        self._clock_s = clock_s
        self._t_us = 0
        self._inertial = InertialTrack(config.inertial_delay_s)
        self._inertial_rate = SampleRate()
        self._last_us = dict.fromkeys(("fix", "try", "gnss", "gnss_velocity", "barometer", "attitude"), -(10**15))
        self._counts: dict[str, int] = {}
        self.stage_seconds: dict[str, float] = {"odometry": 0.0, "registration": 0.0, "inertial": 0.0}

    @property
    def counts(self) -> dict[str, int]:
        """How many samples of each kind were fused, refused or late."""
        return {**self._counts, "late": self._queue.late}

    @property
    def innovations(self) -> dict[str, InnovationTally]:
        """How well the innovations of each measurement fitted since the filter was started."""
        return {} if self._eskf is None else self._eskf.innovations

    @property
    def state(self) -> NavigationState | None:
        """The state at the filter's horizon, None before alignment."""
        return None if self._eskf is None else self._snapshot(self._eskf, self._t_us)

    @property
    def waiting_for(self) -> str | None:
        """What alignment still lacks, or how the search for a lost position stands; None while the position is held."""
        searching = self._search.words if self._search is not None and self._searching else None
        if self._eskf is not None or searching is None:
            return searching if self._eskf is not None else self._initial.missing()
        return f"{self._initial.missing()}; {searching}"

    @property
    def video_clock(self) -> VideoClock | None:
        """What is known of the video's clock, None where its offset was given."""
        return self._video_clock

    def exposure_us(self, t_frame_us: int) -> int:
        """When a picture with this frame time, not stamped, was taken, as far as the video's clock is known."""
        return t_frame_us + (self._video_clock.offset_us if self._video_clock is not None else 0)

    @property
    def video_offset(self) -> VideoOffset:
        """What is added to frame times, and how well it is known."""
        return offset_of(self._video_clock, self._video_stamped)

    def offer(self, sample: Sample) -> None:
        """Take a sample; it is used when ``advance`` passes its time. One that comes too late is counted and left."""
        if isinstance(sample, FrameSample):
            self._video_stamped = sample.stamped
        if self._video_clock is not None:
            sample = self._on_one_clock(sample, self._video_clock)
        match sample:
            case AttitudeSample():
                self._attitudes.add(sample.t_us, sample.q_ned_from_body)
            case InertialSample():
                self._inertial.add(sample)
            case CameraAttitudeSample():
                self._camera_attitude.offer(sample)
                return
            case _:
                pass
        self._queue.push(sample)

    def _on_one_clock(self, sample: Sample, clock: VideoClock) -> Sample:
        if not isinstance(sample, FrameSample):
            clock.offer(sample)
            return sample
        if sample.stamped:
            return sample
        started = self._clock_s()
        if self._video_epoch not in (None, sample.epoch):
            clock.restart()
        self._video_epoch = sample.epoch
        down_camera = np.array([0.0, 0.0, 1.0])
        if self._eskf is not None:
            down_camera = self._camera_now(self._eskf)[0].ned_from_camera[2]
        clock.see(sample.t_us, grey(sample.image), down_camera)
        self.stage_seconds["video_clock"] = self.stage_seconds.get("video_clock", 0.0) + self._clock_s() - started
        return replace(sample, t_us=self.exposure_us(sample.t_us))

    def advance(self, t_us: int) -> list[FixReport]:
        """Process all samples up to ``t_us``; returns the attempts at fixes made on the way.

        Where the video's clock runs ahead of the telemetry's it stays so far behind ``t_us``.
        """
        if self._video_clock is not None:
            t_us -= self._video_clock.lag_us
        reports = []
        for sample in self._queue.take_until(t_us):
            report = self._handle(sample)
            if report is not None:
                reports.append(report)
        return reports

    def state_at(self, t_us: int) -> NavigationState | None:
        """The state at a past time, None outside the kept history."""
        return self._history.at(t_us)

    def predict(self, t_us: int) -> NavigationState | None:
        """The state carried on to ``t_us`` with the samples that still wait; None before alignment."""
        if self._eskf is None:
            return None
        if t_us <= self._t_us:
            return self._history.at(t_us) or self.state
        return self._carried_on(self._eskf.copied(), t_us, (), self._is_lost(self._eskf))

    def outlook(self) -> Outlook:
        """What is known now, for another thread to ask while this one is at work on a picture, and until it ends.

        It is asked for a time, with the samples that have come since, and answers as ``state_at`` and ``predict`` do.
        """
        eskf = None if self._eskf is None else self._eskf.copied()
        lost = self._eskf is not None and self._is_lost(self._eskf)

        def at(t_us: int, newer: Sequence[Sample]) -> NavigationState | None:
            known = self._history.at(t_us)
            if known is not None or eskf is None or t_us < self._t_us:
                return known
            return self._carried_on(eskf, t_us, newer, lost)

        return at

    def _carried_on(self, eskf: ErrorStateFilter, t_us: int, newer: Sequence[Sample], lost: bool) -> NavigationState:
        """The state at ``t_us``, ahead of the horizon, from a copy of the filter, which is changed."""
        nominal = eskf.nominal
        ahead = Ahead(nominal, self._t_us)
        if self._process_model() == "inertial":
            waiting = sorted((*self._queue.pending(), *newer), key=lambda sample: sample.t_us)
            for sample in waiting:
                if isinstance(sample, InertialSample) and ahead.t_us < sample.t_us <= t_us:
                    ahead = ahead.by_inertial(sample, sample.t_us, self._earth)
        eskf.nominal = ahead.coasting(t_us).nominal
        state = self._snapshot(eskf, t_us, lost)
        eskf.nominal = nominal
        return carried_on(state, (t_us - self._t_us) / 1e6)

    def _handle(self, sample: Sample) -> FixReport | None:
        if isinstance(sample, GnssSample) and self.gps_denied:
            return None
        if self._eskf is None:
            self._align(sample)
            return None
        if isinstance(sample, InertialSample):
            self._inertial_rate.note(sample.t_us)
        self._predict_to(sample.t_us)
        if isinstance(sample, FrameSample | GnssSample | AlignmentSample):
            self._history.expect(self._snapshot(self._eskf, sample.t_us))
        report = None
        match sample:
            case BarometerSample():
                self._fuse_barometer(sample)
            case GnssSample():
                self._fuse_gnss(sample)
            case AttitudeSample():
                self._fuse_attitude(sample)
            case FrameSample():
                with self.while_busy(self.outlook()):
                    report = self._fuse_frame(sample)
                    self._search_while_lost(sample)
            case AlignmentSample():
                report = operator_fix.fuse(self._eskf, sample, self._history)
                self._watch.place_was_given()
            case _:
                pass
        if report is not None and report.accepted:
            self._last_us["accepted"] = sample.t_us
        if isinstance(sample, FrameSample | AttitudeSample | GnssSample | AlignmentSample):
            self._history.add(self._snapshot(self._eskf, sample.t_us))
        return report

    def _align(self, sample: Sample) -> None:
        self._initial.offer(sample)
        if isinstance(sample, InertialSample):
            self._inertial_rate.note(sample.t_us)
        if isinstance(sample, BarometerSample):
            self._pressure_alt_m = sample.pressure_alt_m
        first = self._initial.ready(sample.t_us)
        if first is not None:
            self._start(first, sample.t_us)
        elif isinstance(sample, FrameSample) and self._initial.lacks_only_place(sample.t_us):
            with self.while_busy(self.outlook()):
                self._search_map(sample)

    def _start(self, first: FirstEstimate, t_us: int) -> None:
        layout = Layout.of(self._groups)
        nominal, P = aligned(first, layout, self._guess, self._noise)
        self._eskf = ErrorStateFilter(nominal, P, layout, self._earth, self._noise)
        self._watch.place_was_given()
        self._t_us = t_us
        self._searching = False

    def _search_map(self, sample: FrameSample) -> bool:
        """Look for the picture on the whole map; True when that has (re)started the filter."""
        reported = self._attitudes.at(sample.t_us)
        unclocked = self._video_clock is not None and not sample.stamped and not self._video_clock.settled
        if self._search is None or reported is None or self._pressure_alt_m is None or unclocked:
            return False
        if not self._searching:
            self._search.restart()
            self._searching = True
        started = self._clock_s()
        camera = self._camera_attitude.at(sample.t_us, reported, np.zeros(3), turned=False)
        found = self._search.offer(sample.t_us, grey(sample.image), camera.ned_from_camera, self._pressure_alt_m)
        self.stage_seconds["search"] = self.stage_seconds.get("search", 0.0) + self._clock_s() - started
        if found is not None:
            self._start_at(found, reported, self._pressure_alt_m)
        return found is not None

    def _start_at(self, found: FoundPose, reported: Float, pressure_alt_m: float) -> None:
        self._turn = q_from_rotvec(np.array([0.0, 0.0, found.turn_rad]))
        self._camera_attitude.turn_rad = found.turn_rad
        q = q_normalise(q_multiply(self._turn, reported))
        pos = found.pos_ned_m - matrix_from_q(q) @ self._camera_attitude.lever_arm_frd_m
        alt_m = self.frame.alt_m - float(pos[2])
        first = FirstEstimate(
            Motion(pos, found.vel_ned_m_s, q), found.pos_std_m, np.full(3, found.vel_std_m_s), pressure_alt_m - alt_m,
            float(found.pos_std_m[2]),
        )  # fmt: skip
        self._start(first, found.t_us)
        if self._fixer is not None:
            self._fixer = MapFixer(self._fixer.registrar, self.config.map_fix)
        self._odometry = VisualOdometry(self.camera, self.config.odometry)
        self._last_us["accepted"] = found.t_us

    def _reported_at(self, t_us: int) -> Float | None:
        """The reported attitude, its heading set right where a search has found it to be wrong."""
        reported = self._attitudes.at(t_us)
        return None if reported is None else q_multiply(self._turn, reported)

    def _process_model(self) -> str:
        """``inertial`` where gyroscopes and accelerometers arrive often enough, else ``attitude``."""
        rate_hz = self._inertial_rate.hz(self._t_us, self.config.inertial_timeout_s)
        often = self.config.use_inertial and rate_hz >= self.config.min_inertial_hz
        return "inertial" if often else "attitude"

    def _predict_to(self, t_us: int) -> None:
        eskf = self._eskf
        if eskf is None or t_us <= self._t_us:
            return
        started = self._clock_s()
        while self._t_us < t_us:
            step_us = min(t_us - self._t_us, 100_000)
            dt_s = step_us / 1e6
            reading = self._inertial.at(self._t_us + step_us // 2)
            if self._process_model() == "inertial" and reading is not None:
                eskf.predict_inertial(*reading, dt_s)
            else:
                before, reported = self._reported_at(self._t_us), self._reported_at(self._t_us + step_us)
                eskf.predict_by_reports(before, reported, dt_s)
            self._t_us += step_us
        self.stage_seconds["inertial"] += self._clock_s() - started

    def _due(self, what: str, t_us: int, interval_s: float) -> bool:
        if t_us - self._last_us[what] < interval_s * 1e6:
            return False
        self._last_us[what] = t_us
        return True

    def _apply(self, what: str, innovation: Innovation | None, gate_sigmas: float = 5.0) -> bool:
        if innovation is None or self._eskf is None:
            return False
        gate = gate_sigmas**2 * len(innovation.z)
        accepted, _ = self._eskf.update(innovation.z, innovation.H, innovation.R, gate, what, innovation.R_one)
        key = what if accepted else f"{what}_rejected"
        self._counts[key] = self._counts.get(key, 0) + 1
        return accepted

    def _fuse_barometer(self, sample: BarometerSample) -> None:
        self._pressure_alt_m = sample.pressure_alt_m
        if self._eskf is not None and self._due("barometer", sample.t_us, self.config.barometer_interval_s):
            std = self.config.barometer_std_m
            innovation = barometer.pressure_altitude(self._eskf, sample.pressure_alt_m, self.frame.alt_m, std)
            self._watch.pressure(sample.t_us, innovation, self._eskf)
            self._apply("barometer", innovation, gate_sigmas=8.0)

    def _fuse_gnss(self, sample: GnssSample) -> None:
        if self._eskf is None:
            return
        if self._due("gnss_velocity", sample.t_us, self.config.gnss_velocity_interval_s):
            reading = self._inertial.at(sample.t_us) if self._process_model() == "inertial" else None
            force = None if reading is None else reading[1]
            self._apply("gnss_velocity", gnss.velocity(self._eskf, sample.vel_ned_m_s, force), gate_sigmas=5.0)
        if not self._due("try", sample.t_us, self.config.gnss_interval_s):
            return
        pos = self.frame.ned_from_geodetic(sample.lat_rad, sample.lon_rad, sample.alt_amsl_m)
        std_ned_m, alike = self.config.gnss_noise(sample)
        if self._apply("gnss", gnss.position(self._eskf, pos, std_ned_m, alike), gate_sigmas=5.0):
            self._last_us["gnss"] = sample.t_us

    def _fuse_attitude(self, sample: AttitudeSample) -> None:
        if self._eskf is None or self._process_model() != "inertial":
            return
        if self._due("attitude", sample.t_us, self.config.reported_attitude_interval_s):
            std = self.config.reported_attitude_std_rad
            q = q_multiply(self._turn, sample.q_ned_from_body)
            self._apply("attitude", heading.reported_attitude(self._eskf, q, std), 6.0)

    def _camera_now(self, eskf: ErrorStateFilter) -> tuple[CameraAttitude, Float]:
        motion = eskf.nominal.motion
        camera = self._camera_attitude.at(self._t_us, motion.q_ned_from_body, eskf.nominal.boresight_rad)
        lever = matrix_from_q(motion.q_ned_from_body) @ self._camera_attitude.lever_arm_frd_m
        return camera, motion.pos_ned_m + lever

    def _down_at(self, north_m: Float, east_m: Float) -> Float:
        """Down coordinate of what is seen at points: the ground model as the filter has corrected it."""
        bias_m = self._eskf.nominal.ground_bias_m if self._eskf is not None else 0.0
        down: Float = self.frame.alt_m - self._ground.alt_amsl_m(north_m, east_m) + bias_m
        return down

    def _fuse_frame(self, sample: FrameSample) -> FixReport | None:
        eskf = self._eskf
        if eskf is None:
            return None
        if self._video_clock is not None and not sample.stamped:
            if not self._video_clock.settled:
                return None
            self._apply("boresight", self._video_clock.boresight(eskf), gate_sigmas=6.0)
        image = grey(sample.image)
        on_pad = self._fuse_pad(sample, image, eskf)
        if not self._watch.takes(image):
            return None
        if not (on_pad and self.config.pad.instead_of_odometry):
            started = self._clock_s()
            self._odometry.fuse(sample.t_us, image, eskf, self._camera_now, self._down_at, self._apply)
            self.stage_seconds["odometry"] += self._clock_s() - started
        wanted = not self._odometry.frozen and not (on_pad and self.config.pad.instead_of_map)
        if self._fixer is None or not wanted or not self._due("fix", sample.t_us, self.config.fix_interval_s):
            return None
        camera, camera_pos = self._camera_now(eskf)
        started = self._clock_s()
        ground_down = float(self._ground_down(camera_pos))
        fix = partial(self._fixer.attempt, replace(sample, image=image), eskf, camera, camera_pos, ground_down)
        report = self._watch.attempt(self._fixer, sample, eskf, self._has_satellites(sample.t_us), fix)
        self.stage_seconds["registration"] += self._clock_s() - started
        return report

    def _fuse_pad(self, sample: FrameSample, image: Image, eskf: ErrorStateFilter) -> bool:
        """Use a picture's landing pad; whether that is followed."""
        if self._pad is not None:
            started = self._clock_s()
            self._pad.fuse(sample.t_us, sample.frame_id, image, eskf, self._camera_now, self._apply)
            self.stage_seconds["pad"] = self.stage_seconds.get("pad", 0.0) + self._clock_s() - started
        return self._on_pad(sample.t_us)

    def _on_pad(self, t_us: int) -> bool:
        return self._pad is not None and self._pad.followed(t_us)

    def _search_while_lost(self, sample: FrameSample) -> None:
        eskf = self._eskf
        if eskf is None or self._search is None or not self.config.global_fix.after_loss:
            return
        if not self._on_pad(sample.t_us) and self._mode(eskf, sample.t_us, self._is_lost(eskf)) is Mode.LOST:
            self._search_map(sample)
        else:
            self._searching = False

    def _ground_down(self, pos_ned_m: Float) -> float:
        down = float(self._down_at(pos_ned_m[0:1], pos_ned_m[1:2])[0])
        return down if np.isfinite(down) else float("nan")

    def _is_lost(self, eskf: ErrorStateFilter) -> bool:
        uncertain = horizontal_std_m(eskf) > self.config.vision_std_m
        return uncertain and self._fixer is not None and self._fixer.lost_probability > 0.5

    def _mode(self, eskf: ErrorStateFilter, t_us: int, lost: bool) -> Mode:
        std = horizontal_std_m(eskf)
        if self._has_satellites(t_us):
            return Mode.GPS
        if std > self.config.lost_std_m or lost:
            return Mode.LOST
        seen = self._fix_age_s(t_us) <= self.config.vision_timeout_s or self._on_pad(min(t_us, self._t_us))
        return Mode.VISION if seen and std <= self.config.vision_std_m else Mode.DEAD_RECKONING

    def _has_satellites(self, t_us: int) -> bool:
        return t_us - self._last_us["gnss"] <= self.config.gnss_timeout_s * 1e6 and not self.gps_denied

    def _fix_age_s(self, t_us: int) -> float:
        accepted = self._last_us.get("accepted")
        return float("inf") if accepted is None else max(t_us - accepted, 0) / 1e6

    def _snapshot(self, eskf: ErrorStateFilter, t_us: int, lost: bool | None = None) -> NavigationState:
        lost = self._is_lost(eskf) if lost is None else lost
        q = eskf.nominal.motion.q_ned_from_body
        camera = self._camera_attitude.at(t_us, q, eskf.nominal.boresight_rad)
        given = Given(
            t_us, self._mode(eskf, t_us, lost), self._process_model(), self._fix_age_s(t_us), self.video_offset,
            self._watch.doubts(eskf, self._fixer),
            None if self._pad is None else self._pad.relative(eskf, t_us, min(t_us, self._t_us)),
        )  # fmt: skip
        lever = self._camera_attitude.lever_arm_frd_m
        return snapshot(eskf, given, self.frame, camera, lever, self._ground_down(eskf.nominal.motion.pos_ned_m))
