"""Error-state Kalman filter: strapdown or attitude-driven prediction, and one update for every measurement.

The error state holds position, velocity and attitude error (the small rotation about the NED axes that takes the
nominal attitude to the true one), the accelerometer bias of Conte 2009 (section 4.3, twelve states), and groups that
can be left out: gyroscope bias, barometer bias, camera misalignment, the slow error of the attitude that the autopilot
reports, how far the visible surface lies below the ground model, and how far the reference imagery is displaced, from
place to place and as a region. The last three change with the ground flown over and not with time. The displacement
of the imagery as a whole is not estimated until ``learn_map_offset`` says that there is one. Then come stochastic
clones of the position and the camera attitude (Roumeliotis and Burdick, Stochastic cloning, ICRA 2002) at the previous
picture and at the last keyframe, which make visual odometry an ordinary measurement, and the common errors of the
heights that points have by the last two keyframes. A landing pad is a landmark: its place and attitude are states from
the first picture that shows it.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass, replace

import numpy as np

from estimator.filters.kalman import correct
from estimator.filters.nominal import PAD_GROUPS, Clone, Layout, Nominal, PadPlace
from estimator.filters.strapdown import EarthModel, Motion, propagate
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec, q_multiply, q_normalise, skew
from estimator.history import rotation_between
from estimator.types import Float

_MOTION = 9
_P, _V, _A = slice(0, 3), slice(3, 6), slice(6, 9)
"""Position, velocity and attitude: always there, and first."""
_ROTATIONS = ("attitude", "clone_rotation", "keyframe_rotation", "pad_rotation")


@dataclass(frozen=True, slots=True)
class ProcessNoise:
    """Continuous noise densities; one standard deviation per square root of a second, and correlation times.

    The defaults are a consumer-grade unit on a vibrating airframe: several times its data sheet, because unmodelled
    scale factor, coning and quantisation land here too.
    """

    accelerometer_m_s2_rt_s: float = 0.04
    gyroscope_rad_rt_s: float = 0.0004
    accelerometer_bias_m_s2_rt_s: float = 0.003
    gyroscope_bias_rad_s_rt_s: float = 1.5e-4
    barometer_bias_m_rt_s: float = 0.09
    boresight_rad_rt_s: float = 1e-4
    # in place of that where a gimbal keeps level by sensors of its own, which drift by tenths of a degree a minute
    gimbal_rad_rt_s: float = 5e-4
    attitude_bias_std_rad: tuple[float, float, float] = (0.01, 0.01, 0.03)
    attitude_bias_time_s: float = 60.0
    # trees and houses stand above a ground model for tens of metres; the model is off, or the land wooded, for longer
    ground_bias_std_m: tuple[float, float] = (7.0, 0.7)
    ground_bias_length_m: tuple[float, float] = (80.0, 1500.0)
    # until a picture tells its footprint (ADR 0015)
    map_bias_length_m: float = 90.0
    map_region_length_m: float = 1500.0
    gnss_bias_std_m: float = 0.9
    gnss_bias_time_s: float = 70.0
    # a pad lies still: what its picture errs by alike changes with the distance
    pad_position_m_rt_s: float = 0.002
    pad_rotation_rad_rt_s: float = 1e-4
    # without inertial data the velocity is a random walk
    manoeuvre_m_s2_rt_s: tuple[float, float, float] = (2.5, 2.5, 1.0)


@dataclass(slots=True)
class InnovationTally:
    """Numbers that accepted innovations held, and the sum of their normalised squares: one each, if ``R_one`` is right.

    An innovation is held against what one reading errs by, not against a noise widened for what readings in a row have
    in common: widening tells how much they count together, and nothing of the size of each.
    """

    numbers: int = 0
    nis: float = 0.0

    @property
    def nis_per_dof(self) -> float:
        """Mean normalised innovation squared per degree of freedom, NaN before the first."""
        return self.nis / self.numbers if self.numbers else float("nan")


class ErrorStateFilter:
    """Nominal state with the covariance of its error. Stateless laws live in the functions it calls."""

    def __init__(self, nominal: Nominal, P: Float, layout: Layout, earth: EarthModel, noise: ProcessNoise) -> None:
        self.nominal = nominal
        self.P = P
        self.layout = layout
        self.earth = earth
        self.noise = noise
        self._bias_noise = self._slow_noise_density()
        # rows of F without what a reading tells; of velocity in position still to be times the step
        self._unread = np.eye(_MOTION, layout.size)
        self._unread[:3, 3:6] = np.eye(3)
        self._per_metre, self._per_second = self._fading()
        self._renewed_m2 = np.zeros(layout.size)
        if layout.has("ground_bias"):
            self._renewed_m2[layout.slices["ground_bias"]] = np.square(noise.ground_bias_std_m)
        self._frame_turn = skew(earth.rate_ned_rad_s)
        self._motion_noise = self._bias_noise.copy()
        self._motion_noise[layout.slices["velocity"]] = noise.accelerometer_m_s2_rt_s**2
        self._motion_noise[layout.slices["attitude"]] = noise.gyroscope_rad_rt_s**2
        self.map_bias_std_m = 1.0
        self._map_region_std_m = self._most_map_region_m = 0.0
        self.innovations: dict[str, InnovationTally] = {}

    @property
    def map_bias_std_m(self) -> float:
        """How far the reference imagery is displaced from place to place, a standard deviation on each axis."""
        return self._map_bias_std_m

    @map_bias_std_m.setter
    def map_bias_std_m(self, std_m: float) -> None:
        self._map_bias_std_m = std_m
        if self.layout.has("map_bias"):
            self._renewed_m2[self.layout.slices["map_bias"]] = std_m**2

    @property
    def map_region_std_m(self) -> float:
        """How far the imagery of the region is displaced, a standard deviation on each axis."""
        return self._map_region_std_m

    @map_region_std_m.setter
    def map_region_std_m(self, std_m: float) -> None:
        """Growth counts at once: over so long a way it would not arrive in a flight. Once only, or it would add up."""
        self._map_region_std_m = std_m
        if self.layout.has("map_region"):
            where = self.layout.slices["map_region"]
            self._renewed_m2[where] = std_m**2
            if std_m > self._most_map_region_m:
                self.inflate("map_region", std_m**2 - self._most_map_region_m**2)
                self._most_map_region_m = std_m

    def see_map_over(self, length_m: float) -> None:
        """Let the imagery's displacement from place to place be alike over so many metres flown."""
        if self.layout.has("map_bias"):
            self._per_metre[self.layout.slices["map_bias"]] = 1.0 / length_m

    def _fading(self) -> tuple[Float, Float]:
        """How fast each state (size,) fades, per metre flown and per second."""
        per_metre, per_second = np.zeros(self.layout.size), np.zeros(self.layout.size)
        part, noise = self.layout.slices, self.noise
        if "ground_bias" in part:
            per_metre[part["ground_bias"]] = 1.0 / np.array(noise.ground_bias_length_m)
        if "map_bias" in part:
            per_metre[part["map_bias"]] = 1.0 / noise.map_bias_length_m
        if "map_region" in part:
            per_metre[part["map_region"]] = 1.0 / noise.map_region_length_m
        if "attitude_bias" in part:
            per_second[part["attitude_bias"]] = 1.0 / noise.attitude_bias_time_s
        if "gnss_bias" in part:
            per_second[part["gnss_bias"]] = 1.0 / noise.gnss_bias_time_s
        return per_metre, per_second

    def _slow_noise_density(self) -> Float:
        q = np.zeros(self.layout.size)
        noise = self.noise
        rates = {
            "accelerometer_bias": noise.accelerometer_bias_m_s2_rt_s,
            "gyroscope_bias": noise.gyroscope_bias_rad_s_rt_s,
            "barometer_bias": noise.barometer_bias_m_rt_s,
            "boresight": noise.boresight_rad_rt_s,
            "attitude_bias": np.array(noise.attitude_bias_std_rad) * np.sqrt(2.0 / noise.attitude_bias_time_s),
            "gnss_bias": noise.gnss_bias_std_m * np.sqrt(2.0 / noise.gnss_bias_time_s),
            "pad_position": noise.pad_position_m_rt_s,
            "pad_rotation": noise.pad_rotation_rad_rt_s,
        }
        for name, density in rates.items():
            where = self.layout.slices.get(name)
            if where is not None:
                q[where] = np.square(density)
        return q

    def predict_inertial(self, rate_body_rad_s: Float, specific_force_body_m_s2: Float, dt_s: float) -> None:
        """Advance by ``dt_s`` with gyroscope (3,) and accelerometer (3,) readings, as measured."""
        nominal = self.nominal
        rate = rate_body_rad_s - nominal.gyroscope_bias_rad_s
        force = specific_force_body_m_s2 - nominal.accelerometer_bias_m_s2
        ned_from_body = matrix_from_q(nominal.motion.q_ned_from_body)
        by_bias = ned_from_body * -dt_s
        velocity_by_attitude = skew(by_bias @ force)
        index = self.layout.slices
        F = self._unread.copy()
        F[_P, _V] *= dt_s
        F[_P, _A] = velocity_by_attitude * (0.5 * dt_s)
        F[_V, _A] = velocity_by_attitude
        F[_A, _A] -= self._frame_turn * dt_s
        if "accelerometer_bias" in index:
            F[_V, index["accelerometer_bias"]] = by_bias
        if "gyroscope_bias" in index:
            F[_A, index["gyroscope_bias"]] = by_bias
        kept = np.exp(self._per_second * -dt_s - self._per_metre * self._flown_m(dt_s))
        self._advance(F, kept)
        diagonal = np.einsum("ii->i", self.P)
        diagonal += self._motion_noise * dt_s + self._renewed_m2 * (1.0 - kept * kept)
        diagonal[_P] += self.noise.accelerometer_m_s2_rt_s**2 * dt_s**3 / 3.0
        self.nominal = nominal.moved(propagate(nominal.motion, rate, force, dt_s, self.earth), kept, index)

    def predict_by_reports(self, q_before: Float | None, q_now: Float | None, dt_s: float) -> None:
        """Advance by ``dt_s`` by how the reported attitude changes; where it is not known at either end it stays."""
        q, noise = self.nominal.motion.q_ned_from_body, self.noise
        if q_before is not None and q_now is not None:
            correction = rotation_between(q_before, q) * np.exp(-dt_s / noise.attitude_bias_time_s)
            q = q_normalise(q_multiply(q_from_rotvec(correction), q_now))
        self.predict_attitude_driven(q, np.array(noise.attitude_bias_std_rad), noise.attitude_bias_time_s, dt_s)

    def predict_attitude_driven(
        self, q_ned_from_body: Float, attitude_std_rad: Float, attitude_time_s: float, dt_s: float
    ) -> None:
        """Advance by ``dt_s`` without inertial data: the attitude is given, the velocity is a random walk.

        ``q_ned_from_body`` is the reported attitude already turned by the estimated correction; its error is a
        first-order Gauss-Markov process of ``attitude_std_rad`` (3,) and ``attitude_time_s``.
        """
        decay = float(np.exp(-dt_s / attitude_time_s))
        F = self._unread.copy()
        F[_P, _V] *= dt_s
        F[_A, _A] *= decay
        kept = np.exp(-self._per_metre * self._flown_m(dt_s))
        self._advance(F, kept)
        diagonal = np.einsum("ii->i", self.P)
        diagonal += self._bias_noise * dt_s + self._renewed_m2 * (1.0 - kept * kept)
        manoeuvre = np.square(self.noise.manoeuvre_m_s2_rt_s)
        diagonal[_V] += manoeuvre * dt_s
        diagonal[_P] += manoeuvre * dt_s**3 / 3.0
        diagonal[_A] += np.square(attitude_std_rad) * (1.0 - decay**2)
        motion = self.nominal.motion
        pos = motion.pos_ned_m + motion.vel_ned_m_s * dt_s
        moved = Motion(pos, motion.vel_ned_m_s, q_ned_from_body)
        self.nominal = self.nominal.moved(moved, kept, self.layout.slices)

    def _advance(self, F: Float, kept: Float) -> None:
        """Make P that of a step: F (9, size) are the rows of position, velocity and attitude.

        Every other state keeps a share (size,) of itself and nothing else, so that the product of whole matrices, most
        of what a prediction costs, is not needed.
        """
        rows = F @ self.P
        P = self.P * kept
        P *= kept[:, None]
        P[:_MOTION] = rows * kept
        P[:, :_MOTION] = P[:_MOTION].T
        P[:_MOTION, :_MOTION] = rows @ F.T
        self.P = P

    def _flown_m(self, dt_s: float) -> float:
        """Distance over which the errors of ground model and imagery fade; in a hover they stay."""
        north, east, _ = self.nominal.motion.vel_ned_m_s.tolist()
        return math.hypot(north, east) * dt_s

    def update(
        self, z: Float, H: Float, R: Float, gate: float = np.inf, what: str = "", R_one: Float | None = None
    ) -> tuple[bool, float]:  # fmt: skip
        """Fuse an innovation; returns whether the gate accepted it, and its normalised square (NaN if rejected).

        One that is not finite is rejected: a single such number would leave nothing of the estimate. The accepted are
        tallied by ``what`` was measured, against ``R_one`` as `Innovation` has it.
        """
        if not (np.isfinite(z).all() and np.isfinite(H).all() and np.isfinite(R).all()):
            return False, float("nan")
        nis = float("nan") if R_one is None else float(z @ np.linalg.solve(H @ self.P @ H.T + R_one, z))
        correction = None if nis > gate else correct(self.P, z, H, R, gate)
        if correction is None:
            return False, float("nan")
        nis = correction.nis if R_one is None else nis
        self.P = correction.P
        self._inject(correction.dx)
        tally = self.innovations.setdefault(what, InnovationTally())
        tally.numbers += len(z)
        tally.nis += nis
        return True, nis

    def _inject(self, dx: Float) -> None:
        """Move the error into the nominal state.

        What that does to the covariance is applied only where it changes more than a two-hundredth of it.
        """
        part = self.layout.slices
        nominal = self.nominal
        rotation = dx[part["attitude"]]
        motion = Motion(
            nominal.motion.pos_ned_m + dx[part["position"]],
            nominal.motion.vel_ned_m_s + dx[part["velocity"]],
            q_normalise(q_multiply(q_from_rotvec(rotation), nominal.motion.q_ned_from_body)),
        )

        def moved(name: str, value: Float) -> Float:
            return value + dx[part[name]] if name in part else value

        def moved_scalar(name: str, value: float) -> float:
            return value + float(dx[part[name]][0]) if name in part else value

        self.nominal = Nominal(
            motion=motion,
            accelerometer_bias_m_s2=moved("accelerometer_bias", nominal.accelerometer_bias_m_s2),
            gyroscope_bias_rad_s=moved("gyroscope_bias", nominal.gyroscope_bias_rad_s),
            barometer_bias_m=moved_scalar("barometer_bias", nominal.barometer_bias_m),
            boresight_rad=moved("boresight", nominal.boresight_rad),
            attitude_bias_rad=moved("attitude_bias", nominal.attitude_bias_rad),
            ground_biases_m=moved("ground_bias", nominal.ground_biases_m),
            map_bias_ne_m=moved("map_bias", nominal.map_bias_ne_m),
            map_region_ne_m=moved("map_region", nominal.map_region_ne_m),
            map_offset_ne_m=moved("map_offset", nominal.map_offset_ne_m),
            gnss_bias_ne_m=moved("gnss_bias", nominal.gnss_bias_ne_m),
            clone=self._moved_clone(nominal.clone, "clone", dx),
            keyframe=self._moved_clone(nominal.keyframe, "keyframe", dx),
            structure_m=moved("structure", nominal.structure_m),
            pad=self._moved_pad(nominal.pad, dx),
        )
        if float(rotation @ rotation) > 1e-4:
            self._turn_rotation_errors(dx)

    def _turn_rotation_errors(self, dx: Float) -> None:
        """Take the rotation errors from about the old nominal state to about the corrected one.

        The Jacobian of an error about the outer axes is I + [dtheta]x / 2 (Sola 2017, section 7.4; about the body's
        axes the sign is minus). The clones' errors turn with the attitude's: one that is left as it was seems to differ
        from what it was copied from, and odometry takes that for knowledge of the heading.
        """
        G = np.eye(self.layout.size)
        for name in _ROTATIONS:
            where = self.layout.slices.get(name)
            if where is not None:
                G[where, where] += 0.5 * skew(dx[where])
        self.P = G @ self.P @ G.T

    def _moved_clone(self, clone: Clone | None, name: str, dx: Float) -> Clone | None:
        if clone is None:
            return None
        part = self.layout.slices
        turn = q_from_rotvec(dx[part[f"{name}_rotation"]])
        return Clone(
            clone.pos_ned_m + dx[part[f"{name}_position"]], q_normalise(q_multiply(turn, clone.q_ned_from_camera))
        )

    def _moved_pad(self, pad: PadPlace | None, dx: Float) -> PadPlace | None:
        if pad is None or not self.layout.has("pad_position"):
            return pad
        part = self.layout.slices
        turn = q_from_rotvec(dx[part["pad_rotation"]])
        return PadPlace(
            pad.pos_ned_m + dx[part["pad_position"]], q_normalise(q_multiply(turn, pad.q_ned_from_pad))
        )  # fmt: skip

    def place_pad(self, pad: PadPlace, position_std_m: Float, rotation_std_rad: Float) -> None:
        """Begin with a pad there, known to so much (3,) each and by nothing else that is estimated."""
        for name, std in zip(PAD_GROUPS, (position_std_m, rotation_std_rad), strict=True):
            where = self.layout.slices[name]
            self.P[where] = 0.0
            self.P[:, where] = 0.0
            self.P[where, where] = np.diag(np.square(std))
        self.nominal = replace(self.nominal, pad=pad)

    def copied(self) -> ErrorStateFilter:
        """One with the same estimate that can be carried on by itself."""
        other = copy.copy(self)
        other.P = self.P.copy()
        other._renewed_m2, other._per_metre = self._renewed_m2.copy(), self._per_metre.copy()
        return other

    def clone(self, camera: Clone, camera_attitude: Float) -> None:
        """Copy position and camera rotation error into the clone states; ``camera`` is their nominal value.

        ``camera_attitude`` (3, size) maps the error state to the camera's rotation error about the NED axes.
        """
        self.nominal = replace(self.nominal, clone=camera)
        self._set_states(clone_position=self._rows("position"), clone_rotation=camera_attitude)

    def take_keyframe(self, camera: Clone, camera_attitude: Float, by_pose: Float | None, cov: Float | None) -> None:
        """Make the present camera pose, as ``clone`` has it, the keyframe; without effect where none is estimated.

        ``by_pose`` (3, 12) are the derivatives of the structure's common errors by the poses of the keyframe before and
        by the present one, and ``cov`` (3, 3) their noise; None leaves the structure as it is.
        """
        if not self.layout.has("keyframe_position"):
            return
        states = {"keyframe_position": self._rows("position"), "keyframe_rotation": camera_attitude}
        if by_pose is not None:
            before = [self._rows("keyframe_position"), self._rows("keyframe_rotation")]
            states["structure"] = by_pose @ np.concatenate((*before, *states.values()))
        self._set_states(**states)
        self.nominal = replace(self.nominal, keyframe=camera)
        if cov is not None:
            where = self.layout.slices["structure"]
            self.P[where, where] += cov
            self.nominal = replace(self.nominal, structure_m=np.zeros(3))

    def _rows(self, name: str) -> Float:
        """Rows of the identity that pick a group of the error state."""
        rows: Float = np.eye(self.layout.size)[self.layout.slices[name]]
        return rows

    def _set_states(self, **groups: Float) -> None:
        """Make groups of states linear functions (k, size) of the present error state."""
        T = np.eye(self.layout.size)
        for name, rows in groups.items():
            T[self.layout.slices[name]] = rows
        self.P = T @ self.P @ T.T

    def inflate(self, group: str, variance: float) -> None:
        """Add independent variance (diagonal) to a group of states."""
        np.einsum("ii->i", self.P)[self.layout.slices[group]] += variance

    def doubt_place(self, cov_ne_m2: Float) -> None:
        """Add to the horizontal position a covariance (2, 2) that the way since earlier pictures does not know.

        Their clones err by the same: left as they are, the next odometry would take the doubt back.
        """
        groups = [name for name in ("position", "clone_position", "keyframe_position") if self.layout.has(name)]
        rows = np.concatenate([np.arange(2) + self.layout.slices[name].start for name in groups])
        self.P[np.ix_(rows, rows)] += np.tile(cov_ne_m2, (len(groups), len(groups)))

    def learn_map_offset(self, displacement_ne_m: Float, std_m: float) -> None:
        """Take the imagery to be displaced by so much (2,) more, to ``std_m``; updates then know it better.

        What else is known of the state does not change: the displacement was seen against it.
        """
        where = self.layout.slices["map_offset"]
        self.nominal = replace(self.nominal, map_offset_ne_m=self.nominal.map_offset_ne_m + displacement_ne_m)
        self.P[where] = 0.0
        self.P[:, where] = 0.0
        self.inflate("map_offset", std_m**2)

    def cov(self, group: str, other: str | None = None) -> Float:
        """A copy of a block of the covariance."""
        return self.P[self.layout.slices[group], self.layout.slices[other or group]].copy()
