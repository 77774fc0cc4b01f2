"""Reference models against SciPy, and what is refused."""

from __future__ import annotations

import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy import signal

from guidance.linear_plant import (
    OSPREY_LATERAL,
    OSPREY_LONGITUDINAL,
    PUBLISHED_INPUT_LATERAL,
    PUBLISHED_INPUT_LONGITUDINAL,
    PUBLISHED_REFERENCE,
    LinearPlant,
    Reference,
    ReferenceModel,
)


@pytest.mark.parametrize("dt_s", [0.01, 0.1])
def test_reference_is_the_step_response_of_its_pairs(dt_s: float) -> None:
    """By SciPy, scaled to settle at one: numerator b (s - a22) of each pair."""
    reference = Reference(PUBLISHED_REFERENCE)
    count = round(5.0 / dt_s)
    found = []
    for _ in range(count):
        reference.step(dt_s, np.array((1.0, -2.0)))
        found.append(reference.output)
    t_s = dt_s * np.arange(count + 1)
    _, fast = signal.step(signal.lti([10.0, 100.0], [1.0, 14.0, 100.0]), T=t_s)
    _, slow = signal.step(signal.lti([0.4, 0.88], [1.0, 1.6, 0.88]), T=t_s)
    assert_allclose(np.array(found), np.column_stack((fast, -2.0 * slow))[1:], atol=1e-9)


def test_rate_is_the_derivative_of_the_output() -> None:
    reference, command = Reference(PUBLISHED_REFERENCE), np.array((0.3, 1.0))
    for _ in range(20):
        reference.step(0.01, command)
    before, rate = reference.output, reference.output_rate(command)
    reference.step(1e-6, command)
    assert_allclose((reference.output - before) / 1e-6, rate, rtol=1e-4)


def test_estimates_of_the_print_are_diagonally_dominant() -> None:
    """Assumption 3 (3-31): the least of the diagonal of Omega W^-1 is above the size of the rest."""
    for plant, estimate in (
        (OSPREY_LONGITUDINAL, PUBLISHED_INPUT_LONGITUDINAL),
        (OSPREY_LATERAL, PUBLISHED_INPUT_LATERAL),
    ):
        product = plant.input_matrix @ np.linalg.inv(estimate)
        rest = product - np.diag(np.diag(product))
        assert 0.5 < np.diag(product).min() < 0.7
        assert np.linalg.norm(rest, 2) < 0.3 * np.diag(product).min()


def test_input_matrices_are_per_radian() -> None:
    assert OSPREY_LONGITUDINAL.input_matrix[0, 0] == pytest.approx(0.98 * 180.0 / math.pi)
    assert OSPREY_LATERAL.input_matrix[1, 1] == pytest.approx(0.17 * 180.0 / math.pi)


def test_what_cannot_be_followed_is_refused() -> None:
    one = np.eye(1)
    with pytest.raises(ValueError, match="C B must have an inverse"):
        LinearPlant(np.zeros((2, 2)), np.array(((0.0,), (1.0,))), np.array(((1.0, 0.0),)))
    with pytest.raises(ValueError, match="not \\(n, n\\)"):
        LinearPlant(one, np.ones((2, 1)), np.ones((1, 2)))
    with pytest.raises(ValueError, match="matrix of finite"):
        LinearPlant(math.nan * one, one, one)
    with pytest.raises(ValueError, match="not stable"):
        ReferenceModel(np.array((((1.0, 0.0), (0.0, -1.0)),)), np.ones(1))
    with pytest.raises(ValueError, match="side of its command"):
        ReferenceModel(np.array((((-1.0, 0.0), (0.0, -1.0)),)), -np.ones(1))
    with pytest.raises(ValueError, match="must be finite"):
        ReferenceModel(np.zeros((1, 2, 3)), np.ones(1))
    reference = Reference(PUBLISHED_REFERENCE)
    with pytest.raises(ValueError, match="2 finite numbers"):
        reference.step(0.01, np.zeros(3))
    with pytest.raises(ValueError, match="dt_s"):
        reference.step(0.0, np.zeros(2))
