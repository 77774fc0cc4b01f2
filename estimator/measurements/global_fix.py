"""Where the aircraft is, from nothing: a search of the whole map, then proof on fresh ground.

Pictures are laid out into a mosaic (`odometry.mosaic`), which is searched on the map over all headings and a range of
scales (`registration.global_search`), a bounded amount of work with each picture. What stands out there are
candidates. Each says where ground that is seen later, and that took no part in the search, must lie on the map: a
sequential probability ratio test (Wald 1945) over such pieces of ground drops them one by one, and accepts the one that
is left when it has proved itself. Until then the answer is "lost".
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from estimator.geometry.camera import Camera
from estimator.odometry.mosaic import Mosaic, MosaicConfig, MosaicOdometry, MosaicPose
from estimator.ports import GroundModel, ReferenceMap
from estimator.registration.global_search import (
    EdgeMap,
    Place,
    SearchConfig,
    Slice,
    Sweep,
    slices,
    template_of,
)
from estimator.types import Float, Image


@dataclass(frozen=True, slots=True)
class GlobalFixConfig:
    """When to search, how much at a time, and what to believe.

    A search begins ``min_way_m`` after the mosaic and again every ``again_way_m``. Work is rationed in transformed
    cells a second of flight, ``cells_per_s``, of which one picture may take ``max_share_s`` seconds' worth. The height
    above ground is the barometer's, to ``height_std_m``, over the map's ground. Up to ``max_candidates`` places that
    hold ``min_share`` of the probability are tested every ``fresh_way_m`` on the ground seen since, within ``reach_m``
    of where it must be. A piece counts between ``min_log_ratio`` and ``max_log_ratio``: a lake or what was built since
    must not decide; ``window_log_ratio`` is taken off for the choice among the places within reach. At
    ``reject_log_ratio`` a candidate is dropped, and a new search replaces those that
    have not yet come to ``promising_log_ratio``.
    One is accepted when it holds ``min_mode`` of the probability, "none of them" counted, and at least ``min_places``
    pieces in a row spoke for it, ``accept_log_ratio`` in all. The standard deviations are those of the pose then.
    """

    enabled: bool = True
    after_loss: bool = False
    mosaic: MosaicConfig = field(default_factory=MosaicConfig)
    search: SearchConfig = field(default_factory=SearchConfig)
    min_way_m: float = 220.0
    again_way_m: float = 80.0
    cells_per_s: float = 5.0e7
    max_share_s: float = 0.2
    height_std_m: float = 30.0
    min_height_m: float = 20.0
    min_mode: float = 0.99
    mode_radius_m: float = 30.0
    max_candidates: int = 12
    min_share: float = 0.003
    fresh_way_m: float = 120.0
    reach_m: float = 16.0
    accept_log_ratio: float = 14.0
    promising_log_ratio: float = 3.0
    max_log_ratio: float = 6.0
    min_log_ratio: float = -4.0
    reject_log_ratio: float = -6.0
    window_log_ratio: float = 2.0
    min_places: int = 3
    position_std_m: float = 10.0
    heading_std_rad: float = 0.03
    height_std_share: float = 0.04
    velocity_std_m_s: float = 1.5


@dataclass(frozen=True, slots=True, eq=False)
class FoundPose:
    """Where the camera is at ``t_us``: position NED (3,) and its standard deviations (3,), velocity (3,) and its.

    ``turn_rad`` takes the reported headings to true ones, to ``turn_std_rad``.
    """

    t_us: int
    pos_ned_m: Float
    pos_std_m: Float
    vel_ned_m_s: Float
    vel_std_m_s: float
    turn_rad: float
    turn_std_rad: float


@dataclass(frozen=True, slots=True, eq=False)
class _Candidate:
    """Ties the mosaic's frame to the local frame: true = anchor + scale Rot(turn) (mosaic - mosaic anchor).

    ``strength`` is the height of the peak in deviations of the clutter over the root of its ground in square metres.
    ``share`` is its probability by the search, ``log_ratio`` what ``places`` pieces of fresh ground in a row, and those
    before, have said since.
    """

    anchor_ne_m: Float
    anchor_mosaic_m: Float
    turn_rad: float
    scale: float
    strength: float
    share: float
    log_ratio: float = 0.0
    places: int = 0

    def ne_m(self, mosaic_m: Float) -> Float:
        """North and east (2,) of a place of the mosaic (2,)."""
        cos, sin = np.cos(self.turn_rad), np.sin(self.turn_rad)
        turned = np.array([[cos, -sin], [sin, cos]]) @ (mosaic_m - self.anchor_mosaic_m)
        place: Float = self.anchor_ne_m + self.scale * turned
        return place


class GlobalFixer:
    """Finds the aircraft on the map from pictures, attitude with any heading, and pressure altitude."""

    def __init__(
        self, camera: Camera, reference: ReferenceMap, ground: GroundModel, origin_alt_amsl_m: float,
        config: GlobalFixConfig | None = None,
    ) -> None:  # fmt: skip
        self.config = config or GlobalFixConfig()
        self._camera = camera
        self._reference = reference
        self._ground = ground
        self._origin_alt_m = origin_alt_amsl_m
        self._coarse: EdgeMap | None = None
        self._odometry: MosaicOdometry | None = None
        self._parts = 0
        self._sweep: Sweep | None = None
        self._sweep_mosaic: Mosaic | None = None
        self._sweep_height_m = 0.0
        self._searched_way_m = -np.inf
        self._credit = 0.0
        self._last_us: int | None = None
        self._candidates: list[_Candidate] = []
        self._others = 1.0
        self._seen: Mosaic | None = None
        self._tested_way_m = 0.0
        self._trail: list[MosaicPose] = []
        self._begun_alt_m = 0.0
        self.hypotheses: int | None = None
        self.slices_done = 0

    @property
    def words(self) -> str:
        """What it is doing, for people."""
        if self._candidates:
            places = max(candidate.places for candidate in self._candidates)
            return (
                f"searching the map: {len(self._candidates)} hypotheses, tested on fresh ground "
                f"({places} of {self.config.min_places} pieces agree)"
            )
        if self.hypotheses is None:
            way_m = 0.0 if self._odometry is None else self._odometry.way_m
            if self._sweep is None:
                return f"searching the map: {way_m:.0f} of {self.config.min_way_m:.0f} m of ground seen"
            return f"searching the map: {100.0 * self._sweep.progress:.0f} % of it looked at"
        return f"searching the map: {self.hypotheses} hypotheses"

    def restart(self) -> None:
        """Forget what was seen; the map is kept."""
        if self._odometry is not None:
            self._odometry.restart()
        self._forget()

    def _forget(self) -> None:
        self._sweep = None
        self._candidates = []
        self._searched_way_m = -np.inf
        self._trail.clear()
        self.hypotheses = None

    def offer(self, t_us: int, image: Image, level_from_camera: Float, pressure_alt_m: float) -> FoundPose | None:
        """Use a grey picture; the camera's rotation may be off by any turn about the vertical."""
        if self._coarse is None or self._odometry is None:
            self._coarse = EdgeMap(self._reference, self.config.search)
            self._odometry = MosaicOdometry(self._camera, self._coarse.fine_gsd_m, self.config.mosaic)
        height_m = max(pressure_alt_m - self._mean_ground()[0], self.config.min_height_m)
        before = self._odometry.pose
        if not self._odometry.offer(t_us, image, level_from_camera, height_m):
            self._work(t_us)
            return None
        if self._odometry.parts != self._parts or before is None:
            self._parts = self._odometry.parts
            self._forget()
            self._begun_alt_m = pressure_alt_m
        pose = self._odometry.pose
        if pose is None:
            return None
        self._trail.append(pose)
        del self._trail[:-8]
        found = self._check(pose) if self._candidates else None
        if found is None:
            self._work(t_us)
        return found

    def _work(self, t_us: int) -> None:
        """Search on, as far as the time that has passed pays for."""
        config = self.config
        elapsed_s = 0.0 if self._last_us is None else max(t_us - self._last_us, 0) / 1e6
        self._last_us = t_us
        self._credit = min(self._credit + elapsed_s * config.cells_per_s, config.max_share_s * config.cells_per_s)
        if self._sweep is None:
            self._begin_sweep()
        while self._sweep is not None and self._credit >= min(
            self._sweep.cells, config.max_share_s * config.cells_per_s
        ):
            self._credit -= self._sweep.cells
            self._sweep.step()
            self.slices_done += 1
            if self._sweep.done:
                self._conclude(self._sweep)
                self._sweep = None

    def _begin_sweep(self) -> None:
        odometry, coarse, config = self._odometry, self._coarse, self.config
        if odometry is None or coarse is None or odometry.pose is None:
            return
        if odometry.way_m < max(config.min_way_m, self._searched_way_m + config.again_way_m):
            return
        mosaic = odometry.mosaic()
        if mosaic is None:
            return
        template = template_of(mosaic.image, mosaic.known, mosaic.gsd_m, coarse.cell_m, config.search)
        ground_m, relief_m = self._mean_ground()
        nominal_m = max(self._begun_alt_m - ground_m, config.min_height_m)
        reach_m = 2.0 * float(np.hypot(config.height_std_m, relief_m))
        low = max(self._begun_alt_m - ground_m - reach_m, 0.4 * nominal_m)
        high = max(self._begun_alt_m - ground_m + reach_m, low * 1.1)
        todo = slices(template, coarse.cell_m, (low / nominal_m, high / nominal_m), config.search)
        self._sweep = Sweep(coarse, template, todo, config.search)
        self._sweep_mosaic = mosaic
        self._sweep_height_m = nominal_m
        self._searched_way_m = odometry.way_m

    def _conclude(self, sweep: Sweep) -> None:
        config = self.config
        places, none = sweep.places(self._log_height_prior)
        if not places:
            self.hypotheses = 0
            return
        if any(candidate.log_ratio >= config.promising_log_ratio for candidate in self._candidates):
            return  # fresh ground says more than the same ground again
        distinct = _distinct(places, config.mode_radius_m)
        self.hypotheses = len(distinct)
        mosaic = self._sweep_mosaic
        kept = [place for place in distinct if place.probability >= config.min_share][: config.max_candidates]
        if mosaic is None or not kept:
            return
        centre_m = _centre_m(mosaic, sweep.template.centre_px)
        strength = kept[0].height_sigmas / float(np.sqrt(mosaic.area_m2))
        self._candidates = [
            _Candidate(p.centre_ne_m, centre_m, p.heading_rad, p.scale, strength, p.probability) for p in kept
        ]
        self._others = max(1.0 - sum(place.probability for place in kept), none)
        self._seen, self._tested_way_m = mosaic, self._searched_way_m

    def _log_height_prior(self, centre_ne_m: Float, scale: Float) -> Float:
        """What the barometer says of heights above the ground of places (n, 2), scales (n,)."""
        ground_m = self._ground.alt_amsl_m(centre_ne_m[:, 0], centre_ne_m[:, 1])
        off_m = self._begun_alt_m - ground_m - scale * self._sweep_height_m
        prior: Float = -0.5 * np.square(np.nan_to_num(off_m) / self.config.height_std_m)
        return prior

    def _mean_ground(self) -> tuple[float, float]:
        """Mean and standard deviation of the map's ground, AMSL."""
        south, west, north, east = self._reference.bounds_ne_m
        n, e = np.meshgrid(np.linspace(south, north, 15), np.linspace(west, east, 15))
        alt = self._ground.alt_amsl_m(n.ravel(), e.ravel())
        alt = alt[np.isfinite(alt)]
        return (float(alt.mean()), float(alt.std())) if alt.size else (self._origin_alt_m, 0.0)

    def _down_at(self, north_m: float, east_m: float) -> float:
        alt_m = float(self._ground.alt_amsl_m(np.array([north_m]), np.array([east_m]))[0])
        return self._origin_alt_m - (alt_m if np.isfinite(alt_m) else self._mean_ground()[0])

    def _check(self, now: MosaicPose) -> FoundPose | None:
        """Test the candidates on the ground seen since; the pose where one has proved itself."""
        odometry, config = self._odometry, self.config
        if odometry is None or self._seen is None or odometry.way_m < self._tested_way_m + config.fresh_way_m:
            return None
        recent, whole = odometry.mosaic(self._tested_way_m), odometry.mosaic()
        self._tested_way_m = odometry.way_m
        if recent is None or whole is None:
            return None
        fresh = recent.without(self._seen)
        if fresh.area_m2 < 0.3 * config.fresh_way_m * now.height_m:
            return None
        self._seen = whole
        self._candidates = self._tested(fresh)
        if not self._candidates:
            return None
        mass = np.array([c.share * np.exp(min(c.log_ratio, 100.0)) for c in self._candidates])
        best = self._candidates[int(np.argmax(mass))]
        proved = best.log_ratio >= config.accept_log_ratio and best.places >= config.min_places
        if not proved or mass.max() / (mass.sum() + self._others) < config.min_mode:
            return None
        return self._found(best, now)

    def _tested(self, fresh: Mosaic) -> list[_Candidate]:
        """The candidates with what a piece of ground says of each; without those off the map, or ruled out."""
        coarse, config = self._coarse, self.config
        if coarse is None:
            return []
        template = template_of(fresh.image, fresh.known, fresh.gsd_m, coarse.cell_m, config.search)
        centre_m = _centre_m(fresh, template.centre_px)
        todo = [Slice(candidate.turn_rad, candidate.scale) for candidate in self._candidates]
        sweep = Sweep(coarse, template, todo, config.search)
        left = []
        for candidate, what in zip(self._candidates, todo, strict=True):
            place = sweep.best_near(what, candidate.ne_m(centre_m), config.reach_m)
            if place is None:
                continue
            expected = candidate.strength * float(np.sqrt(fresh.area_m2))
            gain = config.search.temperature * (expected * place.height_sigmas - 0.5 * expected**2)
            gain -= config.window_log_ratio
            gain = float(np.clip(gain, config.min_log_ratio, config.max_log_ratio))
            tested = replace(
                candidate, log_ratio=candidate.log_ratio + gain, places=candidate.places + 1 if gain > 0.0 else 0
            )
            if gain > 0.0:
                tested = replace(tested, anchor_ne_m=place.centre_ne_m, anchor_mosaic_m=centre_m)
            if tested.log_ratio > config.reject_log_ratio:
                left.append(tested)
        return left

    def _found(self, candidate: _Candidate, now: MosaicPose) -> FoundPose | None:
        config = self.config
        ne = candidate.ne_m(now.pos_m)
        height_m = candidate.scale * now.height_m
        down = self._down_at(float(ne[0]), float(ne[1]))
        past = next(pose for pose in self._trail if now.t_us - pose.t_us <= 1_500_000)
        velocity = np.zeros(3)
        if past.t_us < now.t_us:
            velocity[:2] = (ne - candidate.ne_m(past.pos_m)) / ((now.t_us - past.t_us) / 1e6)
        std = np.array([config.position_std_m, config.position_std_m, config.height_std_share * height_m])
        return FoundPose(
            now.t_us, np.array([ne[0], ne[1], down - height_m]), std, velocity, config.velocity_std_m_s,
            candidate.turn_rad, config.heading_std_rad,
        )  # fmt: skip


def _centre_m(mosaic: Mosaic, centre_px: Float) -> Float:
    """A pixel's place (2,) in the mosaic's frame."""
    place: Float = mosaic.first_m + mosaic.gsd_m * centre_px * np.array([-1.0, 1.0])
    return place


def _distinct(places: list[Place], radius_m: float) -> list[Place]:
    """The places that lie apart and hold at least a hundredth of what the best one does, with what lies about each."""
    kept: list[Place] = []
    for place in places:
        near = [i for i, other in enumerate(kept) if np.hypot(*(place.centre_ne_m - other.centre_ne_m)) < radius_m]
        if near:
            kept[near[0]] = replace(kept[near[0]], probability=kept[near[0]].probability + place.probability)
        elif place.probability >= 0.01 * places[0].probability:
            kept.append(place)
    return kept
