"""The offset between the clocks of video and telemetry, and the camera's misalignment, from how both turned.

The exposure on the telemetry's clock is the frame's time plus the offset. With phi_i the rotation vector seen between
two pictures, in camera axes, the angle Theta run through by the telemetry's frame and C its rotation from the camera by
the stated mount,

    phi_i = C^T Exp(-beta) [Theta(t2_i + t_d) - Theta(t1_i + t_d)] + b (t2_i - t1_i) + noise

for the offset t_d, the misalignment beta and the difference b of the two rate biases. A scan over the offset finds the
basin, Gauss-Newton steps with Student-t weights the minimum (the same residual as in Kalibr's camera-IMU calibration:
Furgale, Rehder and Siegwart, IROS 2013; the rotation alone, as in Li and Mourikis, IJRR 33(7), 2014). The covariance is
the sandwich of M-estimation with the residuals' autocorrelation in it (Newey and West, Econometrica 55(3), 1987).
"""

from __future__ import annotations

import math
from collections.abc import Generator
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np
from numpy.typing import NDArray

from estimator.geometry.rotation import matrix_from_q, q_from_matrix, q_from_rotvec, rotvec_from_q, skew
from estimator.robust import NORMAL_BY_MAD
from estimator.timing.turns import TurnTrack
from estimator.types import Float

# Student-t with this many degrees of freedom, three components (Lange, Little and Taylor 1989)
_FREEDOM = 4.0
_STEPS = 12
_SETTLED_S = 1e-6
# normalised square of a turn that is an outlier for certain
_FAR_OFF = 50.0
# that so many basins of the search may compete
_BASINS = 4
# one step of the work: so many turns, each looked at for one offset, are some five milliseconds
_TURNS_A_STEP = 16_000
# a Gauss-Newton step, and the verdict, cost as much as that many offsets
_OFFSETS_A_FIT = 10
_Result = TypeVar("_Result")


@dataclass(frozen=True, slots=True)
class OffsetConfig:
    """Search span and priors, one sigma each.

    ``span_s`` bounds the offset on both sides. ``sensor_delay_std_s`` is what is not known of the delay of rate sensors
    and their stamps, ``boresight_floor_rad`` what relief and lens lend to the boresight; they are in every sigma. The
    offset counts as observed where its sigma is below ``observable_std_s``.
    """

    span_s: float = 1.0
    scan_step_s: float = 0.02
    boresight_std_rad: float = math.radians(3.0)
    boresight_floor_rad: float = math.radians(0.15)
    rate_bias_std_rad_s: float = 0.05
    sensor_delay_std_s: float = 0.004
    observable_std_s: float = 0.05
    correlation_time_s: float = 1.0
    min_correlation: float = 0.4
    min_pairs: int = 30


@dataclass(frozen=True, slots=True, eq=False)
class PictureTurns:
    """Turns seen between pictures: frame times (n,), rotation vectors (n, 3) in camera axes, covariances (n, 3, 3)."""

    first_s: Float
    second_s: Float
    rotvec_camera_rad: Float
    cov_rotvec_rad2: Float

    def __len__(self) -> int:
        return len(self.first_s)

    def where(self, keep: NDArray[np.bool_]) -> PictureTurns:
        """Those marked (n,)."""
        return PictureTurns(
            self.first_s[keep], self.second_s[keep], self.rotvec_camera_rad[keep], self.cov_rotvec_rad2[keep]
        )


@dataclass(frozen=True, slots=True, eq=False)
class OffsetEstimate:
    """The clock offset and what else the rotations tell.

    ``offset_s`` is added to frame times; its ``std_s`` counts other minima and the unknown delay of the sensors.
    ``boresight_rad`` (3,) is the small rotation about the axes of the telemetry's frame (body, or gimbal) that takes
    the stated mount to the true one, body_from_camera = Exp(boresight) mount; ``cov_boresight_rad2`` (3, 3) stays at
    the prior's where nothing excites it. ``rate_bias_camera_rad_s`` (3,) is picture minus telemetry. ``correlation`` is
    of the two rates, bias removed. ``reason`` says why the offset is not observable, and is empty where it is.
    """

    offset_s: float
    std_s: float
    boresight_rad: Float
    cov_boresight_rad2: Float
    rate_bias_camera_rad_s: Float
    correlation: float
    residual_std_rad_s: Float
    pairs: int
    observable: bool
    reason: str


def unknown_offset(config: OffsetConfig, pairs: int, reason: str) -> OffsetEstimate:
    """Nothing is known but the priors."""
    return OffsetEstimate(
        0.0, config.span_s / math.sqrt(3.0), np.zeros(3), np.eye(3) * config.boresight_std_rad**2, np.zeros(3),
        0.0, np.full(3, np.nan), pairs, False, reason,
    )  # fmt: skip


def estimate_offset(
    turns: PictureTurns, track: TurnTrack, frame_from_camera: Float, config: OffsetConfig
) -> OffsetEstimate:
    """Fit the offset to turns (n) that both clocks saw.

    Parameters
    ----------
    track
        How the frame that carries the camera turned, on the telemetry's clock.
    frame_from_camera
        The stated rotation (3, 3) from the camera to that frame.

    Returns
    -------
    OffsetEstimate
        Not observable, with a reason and a large sigma, where there is too little to go by.
    """
    return finished(offset_steps(turns, track, frame_from_camera, config))


def finished(steps: Generator[None, None, _Result]) -> _Result:
    """The result of work that comes in steps, done at once."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: _Result = end.value
            return result


def offset_steps(
    turns: PictureTurns, track: TurnTrack, frame_from_camera: Float, config: OffsetConfig
) -> Generator[None, None, OffsetEstimate]:
    """`estimate_offset` in steps of a few milliseconds, for who has other work that cannot wait for the whole."""
    known = track.covers(turns.first_s - config.span_s, turns.second_s + config.span_s)
    turns = turns.where(known & np.isfinite(turns.rotvec_camera_rad).all(axis=1))
    if len(turns) < config.min_pairs:
        return unknown_offset(config, len(turns), "too few pairs of pictures with telemetry about them")
    problem = _Problem(turns, track, frame_from_camera, config)
    lags_s = np.arange(-config.span_s, config.span_s + 0.5 * config.scan_step_s, config.scan_step_s)
    start = _State()
    scale = np.zeros(3)
    # the noise that the telemetry adds is known only near the right offset: scan, measure it, scan again
    costs = yield from problem.scan(lags_s, start, scale)
    start.offset_s = float(lags_s[int(np.argmin(costs))])
    scale = problem.added_noise(start)
    costs = yield from problem.scan(lags_s, start, scale)
    basins = yield from problem.minima(lags_s, costs, start, scale)
    start.offset_s = basins[0].lag_s
    solution = yield from problem.refine(start)
    return (yield from problem.judged(solution, lags_s))


@dataclass(frozen=True, slots=True)
class _Minimum:
    """A basin of the scan: where, and its cost."""

    lag_s: float
    cost: float


@dataclass(slots=True)
class _State:
    """What is fitted."""

    offset_s: float = 0.0
    misaligned: Float = field(default_factory=lambda: np.eye(3))
    rate_bias_rad_s: Float = field(default_factory=lambda: np.zeros(3))


class _Problem:
    """Residuals, weights and derivatives of the model above."""

    def __init__(self, turns: PictureTurns, track: TurnTrack, frame_from_camera: Float, config: OffsetConfig) -> None:
        self._turns = turns
        self._track = track
        self._camera_from_frame = frame_from_camera.T
        self._config = config
        self._dt_s = turns.second_s - turns.first_s
        bias = np.full(3, 1.0 / config.rate_bias_std_rad_s**2)
        self._prior = np.diag([0.0, *np.full(3, 1.0 / config.boresight_std_rad**2), *bias])
        self._added = np.zeros(3)
        self._since_pause = 0

    def _pause(self, offsets: int) -> Generator[None, None, None]:
        """Let others work, if looking at so many offsets and what went before are a step."""
        self._since_pause += offsets * len(self._turns)
        if self._since_pause >= _TURNS_A_STEP:
            self._since_pause = 0
            yield

    def predicted(self, state: _State) -> Float:
        """Rotation vectors (n, 3) that the telemetry predicts, bias left out."""
        turned = self._track.turned(self._turns.first_s + state.offset_s, self._turns.second_s + state.offset_s)
        return turned @ (self._camera_from_frame @ state.misaligned.T).T

    def _inverse_noise(self, added_rad_s: Float) -> Float:
        added = np.eye(3) * added_rad_s**2
        noise = self._turns.cov_rotvec_rad2 + added * (self._dt_s**2)[:, None, None]
        return np.asarray(np.linalg.inv(noise), dtype=np.float64)

    def scan(self, lags_s: Float, state: _State, added_rad_s: Float) -> Generator[None, None, Float]:
        """Robust cost (m,) at each offset, the bias fitted, all else as it stands."""
        inverse = self._inverse_noise(added_rad_s)
        costs = np.empty(len(lags_s))
        for index, lag_s in enumerate(lags_s):
            yield from self._pause(1)
            at = _State(float(lag_s), state.misaligned)
            residuals = self._turns.rotvec_camera_rad - self.predicted(at)
            residuals = residuals - np.median(residuals / self._dt_s[:, None], axis=0) * self._dt_s[:, None]
            squares = np.einsum("ni,nij,nj->n", residuals, inverse, residuals)
            costs[index] = (_FREEDOM + 3.0) * np.log1p(squares / _FREEDOM).sum()
        return costs

    def minima(
        self, lags_s: Float, costs: Float, state: _State, added_rad_s: Float
    ) -> Generator[None, None, list[_Minimum]]:
        """The lowest basins (at least one) of a scan's costs (m,), looked up at a tenth of its step, best first."""
        padded = np.concatenate(([np.inf], costs, [np.inf]))
        basins = np.flatnonzero((costs <= padded[:-2]) & (costs <= padded[2:]))
        basins = basins[np.argsort(costs[basins], kind="stable")][:_BASINS]
        found = []
        fine_s = np.linspace(-0.5, 0.5, 11) * float(lags_s[1] - lags_s[0])
        for index in basins:
            near_s = np.clip(lags_s[index] + fine_s, lags_s[0], lags_s[-1])
            near = yield from self.scan(near_s, state, added_rad_s)
            best = int(np.argmin(near))
            found.append(_Minimum(float(near_s[best]), float(near[best])))
        return sorted(found, key=lambda basin: basin.cost)

    def added_noise(self, state: _State) -> Float:
        """Rate noise (3,) beyond what the pictures admit: telemetry, its interpolation, relief."""
        rates = (self._turns.rotvec_camera_rad - self.predicted(state)) / self._dt_s[:, None]
        rates = rates - np.median(rates, axis=0)
        seen = NORMAL_BY_MAD * np.median(np.abs(rates), axis=0)
        said = np.median(np.einsum("nii->ni", self._turns.cov_rotvec_rad2) / (self._dt_s**2)[:, None], axis=0)
        added: Float = np.sqrt(np.maximum(seen**2 - said, 0.0))
        return added

    def refine(self, start: _State) -> Generator[None, None, _State]:
        """Gauss-Newton from a start; the noise is measured anew in each step."""
        state = _State(start.offset_s, start.misaligned, start.rate_bias_rad_s)
        for _ in range(_STEPS):
            yield from self._pause(_OFFSETS_A_FIT)
            self._added = self.added_noise(state)
            residuals, J, inverse, weights = self._linearised(state)
            weighted = np.einsum("n,nij->nij", weights, inverse)
            H = np.einsum("nip,nij,njq->pq", J, weighted, J) + self._prior
            pull = self._prior[1:, 1:] @ np.concatenate((self._boresight(state), state.rate_bias_rad_s))
            g = np.einsum("nip,nij,nj->p", J, weighted, residuals) - np.concatenate(([0.0], pull))
            # the first entry has no prior: a track that does not move must not make the matrix singular
            H[0, 0] += 1e-9
            change = np.linalg.solve(H, g)
            step_s = float(np.clip(change[0], -self._config.scan_step_s, self._config.scan_step_s))
            limit = self._config.span_s
            state.offset_s = float(np.clip(state.offset_s + step_s, -limit, limit))
            state.misaligned = matrix_from_q(q_from_rotvec(change[1:4])) @ state.misaligned
            state.rate_bias_rad_s = state.rate_bias_rad_s + change[4:]
            if abs(step_s) < _SETTLED_S and float(np.abs(change[1:]).max()) < 1e-6:
                break
        return state

    def _boresight(self, state: _State) -> Float:
        return rotvec_from_q(q_from_matrix(state.misaligned))

    def _linearised(self, state: _State) -> tuple[Float, Float, Float, Float]:
        """Residuals (n, 3), derivatives of the prediction (n, 3, 7), inverse noise (n, 3, 3), weights (n,)."""
        first_s, second_s = self._turns.first_s + state.offset_s, self._turns.second_s + state.offset_s
        camera_from_frame = self._camera_from_frame @ state.misaligned.T
        turned = self._track.turned(first_s, second_s)
        predicted = turned @ camera_from_frame.T + state.rate_bias_rad_s * self._dt_s[:, None]
        J = np.empty((len(turned), 3, 7))
        J[:, :, 0] = (self._track.rate(second_s) - self._track.rate(first_s)) @ camera_from_frame.T
        # Exp(-d) v = v - d x v = v + v x d
        J[:, :, 1:4] = camera_from_frame @ skew(turned)
        J[:, :, 4:] = np.eye(3) * self._dt_s[:, None, None]
        residuals = self._turns.rotvec_camera_rad - predicted
        inverse = self._inverse_noise(self._added)
        squares = np.einsum("ni,nij,nj->n", residuals, inverse, residuals)
        weights = (_FREEDOM + 3.0) / (_FREEDOM + squares)
        return residuals, J, inverse, weights

    def judged(self, state: _State, lags_s: Float) -> Generator[None, None, OffsetEstimate]:
        """The estimate with its sigmas."""
        config = self._config
        cov, efficiency = self._covariance(state)
        local_std_s = min(math.sqrt(cov[0, 0]), 10.0 * config.span_s)
        yield from self._pause(_OFFSETS_A_FIT)
        std_s = yield from self._std_over_span(state, lags_s, local_std_s, efficiency)
        std_s = math.hypot(std_s, config.sensor_delay_std_s, self._pull_of_telemetry_noise_s(state))
        correlation = self._correlation(state)
        rates = (self._turns.rotvec_camera_rad - self.predicted(state)) / self._dt_s[:, None] - state.rate_bias_rad_s
        cov_boresight = cov[1:4, 1:4] + np.eye(3) * config.boresight_floor_rad**2
        reason = ""
        if abs(state.offset_s) > config.span_s - config.scan_step_s:
            std_s = max(std_s, config.span_s / math.sqrt(3.0))
            reason = "the best offset lies at the edge of the search"
        elif std_s > config.observable_std_s:
            reason = "the motion does not tell: it hardly changes, or repeats"
        elif correlation < config.min_correlation:
            std_s = max(std_s, config.span_s / math.sqrt(3.0))
            reason = "pictures and telemetry turn unlike each other: is the camera's mount right?"
        return OffsetEstimate(
            state.offset_s, std_s, self._boresight(state), cov_boresight, state.rate_bias_rad_s,
            correlation, NORMAL_BY_MAD * np.median(np.abs(rates), axis=0), len(self._turns), not reason, reason,
        )  # fmt: skip

    def _covariance(self, state: _State) -> tuple[Float, float]:
        """Sandwich covariance (7, 7), and what of the nominal information on the offset it leaves."""
        residuals, J, inverse, weights = self._linearised(state)
        squares = np.einsum("ni,nij,nj->n", residuals, inverse, residuals)
        # mean derivative of the weighted residual, which for outliers is less than its weight
        slope = float((weights - 2.0 * weights * squares / (3.0 * (_FREEDOM + squares))).mean())
        H = slope * np.einsum("nip,nij,njq->pq", J, inverse, J) + self._prior
        explained = float(H[0, 1:] @ np.linalg.solve(H[1:, 1:], H[1:, 0]))
        nominal = float(H[0, 0]) - explained
        scores = np.einsum("n,nip,nij,nj->np", weights, J, inverse, residuals)
        S = self._autocorrelated(scores) + self._prior
        # noise in the telemetry's rates looks like change that could tell the offset, and does not: only change that
        # the pictures saw as well, with a noise of their own, counts (the instrumental variable of econometrics)
        shared = slope * self._shared_change(J[:, :, 0], inverse, squares)
        # no change at all leaves nothing but a floor, so that the sigma is large and not infinite
        H[0, 0] = explained + max(min(max(shared - explained, 1e-3 * nominal), nominal), 1e-9)
        inverted = np.linalg.inv(H)
        sandwich = inverted @ S @ inverted
        # a short window can by chance show negative autocorrelation: not below what independent noise gives
        grown = np.sqrt(np.maximum(np.diag(inverted) / np.maximum(np.diag(sandwich), 1e-30), 1.0))
        cov = sandwich * np.outer(grown, grown)
        return cov, min(1.0 / max(nominal * float(cov[0, 0]), 1e-12), 1.0)

    def _autocorrelated(self, scores: Float) -> Float:
        """Covariance (7, 7) of the sum of scores (n, 7), by Newey and West."""
        count, size = scores.shape
        lags = math.ceil(self._config.correlation_time_s / max(float(np.median(self._dt_s)), 1e-3))
        S = scores.T @ scores
        for lag in range(1, min(lags, count - 1) + 1):
            product = scores[lag:].T @ scores[:-lag]
            S = S + (1.0 - lag / (lags + 1.0)) * (product + product.T)
        corrected: Float = S * (count / (count - size))
        return corrected

    def _shared_change(self, change_rad_s: Float, inverse: Float, squares: Float) -> float:
        """Information on the offset in the change of rate (n, 3) over pairs, as far as their neighbours confirm it."""
        rates = self._turns.rotvec_camera_rad / self._dt_s[:, None]
        middle_s = 0.5 * (self._turns.first_s + self._turns.second_s)
        apart_s = middle_s[2:] - middle_s[:-2]
        near = apart_s < 3.0 * self._dt_s[1:-1]
        # a picture or two that are far off must not decide
        near &= (squares[2:] < _FAR_OFF) & (squares[:-2] < _FAR_OFF)
        if not near.any():
            return 0.0
        seen = (rates[2:] - rates[:-2]) * (self._dt_s[1:-1] / apart_s)[:, None]
        products = np.einsum("ni,nij,nj->n", change_rad_s[1:-1], inverse[1:-1], seen)
        return float(products[near].mean()) * len(rates)

    def _seen_noise(self, state: _State) -> tuple[Float, Float]:
        """Variances (3,), in camera axes, of the residual rates, and of the telemetry's part in them.

        The part is by the roughness of the telemetry's rates, but not more than the residuals could hide.
        """
        residuals, *_ = self._linearised(state)
        seen = (NORMAL_BY_MAD * np.median(np.abs(residuals / self._dt_s[:, None]), axis=0)) ** 2
        rough = (self._camera_from_frame**2) @ self._track.rate_noise_rad_s**2
        averaging = max(float(np.median(self._dt_s)) / self._track.interval_s, 1.0)
        return seen, np.minimum(rough / averaging, seen)

    def _std_over_span(
        self, state: _State, lags_s: Float, local_std_s: float, efficiency: float
    ) -> Generator[None, None, float]:
        """Sigma of the offset over the whole span: the minimum's own, and the mass of everything else."""
        config = self._config
        flat_std_s = config.span_s / math.sqrt(3.0)
        if local_std_s > flat_std_s:
            return flat_std_s
        width_s = math.sqrt(math.tau) * local_std_s
        costs = yield from self.scan(lags_s, state, self._added)
        basins = yield from self.minima(lags_s, costs, state, self._added)
        at_offset = yield from self.scan(np.array([state.offset_s]), state, self._added)
        here = float(at_offset[0])
        # another basin may be the true one in spite of its cost; the slopes of this one may not
        gained = np.concatenate(
            (
                costs - here,
                np.array([basin.cost for basin in basins]) - here - self._chance_gain(state),
            )
        )
        widths_s = np.concatenate(
            (np.full(len(lags_s), config.scan_step_s), np.full(len(basins), min(width_s, config.scan_step_s)))
        )
        away_s = np.concatenate((lags_s, [basin.lag_s for basin in basins])) - state.offset_s
        far = np.abs(away_s) > max(3.0 * local_std_s, 0.25 * config.scan_step_s)
        mass = np.exp(-0.5 * efficiency * np.clip(gained[far], 0.0, None)) * widths_s[far]
        square = (width_s * local_std_s**2 + float(mass @ away_s[far] ** 2)) / (width_s + float(mass.sum()))
        return min(math.sqrt(square), flat_std_s)

    def _chance_gain(self, state: _State) -> float:
        """How much lower the cost at one offset may be than at another by the telemetry's noise alone, 2.5 sigma.

        With noise e of the picture and n of the telemetry, which is another at another offset, (e + n)^2 - (e + n')^2
        has the variance 8 E e^2 E n^2 + 4 (E n^2)^2.
        """
        seen, telemetry = self._seen_noise(state)
        share = telemetry / np.maximum(seen, 1e-30)
        return 2.5 * math.sqrt(len(self._turns) * float((8.0 * share * (1.0 - share) + 4.0 * share**2).sum()))

    def _pull_of_telemetry_noise_s(self, state: _State) -> float:
        """How far noise of the telemetry may pull the offset.

        Between two knots the noise of both is averaged, so that residuals are least at some phase of the sampling,
        wherever the truth lies: as in regression with errors in the variable, by the share of noise in the signal.
        """
        said = self.predicted(state) / self._dt_s[:, None]
        signal = np.var(said, axis=0)
        weight = np.einsum("nii->i", self._inverse_noise(self._added))
        share = float((weight * self._added**2).sum()) / max(float((weight * signal).sum()), 1e-12)
        return self._track.interval_s * min(share, 1.0)

    def _correlation(self, state: _State) -> float:
        """Correlation of the rates seen and predicted, over all axes, weighted by the pictures' noise.

        Not by what the telemetry adds: it would hide an axis on which the two have nothing in common.
        """
        whitening = np.linalg.cholesky(self._inverse_noise(np.zeros(3)))
        seen, said = (
            np.einsum("nji,nj->ni", whitening, (x - np.median(x, axis=0)))
            for x in (self._turns.rotvec_camera_rad, self.predicted(state))
        )
        length = math.sqrt(float((seen**2).sum()) * float((said**2).sum()))
        return float((seen * said).sum()) / length if length > 0.0 else 0.0
