"""How a position measured from a picture behaves with height, with and without the attitude in its Jacobian.

The thesis's question of section 5.8.5 (figures 5.15 and 5.16): the attitude that the filter estimates is used to make
the position that updates it, and the loop swings the more the higher the aircraft. As there, inertial readings are
drawn and pictures are not: the matched ground point is where the true camera sees it, with noise, and the filter's own
code does the rest.
"""

from __future__ import annotations

import numpy as np

from estimator.filters.eskf import ErrorStateFilter, ProcessNoise
from estimator.filters.initialise import FirstEstimate, InitialGuess, aligned
from estimator.filters.nominal import Layout
from estimator.filters.strapdown import EarthModel, Motion
from estimator.geometry.camera import Mount
from estimator.geometry.rotation import matrix_from_q, q_conjugate, q_from_rotvec, q_multiply, rotvec_from_q
from estimator.measurements import terrain_fix
from estimator.measurements.camera_attitude import CameraAttitudeModel, Gimbal
from estimator.registration.calibration import calibration_of
from estimator.types import Float

GROUPS = ("position", "velocity", "attitude", "accelerometer_bias", "gyroscope_bias")
INERTIAL_HZ, FIX_HZ = 50, 4
REFERENCE_GSD_M, FOCAL_PX = 0.5, 554.0
"""A map of half a metre, and a camera of 640 pixels and 60 degrees across."""
GYRO_RAD_RT_S = 3.5e-3 / np.sqrt(INERTIAL_HZ)
FORCE_M_S2_RT_S = 0.05 / np.sqrt(INERTIAL_HZ)
GYRO_BIAS_RAD_S, FORCE_BIAS_M_S2 = 1.7e-3, 0.127
"""Table 5.1 of the thesis: 0.1 deg/s and 13 mg at the most."""
ATTITUDE_STD_RAD = (0.01, 0.01, 0.02)
DIVERGED_RAD = 0.35


def fix_std_m(height_m: float) -> float:
    """What the calibration in use states of the map's local error, at the resolution that a picture is matched at."""
    return calibration_of("double_angle").likelihood.local_std_m(max(REFERENCE_GSD_M, height_m / FOCAL_PX))


def hover(seed: int, height_m: float, coupled: bool, seconds: float) -> dict[str, float]:
    """Errors of a filter in a hover at a height: rms position (m), its share of the height, rms tilt (deg), NEES.

    Figures are of the second half. Where the tilt was wrong by more than 20 degrees once, ``diverged`` is one and
    there are no others.
    """
    rng = np.random.default_rng([seed, round(height_m)])
    truth_q = q_from_rotvec(np.array([0.0, 0.0, rng.uniform(-np.pi, np.pi)]))
    truth_pos = np.array([0.0, 0.0, -height_m])
    eskf = _started(rng, truth_pos, truth_q)
    model = CameraAttitudeModel(Mount(0.0, -np.pi / 2, 0.0, np.zeros(3)), Gimbal.FIXED)
    gyro_bias = rng.uniform(-1.0, 1.0, 3) * GYRO_BIAS_RAD_S
    force_bias = rng.uniform(-1.0, 1.0, 3) * FORCE_BIAS_M_S2
    earth = EarthModel.at(1.0, 100.0)
    true_force = matrix_from_q(truth_q).T @ np.array([0.0, 0.0, -earth.gravity_m_s2])
    true_rate = matrix_from_q(truth_q).T @ earth.rate_ned_rad_s
    errors, tilts, nees = [], [], []
    steps = round(seconds * INERTIAL_HZ)
    for step in range(1, steps + 1):
        rate = true_rate + gyro_bias + rng.normal(0.0, GYRO_RAD_RT_S * np.sqrt(INERTIAL_HZ), 3)
        force = true_force + force_bias + rng.normal(0.0, FORCE_M_S2_RT_S * np.sqrt(INERTIAL_HZ), 3)
        eskf.predict_inertial(rate, force, 1.0 / INERTIAL_HZ)
        if step % round(INERTIAL_HZ / FIX_HZ) == 0:
            _fix(eskf, model, truth_pos, truth_q, coupled, rng)
        turn = rotvec_from_q(q_multiply(truth_q, q_conjugate(eskf.nominal.motion.q_ned_from_body)))
        tilt = float(np.hypot(turn[0], turn[1]))
        if not tilt < DIVERGED_RAD:
            return {"diverged": 1.0}
        if step > steps // 2:
            error = (truth_pos - eskf.nominal.motion.pos_ned_m)[:2]
            errors.append(float(error @ error))
            tilts.append(tilt**2)
            nees.append(float(error @ np.linalg.solve(eskf.cov("position")[:2, :2], error)) / 2.0)
    rms_m = float(np.sqrt(np.mean(errors)))
    return {
        "rms_m": rms_m,
        "share": rms_m / height_m,
        "tilt_rms_deg": float(np.degrees(np.sqrt(np.mean(tilts)))),
        "nees_per_dof": float(np.mean(nees)),
        "diverged": 0.0,
    }


def _started(rng: np.random.Generator, truth_pos: Float, truth_q: Float) -> ErrorStateFilter:
    """A filter that is wrong by what it believes."""
    noise = ProcessNoise(
        accelerometer_m_s2_rt_s=FORCE_M_S2_RT_S, gyroscope_rad_rt_s=GYRO_RAD_RT_S,
        accelerometer_bias_m_s2_rt_s=1e-4, gyroscope_bias_rad_s_rt_s=1e-6,
    )  # fmt: skip
    q = q_multiply(q_from_rotvec(rng.normal(0.0, ATTITUDE_STD_RAD)), truth_q)
    first = FirstEstimate(
        Motion(truth_pos + rng.normal(0.0, 2.0, 3), rng.normal(0.0, 0.3, 3), q),
        np.full(3, 2.0), np.full(3, 0.3), 0.0, 1.0,
    )  # fmt: skip
    guess = InitialGuess(
        attitude_std_rad=ATTITUDE_STD_RAD, accelerometer_bias_std_m_s2=FORCE_BIAS_M_S2 / np.sqrt(3.0),
        gyroscope_bias_std_rad_s=GYRO_BIAS_RAD_S / np.sqrt(3.0),
    )  # fmt: skip
    layout = Layout.of(GROUPS)
    nominal, P = aligned(first, layout, guess, noise)
    return ErrorStateFilter(nominal, P, layout, EarthModel.at(1.0, 100.0), noise)


def _fix(
    eskf: ErrorStateFilter, model: CameraAttitudeModel, truth_pos: Float, truth_q: Float, coupled: bool,
    rng: np.random.Generator,
) -> None:  # fmt: skip
    """The ground point on the optical axis, where the map has it, less where the filter expects it; and the height."""
    std_m = fix_std_m(-float(truth_pos[2]))
    seen = _aim(truth_pos, model.at(0, truth_q, np.zeros(3)).ned_from_camera) + rng.normal(0.0, std_m, 2)
    motion = eskf.nominal.motion
    camera = model.at(0, motion.q_ned_from_body, np.zeros(3))
    expected = _aim(motion.pos_ned_m, camera.ned_from_camera)
    T = terrain_fix.apparent_pose_jacobian(eskf, camera)
    if not coupled:
        T[2:] = 0.0
    centre = np.array([expected[0], expected[1], 0.0])
    H = terrain_fix.centre_by_pose(centre, motion.pos_ned_m) @ T
    eskf.update(seen - expected, H, np.eye(2) * std_m**2)
    down = eskf.layout.jacobian(1, position=np.array([[0.0, 0.0, 1.0]]))
    height_noise = rng.normal(0.0, 1.0)
    eskf.update(np.array([truth_pos[2] + height_noise - eskf.nominal.motion.pos_ned_m[2]]), down, np.eye(1))


def _aim(pos_ned_m: Float, ned_from_camera: Float) -> Float:
    """Where the optical axis meets level ground at zero, north and east; as far as twenty heights where it does not."""
    axis = ned_from_camera[:, 2]
    found: Float = pos_ned_m[:2] - pos_ned_m[2] * axis[:2] / max(float(axis[2]), 0.05)
    return found
