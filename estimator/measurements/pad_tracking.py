"""Following a landing pad from picture to picture: where to look, what to make of what is found, and how it stands."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.geometry.camera import Camera
from estimator.integrity.picture import Repeats
from estimator.landing.detector import detect_circles
from estimator.landing.pad import CirclePad, Pad
from estimator.landing.pose import PadPose, TiltPrior
from estimator.landing.sighting import NoPad, PadSighting
from estimator.landing.tags import detect_tags
from estimator.measurements.camera_attitude import CameraAttitude, camera_rotation_jacobian
from estimator.measurements.innovation import Innovation
from estimator.measurements.pad_fix import PadNoise, by_states, foreseen, innovation, place
from estimator.robust import largest_std
from estimator.types import Float, Image, PadMode, PadRelative, PadSeen

KIND = "pad"
CameraNow = Callable[[ErrorStateFilter], tuple[CameraAttitude, Float]]
_ANYWHERE_M = 1000.0
_ANY_HEADING_RAD = 0.5
"""What a pad's place and heading are known to before its first picture is used: much less than the picture tells."""
_NO_AGE_S = float("inf")


@dataclass(frozen=True, slots=True)
class PadConfig:
    """How the pad is sought and followed.

    A pad lies level to ``level_std_rad``. Where it is foreseen to ``foreseen_px`` and its distance to
    ``foreseen_share`` it is sought there first; while it is not followed, every ``search_interval_s``. It is followed
    until ``tracking_s`` after the last picture of it that was used, then carried on while sigma is within
    ``landing_std_m``. Sightings refused for ``moved_after_s`` on end mean that it lies elsewhere. The tilt handed to
    the detector is never surer than ``least_tilt_rad``. ``frozen_difference`` is the mean grey change below which a
    picture repeats the last. With ``instead_of_map`` no picture in which the pad is followed is laid on the map, and
    with ``instead_of_odometry`` none is compared with the one before.
    """

    noise: PadNoise = field(default_factory=PadNoise)
    level_std_rad: float = 0.05
    foreseen_px: float = 5.0
    foreseen_share: float = 0.04
    search_interval_s: float = 0.1
    tracking_s: float = 0.3
    behind_s: float = 0.8
    landing_std_m: float = 0.3
    moved_after_s: float = 1.0
    least_tilt_rad: float = 0.003
    frozen_difference: float = 0.02
    gate_sigmas: float = 5.0
    instead_of_map: bool = True
    instead_of_odometry: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class SurveyedPlace:
    """Where a pad's centre is known to lie (3,) NED, to ``std_m``."""

    pos_ned_m: Float
    std_m: float


@dataclass(frozen=True, slots=True, eq=False)
class _Status:
    """How the search stands; replaced as a whole, so that other threads read what belongs together."""

    used_us: int | None = None
    tried_us: int | None = None
    refused_since_us: int | None = None
    reason: str = "no picture yet"
    seen: PadSeen | None = None


class PadTracker:
    """Finds one described pad in pictures and keeps it in the filter. Not thread-safe but for ``relative``."""

    def __init__(
        self, camera: Camera, pad: Pad, config: PadConfig | None = None, surveyed: SurveyedPlace | None = None
    ) -> None:  # fmt: skip
        self.config = config or PadConfig()
        self._camera = camera
        self._pad = pad
        self._surveyed = surveyed
        self._repeats = Repeats(self.config.frozen_difference)
        self._status = _Status()

    def followed(self, t_us: int) -> bool:
        """Whether a picture has shown it just now."""
        used_us = self._status.used_us
        return used_us is not None and t_us - used_us <= self.config.tracking_s * 1e6

    def fuse(
        self, t_us: int, frame_id: int, image: Image, eskf: ErrorStateFilter, camera_now: CameraNow,
        apply: Callable[[str, Innovation | None, float], bool],
    ) -> bool:  # fmt: skip
        """Use a grey picture on the filter; whether it was used.

        ``camera_now`` gives the camera's attitude and position by the filter as it stands, ``apply`` fuses an
        innovation under a name with a gate in sigmas and says whether it was accepted.
        """
        rows, cols = image.shape
        if (cols, rows) != (self._camera.width_px, self._camera.height_px):
            size = f"{self._camera.width_px} x {self._camera.height_px}"
            self._status = replace(
                self._status, reason=f"the picture is {cols} x {rows} px, the camera's are {size} px"
            )
            return False
        if self._repeats.last(image):
            self._status = replace(self._status, reason="the picture repeats the last one")
            return False
        if not self._due(t_us):
            return False
        camera, camera_pos = camera_now(eskf)
        found = self._sought(image, *self._where(eskf, camera, camera_pos))
        self._status = replace(self._status, tried_us=t_us)
        if isinstance(found, NoPad):
            self._status = replace(self._status, reason=found.reason, refused_since_us=None)
            return False
        since_us = self._status.refused_since_us
        moved = since_us is not None and t_us - since_us > self.config.moved_after_s * 1e6
        first = eskf.nominal.pad is None or moved
        if first:
            self._begin(found, eskf, camera, camera_pos)
        used_us = self._status.used_us
        since_s = _NO_AGE_S if first or used_us is None else (t_us - used_us) / 1e6
        told = innovation(eskf, found.solutions, camera, camera_pos, self.config.noise, since_s)
        if not apply(KIND, told, self.config.gate_sigmas):
            self._refuse(t_us)
            return False
        if first:
            apply("pad_survey", self._by_survey(eskf), self.config.gate_sigmas)
        best = found.best.pose
        seen = PadSeen(t_us, frame_id, best.camera_from_pad, best.pad_in_camera_m, found.triple, found.seen_share)
        self._status = _Status(used_us=t_us, tried_us=t_us, reason="", seen=seen)
        return True

    def _due(self, t_us: int) -> bool:
        tried_us = self._status.tried_us
        return self.followed(t_us) or tried_us is None or t_us - tried_us >= self.config.search_interval_s * 1e6

    def _refuse(self, t_us: int) -> None:
        since_us = self._status.refused_since_us
        self._status = replace(
            self._status, reason="it is not where the estimate has it",
            refused_since_us=t_us if since_us is None else since_us,
        )  # fmt: skip

    def _sought(self, image: Image, prior: TiltPrior, expected: PadPose | None) -> PadSighting | NoPad:
        if isinstance(self._pad, CirclePad):
            return detect_circles(image, self._camera, self._pad, prior, expected)
        return detect_tags(image, self._camera, self._pad, prior)

    def _where(
        self, eskf: ErrorStateFilter, camera: CameraAttitude, camera_pos_ned_m: Float
    ) -> tuple[TiltPrior, PadPose | None]:
        """How the pad is tilted in the camera frame by the estimate, and its pose where that is foreseen well."""
        pad = eskf.nominal.pad
        if pad is None:
            by_camera = camera_rotation_jacobian(camera, eskf)[:2]
            level = np.linalg.eigvalsh(by_camera @ eskf.P @ by_camera.T)[-1] + self.config.level_std_rad**2
            return TiltPrior(camera.ned_from_camera[2], self._tilt_std(level)), None
        pose = foreseen(pad, camera, camera_pos_ned_m)
        H = by_states(eskf, pad, camera, camera_pos_ned_m)
        cov = H @ eskf.P @ H.T
        down, depth_m = pose.camera_from_pad[:, 2], float(pose.pad_in_camera_m[2])
        # a turn about the pad's normal does not tilt it
        tilt = np.linalg.eigvalsh(cov[:3, :3] - np.outer(down, down) * float(down @ cov[:3, :3] @ down))[-1]
        prior = TiltPrior(down / np.linalg.norm(down), self._tilt_std(tilt))
        if depth_m <= 0.0:
            return prior, None
        off_px = self._camera.fx_px * np.sqrt(float(np.linalg.eigvalsh(cov[3:5, 3:5])[-1])) / depth_m
        well = off_px < self.config.foreseen_px and np.sqrt(cov[5, 5]) < self.config.foreseen_share * depth_m
        return prior, pose if well else None

    def _tilt_std(self, variance: float) -> float:
        return float(np.sqrt(max(variance, self.config.least_tilt_rad**2)))

    def _begin(
        self, found: PadSighting, eskf: ErrorStateFilter, camera: CameraAttitude, camera_pos_ned_m: Float
    ) -> None:
        """Put a pad where a picture shows it, known by nothing yet, so that the picture's innovation tells it."""
        level = self.config.level_std_rad
        eskf.place_pad(
            place(found.best.pose, camera, camera_pos_ned_m), np.full(3, _ANYWHERE_M),
            np.array((level, level, _ANY_HEADING_RAD)),
        )  # fmt: skip

    def _by_survey(self, eskf: ErrorStateFilter) -> Innovation | None:
        """Innovation of the surveyed place: the first picture of the pad is then a fix on the map."""
        pad = eskf.nominal.pad
        if self._surveyed is None or pad is None:
            return None
        H = eskf.layout.jacobian(3, pad_position=np.eye(3))
        return Innovation(self._surveyed.pos_ned_m - pad.pos_ned_m, H, np.eye(3) * self._surveyed.std_m**2)

    def relative(self, eskf: ErrorStateFilter, t_us: int, looked_to_us: int | None = None) -> PadRelative:
        """Where the vehicle is relative to the pad by a filter that stands at ``t_us``.

        Pictures have been looked at to ``looked_to_us``, ``t_us`` if not given: a pad that is carried on from there for
        want of later ones is not yet out of sight, unless that is longer ago than ``behind_s``.
        """
        status, pad, motion = self._status, eskf.nominal.pad, eskf.nominal.motion
        vel, cov_vel = motion.vel_ned_m_s.copy(), eskf.cov("velocity")
        if pad is None or status.used_us is None:
            pos, cov = self._from_survey(eskf)
            level = np.array((1.0, 0.0, 0.0, 0.0))
            return PadRelative(PadMode.SEARCHING, pos, vel, cov, cov_vel, level, _NO_AGE_S, status.reason, None)
        H = eskf.layout.jacobian(3, position=np.eye(3), pad_position=-np.eye(3))
        cov = H @ eskf.P @ H.T
        age_s = max(t_us - status.used_us, 0) / 1e6
        behind_s = 0.0 if looked_to_us is None else (t_us - looked_to_us) / 1e6
        unseen_s = age_s - min(max(behind_s, 0.0), self.config.behind_s)
        mode = self._mode(unseen_s, largest_std(cov))
        return PadRelative(
            mode, motion.pos_ned_m - pad.pos_ned_m, vel, cov, cov_vel, pad.q_ned_from_pad.copy(), age_s,
            status.reason, status.seen,
        )  # fmt: skip

    def _mode(self, unseen_s: float, std_m: float) -> PadMode:
        if std_m > self.config.landing_std_m and unseen_s > self.config.tracking_s:
            return PadMode.LOST
        return PadMode.TRACKING if unseen_s <= self.config.tracking_s else PadMode.DEAD_RECKONING

    def _from_survey(self, eskf: ErrorStateFilter) -> tuple[Float, Float]:
        """Position and covariance before a picture has shown it, NaN where nobody has said where it lies."""
        if self._surveyed is None:
            return np.full(3, np.nan), np.full((3, 3), np.nan)
        cov: Float = eskf.cov("position") + np.eye(3) * self._surveyed.std_m**2
        return eskf.nominal.motion.pos_ned_m - self._surveyed.pos_ned_m, cov
