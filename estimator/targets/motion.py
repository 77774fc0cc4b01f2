"""From sightings to whether a target stands or moves, where it is, how fast, and how sure that is.

Three models run side by side and mix (interacting multiple models: Blom and Bar-Shalom, IEEE Trans. Automatic Control
33(8), 1988; Bar-Shalom, Li and Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001, section
11.6): standing; driving straight; braking or turning. All carry the error that sightings share over seconds, that of
the camera's pose, as a first-order Gauss-Markov state: a place that wanders as slowly as the pose may err is then no
motion, and many sightings from one pose do not make the place sure.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from estimator.types import Float

STANDING, CRUISING, MANOEUVRING = range(3)
Complex = NDArray[np.complex128]
_P, _V, _B = slice(0, 2), slice(2, 4), slice(4, 6)
_SEEN = np.hstack((np.eye(2), np.zeros((2, 2)), np.eye(2)))


@dataclass(frozen=True, slots=True, eq=False)
class PlaceSighting:
    """One place ``pos_ned_m`` (3,) of a target, ``down_std_m`` of its height.

    ``own_ne_m2`` (2, 2) is the covariance of the error that is this sighting's alone (the pixel's), ``slow_ne_m2``
    (2, 2) of the one that it shares with its neighbours in time (the pose's). Where it was watched for a moment before,
    ``vel_ne_m_s`` (2,) is how fast it went, ``vel_std_m_s`` the standard deviation of that on each axis.
    """

    t_us: int
    pos_ned_m: Float
    own_ne_m2: Float
    slow_ne_m2: Float
    down_std_m: float = 0.0
    vel_ne_m_s: Float | None = None
    vel_std_m_s: float = 1.0

    def __post_init__(self) -> None:
        if self.pos_ned_m.shape != (3,) or self.own_ne_m2.shape != (2, 2) or self.slow_ne_m2.shape != (2, 2):
            message = "a sighting needs a place (3,) and two covariances (2, 2)"
            raise ValueError(message)
        if not (np.isfinite(self.pos_ned_m).all() and np.isfinite(self.own_ne_m2 + self.slow_ne_m2).all()):
            message = "a sighting's place and covariances must be finite"
            raise ValueError(message)
        if np.linalg.eigvalsh(self.own_ne_m2)[0] <= 0.0 or np.linalg.eigvalsh(self.slow_ne_m2)[0] < -1e-9:
            message = "a sighting's own covariance must be positive, the shared one not negative"
            raise ValueError(message)
        if self.vel_ne_m_s is not None and not (
            self.vel_ne_m_s.shape == (2,) and np.isfinite(self.vel_ne_m_s).all() and 0.0 < self.vel_std_m_s < np.inf
        ):
            message = "a sighting's velocity must be (2,) and finite, its standard deviation positive"
            raise ValueError(message)


@dataclass(frozen=True, slots=True)
class MotionConfig:
    """How targets move and poses err.

    ``alike_s`` is the time in which the shared error falls to 1/e; ``cruise_psd`` and ``manoeuvre_psd`` are power
    spectral densities of the acceleration on each axis (m^2/s^3); rates are of changes between models, per second;
    ``forget_s`` is in what time a manoeuvring target's velocity is forgotten, which bounds its speed;
    ``start_speed_std_m_s`` is what may be there when a target starts or is first seen, ``stop_speed_std_m_s`` what may
    be left when it is taken to stand. ``say_moving`` and ``say_standing`` are the probabilities of motion at which the
    verdict changes. ``nu`` are the degrees of freedom of Student's t that holds down false sightings.
    """

    alike_s: float = 20.0
    cruise_psd: float = 0.1
    manoeuvre_psd: float = 4.0
    stand_psd_m2_s: float = 1e-4
    forget_s: float = 60.0
    start_rate: float = 0.004
    stop_rate: float = 0.03
    manoeuvre_rate: float = 0.15
    settle_rate: float = 0.35
    start_speed_std_m_s: float = 7.0
    stop_speed_std_m_s: float = 1.5
    say_moving: float = 0.95
    say_standing: float = 0.10
    nu: float = 8.0
    most_track: int = 20_000

    def __post_init__(self) -> None:
        names = [name for name in self.__dataclass_fields__ if name not in ("say_moving", "say_standing")]
        if not all(np.isfinite(getattr(self, name)) and getattr(self, name) > 0.0 for name in names):
            message = f"times, densities, rates and counts must be positive and finite: {self}"
            raise ValueError(message)
        if not 0.0 < self.say_standing < self.say_moving < 1.0:
            message = "the verdicts need 0 < say_standing < say_moving < 1"
            raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class MotionState:
    """A target at ``t_us``: place (3,) and horizontal velocity (2,) with covariance (4, 4) of north, east, their rates.

    ``moving_probability`` is the models'; ``moving`` the verdict with hysteresis, None before there is one. The rest is
    for finding it again, by the models that the verdict leaves: ``seen_ne_m`` (2,) with ``cov_seen_ne_m2`` (2, 2) is
    where the next sighting should have it, the place and the shared error; ``seen_vel_ne_m_s`` (2,) with
    ``cov_seen_vel_ne_m2_s2`` (2, 2) how fast.
    """

    t_us: int
    pos_ned_m: Float
    vel_ne_m_s: Float
    cov_ne: Float
    down_std_m: float
    moving_probability: float
    moving: bool | None
    seen_ne_m: Float
    cov_seen_ne_m2: Float
    seen_vel_ne_m_s: Float
    cov_seen_vel_ne_m2_s2: Float

    @property
    def cov_pos_ne_m2(self) -> Float:
        """Covariance (2, 2) of the place."""
        return self.cov_ne[:2, :2]

    @property
    def cov_vel_ne_m2_s2(self) -> Float:
        """Covariance (2, 2) of the velocity."""
        return self.cov_ne[2:, 2:]

    @property
    def course(self) -> tuple[float, float]:
        """Direction of motion, clockwise from north, and its standard deviation, radians; NaN when hardly moving."""
        speed = float(np.hypot(*self.vel_ne_m_s))
        across = np.array([-self.vel_ne_m_s[1], self.vel_ne_m_s[0]]) / max(speed, 1e-9)
        std_m_s = math.sqrt(float(across @ self.cov_vel_ne_m2_s2 @ across))
        if speed < 3.0 * std_m_s or speed < 1.0:
            return math.nan, math.nan
        return math.atan2(self.vel_ne_m_s[1], self.vel_ne_m_s[0]), std_m_s / speed


class TargetMotion:
    """Sightings of one target in the order of their times, and what they say of its motion."""

    def __init__(self, config: MotionConfig | None = None) -> None:
        self.config = config or MotionConfig()
        self.track: list[MotionState] = []
        self._t_us: int | None = None
        self._x = np.zeros((3, 6))
        self._P = np.zeros((3, 6, 6))
        self._chances = np.array([0.5, 0.3, 0.2])
        self._slow = np.zeros((2, 2))
        self._down = (0.0, 0.0)
        self._moving: bool | None = None
        self._rates = _spectrum(self.config)

    def update(self, sighting: PlaceSighting) -> MotionState:
        """Take a sighting in and return the state at its time; ValueError where it is older than the last one."""
        if self._t_us is None:
            self._begin(sighting)
        elif sighting.t_us < self._t_us:
            message = f"sightings must come in order: {sighting.t_us} us is before {self._t_us} us"
            raise ValueError(message)
        else:
            self._slow = sighting.slow_ne_m2
            self._x, self._P, self._chances = self._predicted((sighting.t_us - self._t_us) / 1e6)
            self._correct(sighting)
        if sighting.vel_ne_m_s is not None:
            self._set_going(sighting.vel_ne_m_s, sighting.vel_std_m_s)
        self._t_us = sighting.t_us
        self._down = (float(sighting.pos_ned_m[2]), sighting.down_std_m)
        self._decide()
        state = self._state(sighting.t_us, self._x, self._P, self._chances)
        self.track.append(state)
        del self.track[: -self.config.most_track]
        return state

    def at(self, t_us: int) -> MotionState:
        """The state at the last sighting's time or later, predicted; ValueError before the first or for the past."""
        if self._t_us is None or t_us < self._t_us:
            message = "there is no sighting yet" if self._t_us is None else "the past is in the track"
            raise ValueError(message)
        return self._state(t_us, *self._predicted((t_us - self._t_us) / 1e6))

    def _begin(self, sighting: PlaceSighting) -> None:
        self._slow = sighting.slow_ne_m2
        cov = np.zeros((6, 6))
        # the place is seen with the shared error on it: what one is too far north the other is too far south
        cov[_P, _P] = sighting.own_ne_m2 + self._slow
        cov[_B, _B], cov[_P, _B], cov[_B, _P] = self._slow, -self._slow, -self._slow
        for model in range(3):
            self._x[model, _P] = sighting.pos_ned_m[:2]
            self._P[model] = cov
            if model != STANDING:
                self._P[model, _V, _V] = self.config.start_speed_std_m_s**2 * np.eye(2)

    def _changes(self, dt_s: float) -> Float:
        """Chances (3, 3) of going from a model (row) to another within ``dt_s``, from the rates' eigenvectors."""
        values, vectors, inverse = self._rates
        changes: Float = ((vectors * np.exp(values * dt_s)) @ inverse).real
        # nothing stands from one moment to the next: it must have slowed down
        for model in (CRUISING, MANOEUVRING):
            vel, cov = self._x[model, _V], self._P[model, _V, _V]
            spread = cov + self.config.stop_speed_std_m_s**2 * np.eye(2)
            stops = changes[model, STANDING] * math.exp(-0.5 * float(vel @ np.linalg.solve(spread, vel)))
            changes[model, model] += changes[model, STANDING] - stops
            changes[model, STANDING] = stops
        return changes

    def _predicted(self, dt_s: float) -> tuple[Float, Float, Float]:
        changes = self._changes(dt_s)
        chances = self._chances @ changes
        x, P = np.zeros((3, 6)), np.zeros((3, 6, 6))
        for to in range(3):
            weight = self._chances * changes[:, to] / max(float(chances[to]), 1e-12)
            x[to], P[to] = self._mixed(weight, to)
            x[to], P[to] = self._moved(x[to], P[to], to, dt_s)
        return x, P, chances

    def _mixed(self, weight: Float, to: int) -> tuple[Float, Float]:
        x = weight @ self._x
        P = np.zeros((6, 6))
        for model in range(3):
            away = self._x[model] - x
            P += weight[model] * (self._P[model] + np.outer(away, away))
        if to == STANDING:
            x[_V] = 0.0
            P[_V, :] = P[:, _V] = 0.0
        else:
            # what sets off from standing may take any course
            P[_V, _V] += weight[STANDING] * self.config.start_speed_std_m_s**2 * np.eye(2)
        return x, P

    def _moved(self, x: Float, P: Float, model: int, dt_s: float) -> tuple[Float, Float]:
        c = self.config
        keep = math.exp(-dt_s / c.alike_s)
        F, Q = np.eye(6), np.zeros((6, 6))
        F[_B, _B] = keep * np.eye(2)
        Q[_B, _B] = (1.0 - keep**2) * self._slow
        if model == STANDING:
            Q[_P, _P] = c.stand_psd_m2_s * dt_s * np.eye(2)
        else:
            psd = c.cruise_psd if model == CRUISING else c.manoeuvre_psd
            F[_P, _V], F[_V, _V], Q[:4, :4] = _driven(dt_s, psd, np.inf if model == CRUISING else c.forget_s)
        return F @ x, F @ P @ F.T + Q

    def _correct(self, sighting: PlaceSighting) -> None:
        z, nu = sighting.pos_ned_m[:2], self.config.nu
        likelihood = np.zeros(3)
        misses, spreads = np.zeros((3, 2)), np.zeros((3, 2, 2))
        for model in range(3):
            misses[model] = z - _SEEN @ self._x[model]
            spreads[model] = _SEEN @ self._P[model] @ _SEEN.T + sighting.own_ne_m2
        d2 = np.array([float(m @ np.linalg.solve(S, m)) for m, S in zip(misses, spreads, strict=True)])
        # a sighting that is far off for every model is doubted, not one that merely speaks against one of them
        worse = max(1.0, (nu + float(d2.min())) / (nu + 2.0))
        R = sighting.own_ne_m2 * worse
        for model in range(3):
            S = spreads[model] + (worse - 1.0) * sighting.own_ne_m2
            gain = self._P[model] @ _SEEN.T @ np.linalg.inv(S)
            self._x[model] = self._x[model] + gain @ misses[model]
            kept = np.eye(6) - gain @ _SEEN
            self._P[model] = kept @ self._P[model] @ kept.T + gain @ R @ gain.T
            # Student's t as well: no single sighting settles which model it is
            mahalanobis = float(misses[model] @ np.linalg.solve(S, misses[model]))
            likelihood[model] = (1.0 + mahalanobis / nu) ** (-(nu + 2.0) / 2.0) / math.sqrt(float(np.linalg.det(S)))
        chances = np.maximum(self._chances * likelihood, 1e-6 * likelihood.max())
        self._chances = chances / chances.sum()

    def _set_going(self, vel_ne_m_s: Float, std_m_s: float) -> None:
        """Correct the models that move by a velocity; which of the models it is, places tell."""
        for model in (CRUISING, MANOEUVRING):
            spread = self._P[model, _V, _V] + std_m_s**2 * np.eye(2)
            gain = self._P[model][:, _V] @ np.linalg.inv(spread)
            self._x[model] = self._x[model] + gain @ (vel_ne_m_s - self._x[model, _V])
            self._P[model] = self._P[model] - gain @ spread @ gain.T

    def _decide(self) -> None:
        moving = 1.0 - float(self._chances[STANDING])
        if moving >= self.config.say_moving:
            self._moving = True
        elif moving <= self.config.say_standing:
            self._moving = False

    def _state(self, t_us: int, x: Float, P: Float, chances: Float) -> MotionState:
        mean, cov = _moments(x, P, chances)
        left = chances.copy()
        if self._moving is not None:
            left[[CRUISING, MANOEUVRING] if not self._moving else [STANDING]] = 0.0
        mean_left, cov_left = _moments(x, P, left / max(float(left.sum()), 1e-12))
        down_m, down_std_m = self._down
        return MotionState(
            t_us, np.array([*mean[_P], down_m]), mean[_V], cov[:4, :4], down_std_m, 1.0 - float(chances[STANDING]),
            self._moving, _SEEN @ mean_left, _SEEN @ cov_left @ _SEEN.T, mean_left[_V], cov_left[_V, _V],
        )  # fmt: skip


def _spectrum(c: MotionConfig) -> tuple[Complex, Complex, Complex]:
    """Eigenvalues (3,), eigenvectors (3, 3) and their inverse of the rates at which the models change."""
    rates = np.array([
        [0.0, 0.3 * c.start_rate, 0.7 * c.start_rate],
        [0.3 * c.stop_rate, 0.0, c.manoeuvre_rate],
        [c.stop_rate, c.settle_rate, 0.0],
    ])  # fmt: skip
    values, vectors = np.linalg.eig(rates - np.diag(rates.sum(axis=1)))
    return values.astype(complex), vectors.astype(complex), np.linalg.inv(vectors).astype(complex)


def _moments(x: Float, P: Float, chances: Float) -> tuple[Float, Float]:
    """Mean (6,) and covariance (6, 6) of the models' (3, 6) and (3, 6, 6)."""
    mean: Float = chances @ x
    cov = np.zeros((6, 6))
    for model in range(3):
        away = x[model] - mean
        cov += chances[model] * (P[model] + np.outer(away, away))
    return mean, cov


def _driven(dt_s: float, psd: float, forget_s: float) -> tuple[Float, Float, Float]:
    """How velocity moves the place (2, 2) and itself (2, 2), and the noise (4, 4), of white acceleration with damping.

    Integrated Ornstein-Uhlenbeck; without damping the usual dt^3 / 3, dt^2 / 2, dt.
    """
    two = np.eye(2)
    if not np.isfinite(forget_s):
        noise: Float = psd * np.array([[dt_s**3 / 3.0, dt_s**2 / 2.0], [dt_s**2 / 2.0, dt_s]])
        return dt_s * two, two, np.asarray(np.kron(noise, two), np.float64)
    a = dt_s / forget_s
    e = math.exp(-a)
    # series for short steps, where the closed form loses its digits
    pp = dt_s**3 / 3.0 if a < 1e-3 else forget_s**3 * (a - 2.0 * (1.0 - e) + 0.5 * (1.0 - e**2))
    pv = dt_s**2 / 2.0 if a < 1e-3 else 0.5 * (forget_s * (1.0 - e)) ** 2
    vv = 0.5 * forget_s * -math.expm1(-2.0 * a)
    spread = np.asarray(np.kron(np.array([[pp, pv], [pv, vv]]), two), np.float64)
    return forget_s * (1.0 - e) * two, e * two, psd * spread
