"""Finding a described pad in a picture: rings, who is who, the pose, and whether all else is where it then must be."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import permutations

import numpy as np

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.landing.edges import edges_along
from estimator.landing.pad import CirclePad, Ring
from estimator.landing.pose import (
    Curve,
    Edges,
    PadPose,
    Samples,
    Solution,
    TiltPrior,
    both_solutions,
    circle_poses,
    distances,
    joined,
    sample_rings,
    seen,
    solve,
)
from estimator.landing.rings import Ellipse, RingSeen, ring_levels
from estimator.landing.sighting import NoPad, PadSighting, Refusal
from estimator.types import Float, Image

_HEADINGS = 72
_SAME_HEADING = 0.985
_SHIFTS_PX = np.arange(-10.0, 10.1, 2.5)
_SHIFTED_EACH = 2
_FIRST = ((0.0, np.inf, 0.6), (2.5, np.inf, 0.3))
"""Reach, limit and sigma in pixels of the first steps of a fit; a pose that was foreseen needs one of them."""
_STRONG = 30.0
"""Grey levels a pixel from which an edge counts fully when guesses are compared."""


@dataclass(frozen=True, slots=True)
class DetectorConfig:
    """Limits of the detector; lengths in pixels.

    ``ratio_within`` and ``side_within`` say how far a ring's ratio and the distance of two may be off for a first
    guess. Of the edges that a pose puts into the picture ``accept_share`` must be there, within ``edge_within_px``, and
    ``expected_share`` where the pose was foreseen. Rings ``larger_by`` than the pad's largest in view are another's.
    A second pose is carried while its cost exceeds the best by less than ``ambiguous_below``.
    """

    ratio_within: float = 0.065
    radius_within: float = 0.05
    slack_px: float = 0.6
    outer_shows: float = 0.7
    inner_lacks: float = 0.3
    side_within: float = 0.25
    told_radius_px: float = 6.0
    least_radius_px: float = 3.0
    edge_within_px: float = 1.0
    accept_share: float = 0.58
    expected_share: float = 0.4
    sure_share: float = 0.9
    least_strength: float = 0.2
    largest_share: float = 0.3
    larger_by: float = 1.5
    mirror_margin: float = 0.06
    mirror_share: float = 0.7
    ambiguous_below: float = 13.8
    single_rings: int = 2


@dataclass(frozen=True, slots=True, eq=False)
class _Fit:
    """A pose with what speaks for it."""

    solution: Solution
    edges: Edges
    share: float
    triple: int


def detect_circles(
    image: Image, camera: Camera, pad: CirclePad, prior: TiltPrior | None = None, expected: PadPose | None = None,
    config: DetectorConfig | None = None,
) -> PadSighting | NoPad:  # fmt: skip
    """The pad in a grey picture (rows, cols), or why there is none to use.

    ``prior`` is down in the camera frame from inertial sensors. ``expected`` is the pose that a filter foresees to some
    pixels: the pad is then sought there first, found even with all rings cut, and not asked again whether it is
    mirrored or one of two.
    """
    if image.ndim != 2 or image.shape != (camera.height_px, camera.width_px):
        message = f"the picture is {image.shape}, the camera's are grey of ({camera.height_px}, {camera.width_px})"
        raise GeometryError(message)
    search = _Search(image, camera, pad, prior, config or DetectorConfig())
    if expected is not None:
        # Which triple is which is known then, so a covered inner circle says nothing.
        tracked = search.fitted(expected, trusting=True)
        if tracked is None or tracked.share < search.config.sure_share:
            tracked = _better(tracked, search.fitted(search.shifted(expected), trusting=True))
        if tracked is not None and tracked.share >= search.config.expected_share:
            return search.sighting(tracked)
    rings: list[RingSeen] = []
    fit = None
    for rings in ring_levels(image):
        fit = _better(fit, search.best(rings))
        if fit is not None and fit.share >= search.config.sure_share:
            break
    mirror = None
    if fit is None or fit.share < search.config.sure_share:
        other = search.mirrored()
        mirror = other.best(rings)
        if fit is None or _lead(fit, mirror) < search.config.mirror_margin:
            fit = _better(fit, search.around_one(rings))
            mirror = _better(mirror, other.around_one(rings))
    lead = _lead(fit, mirror)
    if mirror is not None and mirror.share >= search.config.mirror_share and lead < -search.config.mirror_margin:
        return NoPad(Refusal.MIRRORED, f"pad '{pad.name}' is printed mirrored: its ratios rise counter-clockwise")
    if fit is None:
        return search.nothing(rings)
    too_little = _too_little(fit, lead, search.config)
    if too_little:
        return NoPad(Refusal.INCOMPLETE, f"pad '{pad.name}': {too_little}")
    return search.alone(rings, fit)


def _too_little(fit: _Fit, lead: float, config: DetectorConfig) -> str:
    """Why a fit is not enough to go by; empty if it is."""
    if fit.share < config.accept_share:
        return (
            f"only {fit.share:.0%} of its edges are in the picture where they should be; it is covered, cut or printed "
            "in part"
        )
    if lead < config.mirror_margin:
        return "too little of it is in the picture to tell it from one that is printed mirrored"
    return ""


def _better(one: _Fit | None, other: _Fit | None) -> _Fit | None:
    if one is None or other is None:
        return one or other
    return other if other.share >= one.share else one


def _lead(fit: _Fit | None, mirror: _Fit | None) -> float:
    """By what share of edges a fit is ahead of that of a mirrored print."""
    return (0.0 if fit is None else fit.share) - (0.0 if mirror is None else mirror.share)


class _Search:
    """One picture searched for one pad."""

    def __init__(
        self, image: Image, camera: Camera, pad: CirclePad, prior: TiltPrior | None, config: DetectorConfig
    ) -> None:
        self.image, self.camera, self.pad, self.prior, self.config = image, camera, pad, prior, config
        self.rings = pad.rings

    def mirrored(self) -> _Search:
        """The same picture searched for a mirrored print."""
        other = _Search(self.image, self.camera, self.pad, self.prior, self.config)
        other.rings = self.pad.mirrored()
        return other

    def best(self, rings: list[RingSeen]) -> _Fit | None:
        """The first fit that leaves no doubt, or the one with most of its edges seen."""
        found: _Fit | None = None
        for tries, guess in enumerate(self._guesses(rings), 1):
            fit = self.fitted(guess)
            if fit is not None and (found is None or fit.share > found.share):
                found = fit
                if fit.share >= self.config.sure_share:
                    break
            if tries >= 24 or (found is not None and found.share >= self.config.accept_share and tries >= 6):
                break
        return found

    def _guesses(self, rings: list[RingSeen]) -> Iterator[PadPose]:
        for one, other in permutations(rings, 2):
            alike = one.outer.size_px / other.outer.size_px
            apart = np.hypot(one.outer.u_px - other.outer.u_px, one.outer.v_px - other.outer.v_px)
            if 1.0 <= alike < 1.7 and apart < 12.0 * one.outer.size_px:
                yield from self._from_pair(one, other)

    def around_one(self, rings: list[RingSeen]) -> _Fit | None:
        """The best fit that a single ring leads to, the pad being turned about it; None where two headings compete."""
        fits: list[_Fit] = []
        large = [ring for ring in rings if ring.outer.size_px >= self.config.told_radius_px]
        for ring in large[: self.config.single_rings]:
            fits += [fit for pose in self._from_one(ring) if (fit := self.fitted(pose)) is not None]
            if any(fit.share >= self.config.sure_share for fit in fits):
                break
        fits.sort(key=lambda fit: -fit.share)
        for fit in fits[1:]:
            one, other = (f.solution.pose.camera_from_pad for f in (fits[0], fit))
            if float(one[:, 0] @ other[:, 0]) < _SAME_HEADING and fits[0].share - fit.share < self.config.mirror_margin:
                return None
        return fits[0] if fits else None

    def shifted(self, expected: PadPose) -> PadPose:
        """The expected pose moved across the line of sight to where most of its edges are."""
        there = self._visible(expected)
        if there is None:
            return expected
        thin = np.arange(len(there[0].ring)) % _SHIFTED_EACH == 0
        samples, curve = there[0].of(thin), there[1].of(thin)
        du, dv = (grid.ravel() for grid in np.meshgrid(_SHIFTS_PX, _SHIFTS_PX))
        shifts = np.column_stack((du, dv))
        pixels = (curve.pixels + shifts[:, np.newaxis]).reshape(-1, 2)
        count = len(shifts)
        _, strength = edges_along(
            self.image, pixels, np.tile(curve.normals, (count, 1)), np.tile(samples.rises, count), 1.5
        )
        strong = np.minimum(np.nan_to_num(strength).reshape(count, -1) / _STRONG, 1.0)
        best = shifts[int(np.argmax(strong.mean(axis=1)))]
        depth = float(expected.pad_in_camera_m[2])
        move = np.array((best[0] / self.camera.fx_px, best[1] / self.camera.fy_px, 0.0)) * depth
        return PadPose(expected.camera_from_pad, expected.pad_in_camera_m + move)

    def _from_one(self, ring: RingSeen) -> list[PadPose]:
        """Poses with most edges among headings all around: the ring's ellipse leaves only the heading open."""
        tried: list[tuple[float, PadPose]] = []
        for a in self.rings:
            if abs(a.ratio - ring.ratio) >= self.config.ratio_within:
                continue
            others = tuple(r for r in self.rings if r.triple in (a.triple, a.triple + 1) and r is not a)
            samples = sample_rings(others, 0, 10)
            for centre, normal in self._planes(ring):
                turns = _turned(normal, _HEADINGS)
                at = turns @ (samples.points_m - (a.x_m, a.y_m, 0.0)).T
                out = turns @ (1.02 * samples.outward * samples.radius_m[:, np.newaxis]).T
                share = self._shares(at, out, centre * a.outer_m, samples)
                for best in np.argsort(-share)[:2].tolist():
                    shift = centre * a.outer_m - turns[best] @ np.array((a.x_m, a.y_m, 0.0))
                    tried.append((float(share[best]), PadPose(turns[best], shift)))
        tried.sort(key=lambda one: -one[0])
        return [pose for _, pose in tried[:3]]

    def _shares(self, at: Float, out: Float, centre: Float, samples: Samples) -> Float:
        """Of points (h, 3, n) about a centre, which share has an edge near, for each of h headings."""
        points = np.moveaxis(at, 1, -1) + centre
        steps = 0.05 * np.moveaxis(out, 1, -1)
        pixels = self.camera.project(points)
        normals = self.camera.project(points + steps) - pixels
        length = np.hypot(normals[..., 0], normals[..., 1])
        normals /= np.maximum(length, 1e-9)[..., np.newaxis]
        flat = np.nan_to_num(pixels.reshape(-1, 2), nan=-100.0), np.nan_to_num(normals.reshape(-1, 2))
        rises = np.tile(samples.rises, len(points))
        offset, strength = edges_along(self.image, *flat, rises, 2.0)
        there = np.isfinite(offset).reshape(length.shape) & (length > 0.05 * self.config.least_radius_px * 0.7)
        strong = np.nan_to_num(strength).reshape(length.shape)
        share: Float = np.mean(there * np.minimum(strong / _STRONG, 1.0), axis=1)
        return share

    def _planes(self, ring: RingSeen) -> list[tuple[Float, Float]]:
        """Centres (3,), for a radius of one, and normals (3,) of planes that the ring may lie in."""
        try:
            planes = list(circle_poses(_conic(self.camera, ring.outer), 1.0))
        except GeometryError:
            return []
        if self.prior is not None:
            return [(planes[0][0], self.prior.down_camera)]
        return planes

    def _from_pair(self, one: RingSeen, other: RingSeen) -> Iterator[PadPose]:
        codes = [
            (a, b) for a in self.rings for b in self.rings
            if a.triple == b.triple and a.place != b.place
            and abs(a.ratio - one.ratio) < self.config.ratio_within
            and abs(b.ratio - other.ratio) < self.config.ratio_within
        ]  # fmt: skip
        codes.sort(key=lambda pair: abs(pair[0].ratio - one.ratio) + abs(pair[1].ratio - other.ratio))
        if not codes:
            return
        planes = self._planes(one)
        ray = self.camera.rays(np.array((other.outer.u_px, other.outer.v_px)))
        for a, b in codes:
            for centre, normal in planes:
                pose = _placed(a, b, centre * a.outer_m, normal, ray, self.config.side_within)
                if pose is not None:
                    yield pose

    def fitted(self, guess: PadPose, *, trusting: bool = False) -> _Fit | None:
        """The guess brought onto the edges in steps of shrinking reach.

        ``trusting`` that it names the right triple, an inner circle that does not show says nothing.
        """
        pose, config = guess, self.config
        fit: _Fit | None = None
        for reach, within, sigma in (*_FIRST[: 1 if trusting else 2], (2.5, config.edge_within_px, 0.2)):
            there = self._visible(pose)
            if there is None:
                return None
            edges, share = self._edges(*there, reach, within)
            if len(edges.xy) < max(24, 0.3 * len(there[0].ring)):
                return None
            solution = solve(edges, pose, self.prior, sigma, steps=6 if np.isfinite(within) else 3)
            if solution is None:
                return None
            pose = solution.pose
            if np.isfinite(within) and not (
                self._largest_is_there(*there, edges) and self._as_described(there[0], edges, pose, trusting)
            ):
                return None
            fit = _Fit(solution, edges, share, min(self.rings[i].triple for i in set(there[0].ring.tolist())))
        return fit

    def _largest_is_there(self, samples: Samples, curve: Curve, edges: Edges) -> bool:
        """Whether the largest triple that should fill the view shows, if most of it is in the picture.

        A triple taken for the next smaller one puts a larger one around it, where there is none.
        """
        if not len(edges.samples.ring):
            return False
        triple = min(samples.ring.tolist()) // 3
        wanted = np.count_nonzero(samples.ring // 3 == triple)
        outer = curve.radius_px[(samples.ring // 3 == triple) & (samples.rises > 0.0)]
        radius_px = float(np.max(outer, initial=0.0))
        whole = len(sample_rings(self.rings[3 * triple : 3 * triple + 3], 3 * triple, _count(radius_px)).ring)
        if wanted < 0.5 * whole:
            return True
        return bool(np.count_nonzero(edges.samples.ring // 3 == triple) >= self.config.largest_share * wanted)

    def _as_described(self, samples: Samples, edges: Edges, pose: PadPose, trusting: bool) -> bool:
        """Whether the rings' ratios and sizes, read off their edges, are those of the description.

        A ring whose outer circle shows and whose inner one does not is one with another ratio, unless ``trusting``.
        """
        away = distances(edges, pose)
        sought, found = (
            np.array([np.bincount(s.ring[s.rises == side], minlength=len(self.rings)) for side in (1.0, -1.0)])
            for s in (samples, edges.samples)
        )
        share = found / np.maximum(sought, 1)
        # Of small rings the inner circle drowns in blur.
        per_m = self.camera.fx_px / float(pose.pad_in_camera_m[2])
        large = np.array([per_m * ring.outer_m >= self.config.told_radius_px for ring in self.rings])
        lacks = large & (sought[1] >= 8) & (share[0] > self.config.outer_shows) & (share[1] < self.config.inner_lacks)
        if np.any(lacks) and not trusting:
            return False
        for number in set(edges.samples.ring.tolist()):
            outer = (edges.samples.ring == number) & (edges.samples.rises > 0.0)
            inner = (edges.samples.ring == number) & (edges.samples.rises < 0.0)
            if np.count_nonzero(outer) < 8 or np.count_nonzero(inner) < 5:
                continue
            radius = float(np.median(edges.radius_px[outer]))
            if radius < self.config.told_radius_px:
                continue
            grown = radius + float(np.median(away[outer]))
            ratio = (float(np.median(edges.radius_px[inner])) + float(np.median(away[inner]))) / grown
            told = float(np.median(edges.radius_px[inner])) / radius
            # Glare and blur move an edge by half a pixel or so.
            slack = self.config.slack_px / radius
            if abs(ratio - told) > self.config.ratio_within + slack:
                return False
            if abs(grown / radius - 1.0) > self.config.radius_within + slack:
                return False
        return True

    def _visible(self, pose: PadPose) -> tuple[Samples, Curve] | None:
        """Points on the rings that are large enough in the picture, of the two largest triples that are in view."""
        if pose.pad_in_camera_m[2] <= 0.0:
            return None
        per_m = self.camera.fx_px / float(pose.pad_in_camera_m[2])
        parts: list[tuple[Samples, Curve]] = []
        for triple in range(len(self.rings) // 3):
            rings = self.rings[3 * triple : 3 * triple + 3]
            radius_px = per_m * rings[0].outer_m
            least = self.config.least_radius_px if parts else self.config.told_radius_px
            if len(parts) == 2 or radius_px < least:
                break
            samples = sample_rings(rings, 3 * triple, _count(radius_px))
            curve = seen(self.camera, pose, samples)
            size = (self.camera.width_px - 5.0, self.camera.height_px - 5.0)
            inside = np.all((curve.pixels > 4.0) & (curve.pixels < size), axis=1)
            if inside.all():
                parts.append((samples, curve))
            elif inside.any():
                parts.append((samples.of(inside), curve.of(inside)))
        if sum(len(samples.ring) for samples, _ in parts) < 24:
            return None
        return joined([samples for samples, _ in parts]), Curve.joined([curve for _, curve in parts])

    def _edges(self, samples: Samples, curve: Curve, reach_px: float, within_px: float = np.inf) -> tuple[Edges, float]:
        """Edges within reach of the predicted circles, those within ``within_px`` of them, and which share that is."""
        if reach_px <= 0.0:
            # Not so far that one circle's edge is taken for the other's.
            reach_px = float(np.clip(0.25 * np.median(curve.radius_px), 2.5, 8.0))
        offset, strength = edges_along(self.image, curve.pixels, curve.normals, samples.rises, reach_px)
        keep = np.abs(offset) <= within_px
        # Ground and noise have edges too, but hardly a pad's, not even beside a pad in the shade.
        if keep.any():
            keep &= strength > self.config.least_strength * np.quantile(strength[keep], 0.8)
        return Edges.found(samples, curve, offset, keep), float(np.mean(keep))

    def explains(self, fit: _Fit, ring: RingSeen) -> bool:
        """A ring is one of the fitted pad's, or an edge within its reach."""
        pose = fit.solution.pose
        centres = np.array([(r.x_m, r.y_m, 0.0) for r in self.rings])
        pixels = self.camera.project(centres @ pose.camera_from_pad.T + pose.pad_in_camera_m)
        apart = np.hypot(pixels[:, 0] - ring.outer.u_px, pixels[:, 1] - ring.outer.v_px)
        return bool(np.nanmin(apart, initial=np.inf) < 0.6 * ring.outer.size_px + 2.0)

    def alone(self, rings: list[RingSeen], fit: _Fit) -> PadSighting | NoPad:
        """The fit's sighting, unless rings that are not of it tell of a second or of another pad."""
        others = [ring for ring in rings if not self.explains(fit, ring)]
        if any(ring.outer.size_px > self.config.larger_by * self.largest_px(fit) for ring in others):
            return NoPad(
                Refusal.FOREIGN,
                f"larger rings are in view than pad '{self.pad.name}' has where it would have to be: another pad, or a "
                "description of another print",
            )
        second = self.best(others)
        if second is not None and second.share >= self.config.accept_share:
            return NoPad(Refusal.TWO_PADS, f"two pads '{self.pad.name}' are in view; which one to land on is not known")
        return self.sighting(fit)

    def largest_px(self, fit: _Fit) -> float:
        """Radius that the rings of the fit's largest triple in view have in the picture."""
        radius_m = max(ring.outer_m for ring in self.rings if ring.triple == fit.triple)
        return self.camera.fx_px * radius_m / float(fit.solution.pose.pad_in_camera_m[2])

    def sighting(self, fit: _Fit) -> PadSighting:
        """The fit settled with the sigma that its edges have, and its mirror image while that is as good."""
        sigma = max(fit.solution.sigma_px, 0.05)
        both = both_solutions(fit.edges, fit.solution.pose, self.prior, sigma, self.config.ambiguous_below)
        return PadSighting(both or (fit.solution,), fit.triple, fit.share, len(fit.edges.xy))

    def nothing(self, rings: list[RingSeen]) -> NoPad:
        """Why no pose was found: no rings, or rings of something else."""
        alike = sum(
            1 for one, other in permutations(rings, 2)
            if 1.0 <= one.outer.size_px / other.outer.size_px < 1.4
        )  # fmt: skip
        if alike < 2:
            return NoPad(Refusal.NOTHING, "no pad in view")
        ratios = ", ".join(f"{ring.ratio:.2f}" for ring in rings[:6])
        return NoPad(
            Refusal.FOREIGN,
            f"rings with ratios {ratios} are in view, but not as pad '{self.pad.name}' is described: another pad, or "
            "a description of another print",
        )


def _count(radius_px: float) -> int:
    """Points on a circle: one each two pixels, in four densities so that they are made once."""
    return next((count for count in (12, 20, 28) if np.pi * radius_px <= count), 36)


def _turned(normal: Float, count: int) -> Float:
    """Rotations (count, 3, 3) camera_from_pad with this down, at headings all around."""
    across = np.array((1.0, 0.0, 0.0)) if abs(normal[0]) < 0.7 else np.array((0.0, 1.0, 0.0))
    first = np.cross(normal, across)
    first /= np.linalg.norm(first)
    second = np.cross(normal, first)
    angle = np.arange(count) * (2.0 * np.pi / count)
    c, s = np.cos(angle)[:, np.newaxis], np.sin(angle)[:, np.newaxis]
    return np.stack((c * first + s * second, c * second - s * first, np.broadcast_to(normal, (count, 3))), axis=-1)


def _conic(camera: Camera, ellipse: Ellipse) -> Float:
    """The ellipse as a conic (3, 3) of normalised image coordinates, free of the lens's distortion."""
    points, _ = ellipse.points(12)
    rays = camera.rays(points)
    xy = rays[:, :2] / rays[:, 2:]
    centre, scale = xy.mean(axis=0), float(np.std(xy))
    x, y = ((xy - centre) / scale).T
    _, _, basis = np.linalg.svd(np.column_stack((x * x, x * y, y * y, x, y, np.ones_like(x))))
    a, b, c, d, e, f = basis[-1]
    local = np.array(((a, b / 2, d / 2), (b / 2, c, e / 2), (d / 2, e / 2, f)))
    shift = np.array(((1.0 / scale, 0.0, -centre[0] / scale), (0.0, 1.0 / scale, -centre[1] / scale), (0.0, 0.0, 1.0)))
    conic: Float = shift.T @ local @ shift
    return conic


def _placed(a: Ring, b: Ring, centre: Float, normal: Float, ray: Float, within: float) -> PadPose | None:
    """The pose with ring ``a`` at a centre on a plane and ``b`` on a ray; None where their distance does not fit."""
    steep = float(normal @ ray)
    if steep < 0.1:
        return None
    there = ray * (float(normal @ centre) / steep)
    along = there - centre
    length = float(np.linalg.norm(along))
    wanted = float(np.hypot(b.x_m - a.x_m, b.y_m - a.y_m))
    if not abs(length - wanted) < within * wanted:
        return None
    first = along / length
    second = np.cross(normal, first)
    c, s = (b.x_m - a.x_m) / wanted, (b.y_m - a.y_m) / wanted
    turn = np.column_stack((c * first - s * second, s * first + c * second, normal))
    return PadPose(turn, centre - turn @ np.array((a.x_m, a.y_m, 0.0)))
