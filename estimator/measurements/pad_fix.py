"""A landing pad in a picture as a measurement of where the camera is from it, and how it is turned.

Pad and camera are both estimated: what a picture tells is pad in camera, R = camera_from_ned ned_from_pad and
t = camera_from_ned (pad - camera), in the terms of `estimator.landing.pose`: a small rotation w about the camera's axes
and a shift of t. Only what the edges say counts. The tilt that helped to find them is the filter's own and would count
twice.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.filters.nominal import PadPlace
from estimator.geometry.rotation import matrix_from_q, q_from_matrix, rotvec_from_q, skew
from estimator.landing.pose import PadPose, Solution
from estimator.measurements.camera_attitude import CameraAttitude
from estimator.measurements.innovation import Innovation
from estimator.types import Float

_UNTOLD_RAD = 0.5
"""As little is known, beside the edges, of a turn; of a shift it is the range. So that their covariance exists."""


@dataclass(frozen=True, slots=True)
class PadNoise:
    """What a picture of the pad errs by beside what its edges show.

    ``edge_factor`` is on the sigma of an edge as if it stood for itself. Beyond 8 m neighbours err alike three times as
    much, by encoder and print, but not in the pose's directions: so counted, errors of single pictures are one sigma
    from 15 m to the ground (NEES of 0.8 to 1.1 a number beyond 8 m and 1.1 to 1.9 below, with 1.0; flights 301 to 303).
    ``alike_s`` is how long lens, print and encoder draw edges alike, so that pictures closer in time say it once.
    ``slew_timing_s`` is how far the report of a gimbal that turns is off in time.
    ``direction_std_rad`` and ``range_share`` are of the camera's calibration: where a pixel looks, and focal length.
    """

    edge_factor: float = 1.15
    alike_s: float = 0.4
    slew_timing_s: float = 0.02
    direction_std_rad: float = 1e-4
    range_share: float = 5e-4

    def alike(self, since_s: float) -> float:
        """How many pictures in a row, so far apart in time, say the same once."""
        return 1.0 + 2.0 * self.alike_s / max(since_s, 1e-3) if since_s < 4.0 * self.alike_s else 1.0


def foreseen(pad: PadPlace, camera: CameraAttitude, camera_pos_ned_m: Float) -> PadPose:
    """The pad in the camera frame by the estimate."""
    camera_from_ned = camera.ned_from_camera.T
    return PadPose(
        camera_from_ned @ matrix_from_q(pad.q_ned_from_pad), camera_from_ned @ (pad.pos_ned_m - camera_pos_ned_m)
    )


def by_states(eskf: ErrorStateFilter, pad: PadPlace, camera: CameraAttitude, camera_pos_ned_m: Float) -> Float:
    """Jacobian (6, n) of the pad in the camera frame, (w, t).

    With errors about NED of camera c and pad p: R_true = R_c^T Exp(p - c) R_p, and t = R_c^T Exp(-c) d changes by
    R_c^T (d x c). The lens moves by a x lever where the body turns by a.
    """
    camera_from_ned = camera.ned_from_camera.T
    lever_ned_m = camera_pos_ned_m - eskf.nominal.motion.pos_ned_m
    by_camera_turn = _by_camera_turn(pad, camera, camera_pos_ned_m)
    by_shift = np.vstack((np.zeros((3, 3)), camera_from_ned))
    return eskf.layout.jacobian(
        6,
        position=-by_shift,
        attitude=by_camera_turn @ camera.by_attitude + by_shift @ skew(lever_ned_m),
        boresight=by_camera_turn @ camera.by_boresight,
        pad_position=by_shift,
        pad_rotation=np.vstack((camera_from_ned, np.zeros((3, 3)))),
    )


def _by_camera_turn(pad: PadPlace, camera: CameraAttitude, camera_pos_ned_m: Float) -> Float:
    camera_from_ned = camera.ned_from_camera.T
    return np.vstack((-camera_from_ned, camera_from_ned @ skew(pad.pos_ned_m - camera_pos_ned_m)))


def place(seen: PadPose, camera: CameraAttitude, camera_pos_ned_m: Float) -> PadPlace:
    """Where a pad lies that is seen so, on level ground: of its attitude only the heading is taken from the picture."""
    ned_from_pad = camera.ned_from_camera @ seen.camera_from_pad
    north, east = ned_from_pad[:2, 0] / np.hypot(*ned_from_pad[:2, 0])
    level = np.array(((north, -east, 0.0), (east, north, 0.0), (0.0, 0.0, 1.0)))
    return PadPlace(camera_pos_ned_m + camera.ned_from_camera @ seen.pad_in_camera_m, q_from_matrix(level))


def innovation(
    eskf: ErrorStateFilter, solutions: tuple[Solution, ...], camera: CameraAttitude, camera_pos_ned_m: Float,
    noise: PadNoise, since_s: float,
) -> Innovation | None:  # fmt: skip
    """Innovation of (w, t); None before the pad has been placed.

    Of two poses that the picture does not tell apart each counts by its likelihood under the estimate; what they differ
    by is noise (the moments of their mixture). ``since_s`` is how long ago the last picture of the pad was used.
    """
    pad = eskf.nominal.pad
    if pad is None:
        return None
    expected = foreseen(pad, camera, camera_pos_ned_m)
    H = by_states(eskf, pad, camera, camera_pos_ned_m)
    told = [_by_edges(one, expected, noise) for one in solutions]
    late = _by_camera_turn(pad, camera, camera_pos_ned_m) @ camera.slew_ned_rad_s * noise.slew_timing_s
    z, R_one = told[0]
    if len(told) > 1:
        weights = _weights(solutions, told, H @ eskf.P @ H.T)
        z = np.einsum("i,ij->j", weights, [each for each, _ in told])
        R_one = np.einsum("i,ijk->jk", weights, [R + np.outer(each - z, each - z) for each, R in told])
    R_one = R_one + np.outer(late, late)
    return Innovation(z, H, R_one * noise.alike(since_s), R_one)


def _weights(solutions: tuple[Solution, ...], told: list[tuple[Float, Float]], prior: Float) -> Float:
    """How likely each pose is, by its edges and by the estimate, whose covariance (6, 6) of (w, t) is ``prior``."""
    alike = max(one.inflation for one in solutions) ** 2
    cost = np.array([one.edges_cost / alike for one in solutions])
    cost += [_minus_two_log_likelihood(z, prior + R) for z, R in told]
    weights: Float = np.exp(-0.5 * (cost - cost.min()))
    weights /= weights.sum()
    return weights


def _by_edges(one: Solution, expected: PadPose, noise: PadNoise) -> tuple[Float, Float]:
    """Difference (6,) of a pose to the expected one, as the edges alone have it, and its covariance (6, 6)."""
    turn = one.pose.camera_from_pad @ expected.camera_from_pad.T
    z = np.concatenate(
        (rotvec_from_q(q_from_matrix(turn)), one.pose.pad_in_camera_m - expected.pad_in_camera_m)
    )  # fmt: skip
    range_m = float(np.linalg.norm(one.pose.pad_in_camera_m))
    untold = np.repeat((_UNTOLD_RAD**-2, range_m**-2), 3)
    scale = (one.inflation / noise.edge_factor) ** 2
    cov = np.asarray(np.linalg.inv(one.edges_information * scale + np.diag(untold)), np.float64)
    shared = np.diag(np.square(np.repeat((noise.direction_std_rad, noise.direction_std_rad * range_m), 3)))
    along = one.pose.pad_in_camera_m * noise.range_share
    shared[3:, 3:] += np.outer(along, along)
    return z + cov @ one.edges_pull * scale, cov + shared


def _minus_two_log_likelihood(z: Float, cov: Float) -> float:
    return float(z @ np.linalg.solve(cov, z)) + float(np.linalg.slogdet(cov)[1])
