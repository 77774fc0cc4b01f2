"""The smoother against all measurements taken at once, and on errors that are drawn."""

from __future__ import annotations

import math

import numpy as np
import pytest

from estimator.filters.eskf import ProcessNoise
from estimator.geometry.local import LocalFrame
from estimator.history import Corrected
from estimator.smoothing import SIZE, smooth
from estimator.types import Float, Mode, NavigationState

FRAME = LocalFrame(math.radians(47.0), math.radians(8.0), 400.0)
NOISE = ProcessNoise()
DT_S, STEPS = 0.1, 60
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
Q_M2_S3 = np.square(NOISE.manoeuvre_m_s2_rt_s)


def state(t_us: int, x: Float, P: Float) -> NavigationState:
    """Position and velocity (6,) with covariance (6, 6); attitude and ground as good as known."""
    cov = 1e-8 * np.eye(SIZE)
    cov[:6, :6] = P
    pose = 1e-4 * np.eye(6)
    pose[:3, :3] = P[:3, :3]
    lat, lon, alt = FRAME.geodetic_from_ned(x[:3])
    return NavigationState(
        t_us, Mode.VISION, "attitude", float(lat), float(lon), float(alt), 100.0, x[:3], x[3:], LEVEL, LEVEL,
        P[:3, :3], P[3:, 3:], 1e-8 * np.eye(3), pose, 0.0, cov_motion=cov,
    )  # fmt: skip


def transition() -> tuple[Float, Float]:
    F = np.eye(6)
    F[:3, 3:] = DT_S * np.eye(3)
    return F, np.diag(np.concatenate((Q_M2_S3 * DT_S**3 / 3.0, Q_M2_S3 * DT_S)))


def flight(rng: np.random.Generator, fixes: tuple[int, ...]) -> tuple[list[Corrected], Float, Float, Float]:
    """A filter of velocities at every step and places at some: what is kept, truth (n, 6), the batch with its cov."""
    F, Q = transition()
    H_v, R_v, H_p, R_p = np.eye(6)[3:], 0.05 * np.eye(3), np.eye(6)[:3], 0.25 * np.eye(3)
    P = np.diag([1.0, 1.0, 1.0, 0.2, 0.2, 0.2])
    x = np.array([0.0, 0.0, -100.0, 10.0, 0.0, 0.0])
    true = x + rng.normal(size=6) * np.sqrt(np.diag(P))
    # the batch: information about all states together
    size = 6 * STEPS
    information, vector = np.zeros((size, size)), np.zeros(size)
    information[:6, :6] += np.linalg.inv(P)
    vector[:6] += np.linalg.solve(P, x)
    kept, truths = [], []
    for k in range(STEPS):
        if k:
            true = F @ true + rng.normal(size=6) * np.sqrt(np.diag(Q))
            x, P = F @ x, F @ P @ F.T + Q
            here = slice(6 * k - 6, 6 * k + 6)
            both = np.hstack((-F, np.eye(6)))
            information[here, here] += both.T @ np.linalg.inv(Q) @ both
        before = state(int(k * DT_S * 1e6), x, P)
        for H, R, there in ((H_v, R_v, True), (H_p, R_p, k in fixes)):
            if there:
                z = H @ true + rng.multivariate_normal(np.zeros(3), R)
                K = P @ H.T @ np.linalg.inv(H @ P @ H.T + R)
                x, P = x + K @ (z - H @ x), (np.eye(6) - K @ H) @ P
                part = slice(6 * k, 6 * k + 6)
                information[part, part] += H.T @ np.linalg.inv(R) @ H
                vector[part] += H.T @ np.linalg.solve(R, z)
        kept.append(Corrected(before, state(int(k * DT_S * 1e6), x, P)))
        truths.append(true)
    return kept, np.array(truths), np.linalg.solve(information, vector).reshape(STEPS, 6), np.linalg.inv(information)


def test_it_finds_what_all_measurements_at_once_say() -> None:
    kept, _, batch, cov = flight(np.random.default_rng(4), (5, STEPS - 2))

    smoothed = smooth(kept, NOISE)

    for k in range(STEPS):
        found = smoothed.at(int(k * DT_S * 1e6), FRAME, camera_is_fixed=True)
        assert found is not None
        assert found.pos_ned_m == pytest.approx(batch[k, :3], abs=2e-3)
        assert found.vel_ned_m_s == pytest.approx(batch[k, 3:], abs=2e-3)
        own = cov[6 * k : 6 * k + 3, 6 * k : 6 * k + 3]
        # wider where the correction was larger than expected, never narrower
        assert np.linalg.eigvalsh(found.cov_pos_ned_m2 - 0.98 * own)[0] > 0.0


def test_errors_shrink_and_fit_their_sigmas() -> None:
    rng = np.random.default_rng(7)
    errors: dict[str, list[float]] = {"then": [], "later": []}
    nees = []
    for _ in range(60):
        kept, truth, _, _ = flight(rng, (STEPS - 1,))
        middle = STEPS // 2
        later = smooth(kept, NOISE).at(int(middle * DT_S * 1e6), FRAME, camera_is_fixed=True)
        assert later is not None
        for name, found in (("then", kept[middle].after), ("later", later)):
            errors[name].append(float(np.linalg.norm(found.pos_ned_m - truth[middle, :3])))
        error = (later.pos_ned_m - truth[middle, :3])[:2]
        nees.append(float(error @ np.linalg.solve(later.cov_pos_ned_m2[:2, :2], error)) / 2.0)

    assert np.mean(errors["later"]) < 0.75 * np.mean(errors["then"])
    assert 0.4 < np.mean(nees) < 1.3


def test_nothing_is_carried_over_a_contradiction_or_a_gap() -> None:
    kept, _, _, _ = flight(np.random.default_rng(2), ())
    last = kept[-1]
    far = np.concatenate((last.after.pos_ned_m + np.array([80.0, 0.0, 0.0]), last.after.vel_ned_m_s))
    jumped = [*kept[:-1], Corrected(last.before, state(last.after.t_us, far, 0.01 * np.eye(6)))]
    late_us = last.after.t_us + 5_000_000
    gap = [
        *kept[:-1],
        Corrected(state(late_us, far, np.eye(6)), state(late_us, far + 0.5, 0.1 * np.eye(6))),
    ]

    for series in (jumped, gap):
        smoothed = smooth(series, NOISE)
        assert smoothed.correction[STEPS - 2] == pytest.approx(np.zeros(SIZE))
        assert smoothed.reach_at(0) == 0.0


def test_times_that_are_not_kept_have_no_state() -> None:
    kept, _, _, _ = flight(np.random.default_rng(2), ())

    smoothed = smooth(kept, NOISE)

    assert smoothed.at(-1_000_000, FRAME, camera_is_fixed=True) is None
    assert smooth([], NOISE).at(0, FRAME, camera_is_fixed=True) is None
    between = smoothed.at(1_050_000, FRAME, camera_is_fixed=True)
    assert between is not None
    assert between.t_us == 1_050_000


def test_the_camera_of_a_gimbal_keeps_its_attitude() -> None:
    kept, _, _, _ = flight(np.random.default_rng(3), (STEPS - 1,))

    fixed = smooth(kept, NOISE).at(0, FRAME, camera_is_fixed=True)
    free = smooth(kept, NOISE).at(0, FRAME, camera_is_fixed=False)

    assert fixed is not None
    assert free is not None
    assert np.array_equal(free.q_ned_from_camera, kept[0].after.q_ned_from_camera)
    assert free.pos_ned_m == pytest.approx(fixed.pos_ned_m)
