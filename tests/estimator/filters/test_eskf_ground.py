"""Errors of ground model and imagery: they fade with the way flown, and pictures tell how large they are."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.eskf import ErrorStateFilter, ProcessNoise
from estimator.filters.strapdown import Motion
from tests.estimator.filters.eskf_cases import EARTH, FULL, nominal_state, quiet_filter


def _advance(eskf: ErrorStateFilter, model: str, dt_s: float) -> None:
    if model == "inertial":
        eskf.predict_inertial(np.zeros(3), np.array([0.0, 0.0, -EARTH.gravity_m_s2]), dt_s)
    else:
        eskf.predict_attitude_driven(np.array([1.0, 0.0, 0.0, 0.0]), np.zeros(3), 60.0, dt_s)


def _cruising(vel_ned_m_s: tuple[float, float, float], ground_m2: float, map_m2: float) -> ErrorStateFilter:
    """Level flight with a ground bias of 2 and -1 m, a map bias of 0.6 and -0.8 m, and their variances."""
    P = np.diag(np.full(FULL.size, 1e-12))
    P[FULL.slices["ground_bias"], FULL.slices["ground_bias"]] = np.eye(2) * ground_m2
    P[FULL.slices["map_bias"], FULL.slices["map_bias"]] = np.eye(2) * map_m2
    motion = Motion(np.array([0.0, 0.0, -100.0]), np.array(vel_ned_m_s), np.array([1.0, 0.0, 0.0, 0.0]))
    nominal = replace(
        nominal_state(),
        motion=motion,
        accelerometer_bias_m_s2=np.zeros(3),
        gyroscope_bias_rad_s=np.zeros(3),
        ground_biases_m=np.array([2.0, -1.0]),
        map_bias_ne_m=np.array([0.6, -0.8]),
    )
    noise = ProcessNoise(
        ground_bias_std_m=(3.0, 1.5), ground_bias_length_m=(40.0, 1000.0), map_bias_length_m=80.0
    )  # fmt: skip
    eskf = ErrorStateFilter(nominal, P, FULL, EARTH, noise)
    eskf.map_bias_std_m = 0.7
    return eskf


@pytest.mark.parametrize("model", ["inertial", "attitude"])
def test_ground_and_map_bias_fade_with_the_distance_flown(model: str) -> None:
    """Twenty metres over the ground at 3-4-5 speed: exp(-20/40), exp(-20/1000) and exp(-20/80) are left."""
    eskf = _cruising((3.0, 4.0, 0.0), 0.0, 0.0)

    for _ in range(80):
        _advance(eskf, model, 0.05)

    # the speed itself drifts by a few centimetres per second as the Earth turns below the inertial prediction
    assert_allclose(eskf.nominal.ground_biases_m, [2.0 * np.exp(-0.5), -np.exp(-0.02)], rtol=1e-3)
    assert eskf.nominal.ground_bias_m == pytest.approx(float(eskf.nominal.ground_biases_m.sum()))
    assert_allclose(eskf.nominal.map_bias_ne_m, np.array([0.6, -0.8]) * np.exp(-0.25), rtol=1e-3)
    # what was known exactly becomes unknown by as much: sigma^2 (1 - exp(-2 d / L))
    assert_allclose(
        np.diag(eskf.cov("ground_bias")), [9.0 * (1.0 - np.exp(-1.0)), 2.25 * (1.0 - np.exp(-0.04))], rtol=2e-3
    )
    assert_allclose(np.diag(eskf.cov("map_bias")), 0.49 * (1.0 - np.exp(-0.5)), rtol=2e-3)


@pytest.mark.parametrize("model", ["inertial", "attitude"])
@pytest.mark.parametrize("dt_s", [0.02, 0.1])
def test_ground_and_map_bias_keep_their_stationary_variance(model: str, dt_s: float) -> None:
    """Started with their own variance, or from any other after many lengths, whatever the step."""
    at_rest = _cruising((18.0, 0.0, -1.0), 9.0, 0.49)
    elsewhere = _cruising((18.0, 0.0, -1.0), 100.0, 25.0)

    for _ in range(int(40.0 / dt_s)):
        _advance(at_rest, model, dt_s)
        _advance(elsewhere, model, dt_s)

    assert at_rest.cov("ground_bias")[0, 0] == pytest.approx(9.0, rel=1e-6)
    assert_allclose(at_rest.cov("map_bias"), np.eye(2) * 0.49, atol=1e-6)
    # 720 m are 18 and 9 lengths: exp(-18) of the excess is left
    assert elsewhere.cov("ground_bias")[0, 0] == pytest.approx(9.0, rel=1e-4)
    assert_allclose(np.diag(elsewhere.cov("map_bias")), 0.49, rtol=1e-4)
    # the long one is still on its way from 100 to 2.25: exp(-2 x 0.72) of the difference
    assert elsewhere.cov("ground_bias")[1, 1] == pytest.approx(2.25 + 97.75 * np.exp(-1.44), rel=1e-3)


@pytest.mark.parametrize("vertical_m_s", [0.0, -3.0])
def test_ground_and_map_bias_stay_in_a_hover(vertical_m_s: float) -> None:
    """Ten minutes in one place, or climbing above it: the ground below is the same, and so is what is known of it."""
    eskf = _cruising((0.0, 0.0, vertical_m_s), 0.04, 0.01)

    for _ in range(6000):
        _advance(eskf, "attitude", 0.1)

    assert_allclose(eskf.nominal.ground_biases_m, [2.0, -1.0])
    assert_allclose(eskf.nominal.map_bias_ne_m, [0.6, -0.8])
    assert_allclose(eskf.cov("ground_bias"), np.eye(2) * 0.04)
    assert_allclose(eskf.cov("map_bias"), np.eye(2) * 0.01)


def test_what_is_learnt_of_position_through_the_map_fades_with_its_bias() -> None:
    """
    A perfect fix leaves position and map bias correlated; flown on, the correlation fades, the position's own stays.

    Prior variances 4 and 0.49: after the fix both are 4 x 0.49 / 4.49, fully anticorrelated.
    """
    eskf = _cruising((10.0, 0.0, 0.0), 0.0, 0.49)
    eskf.inflate("position", 4.0)
    H = FULL.jacobian(2, position=np.eye(3)[:2], map_bias=np.eye(2))
    eskf.update(np.zeros(2), H, np.eye(2) * 1e-8)
    left = 4.0 * 0.49 / 4.49
    assert eskf.cov("position")[0, 0] == pytest.approx(left, rel=1e-3)
    assert eskf.cov("position", "map_bias")[0, 0] == pytest.approx(-left, rel=1e-3)

    for _ in range(80):
        eskf.predict_inertial(np.zeros(3), np.array([0.0, 0.0, -EARTH.gravity_m_s2]), 0.1)

    assert eskf.cov("position", "map_bias")[0, 0] == pytest.approx(-left * np.exp(-1.0), rel=0.01)
    assert eskf.cov("map_bias")[0, 0] == pytest.approx(0.49 + (left - 0.49) * np.exp(-2.0), rel=0.01)
    assert eskf.cov("position")[0, 0] >= left


def test_the_regions_displacement_fades_over_its_own_length() -> None:
    """Twenty metres at 3-4-5 speed leave exp(-20/1500) of it; of the local one as much as the footprint says."""
    eskf = _cruising((3.0, 4.0, 0.0), 0.0, 0.0)
    eskf.map_region_std_m = 0.9
    eskf.see_map_over(40.0)
    part = FULL.slices["map_region"]
    eskf.P[part, part] = 0.0
    eskf.nominal = replace(eskf.nominal, map_region_ne_m=np.array([1.2, -0.4]))

    for _ in range(80):
        _advance(eskf, "attitude", 0.05)

    assert_allclose(eskf.nominal.map_region_ne_m, np.array([1.2, -0.4]) * np.exp(-20.0 / 1500.0), rtol=1e-6)
    assert_allclose(np.diag(eskf.cov("map_region")), 0.81 * (1.0 - np.exp(-40.0 / 1500.0)), rtol=1e-6)
    assert_allclose(eskf.nominal.map_bias_ne_m, np.array([0.6, -0.8]) * np.exp(-0.5), rtol=1e-6)


def test_a_regions_displacement_that_grows_counts_at_once_and_one_that_wavers_only_once() -> None:
    eskf = quiet_filter(np.zeros((FULL.size, FULL.size)))

    for std_m in (0.5, 0.3, 0.5, 0.4, 0.8):
        eskf.map_region_std_m = std_m

    assert_allclose(eskf.cov("map_region"), 0.64 * np.eye(2), rtol=1e-12)
    assert np.count_nonzero(eskf.P) == 2
