"""One target from many sightings: least squares, brought up to date with each, over errors that are not independent.

Conte's thesis (2009, section 7.3 and figure 7.9) puts the sightings of a target through a recursive least-squares
filter, as if each erred by itself; the estimate then settles on what they have in common and calls it exact. Here the
errors are taken apart. The click's is each sighting's own. A registration's, or a pose's, is alike in sightings taken
from near each other, exp(-d / L) at a distance d (Pilotage methods, section 2.3), so that hovering gains nothing and a
new pass does. The error of the ground's height at the target is one and the same for all of them, though it moves each
along its own line of sight. The reference imagery's displacement is common to all targets: it cannot be averaged, and
is only added at the end.

False matches are held down by Student's t: each sighting's covariance is divided by w = (nu + n) / (nu + d2), with d2
its squared normalised residual of n = 3 numbers (Lange, Little and Taylor, J. Am. Statist. Assoc. 84, 1989, p. 881).

Sightings are weighed as if independent but for how crowded they are, and only the covariance of the outcome knows of
what they share; `_weighted` says why. With independent errors and none held down it is the thesis's filter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from estimator.targets.ray import RayTarget
from estimator.targets.registered import RegisteredTarget
from estimator.types import Float

RAY, REGISTERED = "ray", "registered"
FLOOR_M2 = 1e-4
CHANGE_M = 1e-4


@dataclass(frozen=True, slots=True, eq=False)
class TargetSighting:
    """One place of a target, and what its error is made of.

    ``own_m2`` (3, 3) is the click's, common to what methods make of the same ``click`` and independent of all else;
    ``slow_m2`` (3, 3) falls to 1/e alike over ``alike_m`` between cameras at ``seen_from_ned_m`` (3,);
    ``height_way_m`` (3,) is how one standard deviation of the ground's height at the target moves the place. ``kind``
    is of the method: places of the same kind share more.
    """

    pos_ned_m: Float
    own_m2: Float
    slow_m2: Float
    height_way_m: Float
    seen_from_ned_m: Float
    alike_m: float
    kind: str
    click: int

    @property
    def cov_ned_m2(self) -> Float:
        """Covariance (3, 3) of this place alone."""
        cov: Float = self.own_m2 + self.slow_m2 + np.outer(self.height_way_m, self.height_way_m)
        return cov

    @classmethod
    def of(
        cls, found: RayTarget | RegisteredTarget, seen_from_ned_m: Float, alike_m: float, click: int
    ) -> TargetSighting:
        """The sighting that a method's place is, seen from a camera at (3,)."""
        registered = isinstance(found, RegisteredTarget)
        whole = found.cov_on_map_ned_m2 if isinstance(found, RegisteredTarget) else found.cov_ned_m2
        slow = whole - found.cov_pixel_m2 - np.outer(found.height_way_m, found.height_way_m)
        kind = REGISTERED if registered else RAY
        return cls(found.pos_ned_m, found.cov_pixel_m2, slow, found.height_way_m, seen_from_ned_m, alike_m, kind, click)


@dataclass(frozen=True, slots=True)
class FusionConfig:
    """How far errors reach.

    ``cross`` is the correlation of the slow errors of a ray and a registration from the same place: the pose is itself
    made of registrations. ``pose_inflation`` multiplies the sigma of rays' slow errors: a navigation filter that
    averages over a whole flight errs by more than it says where the map is strange. Both were found on simulated
    flights (``docs/results/targets.md``). ``nu`` are the degrees of freedom of Student's t; ``most`` sightings are
    kept.
    """

    cross: float = 0.5
    pose_inflation: float = 2.0
    nu: float = 4.0
    iterations: int = 30
    most: int = 120

    def __post_init__(self) -> None:
        counts = self.most >= 2 and self.iterations >= 1
        if not (0.0 <= self.cross <= 1.0 and self.pose_inflation >= 1.0 and self.nu > 0.0 and counts):
            message = (
                "cross must lie in [0, 1], pose_inflation be 1 or more, nu positive, most at least 2, iterations at"
                f" least 1: {self}"
            )
            raise ValueError(message)


@dataclass(frozen=True, slots=True, eq=False)
class FusedTarget:
    """The target from all its sightings.

    ``cov_on_map_ned_m2`` (3, 3) is without ``map_offset_std_m``, which comes on top on both horizontal axes and is
    common to all targets. ``weights`` (n,) are what each sighting was believed, 1 being what it claims;
    ``effective`` is how many independent ones of the same quality would say as much.
    """

    pos_ned_m: Float
    cov_on_map_ned_m2: Float
    map_offset_std_m: float
    weights: Float
    effective: float

    @property
    def cov_ned_m2(self) -> Float:
        """Covariance (3, 3) in the world."""
        offset_m2 = self.map_offset_std_m**2
        return self.cov_on_map_ned_m2 + np.diag([offset_m2, offset_m2, 0.0])


class TargetFusion:
    """Sightings of one target, and where it is by all of them. ``map_offset_std_m`` is of the whole map, an axis."""

    def __init__(self, map_offset_std_m: float = 0.0, config: FusionConfig | None = None) -> None:
        self.config = config or FusionConfig()
        self.map_offset_std_m = map_offset_std_m
        self._sightings: list[TargetSighting] = []

    @property
    def sightings(self) -> Sequence[TargetSighting]:
        """Those kept, in the order they came."""
        return tuple(self._sightings)

    def add(self, *sightings: TargetSighting) -> FusedTarget:
        """Take in sightings; where the target is now."""
        self._sightings.extend(sightings)
        while len(self._sightings) > self.config.most:
            del self._sightings[_most_repeated(self._sightings)]
        return self.result()

    def result(self) -> FusedTarget:
        """Where the target is by the sightings so far; ValueError before the first."""
        return fuse(self._sightings, self.map_offset_std_m, self.config)


def fuse(
    sightings: Sequence[TargetSighting], map_offset_std_m: float = 0.0, config: FusionConfig | None = None
) -> FusedTarget:
    """Where a target is by all its sightings.

    Raises
    ------
    ValueError
        There is none, or one holds a number that is not finite.
    """
    config = config or FusionConfig()
    if not sightings:
        message = "no sighting of the target"
        raise ValueError(message)
    z = np.array([s.pos_ned_m for s in sightings])
    alike = correlations(sightings, config)
    joint = joint_covariance(sightings, alike, config.pose_inflation)
    if not (np.isfinite(z).all() and np.isfinite(joint).all()):
        message = "a sighting's place or covariance is not finite"
        raise ValueError(message)
    count = len(sightings)
    own = joint.reshape(count, 3, count, 3)[np.arange(count), :, np.arange(count)]
    alone = 1.0 / alike.sum(axis=1)
    weights = np.ones(count)
    x = _robust_start(z, own)
    for _ in range(config.iterations):
        residual = z - x
        d2 = np.einsum("ni,nij,nj->n", residual, np.linalg.inv(own), residual)
        weights = np.minimum((config.nu + 3.0) / (config.nu + d2), 1.0) if count > 2 else np.ones(count)
        before = x
        x, cov = _weighted(z, own, joint, weights, alone)
        if float(np.linalg.norm(x - before)) < CHANGE_M:
            break
    single = float(np.median(np.trace(own[:, :2, :2], axis1=1, axis2=2)))
    effective = single / float(np.trace(cov[:2, :2]))
    return FusedTarget(x, cov, map_offset_std_m, weights, effective)


def correlations(sightings: Sequence[TargetSighting], config: FusionConfig) -> Float:
    """How far the slow errors of sightings are alike, (n, n) in [0, 1]."""
    at = np.array([s.seen_from_ned_m for s in sightings])
    length_m2 = np.array([s.alike_m**2 for s in sightings])
    apart = np.linalg.norm(at[:, None] - at[None], axis=-1)
    # of two lengths: Paciorek and Schervish, Environmetrics 17 (2006), p. 483, eq. 6, which keeps it positive definite
    mean_m2 = 0.5 * (length_m2[:, None] + length_m2[None])
    alike = (np.sqrt(np.outer(length_m2, length_m2)) / mean_m2) ** 1.5 * np.exp(-apart / np.sqrt(mean_m2))
    kinds = np.array([s.kind for s in sightings])
    same: Float = np.where(kinds[:, None] == kinds[None], alike, config.cross * alike)
    return same


def joint_covariance(sightings: Sequence[TargetSighting], alike: Float, pose_inflation: float) -> Float:
    """Covariance (3 n, 3 n) of all sightings' errors without the map's offset; ``alike`` (n, n) is of the slow ones."""
    count = len(sightings)
    roots = np.array([_root(s.slow_m2) * (pose_inflation if s.kind == RAY else 1.0) for s in sightings])
    ways = np.array([s.height_way_m for s in sightings])
    blocks = np.einsum("nm,nik,mjk->nimj", alike, roots, roots) + np.einsum("ni,mj->nimj", ways, ways)
    clicks = np.array([s.click for s in sightings])
    own = np.array([_root(s.own_m2) for s in sightings])
    blocks += np.einsum("nm,nik,mjk->nimj", (clicks[:, None] == clicks[None]).astype(np.float64), own, own)
    for n in range(count):
        blocks[n, :, n] += FLOOR_M2 * np.eye(3)
    joint: Float = blocks.reshape(3 * count, 3 * count)
    return 0.5 * (joint + joint.T)


def _weighted(z: Float, own: Float, joint: Float, weights: Float, alone: Float) -> tuple[Float, Float]:
    """The mean by each sighting's own covariance (n, 3, 3), and the mean's covariance under all of them, ``joint``.

    The best linear estimate under ``joint`` would extrapolate: where two sightings are said to err alike and one of
    them more, it believes their difference. That is only as good as the correlations, which nobody knows well.
    """
    shares = (weights * alone)[:, None, None] * np.linalg.inv(own)
    shares = np.linalg.solve(shares.sum(axis=0), shares)
    spread = np.repeat(1.0 / np.sqrt(weights), 3)
    design = np.transpose(shares, (1, 0, 2)).reshape(3, -1)
    cov = design @ (joint * np.outer(spread, spread)) @ design.T
    return np.einsum("nij,nj->i", shares, z), 0.5 * (cov + cov.T)


def _robust_start(z: Float, own: Float) -> Float:
    """The sighting that the others lie nearest to, in their deviations: a few false matches do not move it."""
    if len(z) < 3:
        weights = np.linalg.inv(own)
        start: Float = np.linalg.solve(weights.sum(axis=0), np.einsum("nij,nj->i", weights, z))
        return start
    apart = z[:, None] - z[None]
    both = np.linalg.inv(own[:, None] + own[None])
    d = np.sqrt(np.maximum(np.einsum("nmi,nmij,nmj->nm", apart, both, apart), 0.0))
    best: Float = z[int(np.argmin(np.median(d, axis=1)))]
    return best


def _root(cov: Float) -> Float:
    """The symmetric root (3, 3)."""
    values, axes = np.linalg.eigh(0.5 * (cov + cov.T))
    root: Float = (axes * np.sqrt(np.maximum(values, 0.0))) @ axes.T
    return root


def _most_repeated(sightings: Sequence[TargetSighting]) -> int:
    """The older of the two of one kind that were seen from the nearest places."""
    at = np.array([s.seen_from_ned_m for s in sightings])
    kinds = np.array([s.kind for s in sightings])
    apart = np.linalg.norm(at[:, None] - at[None], axis=-1)
    apart[kinds[:, None] != kinds[None]] = np.inf
    apart[np.tril_indices(len(at))] = np.inf
    return int(np.argmin(apart)) // len(at)
