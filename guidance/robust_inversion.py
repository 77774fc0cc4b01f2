"""Dynamic inversion towards a reference model, with the robust integral of the error's sign (RISE). Pure.

Kaiser's thesis (2008), section 3.4. With e = y - y_m (3-15), r = e' + alpha e (3-16) and a constant estimate W of the
input matrix Omega = C B (3-23, 3-27), the published law (3-26) is the integral of

    u' = - alpha u - W^-1 ((k_s + 1) r + beta sgn(r)).

What it is without its sign can be seen at once: (s + alpha) stands on both sides, and u = - (k_s + 1) W^-1 e is left, a
proportional feedback of the output. So the sign alone holds a lasting input; and where noise on r makes the mean of the
sign proportional to r, the same pole and zero cancel again, and the robust term is a second proportional gain.

Two things are different by default here. ``leak`` (the - alpha u) is left out: alpha Omega u in (3-20) is alpha times
e' - C A x - C f + y_m', hence bounded by what the proof bounds anyway, and without the leak (k_s + 1) alpha e is an
integral. And ``model`` inverts A as well: u has the part W^-1 (y_m' - C A x). The sign has a slope within
``boundary``, and integrals wait where an input is at its limit. ``as_published`` is (3-26).

Nothing adapts while it flies: W is constant in the thesis too, which leaves adaptive estimates to future work (p. 38).
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from estimator.geometry.checks import check_step
from estimator.types import Float
from guidance.linear_plant import LinearPlant, Reference, ReferenceModel

_LONGEST_STEP_S = 0.1
_ARRAYS = ("input_estimate", "feedback_per_s", "alpha_per_s", "robust", "boundary", "input_min", "input_max")


@dataclass(frozen=True, slots=True, eq=False)
class RobustInversionConfig:
    """The law of a plant with m inputs and outputs; inputs are deviations from trim.

    Parameters
    ----------
    input_estimate
        W (m, m).
    feedback_per_s
        k_s + 1, (m,).
    alpha_per_s
        alpha, (m,).
    robust
        beta (m,), in the output's unit by s^2; zero is without the sign.
    boundary
        r (m,) at which the sign is all of 1; zero is a sign.
    derivative_time_s
        Of the filter that takes e' from e. The law uses e' within the sign only (remark 3.2).
    input_min, input_max
        Limits (m,) of the inputs; infinity where there is none.
    leak, integral
        Whether u leaks by alpha as in (3-26), and whether what is under the integral sign is integrated: without it
        there is neither (k_s + 1) alpha e nor a sign, and the law is its baseline.
    model
        The plant to be inverted, or None: its A is then left to the feedback.

    Raises
    ------
    ValueError
        Shapes do not belong together, a number is not finite or negative where it cannot be, W has no inverse, an
        input's limits do not hold zero between them, or the leak is asked for without the integral.
    """

    input_estimate: Float
    feedback_per_s: Float
    alpha_per_s: Float
    robust: Float
    boundary: Float
    input_min: Float
    input_max: Float
    derivative_time_s: float = 0.03
    leak: bool = False
    integral: bool = True
    model: LinearPlant | None = None

    def __post_init__(self) -> None:
        m = len(np.atleast_1d(self.input_estimate))
        for name in _ARRAYS:
            value: Float = np.array(getattr(self, name), np.float64)
            shape = (m, m) if name == "input_estimate" else (m,)
            if value.shape != shape or np.any(np.isnan(value)):
                message = f"{name} must be numbers of shape {shape}, not {value}"
                raise ValueError(message)
            limit = name in ("input_min", "input_max")
            if not limit and not np.all(np.isfinite(value)):
                message = f"{name} must be finite, not {value}"
                raise ValueError(message)
            if name not in ("input_estimate", "input_min") and np.any(value < 0.0):
                message = f"{name} must not be negative, not {value}"
                raise ValueError(message)
            object.__setattr__(self, name, value)
        if np.any(self.input_min > 0.0):
            message = f"input_min must not be above zero, the trim, not {self.input_min}"
            raise ValueError(message)
        if np.linalg.matrix_rank(self.input_estimate) < m:
            message = "input_estimate has no inverse"
            raise ValueError(message)
        if not (math.isfinite(self.derivative_time_s) and self.derivative_time_s > 0.0):
            message = f"derivative_time_s must be positive, not {self.derivative_time_s}"
            raise ValueError(message)
        if self.leak and not self.integral:
            message = "a leak without the integral leaves nothing of the law"
            raise ValueError(message)
        if self.model is not None and self.model.b.shape[1] != m:
            message = f"the model has {self.model.b.shape[1]} inputs, the estimate {m}"
            raise ValueError(message)


def as_published(config: RobustInversionConfig) -> RobustInversionConfig:
    """(3-26) with the gains and limits of a configuration."""
    return replace(config, boundary=np.zeros_like(config.boundary), leak=True, integral=True, model=None)


def baseline(config: RobustInversionConfig) -> RobustInversionConfig:
    """The same inversion and feedback without the robust integral."""
    return replace(config, leak=False, integral=False)


class RobustInversion:
    """The law in steps of time."""

    def __init__(self, config: RobustInversionConfig, reference: ReferenceModel) -> None:
        m = len(config.feedback_per_s)
        if len(reference.drive) != m:
            message = f"the reference model has {len(reference.drive)} outputs, the law {m} inputs"
            raise ValueError(message)
        self.config = config
        self.reference = Reference(reference)
        self._inverse: Float = np.asarray(np.linalg.inv(config.input_estimate), np.float64)
        # alpha Omega u is what (3-20) leaves; with unequal alphas it is not Omega alpha u, as written there.
        self._leak: Float = self._inverse @ np.diag(config.alpha_per_s) @ config.input_estimate
        self._integral: Float = np.zeros(m)
        self._error_before: Float | None = None
        self._error_first: Float = np.zeros(m)
        self._rate: Float = np.zeros(m)
        self._input: Float = np.zeros(m)

    def step(self, dt_s: float, command: Float, output: Float, state: Float | None = None) -> Float:
        """Inputs (m,) for the next ``dt_s``, from a command (m,), measured outputs (m,) and the state (n,).

        ``state`` is what the model is inverted at, and is not looked at without one.

        Raises
        ------
        ValueError
            ``dt_s`` is not above 0 and at most 0.1 s, a vector has not its length or is not finite, or the state is
            wanted and missing.
        """
        config = self.config
        check_step(dt_s, _LONGEST_STEP_S)
        if output.shape != self._input.shape or not np.all(np.isfinite(output)):
            message = f"output must be {len(self._input)} finite numbers, not {output}"
            raise ValueError(message)
        # Outputs are of the beginning of the step, and so is the reference they are held against.
        error = output - self.reference.output
        if self._error_before is None:
            self._error_before = self._error_first = error
        share = 1.0 - math.exp(-dt_s / config.derivative_time_s)
        self._rate = self._rate + share * ((error - self._error_before) / dt_s - self._rate)
        self._error_before = error
        feedback = config.feedback_per_s * error
        if config.leak:
            feedback = feedback - config.feedback_per_s * self._error_first
        direct = -self._inverse @ feedback + self._inverted(command, state)
        if config.integral:
            self._integrate(dt_s, error, direct)
        self.reference.step(dt_s, command)
        self._input = np.minimum(np.maximum(direct + self._integral, config.input_min), config.input_max)
        return self._input.copy()

    def _inverted(self, command: Float, state: Float | None) -> Float:
        """W^-1 (y_m' - C A x)."""
        model = self.config.model
        if model is None:
            return np.zeros_like(self._input)
        if state is None or state.shape != (len(model.a),) or not np.all(np.isfinite(state)):
            message = f"state must be {len(model.a)} finite numbers to invert the model at, not {state}"
            raise ValueError(message)
        wanted: Float = self._inverse @ (self.reference.output_rate(command) - model.c @ (model.a @ state))
        return wanted

    def _integrate(self, dt_s: float, error: Float, direct: Float) -> None:
        """The integrals of (3-26); one that would push an input further beyond its limit waits."""
        config = self.config
        r = self._rate + config.alpha_per_s * error
        slope = np.where(config.boundary > 0.0, r / np.where(config.boundary > 0.0, config.boundary, 1.0), np.sign(r))
        under = config.feedback_per_s * config.alpha_per_s * error + config.robust * np.clip(slope, -1.0, 1.0)
        more = -self._inverse @ under * dt_s
        if config.leak:
            more = more - self._leak @ self._input * dt_s
        total = direct + self._integral + more
        beyond = ((total > config.input_max) & (more > 0.0)) | ((total < config.input_min) & (more < 0.0))
        self._integral = self._integral + np.where(beyond, 0.0, more)
