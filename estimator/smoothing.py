"""Past states corrected by what came later: a fixed-interval smoother over the states that a navigator keeps.

Rauch, Tung and Striebel, Maximum likelihood estimates of linear dynamic systems, AIAA J. 3 (1965), p. 1445: going
backwards, the error of a state is what its covariance with the next one's prediction makes of that one's correction.
Here the states are those after each picture and each fix, of which the filter's prediction is kept too: position,
velocity, attitude and the ground's bias, ten of the filter's errors. What updates between them (barometer, reported
attitude) changed is not carried back: innovations of a filter are white, so that leaving some out gives a worse
estimate, with a covariance that is right for it.

Biases and clones are no part of it. What they add between two states is seen in the filter's own prediction, and taken
for noise there, which makes the smoother carry less back, never more.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from estimator.filters.eskf import ProcessNoise
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import q_from_rotvec, q_multiply, q_normalise, skew
from estimator.history import Corrected, rotation_between
from estimator.types import Float, Mode, NavigationState

SIZE = 10
_P, _V, _A, _G = slice(0, 3), slice(3, 6), slice(6, 9), slice(9, 10)
GRAVITY_M_S2 = 9.81
MAX_GAP_US = 1_500_000
# A correction beyond it says that the filter had been wrong of itself: its covariances carry nothing back.
CONTRADICTION_SIGMAS = 4.0
NEAREST_US = 150_000
MOST_KNOWN = 0.99
_TINY = 1e-12
_LEAST_M2 = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class Smoothed:
    """What later measurements say of past states: times (n,), corrections (n, 10), and by how much their covariances
    shrink (n, 10, 10). ``reach`` (n,) is what a metre of horizontal correction at the end would still move each.
    """

    t_us: Float
    after: Sequence[NavigationState]
    correction: Float
    known: Float
    reach: Float

    def reach_at(self, t_us: int) -> float:
        """``reach`` of a time, 0 where it is not kept."""
        nearest = self._nearest(t_us)
        return 0.0 if nearest is None else float(self.reach[nearest])

    def at(self, t_us: int, frame: LocalFrame, *, camera_is_fixed: bool) -> NavigationState | None:
        """The corrected state of a picture's exposure; None where the filter's own was not kept.

        A camera that is not fixed to the vehicle keeps its attitude: its gimbal reports that by itself.
        """
        nearest = self._nearest(t_us)
        if nearest is None:
            return None
        state, d, known = self.after[nearest], self.correction[nearest], self.known[nearest]
        if state.t_us != t_us:
            way = state.vel_ned_m_s * ((t_us - state.t_us) / 1e6)
            state = replace(state, pos_ned_m=state.pos_ned_m + way)
        return _moved(state, t_us, d, known, frame, camera_is_fixed)

    def _nearest(self, t_us: int) -> int | None:
        if not len(self.t_us):
            return None
        nearest = int(np.argmin(np.abs(self.t_us - t_us)))
        return nearest if abs(self.t_us[nearest] - t_us) <= NEAREST_US else None


def smooth(kept: Sequence[Corrected], noise: ProcessNoise) -> Smoothed:
    """Carry the corrections of states in order of time back to those before them."""
    usable = [each for each in kept if each.before.cov_motion is not None and each.after.cov_motion is not None]
    count = len(usable)
    d, known = np.zeros((count, SIZE)), np.zeros((count, SIZE, SIZE))
    reach, chain = np.ones(count), np.eye(SIZE)
    for k in range(count - 2, -1, -1):
        now, then = usable[k].after, usable[k + 1]
        gain = _gain(now, then.before, noise)
        if gain is None or _contradicts(then):
            chain = np.zeros((SIZE, SIZE))
            reach[k] = 0.0
            continue
        chain = gain @ chain
        reach[k] = np.linalg.norm(chain[:2, :2], 2)
        known_after = known[k + 1] + _positive(_cov(then.before) - _cov(then.after), _cov(then.before))
        d[k] = gain @ (d[k + 1] + _between(then.before, then.after))
        known[k] = _at_most(gain @ known_after @ gain.T, _cov(now))
    times = np.array([each.after.t_us for each in usable], dtype=np.float64)
    return Smoothed(times, [each.after for each in usable], d, known, reach)


def _gain(now: NavigationState, then: NavigationState, noise: ProcessNoise) -> Float | None:
    """What a correction of the prediction ``then`` makes of ``now`` (10, 10); None where the one is no other's next."""
    span_us = then.t_us - now.t_us
    if not 0 <= span_us <= MAX_GAP_US or now.mode is Mode.LOST:
        return None
    Phi, Q = _transition(now, then, span_us / 1e6, noise)
    P = _cov(now)
    carried = Phi @ P
    predicted = carried @ Phi.T + Q
    predicted += _positive(_cov(then) - predicted, _cov(then))
    scale = np.sqrt(np.diag(predicted)) + _TINY
    scaled = predicted / scale[:, None] / scale + 1e-9 * np.eye(SIZE)
    gain: Float = np.linalg.solve(scaled, carried / scale[:, None]).T / scale
    return gain


def _transition(now: NavigationState, then: NavigationState, dt_s: float, noise: ProcessNoise) -> tuple[Float, Float]:
    Phi, Q = np.eye(SIZE), np.zeros((SIZE, SIZE))
    Phi[_P, _V] = np.eye(3) * dt_s
    diagonal = np.einsum("ii->i", Q)
    if now.process_model == "inertial":
        gained = then.vel_ned_m_s - now.vel_ned_m_s - np.array([0.0, 0.0, GRAVITY_M_S2 * dt_s])
        Phi[_V, _A] = -skew(gained)
        Phi[_P, _A] = -skew(gained) * (0.5 * dt_s)
        diagonal[_V] = noise.accelerometer_m_s2_rt_s**2 * dt_s
        diagonal[_A] = noise.gyroscope_rad_rt_s**2 * dt_s
        diagonal[_P] = noise.accelerometer_m_s2_rt_s**2 * dt_s**3 / 3.0
        return Phi, Q
    decay = float(np.exp(-dt_s / noise.attitude_bias_time_s))
    Phi[_A, _A] *= decay
    manoeuvre = np.square(noise.manoeuvre_m_s2_rt_s)
    diagonal[_V] = manoeuvre * dt_s
    diagonal[_P] = manoeuvre * dt_s**3 / 3.0
    diagonal[_A] = np.square(noise.attitude_bias_std_rad) * (1.0 - decay**2)
    return Phi, Q


def _between(before: NavigationState, after: NavigationState) -> Float:
    return np.concatenate((
        after.pos_ned_m - before.pos_ned_m, after.vel_ned_m_s - before.vel_ned_m_s,
        rotation_between(before.q_ned_from_body, after.q_ned_from_body),
        [after.ground_bias_m - before.ground_bias_m],
    ))  # fmt: skip


def _contradicts(each: Corrected) -> bool:
    moved = (each.after.pos_ned_m - each.before.pos_ned_m)[:2]
    cov = each.before.cov_pos_ned_m2[:2, :2]
    return bool(moved @ np.linalg.solve(cov, moved) > CONTRADICTION_SIGMAS**2)


def _cov(state: NavigationState) -> Float:
    if state.cov_motion is None:
        message = "a state without the joint covariance of its motion cannot be smoothed"
        raise ValueError(message)
    return state.cov_motion


def _positive(matrix: Float, like: Float) -> Float:
    """The part of a symmetric matrix that is not negative, its rows scaled as those of a covariance ``like`` it."""
    scale = np.sqrt(np.maximum(np.diag(like), 0.0)) + _TINY
    scaled = matrix / scale[:, None] / scale
    values, axes = np.linalg.eigh(0.5 * (scaled + scaled.T))
    clipped: Float = (axes * np.maximum(values, 0.0)) @ axes.T
    return clipped * scale[:, None] * scale


def _at_most(known: Float, cov: Float) -> Float:
    """``known`` with no more of any direction of ``cov`` than ``MOST_KNOWN``."""
    scale = np.sqrt(np.maximum(np.diag(cov), 0.0)) + _TINY
    values, axes = np.linalg.eigh(0.5 * (cov + cov.T) / scale[:, None] / scale)
    root = axes * np.sqrt(np.maximum(values, 1e-9))
    white = np.linalg.solve(root, np.linalg.solve(root, known / scale[:, None] / scale).T)
    shares, ways = np.linalg.eigh(0.5 * (white + white.T))
    back = scale[:, None] * (root @ ways)
    limited: Float = (back * np.clip(shares, 0.0, MOST_KNOWN)) @ back.T
    return limited


def _excess(d: Float, known: Float) -> float:
    """How many times larger the square of a horizontal correction is than the filter's covariances have it, 1 or more.

    A filter that drifted faster than it said has left as much more unknown.
    """
    cov = known[:2, :2] + _LEAST_M2 * np.eye(2)
    return max(1.0, 0.5 * float(d[:2] @ np.linalg.solve(cov, d[:2])))


def _moved(
    state: NavigationState, t_us: int, d: Float, known: Float, frame: LocalFrame, camera_is_fixed: bool
) -> NavigationState:
    pos = state.pos_ned_m + d[_P]
    lat, lon, alt = frame.geodetic_from_ned(pos)
    turn = q_from_rotvec(d[_A])
    excess = _excess(d, known)
    # camera position, camera rotation, ground bias, out of the ten
    pick = np.zeros((7, SIZE))
    pick[:3, _P], pick[6, 9] = np.eye(3), 1.0
    q_camera = state.q_ned_from_camera
    if camera_is_fixed:
        pick[3:6, _A] = np.eye(3)
        q_camera = q_normalise(q_multiply(turn, q_camera))
    joint = np.zeros((7, 7))
    joint[:6, :6] = state.cov_camera_pose
    if state.cov_ground_bias is not None:
        joint[6] = joint[:, 6] = state.cov_ground_bias
    joint = excess * (joint - _at_most(pick @ known @ pick.T, joint))
    cov = excess * (_cov(state) - known)
    return replace(
        state, t_us=t_us, lat_rad=float(lat), lon_rad=float(lon), alt_amsl_m=float(alt), pos_ned_m=pos,
        alt_agl_m=state.alt_agl_m + float(d[9] - d[2]), vel_ned_m_s=state.vel_ned_m_s + d[_V],
        q_ned_from_body=q_normalise(q_multiply(turn, state.q_ned_from_body)), q_ned_from_camera=q_camera,
        cov_pos_ned_m2=cov[_P, _P], cov_vel_ned_m2_s2=cov[_V, _V], cov_attitude_rad2=cov[_A, _A], cov_motion=cov,
        cov_camera_pose=joint[:6, :6], ground_bias_m=state.ground_bias_m + float(d[9]),
        cov_ground_bias=None if state.cov_ground_bias is None else joint[6],
    )  # fmt: skip
