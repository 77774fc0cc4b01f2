"""Where the aircraft is, from nothing: a search of the whole map, then proof on other ground.

Pictures are laid out into a mosaic (`odometry.mosaic`). Its last stretches are searched on the map over all headings
and a range of scales (`registration.global_search`), again and again, a bounded amount of work with each picture. The
places that stand out are hypotheses, which ground that took no part in their search must prove (`contenders`). Until
one is proved the answer is "lost".
"""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from estimator.geometry.camera import Camera
from estimator.measurements.contenders import Contenders, ContestConfig, GroundSeen, Searched, piece_of
from estimator.measurements.hypothesis import Fit, predicted
from estimator.odometry.mosaic import Mosaic, MosaicConfig, MosaicOdometry, MosaicPose
from estimator.ports import GroundModel, ReferenceMap
from estimator.registration.global_search import EdgeMap, SearchConfig, Sweep, slices, template_of
from estimator.registration.near_match import NearMatcher
from estimator.types import Float, Image


@dataclass(frozen=True, slots=True)
class GlobalFixConfig:
    """When to search, how much at a time, and what to believe.

    The way is cut into stretches of ``stretch_m`` that show ``min_fresh`` times the stretch times the height of ground
    not seen before; one that has not after twice its length is left out. The last ``searched_stretches`` together are
    searched, whenever there is a new one and the last search has ended. Work is rationed in transformed cells a second
    of flight, ``cells_per_s``, of which one picture may take ``max_share_s`` seconds' worth; a comparison of one
    hypothesis with one piece of ground counts ``comparison_cells``. The height above ground is the barometer's, to
    ``height_std_m``, over the map's ground. Hypotheses are compared on cells of ``near_cell_m``, finer than those of
    the search, which sees a hundred million places and not a thousand. The standard deviations are the least of the
    pose that is found.
    """

    enabled: bool = True
    after_loss: bool = False
    mosaic: MosaicConfig = field(default_factory=MosaicConfig)
    search: SearchConfig = field(default_factory=SearchConfig)
    contest: ContestConfig = field(default_factory=ContestConfig)
    stretch_m: float = 120.0
    min_fresh: float = 0.8
    searched_stretches: int = 2
    cells_per_s: float = 5.0e7
    max_share_s: float = 0.2
    comparison_cells: float = 3.0e5
    height_std_m: float = 30.0
    min_height_m: float = 20.0
    near_cell_m: float = 4.0
    position_std_m: float = 6.0
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


@dataclass(slots=True, eq=False)
class _Stretch:
    """The stretch of the way that is being flown: where it began, and the heights on it."""

    from_way_m: float = -np.inf
    heights_m: list[float] = field(default_factory=list)
    pressure_alts_m: list[float] = field(default_factory=list)


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
        self._near: NearMatcher | None = None
        self._coarse: EdgeMap | None = None
        self._ground_m = (origin_alt_amsl_m, 0.0)
        self._odometry: MosaicOdometry | None = None
        self._contest: Contenders | None = None
        self._parts = 0
        self._stretch = _Stretch()
        self._begins_m: list[float] = []
        self._seen: Mosaic | None = None
        self._sweep: Sweep | None = None
        self._searched: Searched | None = None
        self._credit = 0.0
        self._last_us: int | None = None
        self._trail: list[MosaicPose] = []
        self.searches = 0
        self.slices_done = 0

    @property
    def words(self) -> str:
        """What it is doing, for people."""
        contest, config = self._contest, self.config
        if contest is not None and contest.left and contest.best is not None:
            agreeing = min(contest.best.agreeing, config.contest.min_pieces)
            return (
                f"searching the map: {len(contest.left)} hypotheses, tested on other ground "
                f"({agreeing} of {config.contest.min_pieces} pieces agree)"
            )
        if self._sweep is not None:
            return f"searching the map: {100.0 * self._sweep.progress:.0f} % of it looked at"
        if self.searches == 0:
            way_m = 0.0 if self._odometry is None else self._odometry.way_m
            return (
                f"searching the map: {way_m:.0f} of {config.stretch_m * config.searched_stretches:.0f} m of ground seen"
            )
        return "searching the map: no hypothesis is left, more ground is needed"

    def restart(self) -> None:
        """Forget what was seen; the map is kept."""
        if self._odometry is not None:
            self._odometry.restart()
        self._forget()

    def _forget(self) -> None:
        if self._contest is not None:
            self._contest.forget()
        self._stretch = _Stretch()
        self._begins_m.clear()
        self._seen = None
        self._sweep = None
        self._searched = None
        self._trail.clear()
        self.searches = 0

    def _prepared(self) -> tuple[NearMatcher, MosaicOdometry, Contenders]:
        """The map's edges, read at the first picture, and what works with them."""
        config = self.config
        if self._near is None:
            self._near = NearMatcher(EdgeMap(self._reference, replace(config.search, cell_m=config.near_cell_m)))
            self._ground_m = self._mean_ground()
        if self._odometry is None:
            self._odometry = MosaicOdometry(self._camera, self._near.map.fine_gsd_m, config.mosaic)
        if self._contest is None:
            self._contest = Contenders(self._near, self._alt_at, config.search, config.contest)
        return self._near, self._odometry, self._contest

    def offer(self, t_us: int, image: Image, level_from_camera: Float, pressure_alt_m: float) -> FoundPose | None:
        """Use a grey picture; the camera's rotation may be off by any turn about the vertical."""
        matcher, odometry, contest = self._prepared()
        height_m = max(pressure_alt_m - self._ground_m[0], self.config.min_height_m)
        before = odometry.pose
        if odometry.offer(t_us, image, level_from_camera, height_m) and odometry.pose is not None:
            if odometry.parts != self._parts or before is None:
                self._parts = odometry.parts
                self._forget()
            self._trail.append(odometry.pose)
            del self._trail[:-8]
            self._lengthen(odometry, odometry.pose, pressure_alt_m, contest, matcher)
        pose = odometry.pose
        if pose is None or not self._work(t_us, contest):
            return None
        best = contest.accepted(complex(*pose.pos_m))
        return None if best is None else self._found(best.ahead, pose, pressure_alt_m)

    def _lengthen(
        self, odometry: MosaicOdometry, pose: MosaicPose, pressure_alt_m: float, contest: Contenders,
        matcher: NearMatcher,
    ) -> None:  # fmt: skip
        """Note where the camera is on its stretch of the way, and begin another where that is long enough."""
        config, stretch = self.config, self._stretch
        stretch.heights_m.append(pose.height_m)
        stretch.pressure_alts_m.append(pressure_alt_m)
        length_m = odometry.way_m - max(stretch.from_way_m, 0.0)
        if length_m < config.stretch_m:
            return
        recent = odometry.mosaic(stretch.from_way_m)
        if recent is None:
            return
        fresh = recent if self._seen is None else recent.without(self._seen)
        height_m, alt_m = float(np.mean(stretch.heights_m)), float(np.mean(stretch.pressure_alts_m))
        piece = None
        if fresh.area_m2 >= config.min_fresh * config.stretch_m * height_m:
            piece = piece_of(fresh, height_m, alt_m, matcher, config.search)
        if piece is None and length_m < 2.0 * config.stretch_m:
            return
        if piece is not None:
            contest.see(GroundSeen(fresh, piece, height_m, alt_m))
            self._begins_m.append(stretch.from_way_m)
        self._seen = odometry.mosaic()
        self._stretch = _Stretch(odometry.way_m)

    def _work(self, t_us: int, contest: Contenders) -> bool:
        """Compare and search on, as far as the time that has passed pays for; True where all is compared."""
        config = self.config
        elapsed_s = 0.0 if self._last_us is None else max(t_us - self._last_us, 0) / 1e6
        self._last_us = t_us
        most = config.max_share_s * config.cells_per_s
        self._credit = min(self._credit + elapsed_s * config.cells_per_s, most)
        while self._credit >= config.comparison_cells:
            if not contest.step():
                break
            self._credit -= config.comparison_cells
        else:
            return False
        if self._sweep is None:
            self._begin_sweep(contest)
        while self._sweep is not None and self._credit >= min(self._sweep.cells, most):
            self._credit -= self._sweep.cells
            self._sweep.step()
            self.slices_done += 1
            if self._sweep.done:
                self._conclude(self._sweep, contest)
                return False
        return True

    def _begin_sweep(self, contest: Contenders) -> None:
        odometry, config = self._odometry, self.config
        last = contest.stretches - 1
        first = last - config.searched_stretches + 1
        searched_before = -1 if self._searched is None else self._searched.last
        if odometry is None or first < 0 or last <= searched_before:
            return
        mosaic = odometry.mosaic(self._begins_m[first])
        if mosaic is None:
            return
        if self._coarse is None:
            self._coarse = EdgeMap(self._reference, config.search)
        coarse = self._coarse
        template = template_of(mosaic.image, mosaic.known, mosaic.gsd_m, coarse.cell_m, config.search)
        height_m, alt_m = contest.heights(first, last)
        ground_m, relief_m = self._ground_m
        likely_m = max(alt_m - ground_m, config.min_height_m)
        reach_m = 2.0 * float(np.hypot(config.height_std_m, relief_m))
        low_m = max(likely_m - reach_m, 0.4 * likely_m)
        high_m = max(likely_m + reach_m, 1.1 * low_m)
        todo = slices(template, coarse.cell_m, (low_m / height_m, high_m / height_m), config.search)
        self._sweep = Sweep(coarse, template, todo, config.search)
        self._searched = Searched(mosaic, first, last)

    def _conclude(self, sweep: Sweep, contest: Contenders) -> None:
        self._sweep = None
        self.searches += 1
        if self._searched is not None:
            centre_m = self._searched.mosaic.place_m(sweep.template.centre_px)
            contest.propose(sweep.places(self.config.contest.max_candidates), self._searched, centre_m)

    def _mean_ground(self) -> tuple[float, float]:
        """Mean and standard deviation of the map's ground, AMSL."""
        south, west, north, east = self._reference.bounds_ne_m
        n, e = np.meshgrid(np.linspace(south, north, 15), np.linspace(west, east, 15))
        alt = self._ground.alt_amsl_m(n.ravel(), e.ravel())
        alt = alt[np.isfinite(alt)]
        return (float(alt.mean()), float(alt.std())) if alt.size else (self._origin_alt_m, 0.0)

    def _alt_at(self, ne_m: complex) -> float:
        return float(self._ground.alt_amsl_m(np.array([ne_m.real]), np.array([ne_m.imag]))[0])

    def _found(self, fit: Fit, now: MosaicPose, pressure_alt_m: float) -> FoundPose:
        config = self.config
        here = complex(*now.pos_m)
        at = predicted(fit, here, now.height_m, pressure_alt_m, self._alt_at, config.contest.follow)
        alt_m = at.ground_alt_m if np.isfinite(at.ground_alt_m) else self._ground_m[0]
        height_m = at.scale * now.height_m
        past = next(pose for pose in self._trail if now.t_us - pose.t_us <= 1_500_000)
        velocity = np.zeros(3)
        if past.t_us < now.t_us:
            per_s = at.ratio * (here - complex(*past.pos_m)) / ((now.t_us - past.t_us) / 1e6)
            velocity[:2] = per_s.real, per_s.imag
        ratio_std = float(np.sqrt(at.cov[1, 1])) / at.scale
        height_std_m = float(np.hypot(config.height_std_share, ratio_std)) * height_m
        std = np.array([config.position_std_m, config.position_std_m, height_std_m])
        place = np.array([at.anchor_ne_m.real, at.anchor_ne_m.imag, self._origin_alt_m - alt_m - height_m])
        return FoundPose(
            now.t_us, place, std, velocity, config.velocity_std_m_s, at.turn_rad,
            max(config.heading_std_rad, ratio_std),
        )  # fmt: skip
