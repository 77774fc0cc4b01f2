"""Absolute position from the map: registration, point-mass filter and hand-over, as one unit.

While one mode carries the density, each fix starts from the inertial filter's own Gaussian and hands over what the
picture added. While several modes compete, the density lives on, moved by the odometry, until one of them wins.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.filters.heading_slices import HeadingSlices
from estimator.filters.point_mass import Moments, PointMassFilter, information_increment
from estimator.integrity.map_evidence import MapEvidence
from estimator.measurements import terrain_fix
from estimator.measurements.camera_attitude import CameraAttitude
from estimator.measurements.innovation import Innovation
from estimator.measurements.map_fix_config import Acceptance, HandOver, MapFixConfig
from estimator.measurements.sliding_window import SlidingWindow
from estimator.registration.alignment import CameraPose, Match, NoMatch, Registrar
from estimator.registration.likelihood import likelihood, likelihoods
from estimator.registration.refine import Refinement
from estimator.robust import largest_std
from estimator.types import FixReport, Float, FrameSample

__all__ = ["Acceptance", "HandOver", "MapFixConfig", "MapFixer", "PictureSays"]
UNKNOWN_NE = np.full(2, np.nan)
LEAST_RIGHT = 0.02
"""Probability of being right that every match keeps: their calibration tells no less."""
MIN_CONTRAST = 1.2  # of a likelihood of mean one; that of a picture of noise reaches three and more
"""Likelihood's largest value below which a picture of nothing (fog, a cap) is no fix."""
UNKNOWN_COV = np.full((2, 2), np.nan)


@dataclass(frozen=True, slots=True, eq=False)
class PictureSays:
    """What a picture says of places: likelihood (rows, cols), of mean one, of displacements from the estimate.

    The first entry lies at (``north_max_m``, ``east_min_m``). ``fresh`` is the share that the last had not said.
    """

    likelihood: Float
    north_max_m: float
    east_min_m: float
    fresh: float


class MapFixer:
    """Makes absolute fixes and applies them to the inertial filter.

    ``least_reach_m`` widens the search, where the map may be displaced by more than the estimate's own error.
    """

    def __init__(
        self, registrar: Registrar, config: MapFixConfig | None = None,
        clock_s: Callable[[], float] = time.perf_counter,
    ) -> None:  # fmt: skip
        self.config = config or MapFixConfig()
        self._registrar = registrar
        self._clock_s = clock_s
        self._density: PointMassFilter | HeadingSlices | None = None
        sliding = self.config.acceptance is Acceptance.SLIDING_WINDOW
        self._window = SlidingWindow(self.config.sliding_window) if sliding else None
        self._last_pos_ne_m = UNKNOWN_NE
        self._last_t_us = 0
        self._last_accepted_ne_m = UNKNOWN_NE
        self._seen: tuple[Match, float] | None = None
        self.rejected_in_row = 0
        self.least_reach_m = 0.0
        self.evidence = MapEvidence(self.config.evidence)

    @property
    def registrar(self) -> Registrar:
        """What it registers pictures with."""
        return self._registrar

    @property
    def lost_probability(self) -> float:
        """Probability that the vehicle is not where the density looks."""
        return self._density.lost_probability if self._density is not None else 0.0

    def last_picture(self, cell_m: float) -> PictureSays | None:
        """What the last picture said, on a grid of ``cell_m``; None where it did not match anything."""
        if self._seen is None:
            return None
        match, fresh = self._seen
        calibration = self._registrar.calibration.likelihood
        judged = match.peak, calibration, match.outlier_probability, cell_m, fresh
        return PictureSays(*likelihood(match.correlation, *judged), fresh)

    def begin_anew(self) -> None:
        """Drop what earlier pictures said of place and map: it was against another position of the map."""
        self._density = None
        self.rejected_in_row = 0
        self.evidence = MapEvidence(self.config.evidence)

    def attempt(
        self, frame: FrameSample, eskf: ErrorStateFilter, camera: CameraAttitude, camera_pos_ned_m: Float,
        ground_down_m: float,
    ) -> FixReport:  # fmt: skip
        """Register a grey picture and update the filter with what it adds."""
        started = self._clock_s()
        self._seen = None
        pose = CameraPose(terrain_fix.apparent_pose(eskf, camera_pos_ned_m), camera.ned_from_camera)
        axis = camera.ned_from_camera[:, 2]
        height_m = ground_down_m - camera_pos_ned_m[2]
        if not height_m >= 2.0:
            unknown = not np.isfinite(height_m)
            self.rejected_in_row += 1
            return self._report(frame, started, "ground height unknown" if unknown else "too close to the ground")
        if camera.being_turned:
            return self._report(frame, started, "the camera is being turned")
        T = terrain_fix.apparent_pose_jacobian(eskf, camera)
        if not self.config.couple_attitude:
            T[2:] = 0.0
        aim = pose.pos_ned_m + axis * (height_m / max(axis[2], 0.2))
        H = terrain_fix.centre_by_pose(aim, pose.pos_ned_m) @ T
        radius_m = self._search_radius_m(H @ eskf.P @ H.T)
        headings, scales = self._hypotheses(eskf, camera, height_m)
        match = self._registrar.register(frame.image, pose, radius_m, headings, scales)
        if isinstance(match, NoMatch):
            self.rejected_in_row += 1
            return self._report(frame, started, match.reason)
        if self._window is not None:
            return self._fuse_by_window(self._window, match, frame, started, eskf, pose, T)
        return self._fuse(match, frame, started, eskf, camera, pose, T)

    def _fuse_by_window(
        self, window: SlidingWindow, match: Match, frame: FrameSample, started: float, eskf: ErrorStateFilter,
        pose: CameraPose, T: Float,
    ) -> FixReport:  # fmt: skip
        """Wait until the last matches say the same, then bring their mean in a part at a time."""
        before_ne = eskf.nominal.motion.pos_ned_m[:2].copy()
        part = window.offer(match.displacement_ne_m)
        measured_ne = before_ne + match.displacement_ne_m
        if part is None:
            reason = f"matches not stable yet (deviation {window.std_m:.1f} m)"
            return self._report(frame, started, reason, match, measured_ne)
        H = terrain_fix.centre_by_pose(match.centre_ned_m, pose.pos_ned_m) @ T
        cov_ne_m2 = np.eye(2) * part.variance_m2
        _apply(eskf, Innovation(part.innovation(H @ eskf.P @ H.T), H, cov_ne_m2), np.inf)
        window.moved(eskf.nominal.motion.pos_ned_m[:2] - before_ne)
        posterior = Moments(measured_ne, cov_ne_m2)
        return self._report(frame, started, None, match, measured_ne, posterior)

    def _search_radius_m(self, cov_ne_m2: Float) -> float:
        std = largest_std(cov_ne_m2)
        if self._density is not None:
            moments = self._density.moments()
            std = max(std, largest_std(moments.cov_ne_m2[:2, :2]))
        config = self.config
        reach_m = max(config.search_sigmas * std + config.min_search_m, self.least_reach_m)
        return float(np.clip(reach_m, 0.0, config.max_search_m))

    def _hypotheses(self, eskf: ErrorStateFilter, camera: CameraAttitude, height_m: float) -> tuple[Float, Float]:
        if not self.config.search_pose:
            return np.zeros(1), np.zeros(1)
        matcher = self._registrar.config
        if isinstance(self._density, HeadingSlices):
            headings = self._density.headings_rad
        else:
            headings = symmetric_steps(2.5 * _heading_std_rad(eskf, camera), matcher.heading_step_rad, most=7)
        height_std = float(np.sqrt(eskf.cov("position")[2, 2])) / height_m
        nadir = camera.ned_from_camera[2, 2] > 0.9
        scales = symmetric_steps(2.5 * height_std, matcher.scale_step, most=2) if nadir else np.zeros(1)
        return headings, scales

    def _fuse(
        self, match: Match, frame: FrameSample, started: float, eskf: ErrorStateFilter, camera: CameraAttitude,
        pose: CameraPose, T: Float,
    ) -> FixReport:  # fmt: skip
        H = terrain_fix.centre_by_pose(match.centre_ned_m, pose.pos_ned_m) @ T
        predicted_ne = eskf.nominal.motion.pos_ned_m[:2].copy()
        fresh = self._density is None
        density = self._predicted_density(eskf, camera, match, H, predicted_ne, frame.t_us)
        alike_m = self.config.correlation_share * match.footprint_m
        self.evidence.add(match.outlier_probability, predicted_ne, alike_m)
        weight = self._weight(predicted_ne, self._last_accepted_ne_m, alike_m)
        # what is handed over is all that the density has gained on the filter, since the last time it was
        prior = self._prior(eskf, camera, density, H, predicted_ne)
        # a refused picture stays in the density: the next from the same place tells it nothing new
        confused_m = self.config.ambiguity_share * match.footprint_m
        unsaid = self._weight(predicted_ne, self._last_pos_ne_m, confused_m)
        self._seen = match, unsaid
        told = 1.0 if fresh else unsaid
        if not self._look(density, match, predicted_ne, told) and fresh:
            self._density = None
            self.rejected_in_row += 1
            return self._report(frame, started, "the picture says nothing of the position", match)
        posterior = density.moments()
        self._density = density
        measured_ne = predicted_ne + match.displacement_ne_m
        reason = self._refusal(match, density)
        if reason is None:
            refinement = None
            if self.config.use_windows:
                refinement = self._registrar.refine(match, density.mode_ne_m() - predicted_ne, T @ eskf.P @ T.T)
            reason = self._update(match, refinement, eskf, camera, pose, T, weight, prior, posterior)
        if reason is None:
            if self.config.hand_over is HandOver.INCREMENT:
                self._density = None  # the inertial filter now holds all that the density does
            self._last_accepted_ne_m = predicted_ne
            self.rejected_in_row = 0
        else:
            self.rejected_in_row += 1
        self._last_pos_ne_m = eskf.nominal.motion.pos_ned_m[:2].copy()
        self._last_t_us = frame.t_us
        return self._report(frame, started, reason, match, measured_ne, posterior)

    def _look(
        self, density: PointMassFilter | HeadingSlices, match: Match, predicted_ne_m: Float, weight: float
    ) -> bool:
        """Multiply the picture's likelihood into the density; False where it is flat."""
        correlation, cell_m = match.correlation, density.cell_m
        judged = match.peak, self._registrar.calibration.likelihood, match.outlier_probability, cell_m, weight
        north, east = predicted_ne_m[0] + correlation.north_max_m, predicted_ne_m[1] + correlation.east_min_m
        if isinstance(density, HeadingSlices):
            surfaces = dict(match.by_heading)
            values = dict(zip(surfaces, likelihoods(correlation, list(surfaces.values()), *judged), strict=True))
            flat = np.ones_like(next(iter(values.values())))
            density.update([values.get(float(h), flat) for h in density.headings_rad], north, east, cell_m)
            return max(float(each.max()) for each in values.values()) >= MIN_CONTRAST
        plain, _, _ = likelihood(correlation, *judged)
        density.update(plain, north, east)
        return float(plain.max()) >= MIN_CONTRAST

    def _prior(
        self, eskf: ErrorStateFilter, camera: CameraAttitude, density: PointMassFilter | HeadingSlices, H: Float,
        predicted_ne_m: Float,
    ) -> Moments:  # fmt: skip
        """What the inertial filter knows before the picture, on the density's terms."""
        if isinstance(density, HeadingSlices):
            # through slices of its own: what their steps and their reach do to a Gaussian is no information
            cov = _with_heading(eskf, camera, H)
            return HeadingSlices(predicted_ne_m, cov, density.headings_rad, self.config.point_mass).moments()
        return Moments(predicted_ne_m, H @ eskf.P @ H.T + np.eye(2) * 0.01)

    def _update(
        self, match: Match, refinement: Refinement | None, eskf: ErrorStateFilter, camera: CameraAttitude,
        pose: CameraPose, T: Float, weight: float, prior: Moments, posterior: Moments,
    ) -> str | None:  # fmt: skip
        """Hand what the picture adds to the inertial filter; why not, where it does not fit."""
        config = self.config
        doubt = self._doubt(match)
        if refinement is None or refinement.agreement < config.min_agreement:
            return self._update_by_density(match, eskf, camera, pose, T, weight, prior, posterior)
        J = terrain_fix.centre_by_pose(match.centre_ned_m, pose.pos_ned_m)
        information = J[:, :2].T @ refinement.information[:2, :2] @ J[:, :2]
        cov_ne_m2 = np.asarray(np.linalg.inv(information + np.eye(2) * 1e-6), dtype=np.float64)
        self._follow_map(eskf, config.noise_inflation**2 * cov_ne_m2, match.footprint_m)
        white, inflation = np.sqrt(config.white_share), config.noise_inflation * np.sqrt(doubt)
        own = terrain_fix.PoseNoise(config.noise_inflation * white, config.noise_inflation)
        noise = terrain_fix.PoseNoise(inflation * white, inflation / np.sqrt(weight))
        innovation = terrain_fix.pose(refinement, T, match.centre_ned_m, pose.pos_ned_m, noise, own)
        if innovation is None:
            return "the picture says nothing of the pose"
        if not _apply(eskf, innovation, config.max_innovation_sigmas):
            return "does not agree with the estimate"
        return None

    def _update_by_density(
        self, match: Match, eskf: ErrorStateFilter, camera: CameraAttitude, pose: CameraPose, T: Float, weight: float,
        prior: Moments, posterior: Moments,
    ) -> str | None:  # fmt: skip
        config = self.config
        if config.hand_over is HandOver.DENSITY:
            return self._update_by_mean(match, eskf, pose, T, posterior)
        sliced = len(prior.mean_ne_m) == 3
        lever_m = 0.5 * match.footprint_m  # headings count by what they move at the picture's rim
        units = np.diag([1.0, 1.0, lever_m])[: len(prior.mean_ne_m), : len(prior.mean_ne_m)]
        increment = information_increment(_in_units(prior, units), _in_units(posterior, units))
        if increment is None:
            return "the picture says nothing of the position"
        H = terrain_fix.centre_by_pose(match.centre_ned_m, pose.pos_ned_m) @ T
        predicted = eskf.nominal.motion.pos_ned_m[:2]
        inflation = config.slices_inflation if sliced else config.density_inflation
        cov_ne_m2 = increment.cov_ne_m2 * inflation**2
        self._follow_map(eskf, cov_ne_m2[:2, :2], match.footprint_m)
        right_m2, cov_ne_m2 = cov_ne_m2, cov_ne_m2 * self._doubt(match)
        R = self._noise(eskf, cov_ne_m2[:2, :2], weight)
        R_one = self._noise(eskf, right_m2[:2, :2], 1.0)
        if sliced:
            H = np.vstack((H, lever_m * _heading_jacobian(eskf, camera)))
            predicted = np.append(predicted, 0.0)
            R = self._with_heading_noise(R, cov_ne_m2, weight, lever_m)
            R_one = self._with_heading_noise(R_one, right_m2, 1.0, lever_m)
        whole = Innovation(increment.position_ne_m - predicted, H, R, R_one)
        innovation = _informative(whole, eskf.P, cov_ne_m2, config.least_information)
        if innovation is None:
            return "the picture says nothing of the position"
        if not _apply(eskf, innovation, config.max_innovation_sigmas):
            return "does not agree with the estimate"
        self._update_heading_and_height(match, eskf, camera, pose.pos_ned_m, weight, heading=not sliced)
        return None

    def _doubt(self, match: Match) -> float:
        """How many times as large the variance of a match is because it may be wrong.

        What one that is right may be off by, which its innovation is gated and tallied by, is without it (Bar-Shalom
        and Tse: a gate is of the right ones).
        """
        return 1.0 / max(1.0 - match.outlier_probability, LEAST_RIGHT) if self.config.by_probability else 1.0

    def _with_heading_noise(self, R: Float, cov: Float, weight: float, lever_m: float) -> Float:
        """Covariance (3, 3) of a fix with heading: correlated as ``cov`` (3, 3), its place as large as R (2, 2)."""
        spread = cov / weight
        scale = np.diag([*np.sqrt(np.diag(R) / np.diag(spread)[:2]), 1.0])
        noise: Float = scale @ spread @ scale
        noise[2, 2] += (lever_m * self.config.heading_floor_rad) ** 2 / weight
        return noise

    def _update_by_mean(
        self, match: Match, eskf: ErrorStateFilter, pose: CameraPose, T: Float, posterior: Moments
    ) -> str | None:
        """The density's mean as a position of constant sigma, whatever its spread."""
        H = terrain_fix.centre_by_pose(match.centre_ned_m, pose.pos_ned_m) @ T
        z = posterior.mean_ne_m - eskf.nominal.motion.pos_ned_m[:2]
        innovation = Innovation(z, H, np.eye(2) * self.config.constant_std_m**2)
        fits = _apply(eskf, innovation, self.config.max_innovation_sigmas)
        return None if fits else "does not agree with the estimate"

    def _noise(self, eskf: ErrorStateFilter, cov_ne_m2: Float, weight: float) -> Float:
        """Covariance (2, 2) of a fix beside the map's displacement, of which a ``weight`` counts.

        What neighbouring fixes have in common is a state as far as that is as large; the rest of what makes a fix
        uncertain (along a road, over a bare field) they share as well, so it is spread over those that do.
        """
        variances, axes = np.linalg.eigh(cov_ne_m2)
        local_share = 1.0 - self.config.white_share - self.config.regional_share
        by_state = np.minimum(variances, eskf.map_bias_std_m**2 / local_share)
        spread = self.config.white_share * by_state + (variances - by_state) / weight
        noise: Float = axes @ np.diag(spread) @ axes.T
        return noise

    def _follow_map(self, eskf: ErrorStateFilter, cov_ne_m2: Float, footprint_m: float) -> None:
        """Let the map's displacements be as large as their shares of what pictures are uncertain by.

        Where pictures become worse the local one grows at once, and shrinks slowly where they become better. Pictures
        err alike as far as they show the same ground. That a match may be wrong says nothing of the map.
        """
        config = self.config
        best_m2 = float(np.linalg.eigvalsh(cov_ne_m2)[0])
        local_share = 1.0 - config.white_share - config.regional_share

        def std_m(share: float, memory: float, before_m: float) -> tuple[float, float]:
            now_m = float(np.clip(np.sqrt(share * best_m2), config.min_map_bias_m, config.max_map_bias_m))
            return now_m, float(np.sqrt(memory * before_m**2 + (1.0 - memory) * now_m**2))

        eskf.map_bias_std_m = max(std_m(local_share, config.map_bias_memory, eskf.map_bias_std_m))
        eskf.map_region_std_m = std_m(config.regional_share, config.map_region_memory, eskf.map_region_std_m)[1]
        eskf.see_map_over(max(config.local_share * footprint_m, 1.0))

    def _predicted_density(
        self, eskf: ErrorStateFilter, camera: CameraAttitude, match: Match, H: Float, predicted_ne_m: Float, t_us: int
    ) -> PointMassFilter | HeadingSlices:
        if self._density is None:
            config = self.config
            if len(match.by_heading) > 2 and _heading_std_rad(eskf, camera) >= config.slice_heading_rad:
                headings = np.array([heading for heading, _ in match.by_heading])
                return HeadingSlices(predicted_ne_m, _with_heading(eskf, camera, H), headings, config.point_mass)
            return PointMassFilter(predicted_ne_m, H @ eskf.P @ H.T + np.eye(2) * 0.01, config.point_mass)
        moved = predicted_ne_m - self._last_pos_ne_m
        elapsed_s = (t_us - self._last_t_us) / 1e6
        velocity_cov = eskf.cov("velocity")[:2, :2]
        cov = velocity_cov * elapsed_s**2 + np.eye(2) * ((0.02 * np.hypot(*moved)) ** 2 + 0.01 * elapsed_s)
        self._density.predict(moved, cov)
        return self._density

    def _weight(self, predicted_ne_m: Float, last_ne_m: Float, alike_m: float) -> float:
        """Share that a fix counts, given how near the last one was: w = (1 - r) / (1 + r), r = exp(-d / L)."""
        if not self.config.temper or not np.isfinite(last_ne_m).all():
            return 1.0
        distance = float(np.hypot(*(predicted_ne_m - last_ne_m)))
        correlation = np.exp(-distance / max(alike_m, 1.0))
        return max(float((1.0 - correlation) / (1.0 + correlation)), self.config.min_weight)

    def _refusal(self, match: Match, density: PointMassFilter | HeadingSlices) -> str | None:
        config = self.config
        if config.evidence is not None and self.evidence.against:
            return "the last pictures together contradict the map"
        if match.outlier_probability > config.max_outlier_probability:
            return f"match too weak (outlier probability {match.outlier_probability:.2f})"
        if density.lost_probability > config.max_lost_probability:
            return f"lost (probability {density.lost_probability:.2f})"
        unimodality = density.unimodality()
        if unimodality < config.min_unimodality:
            return f"ambiguous (main mode holds {unimodality:.2f})"
        return None

    def _update_heading_and_height(
        self, match: Match, eskf: ErrorStateFilter, camera: CameraAttitude, camera_pos_ned_m: Float, weight: float,
        heading: bool = True,
    ) -> None:  # fmt: skip
        if heading and np.isfinite(match.heading_std_rad):
            std = float(np.hypot(match.heading_std_rad, self.config.heading_floor_rad))
            _apply(eskf, terrain_fix.heading(eskf, camera, match.heading_rad, std, weight), what="fix_heading")
        if np.isfinite(match.scale_std):
            height_m = float(match.centre_ned_m[2] - camera_pos_ned_m[2])
            std = float(np.hypot(match.scale_std, self.config.scale_floor))
            _apply(eskf, terrain_fix.height(eskf, height_m, match.scale, std, weight), what="fix_height")

    def _report(
        self, frame: FrameSample, started: float, reason: str | None, match: Match | None = None,
        measured_ne_m: Float = UNKNOWN_NE, posterior: Moments | None = None,
    ) -> FixReport:  # fmt: skip
        return FixReport(
            t_us=frame.t_us,
            frame_id=frame.frame_id,
            kind="registration",
            accepted=reason is None,
            reason=reason or "",
            north_m=float(measured_ne_m[0]),
            east_m=float(measured_ne_m[1]),
            cov_ne_m2=UNKNOWN_COV if posterior is None else posterior.cov_ne_m2[:2, :2],
            score=match.peak.value if match else float("nan"),
            outlier_probability=match.outlier_probability if match else 1.0,
            heading_correction_rad=match.heading_rad if match else 0.0,
            scale_correction=match.scale if match else 0.0,
            elapsed_ms=(self._clock_s() - started) * 1e3,
        )


def _heading_jacobian(eskf: ErrorStateFilter, camera: CameraAttitude) -> Float:
    return eskf.layout.jacobian(1, attitude=camera.by_attitude[2:], boresight=camera.by_boresight[2:])


def _heading_std_rad(eskf: ErrorStateFilter, camera: CameraAttitude) -> float:
    H = _heading_jacobian(eskf, camera)
    return float(np.sqrt(H @ eskf.P @ H.T)[0, 0])


def _with_heading(eskf: ErrorStateFilter, camera: CameraAttitude, H: Float) -> Float:
    """Covariance (3, 3) of the picture's middle, whose Jacobian is H (2, n), and of the camera's heading."""
    J = np.vstack((H, _heading_jacobian(eskf, camera)))
    cov: Float = J @ eskf.P @ J.T + np.diag([0.01, 0.01, 0.0])
    return cov


def _in_units(moments: Moments, units: Float) -> Moments:
    return Moments(units @ moments.mean_ne_m, units @ moments.cov_ne_m2 @ units)


def _informative(innovation: Innovation, P: Float, cov: Float, least: float) -> Innovation | None:
    """Along the axes of ``cov`` on which it tells at least a share ``least`` of what is known; None where on none.

    On the others the search's reach bounds what is found, and not the picture.
    """
    variances, axes = np.linalg.eigh(cov)
    D = axes.T[least * variances <= np.einsum("ik,ij,jk->k", axes, innovation.H @ P @ innovation.H.T, axes)]
    if not len(D):
        return None
    R_one = None if innovation.R_one is None else D @ innovation.R_one @ D.T
    return Innovation(D @ innovation.z, D @ innovation.H, D @ innovation.R @ D.T, R_one)


def _apply(eskf: ErrorStateFilter, innovation: Innovation, gate_sigmas: float = 4.0, what: str = "fix") -> bool:
    accepted, _ = eskf.update(innovation.z, innovation.H, innovation.R, gate_sigmas**2, what, innovation.R_one)
    return accepted


def symmetric_steps(reach: float, step: float, most: int) -> Float:
    """Zero and ``most`` steps at the most to either side, enough to reach ``reach``; at least one."""
    count = int(np.clip(np.ceil(reach / step), 1, most))
    return step * np.arange(-count, count + 1, dtype=np.float64)
