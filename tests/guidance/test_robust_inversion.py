"""The law on linear plants, where what it shall do is known in closed form."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.linalg import expm

from estimator.types import Float
from guidance.linear_plant import OSPREY_LATERAL, OSPREY_LONGITUDINAL, PUBLISHED_REFERENCE, LinearPlant
from guidance.robust_inversion import RobustInversion, RobustInversionConfig, as_published, baseline

DT_S = 0.005
FREE = np.full(2, np.inf)
CONFIG = RobustInversionConfig(
    input_estimate=OSPREY_LATERAL.input_matrix, feedback_per_s=np.array((10.0, 6.0)), alpha_per_s=np.array((8.0, 5.0)),
    robust=np.array((8.0, 4.0)), boundary=np.array((0.5, 0.5)), input_min=-FREE, input_max=FREE, model=OSPREY_LATERAL,
)  # fmt: skip


def errors(
    config: RobustInversionConfig, plant: LinearPlant, seconds: float = 6.0, push: Float | None = None,
    command: Float | None = None,
) -> Float:  # fmt: skip
    """y - y_m (k, m) of a plant that is pushed by accelerations (n,) of its states from the start on."""
    law, x = RobustInversion(config, PUBLISHED_REFERENCE), np.zeros(len(plant.a))
    n, m = plant.b.shape
    whole = np.zeros((n + m + 1, n + m + 1))
    whole[:n, :n], whole[:n, n : n + m] = plant.a, plant.b
    whole[:n, -1] = np.zeros(n) if push is None else push
    over = expm(whole * DT_S)[:n]
    wanted = np.zeros(m) if command is None else command
    found = []
    for _ in range(round(seconds / DT_S)):
        u = law.step(DT_S, wanted, plant.c @ x, x)
        x = over @ np.concatenate((x, u, (1.0,)))
        found.append(plant.c @ x - law.reference.output)
    return np.array(found)


def test_exact_inversion_follows_the_reference() -> None:
    """No error but of inputs that are held for 5 ms while roll and sideslip grow, of commands of 0.3 and 0.1 rad/s."""
    found = errors(baseline(CONFIG), OSPREY_LATERAL, command=np.array((0.3, 0.1)))
    assert np.abs(found).max() < 0.02
    assert_allclose(found[-1], 0.0, atol=2e-3)


def test_wrong_inversion_leaves_an_error_that_the_robust_law_takes_out() -> None:
    """All inputs work by a third less and roll damping is doubled; yaw is left aside in a lasting roll."""
    a = np.array(OSPREY_LATERAL.a)
    a[1, 1] *= 2.0
    plant = replace(OSPREY_LATERAL, a=a, b=OSPREY_LATERAL.b / 1.5)
    command = np.array((0.3, 0.0))
    left, taken = errors(baseline(CONFIG), plant, command=command), errors(CONFIG, plant, command=command)
    assert abs(left[-1, 0]) > 0.05
    assert abs(taken[-1, 0]) < 0.1 * abs(left[-1, 0])


def test_a_lasting_push_is_balanced_by_integral_and_by_sign() -> None:
    """1 rad/s2 on the roll: the baseline's error settles at 1 / (damped by the model's own) = 1 / 10 rad/s."""
    push = np.array((0.0, 1.0, 0.0, 0.0))
    plain = errors(baseline(CONFIG), OSPREY_LATERAL, push=push)
    assert plain[-1, 0] == pytest.approx(0.1, rel=0.05)
    robust = errors(CONFIG, OSPREY_LATERAL, push=push)
    no_sign = errors(replace(CONFIG, robust=np.zeros(2)), OSPREY_LATERAL, push=push)
    assert abs(robust[-1, 0]) < 2e-3
    assert np.sum(robust[:, 0] ** 2) < 0.7 * np.sum(no_sign[:, 0] ** 2)


def test_published_law_without_its_sign_is_a_proportional_feedback() -> None:
    """Leak and integral cancel: u = -(k_s + 1) W^-1 (e - e_0 exp(-alpha t)), whatever the errors; e_0 is zero here."""
    law = RobustInversion(replace(as_published(CONFIG), robust=np.zeros(2)), PUBLISHED_REFERENCE)
    rng, dt_s = np.random.default_rng(5), 0.0005
    phase = rng.uniform(0.0, 6.0, 2)
    inverse = np.linalg.inv(CONFIG.input_estimate)
    off, size = 0.0, 0.0
    for step in range(4000):
        t_s = step * dt_s
        y = np.sin(np.array((3.0, 2.0)) * t_s + phase) - np.sin(phase)
        error = y - law.reference.output
        u = law.step(dt_s, np.zeros(2), y)
        expected = -inverse @ (CONFIG.feedback_per_s * error)
        off, size = max(off, float(np.abs(u - expected).max())), max(size, float(np.abs(u).max()))
    assert size > 0.1
    # Integrated by Euler's rule, alpha dt / 2 of it.
    assert off < 0.01 * size


def test_published_law_holds_what_its_sign_can_hold() -> None:
    """A push of 0.5 rad/s2 is below beta / alpha = 1: the sign balances it, up to the chatter of a step."""
    plant = LinearPlant(-np.eye(2), np.eye(2), np.eye(2))
    config = replace(as_published(CONFIG), input_estimate=np.eye(2), derivative_time_s=0.005)
    found = errors(config, plant, push=np.array((0.5, 0.0)))
    without = errors(replace(config, robust=np.zeros(2)), plant, push=np.array((0.5, 0.0)))
    assert without[-1, 0] == pytest.approx(0.5 / 11.0, rel=0.01)
    assert np.abs(found[-200:, 0]).max() < 0.1 * without[-1, 0]


def test_inputs_keep_their_limits_and_integrals_wait_there() -> None:
    """A push beyond what the limit can hold, for 3 s, then none: without waiting the integral would last seconds."""
    config = replace(CONFIG, input_estimate=np.eye(2), input_min=-np.ones(2), input_max=np.ones(2), model=None)
    law, x = RobustInversion(config, PUBLISHED_REFERENCE), np.zeros(2)
    after = []
    for step in range(1000):
        u = law.step(DT_S, np.zeros(2), x)
        assert np.abs(u).max() <= 1.0
        push = 5.0 if step < 600 else 0.0
        x = x + DT_S * (-x + u + (push, 0.0))
        after.append(float(x[0]))
    assert after[599] > 3.0
    # 4 m/s2 at most bring it back: 4 exp(-t) - 1 is zero after 1.6 s.
    assert abs(after[-1]) < 0.2
    assert min(after) > -0.3


def test_a_flight_is_its_input() -> None:
    first, second = (errors(CONFIG, OSPREY_LATERAL, 1.0, command=np.array((0.2, 0.0))) for _ in range(2))
    assert_allclose(first, second, rtol=0, atol=0)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"input_estimate": np.ones((2, 2))}, "no inverse"),
        ({"feedback_per_s": np.ones(3)}, r"feedback_per_s must be numbers of shape \(2,\)"),
        ({"alpha_per_s": np.array((math.inf, 1.0))}, "alpha_per_s must be finite"),
        ({"robust": -np.ones(2)}, "robust must not be negative"),
        ({"input_min": np.ones(2)}, "input_min must not be above zero"),
        ({"input_max": -np.ones(2)}, "input_max must not be negative"),
        ({"derivative_time_s": 0.0}, "derivative_time_s must be positive"),
        ({"leak": True, "integral": False}, "leaves nothing of the law"),
    ],
)
def test_bad_settings_are_named(change: dict[str, Any], message: str) -> None:
    with pytest.raises(ValueError, match=message):
        replace(CONFIG, **change)


def test_bad_steps_are_named() -> None:
    law = RobustInversion(CONFIG, PUBLISHED_REFERENCE)
    with pytest.raises(ValueError, match="output must be 2"):
        law.step(DT_S, np.zeros(2), np.array((math.nan, 0.0)), np.zeros(4))
    with pytest.raises(ValueError, match="state must be 4"):
        law.step(DT_S, np.zeros(2), np.zeros(2))
    with pytest.raises(ValueError, match="dt_s"):
        law.step(1.0, np.zeros(2), np.zeros(2), np.zeros(4))
    one = LinearPlant(-np.eye(1), np.eye(1), np.eye(1))
    with pytest.raises(ValueError, match="the model has 1 inputs"):
        replace(CONFIG, model=one)


def test_the_longitudinal_pair_is_controlled_alike() -> None:
    """V's command of 2 m/s is followed within a decimetre, thrust in newtons beside elevator in radians."""
    config = replace(
        CONFIG, input_estimate=OSPREY_LONGITUDINAL.input_matrix, feedback_per_s=np.array((10.0, 1.0)),
        alpha_per_s=np.array((8.0, 1.5)), robust=np.array((8.0, 2.0)), boundary=np.array((0.5, 1.0)),
        model=OSPREY_LONGITUDINAL,
    )  # fmt: skip
    found = errors(config, OSPREY_LONGITUDINAL, command=np.array((0.0, 2.0)))
    assert np.abs(found[:, 1]).max() < 0.1
    assert np.abs(found[:, 0]).max() < 0.01
