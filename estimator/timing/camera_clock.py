"""The clock offset while flying: samples and the camera's turns in, an estimate over a sliding window out."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator
from dataclasses import dataclass, field

import numpy as np

from estimator.geometry.camera import GIMBAL_FROM_CAMERA, Mount
from estimator.geometry.rotation import q_multiply
from estimator.history import AttitudeTrack
from estimator.timing.offset import (
    OffsetConfig,
    OffsetEstimate,
    PictureTurns,
    finished,
    offset_steps,
    unknown_offset,
)  # fmt: skip
from estimator.timing.turns import TurnTrack
from estimator.types import AttitudeSample, CameraAttitudeSample, Float, InertialSample


@dataclass(frozen=True, slots=True)
class CameraClockConfig:
    """``window_s`` is how long a turn counts: longer is surer, shorter follows a clock that drifts or jumps.

    ``sensor_delay_s`` is how much later than the motion a rate is stamped: half of 20 ms where a reading is the mean
    since the last, 11 ms behind the two-pole filter of 20 Hz that ArduPilot ships with. Below ``min_rate_hz`` the
    gyroscopes are left for the attitude; longer than ``max_gap_s`` nothing is interpolated.
    """

    offset: OffsetConfig = field(default_factory=OffsetConfig)
    window_s: float = 60.0
    sensor_delay_s: float = 0.010
    min_rate_hz: float = 18.0
    max_gap_s: float = 0.6


class CameraClock:
    """Finds the offset of one camera's video to its vehicle's telemetry. Not thread-safe: one owner calls it.

    ``gimbal`` is how the camera hangs (``fixed``, ``stabilised`` or ``pan_tilt``, design section 4): fixed cameras turn
    as the gyroscopes say, or the reported attitude where they are too slow; others as the gimbal reports, or else about
    the vertical with the vehicle.
    """

    def __init__(self, mount: Mount, gimbal: str, config: CameraClockConfig | None = None) -> None:
        self.config = config or CameraClockConfig()
        self._mount = mount
        self._is_fixed = gimbal == "fixed"
        self._rates = _Series(self.config, 3)
        self._attitudes = _Series(self.config, 7)
        self._camera_attitudes = _Series(self.config, 4)
        self._headings = AttitudeTrack()
        self._turns: deque[tuple[int, int, Float, Float]] = deque()
        self._estimate: OffsetEstimate | None = None

    def reset(self) -> None:
        """Forget the pictures, where the video's clock begins anew; the telemetry stays."""
        self._turns.clear()
        self._estimate = None

    def offer(self, sample: object) -> None:
        """Take a sample of the telemetry, in order of time; of no use is what does not turn, and is left."""
        match sample:
            case InertialSample():
                self._rates.add(sample.t_us, sample.rate_body_rad_s)
            case AttitudeSample():
                self._headings.add(sample.t_us, sample.q_ned_from_body)
                self._attitudes.add(sample.t_us, np.concatenate((sample.q_ned_from_body, sample.rate_body_rad_s)))
            case CameraAttitudeSample():
                self._add_camera_attitude(sample)
            case _:
                pass

    def add_turn(self, t_first_us: int, t_second_us: int, rotvec_camera_rad: Float, cov_rotvec_rad2: Float) -> None:
        """Take a turn (3,) seen between two pictures, covariance (3, 3); times are the frames' own, no offset added."""
        if self._turns and t_second_us <= self._turns[-1][1]:
            return
        self._turns.append((t_first_us, t_second_us, rotvec_camera_rad, cov_rotvec_rad2))
        while self._turns[0][0] < t_second_us - self.config.window_s * 1e6:
            self._turns.popleft()
        self._estimate = None

    def estimate(self) -> OffsetEstimate:
        """The offset by what the window holds; computed once for each new turn, tens of milliseconds."""
        if self._estimate is None:
            self._estimate = finished(self.steps())
        return self._estimate

    def _add_camera_attitude(self, sample: CameraAttitudeSample) -> None:
        q = sample.q_ned_from_gimbal
        if not sample.yaw_is_earth:
            body = self._headings.at(sample.t_us)
            if body is None:
                return
            q = q_multiply(_heading_alone(body), q)
        self._camera_attitudes.add(sample.t_us, q)

    def steps(self) -> Generator[None, None, OffsetEstimate]:
        """The estimate by what the window holds now, in steps of a few milliseconds; samples may come in between."""
        config = self.config.offset
        if len(self._turns) < config.min_pairs:
            return unknown_offset(config, len(self._turns), "too few pairs of pictures")
        origin_us = self._turns[0][0]
        first, second, rotvec, cov = zip(*self._turns, strict=True)
        turns = PictureTurns(
            (np.array(first) - origin_us) / 1e6, (np.array(second) - origin_us) / 1e6, np.array(rotvec), np.array(cov)
        )
        tracks, frame_from_camera = self._tracks(origin_us)
        if not tracks:
            return unknown_offset(config, len(turns), "no telemetry that turns with the camera")
        estimates = []
        for track in tracks:
            estimate = yield from offset_steps(turns, track, frame_from_camera, config)
            estimates.append(estimate)
        # rates that alias and attitudes that jitter both show in the residuals
        return min(estimates, key=_misfit)

    def _tracks(self, origin_us: int) -> tuple[list[TurnTrack], Float]:
        """How the camera's frame may have turned, in one or two ways, and its stated rotation from the camera."""
        delay_s, gap_s = self.config.sensor_delay_s, self.config.max_gap_s
        tracks: list[TurnTrack | None] = []
        frame_from_camera = self._mount.body_from_camera
        t_s, attitudes = self._attitudes.arrays(origin_us)
        if not self._is_fixed and len(self._camera_attitudes):
            t_camera_s, q = self._camera_attitudes.arrays(origin_us)
            tracks.append(TurnTrack.from_attitudes(t_camera_s, q, None, gap_s))
            frame_from_camera = GIMBAL_FROM_CAMERA
        elif not self._is_fixed:
            q = np.array([_heading_alone(q) for q in attitudes[:, :4]]).reshape(-1, 4)
            tracks.append(TurnTrack.from_attitudes(t_s, q, None, gap_s))
        elif self._rates.rate_hz >= self.config.min_rate_hz:
            t_rates_s, rates = self._rates.arrays(origin_us)
            tracks.append(TurnTrack.from_rates(t_rates_s - delay_s, rates, gap_s))
        else:
            q, rates = attitudes[:, :4], attitudes[:, 4:]
            has_rates = bool(np.any(rates))
            tracks.append(TurnTrack.from_attitudes(t_s, q, rates if has_rates else None, gap_s))
            if has_rates:
                tracks.append(TurnTrack.from_rates(t_s - delay_s, rates, gap_s))
        return [track for track in tracks if track is not None], frame_from_camera


class _Series:
    """Vectors over time, as long as the window and the search need them."""

    def __init__(self, config: CameraClockConfig, size: int) -> None:
        self._keep_us = int((config.window_s + 4.0 * config.offset.span_s) * 1e6)
        self._size = size
        self._t_us: deque[int] = deque()
        self._values: deque[Float] = deque()

    def __len__(self) -> int:
        return len(self._t_us)

    def add(self, t_us: int, value: Float) -> None:
        """Add the newest vector; one that is not newer is left out."""
        if self._t_us and t_us <= self._t_us[-1]:
            return
        self._t_us.append(t_us)
        self._values.append(value)
        while self._t_us[0] < t_us - self._keep_us:
            self._t_us.popleft()
            self._values.popleft()

    @property
    def rate_hz(self) -> float:
        """Mean rate of the series."""
        if len(self._t_us) < 2:
            return 0.0
        return (len(self._t_us) - 1) / ((self._t_us[-1] - self._t_us[0]) / 1e6)

    def arrays(self, origin_us: int) -> tuple[Float, Float]:
        """Seconds (n,) after an origin, and values (n, size)."""
        t_us = np.fromiter(self._t_us, dtype=np.int64, count=len(self._t_us))
        return (t_us - origin_us) / 1e6, np.array(self._values, dtype=np.float64).reshape(-1, self._size)


def _heading_alone(q_ned_from_body: Float) -> Float:
    """The attitude (4,) with roll and pitch taken out."""
    w, x, y, z = q_ned_from_body.tolist()
    half = 0.5 * np.arctan2(2.0 * (x * y + w * z), 1.0 - 2.0 * (y * y + z * z))
    return np.array([np.cos(half), 0.0, 0.0, np.sin(half)])


def _misfit(estimate: OffsetEstimate) -> float:
    residual = float(np.sum(estimate.residual_std_rad_s**2))
    return residual if np.isfinite(residual) else np.inf
