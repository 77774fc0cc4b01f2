"""What the navigator notices of its own inputs, and what it does about it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.geometry.rotation import matrix_from_q
from estimator.integrity.displacement import DisplacementConfig, DisplacementWatch
from estimator.integrity.picture import shows_ground
from estimator.integrity.second_opinion import SecondOpinion, SecondOpinionConfig
from estimator.integrity.steady import SteadyConfig, SteadyInnovations
from estimator.integrity.zero import WanderingZero, ZeroConfig
from estimator.measurements.innovation import Innovation
from estimator.measurements.map_fix import MapFixer
from estimator.robust import largest_std
from estimator.types import Doubt, FixReport, Float, FrameSample, Image


@dataclass(frozen=True, slots=True)
class SelfWatchConfig:
    """``enabled`` off takes every picture and doubts nothing.

    A second opinion more than ``contradiction_sigmas`` of its own from the estimate replaces it. From
    ``displaced_sigmas`` of the estimate's on it is rather the map, or what looks alike, that lies elsewhere. After
    ``wide_after`` refused pictures in a row under satellites the search reaches ``wide_reach_m``, as far as a displaced
    map is looked for. In level flight the tilt is below ``level_rad``, and climb or sink below ``steep_m_s`` or below
    ``steep_share`` of the speed over ground.
    """

    enabled: bool = True
    displacement: DisplacementConfig = field(default_factory=DisplacementConfig)
    opinion: SecondOpinionConfig = field(default_factory=SecondOpinionConfig)
    steady: SteadyConfig = field(default_factory=SteadyConfig)
    zero: ZeroConfig = field(default_factory=ZeroConfig)
    pressure_gain: float = 5.0
    level_rad: float = 0.35
    steep_m_s: float = 0.5
    steep_share: float = 0.5
    contradiction_sigmas: float = 2.5
    displaced_sigmas: float = 7.0
    wide_after: int = 5
    wide_reach_m: float = 40.0


@dataclass(slots=True, eq=False)
class _Learned:
    """Where (2,) a map's displacement (2,) was learned, how much it changes a metre, and where that last counted."""

    pos_ne_m: Float
    displacement_ne_m: Float
    std_m: float
    last_ne_m: Float
    by_place: float = 0.0


class SelfWatch:
    """Watches pictures and matches; says which doubts stand."""

    def __init__(self, config: SelfWatchConfig) -> None:
        self.config = config
        self._blind = False
        self._map_offset_m = 0.0
        self._map_agreed = False
        self._learned: _Learned | None = None
        self._by_satellites = DisplacementWatch(config.displacement)
        self._opinion = SecondOpinion(config.opinion)
        self._opinion_ne_m = np.zeros(2)
        self._pressure = SteadyInnovations(config.steady)
        self._pressure_zero = WanderingZero(config.zero)
        self._t_us = 0

    def takes(self, image: Image) -> bool:
        """Whether a grey picture (rows, cols) may be used: what seems to move in a blind one is noise, or a light."""
        self._blind = self.config.enabled and not shows_ground(image)
        return not self._blind

    def pressure(self, t_us: int, innovation: Innovation, eskf: ErrorStateFilter) -> None:
        """Let the barometer's zero follow where its readings keep to one side of what the pictures say of the climb.

        Only in level flight: in a steep turn it is the pictures' climb that is poor, and so it is straight up or down,
        where nothing is passed by whose distance could be told. What is told is not that, which chance does as well for
        a few seconds, but how far the zero has gone.
        """
        self._t_us = t_us
        if eskf.layout.has("barometer_bias"):
            zero_std_m = float(np.sqrt(eskf.cov("barometer_bias")[0, 0]))
            self._pressure_zero.note(t_us, eskf.nominal.barometer_bias_m, zero_std_m)
        if not self._is_level(eskf):
            self._pressure.restart()
            return
        std_m = float(np.sqrt((innovation.H @ eskf.P @ innovation.H.T + innovation.R)[0, 0]))
        mean_m = self._pressure.note(t_us, float(innovation.z[0]), std_m)
        if self.config.enabled and mean_m != 0.0 and eskf.layout.has("barometer_bias"):
            # what the zero lags behind it is to make up at once: its usual wandering would take minutes
            eskf.inflate("barometer_bias", (self.config.pressure_gain * mean_m) ** 2)

    def _is_level(self, eskf: ErrorStateFilter) -> bool:
        north, east, down = eskf.nominal.motion.vel_ned_m_s.tolist()
        if abs(down) > max(self.config.steep_m_s, self.config.steep_share * float(np.hypot(north, east))):
            return False
        return bool(matrix_from_q(eskf.nominal.motion.q_ned_from_body)[2, 2] >= np.cos(self.config.level_rad))

    def attempt(
        self, fixer: MapFixer, frame: FrameSample, eskf: ErrorStateFilter, by_satellites: bool,
        fix: Callable[[], FixReport],
    ) -> FixReport:  # fmt: skip
        """Make a map fix and hold it against satellites, where there are, or against the estimate."""
        wide = self.config.enabled and by_satellites and fixer.rejected_in_row >= self.config.wide_after
        fixer.least_reach_m = self.config.wide_reach_m if wide else 0.0
        pos_ne_m = eskf.nominal.motion.pos_ned_m[:2].copy()
        cov_ne_m2 = eskf.cov("position")[:2, :2]
        report = fix()
        if not self.config.enabled:
            return report
        self._forget_with_the_way(eskf, pos_ne_m)
        if by_satellites:
            self._opinion.forget()
            displacement_ne_m = np.array([report.north_m, report.east_m]) - pos_ne_m
            std_m = largest_std(cov_ne_m2)
            self._against_satellites(fixer, eskf, frame.t_us, pos_ne_m, displacement_ne_m, std_m)
        else:
            self._against_estimate(fixer, eskf, pos_ne_m, cov_ne_m2)
        return report

    def place_was_given(self) -> None:
        """The estimate has been put elsewhere, by the operator or a search: what was thought before is void."""
        self._opinion.forget()

    def _against_satellites(
        self, fixer: MapFixer, eskf: ErrorStateFilter, t_us: int, pos_ne_m: Float, displacement_ne_m: Float,
        std_m: float,
    ) -> None:  # fmt: skip
        """Learn how far the map as a whole is displaced.

        Only of a map that has never agreed with satellites: where it has, what has moved may be the satellites'
        position, and which of the two is for the operator to say.
        """
        standing = self._by_satellites.add(t_us, pos_ne_m, displacement_ne_m)
        if standing is None:
            return
        far = standing.size_m > self.config.displacement.least_m
        self._map_offset_m = standing.size_m if far else 0.0
        if self._learned is not None:
            self._learn_change(self._learned, eskf.nominal.map_offset_ne_m + standing.displacement_ne_m, pos_ne_m)
        if not far:
            self._map_agreed = True
        elif not self._map_agreed and eskf.layout.has("map_offset"):
            std_m = float(np.hypot(standing.std_m, std_m))
            eskf.learn_map_offset(standing.displacement_ne_m, std_m)
            if self._learned is None:
                self._learned = _Learned(pos_ne_m, eskf.nominal.map_offset_ne_m, std_m, pos_ne_m)
            self._by_satellites.forget()
            fixer.begin_anew()

    def _learn_change(self, learned: _Learned, displacement_ne_m: Float, pos_ne_m: Float) -> None:
        """A map that is turned or stretched is displaced otherwise elsewhere: by how much a metre, beyond noise."""
        way_m = float(np.hypot(*(pos_ne_m - learned.pos_ne_m)))
        if way_m >= self.config.displacement.min_way_m:
            changed_m = float(np.hypot(*(displacement_ne_m - learned.displacement_ne_m)))
            learned.by_place = max(changed_m - 2.0 * learned.std_m, 0.0) / way_m

    def _forget_with_the_way(self, eskf: ErrorStateFilter, pos_ne_m: Float) -> None:
        """Let the learned displacement grow unsure with the way, by as much as it was seen to change."""
        learned = self._learned
        if learned is None:
            return
        grown_m = learned.by_place * float(np.hypot(*(pos_ne_m - learned.last_ne_m)))
        std_m = float(np.sqrt(np.trace(eskf.cov("map_offset")) / 2.0))
        # one and the same turn all along: standard deviations add, not variances
        eskf.inflate("map_offset", grown_m * (2.0 * std_m + grown_m))
        learned.last_ne_m = pos_ne_m

    def _against_estimate(self, fixer: MapFixer, eskf: ErrorStateFilter, pos_ne_m: Float, cov_ne_m2: Float) -> None:
        """Replace a position, or doubt the map, that all pictures together contradict.

        ``pos_ne_m`` (2,) and ``cov_ne_m2`` (2, 2) are the estimate's from before the picture.
        """
        opinion, config = self._opinion, self.config
        if 3.0 * largest_std(cov_ne_m2) > config.opinion.half_extent_m:
            # the place may be off the grid, and what looks alike on it would be taken for it
            opinion.forget()
            return
        if not opinion.begun:
            opinion.begin(cov_ne_m2)
            self._opinion_ne_m = pos_ne_m
        says = fixer.last_picture(config.opinion.cell_m)
        if says is None:
            return
        way_m = float(np.hypot(*(pos_ne_m - self._opinion_ne_m)))
        opinion.see(says.likelihood, says.north_max_m, says.east_min_m, says.fresh, way_m)
        self._opinion_follows(eskf, pos_ne_m)
        found = opinion.opinion()
        if found is None:
            return
        far = found.sigmas > config.contradiction_sigmas
        std_m = largest_std(eskf.cov("position")[:2, :2])
        displaced = far and found.size_m > config.displaced_sigmas * std_m
        self._map_offset_m = found.size_m if displaced else 0.0
        if far and not displaced:
            before_ne_m = eskf.nominal.motion.pos_ned_m[:2].copy()
            # what the filter knew counts for little against it, however small its sigma had become
            eskf.doubt_place(found.cov_ne_m2 + np.outer(found.displacement_ne_m, found.displacement_ne_m))
            H = eskf.layout.jacobian(2, position=np.eye(2, 3))
            eskf.update(found.displacement_ne_m, H, found.cov_ne_m2, what="second_opinion")
            fixer.begin_anew()
            self._opinion_follows(eskf, before_ne_m)

    def _opinion_follows(self, eskf: ErrorStateFilter, before_ne_m: Float) -> None:
        self._opinion_ne_m = eskf.nominal.motion.pos_ned_m[:2].copy()
        self._opinion.corrected(self._opinion_ne_m - before_ne_m)

    def doubts(self, eskf: ErrorStateFilter, fixer: MapFixer | None) -> tuple[Doubt, ...]:
        """Those that stand."""
        learned_m = float(np.hypot(*eskf.nominal.map_offset_ne_m))
        stand = {
            Doubt.NO_TEXTURE: self._blind,
            Doubt.MAP_MISMATCH: fixer is not None and fixer.evidence.against,
            Doubt.MAP_OFFSET: max(self._map_offset_m, learned_m) > self.config.displacement.least_m,
            Doubt.BAROMETER_DRIFT: self.config.enabled and self._pressure_zero.stands(self._t_us),
        }
        return tuple(doubt for doubt, stands in stand.items() if stands)
