"""What is noticed of the inputs, and what follows from it in the filter."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.eskf import ErrorStateFilter, ProcessNoise
from estimator.filters.nominal import STATE_GROUPS, Layout, Nominal
from estimator.filters.strapdown import EarthModel, Motion
from estimator.integrity.map_evidence import MapEvidence
from estimator.measurements.barometer import pressure_altitude
from estimator.measurements.map_fix import MapFixer, PictureSays
from estimator.measurements.self_watch import SelfWatch, SelfWatchConfig
from estimator.types import Doubt, FixReport, FrameSample

LAYOUT = Layout.of(STATE_GROUPS)
SHIFT = np.array([14.0, -14.0])
HEIGHT_M = 100.0
STD_M = 2.0


class Fixer:
    """Stands for a map fixer: says what a test lets it say."""

    def __init__(self) -> None:
        self.rejected_in_row = 0
        self.least_reach_m = 0.0
        self.evidence = MapEvidence()
        self.begun_anew = 0
        self.from_estimate_ne_m = np.zeros(2)

    def begin_anew(self) -> None:
        self.begun_anew += 1

    def last_picture(self, cell_m: float) -> PictureSays:
        """A match of a metre's sigma where the report is, and a tenth everywhere."""
        axis = cell_m * np.arange(-30.0, 31.0)
        north, east = np.meshgrid(-axis - self.from_estimate_ne_m[0], axis - self.from_estimate_ne_m[1], indexing="ij")
        matched = np.exp(-0.5 * (north**2 + east**2))
        return PictureSays(0.9 * matched / matched.mean() + 0.1, float(axis[-1]), float(axis[0]), 1.0)


def new_filter() -> ErrorStateFilter:
    zero = np.zeros(3)
    nominal = Nominal(Motion(zero, zero, np.array([1.0, 0.0, 0.0, 0.0])), zero, zero, 0.0, zero, zero)
    sigma = np.full(LAYOUT.size, 0.1)
    sigma[LAYOUT.slices["position"]] = STD_M
    sigma[LAYOUT.slices["map_offset"]] = 0.0
    return ErrorStateFilter(nominal, np.diag(sigma**2), LAYOUT, EarthModel.at(0.8, 300.0), ProcessNoise())


def report(t_us: int, place_ne_m: np.ndarray) -> FixReport:
    return FixReport(
        t_us, 0, "registration", False, "", float(place_ne_m[0]), float(place_ne_m[1]), np.eye(2), 0.2, 0.1, 0.0,
        0.0, 1.0,
    )  # fmt: skip


def fly(
    watch: SelfWatch, eskf: ErrorStateFilter, displaced_ne_m: np.ndarray, *, by_satellites: bool, seconds: float = 14.0,
    start_s: float = 0.0, fixer: Fixer | None = None,
) -> tuple[Doubt, ...]:  # fmt: skip
    """Go north at 10 m/s with a match every 0.4 s, each displaced by so much less what the filter has learned.

    Under satellites the estimate is kept on its track; without, what has corrected it stays.
    """
    fixer = fixer or Fixer()
    stands_in = cast(MapFixer, fixer)
    corrected_m = np.zeros(3)
    for k in range(round(seconds / 0.4)):
        t_us = round(1e6 * (start_s + 0.4 * k))
        on_track = np.array([10.0 * (start_s + 0.4 * k), 0.0, -HEIGHT_M])
        eskf.nominal = replace(
            eskf.nominal, motion=replace(eskf.nominal.motion, pos_ned_m=on_track + corrected_m)
        )  # fmt: skip
        place = on_track[:2] + displaced_ne_m - eskf.nominal.map_offset_ne_m
        fixer.from_estimate_ne_m = place - eskf.nominal.motion.pos_ned_m[:2]
        frame = FrameSample(t_us, k, np.zeros((2, 2), dtype=np.uint8))
        found = report(t_us, place)
        watch.attempt(stands_in, frame, eskf, by_satellites, lambda found=found: found)  # type: ignore[misc]
        if not by_satellites:
            corrected_m = eskf.nominal.motion.pos_ned_m - on_track
    return watch.doubts(eskf, stands_in)


def test_a_displaced_map_is_learned_while_there_are_satellites_and_told_for_good() -> None:
    watch, eskf, fixer = SelfWatch(SelfWatchConfig()), new_filter(), Fixer()

    doubts = fly(watch, eskf, SHIFT, by_satellites=True, fixer=fixer)

    assert fixer.begun_anew == 1
    assert doubts == (Doubt.MAP_OFFSET,)
    assert_allclose(eskf.nominal.map_offset_ne_m, SHIFT, atol=0.1)
    # as sure as the position that it was seen from, to begin with
    assert_allclose(np.sqrt(np.diag(eskf.cov("map_offset"))), STD_M, rtol=0.05)
    later = fly(watch, eskf, SHIFT, by_satellites=False, start_s=20.0)
    assert later == (Doubt.MAP_OFFSET,)
    assert_allclose(eskf.nominal.map_offset_ne_m, SHIFT, atol=0.1)


@pytest.mark.parametrize(("by_place", "grows"), [(0.0, False), (0.1, True)])
def test_a_displacement_that_changes_with_the_place_grows_unsure_with_the_way(by_place: float, grows: bool) -> None:
    """Fault: a map turned by six degrees. Expected: what has been learned serves nearby, and ever less afar."""
    watch, eskf = SelfWatch(SelfWatchConfig()), new_filter()
    start, rate = np.array([14.0, 0.0]), np.array([0.0, by_place])
    for second in range(0, 30, 2):
        fly(watch, eskf, start + 10.0 * second * rate, by_satellites=True, seconds=2.0, start_s=float(second))
    learned_m = np.sqrt(eskf.cov("map_offset")[0, 0])

    fly(watch, eskf, eskf.nominal.map_offset_ne_m, by_satellites=False, start_s=30.0, seconds=20.0)

    std_m = float(np.sqrt(eskf.cov("map_offset")[0, 0]))
    # 200 m on by six hundredths to a tenth a metre: some of the change is taken for noise
    assert (12.0 < std_m - learned_m < 21.0) if grows else (std_m == pytest.approx(learned_m))


def test_a_map_that_has_agreed_is_not_moved_after_satellites_that_wander_off() -> None:
    """Fault: satellites are dragged away by 20 m after the map had agreed with them. Expected: alarm, map unmoved."""
    watch, eskf = SelfWatch(SelfWatchConfig()), new_filter()
    assert fly(watch, eskf, np.zeros(2), by_satellites=True) == ()

    doubts = fly(watch, eskf, SHIFT, by_satellites=True, start_s=20.0)

    assert doubts == (Doubt.MAP_OFFSET,)
    assert_allclose(eskf.nominal.map_offset_ne_m, 0.0)
    assert fly(watch, eskf, np.zeros(2), by_satellites=True, start_s=40.0) == ()


@pytest.mark.parametrize(("std_m", "replaced"), [(5.0, True), (2.0, False)])
def test_without_satellites_pictures_that_contradict_the_estimate_together_replace_it(
    std_m: float, replaced: bool
) -> None:
    """Twenty metres are four and ten of its sigmas; the second is told as a displaced map."""
    watch, eskf, fixer = SelfWatch(SelfWatchConfig()), new_filter(), Fixer()
    eskf.inflate("position", std_m**2 - STD_M**2)

    doubts = fly(watch, eskf, SHIFT, by_satellites=False, fixer=fixer)

    assert (Doubt.MAP_OFFSET in doubts) == (not replaced)
    assert (fixer.begun_anew > 0) == replaced
    left_m = np.array([10.0 * 0.4 * 34, 0.0]) + SHIFT - eskf.nominal.motion.pos_ned_m[:2]
    assert_allclose(left_m, np.zeros(2) if replaced else SHIFT, atol=1.5)
    cov = eskf.cov("position")[:2, :2]
    assert np.sqrt(np.linalg.eigvalsh(cov)) == pytest.approx([1.5, 1.8] if replaced else [std_m] * 2, abs=0.5)
    assert_allclose(eskf.nominal.map_offset_ne_m, 0.0)


def test_a_place_that_is_hardly_known_is_not_replaced_by_what_looks_alike_near_by() -> None:
    """Known to 50 m, more than the second opinion reaches: what matches 20 m off may be anything."""
    watch, eskf, fixer = SelfWatch(SelfWatchConfig()), new_filter(), Fixer()
    eskf.inflate("position", 50.0**2 - STD_M**2)

    assert fly(watch, eskf, SHIFT, by_satellites=False, fixer=fixer) == ()

    assert fixer.begun_anew == 0
    assert np.sqrt(np.linalg.eigvalsh(eskf.cov("position")[:2, :2])[0]) == pytest.approx(50.0)


@pytest.mark.parametrize("given", [True, False])
def test_a_place_that_was_given_is_held_against_pictures_from_then_on(given: bool) -> None:
    """The operator gives a place to 5 m; the next picture is 12 m off. What was sure before no longer speaks for it."""
    watch, eskf, fixer = SelfWatch(SelfWatchConfig()), new_filter(), Fixer()
    fly(watch, eskf, np.zeros(2), by_satellites=False, fixer=fixer)
    eskf.inflate("position", 5.0**2 - STD_M**2)
    if given:
        watch.place_was_given()
    assert fixer.begun_anew == 0

    fly(watch, eskf, 0.6 * SHIFT, by_satellites=False, start_s=14.0, seconds=0.4, fixer=fixer)

    assert (fixer.begun_anew == 1) == given


def test_under_satellites_refusals_widen_the_search() -> None:
    fixer = Fixer()
    watch, eskf = SelfWatch(SelfWatchConfig()), new_filter()
    reaches = []
    for rejected, by_satellites in ((0, True), (5, True), (5, False)):
        fixer.rejected_in_row = rejected
        fly(watch, eskf, np.zeros(2), by_satellites=by_satellites, seconds=0.4, fixer=fixer)
        reaches.append(fixer.least_reach_m)

    assert reaches == [0.0, SelfWatchConfig().wide_reach_m, 0.0]


def test_switched_off_it_takes_everything_and_doubts_nothing() -> None:
    watch, eskf = SelfWatch(SelfWatchConfig(enabled=False)), new_filter()
    P = eskf.P.copy()

    assert watch.takes(np.zeros((48, 64), dtype=np.uint8))
    assert fly(watch, eskf, SHIFT, by_satellites=True) == ()
    assert_allclose(eskf.P, P)


def test_a_blind_picture_and_a_contradicted_map_are_told() -> None:
    fixer = Fixer()
    watch, eskf = SelfWatch(SelfWatchConfig()), new_filter()
    assert not watch.takes(np.full((48, 64), 9, dtype=np.uint8))
    fixer.evidence.against = True

    assert watch.doubts(eskf, cast(MapFixer, fixer)) == (Doubt.NO_TEXTURE, Doubt.MAP_MISMATCH)
    assert watch.doubts(eskf, None) == (Doubt.NO_TEXTURE,)


def test_a_barometer_that_keeps_to_one_side_is_let_go() -> None:
    """The zero's variance grows only where readings do; one on both sides changes nothing."""
    where = LAYOUT.slices["barometer_bias"]
    grown = {}
    for name, innovations in (("steady", np.full(60, 1.5)), ("both sides", np.tile([1.5, -1.5], 30))):
        eskf = new_filter()
        before = eskf.P[where, where][0, 0]
        watch = SelfWatch(SelfWatchConfig())
        for k, z in enumerate(innovations):
            innovation = replace(pressure_altitude(eskf, 100.0, 0.0, 0.5), z=np.array([z]))
            watch.pressure(k * 180_000, innovation, eskf)
        grown[name] = float(eskf.P[where, where][0, 0] - before)
    assert grown["both sides"] == 0.0
    assert grown["steady"] > 1.0


@pytest.mark.parametrize(
    ("vel_ned_m_s", "let_go"),
    [((0.0, 0.0, 2.0), False), ((1.0, 1.0, -2.0), False), ((6.0, 0.0, 2.0), True), ((0.0, 0.0, 0.3), True)],
)
def test_straight_up_or_down_the_pictures_do_not_outweigh_the_barometer(
    vel_ned_m_s: tuple[float, float, float], let_go: bool
) -> None:
    """Where nothing is passed by, how far the ground is cannot be told from how fast it comes."""
    where = LAYOUT.slices["barometer_bias"]
    eskf = new_filter()
    motion = replace(eskf.nominal.motion, vel_ned_m_s=np.array(vel_ned_m_s))
    eskf.nominal = replace(eskf.nominal, motion=motion)
    before = eskf.P[where, where][0, 0]
    watch = SelfWatch(SelfWatchConfig())
    for k in range(60):
        innovation = replace(pressure_altitude(eskf, 100.0, 0.0, 0.5), z=np.array([1.5]))
        watch.pressure(k * 180_000, innovation, eskf)

    assert (eskf.P[where, where][0, 0] > before) is np.bool_(let_go)


def test_a_barometer_that_drifts_is_doubted_and_one_that_errs_for_seconds_is_not() -> None:
    """Height held by other means: 20 m a minute are told within 20 s, five seconds of 1 m are not."""
    told = {}
    for name, errors_m in (("drift", np.arange(110) * 0.06), ("gust", np.repeat([0.0, 1.0, 0.0], [40, 28, 42]))):
        eskf = new_filter()
        eskf.P[2, 2] = 0.05**2
        watch = SelfWatch(SelfWatchConfig())
        told[name] = False
        for k, error_m in enumerate(errors_m):
            innovation = pressure_altitude(eskf, float(error_m), 0.0, 0.5)
            watch.pressure(k * 180_000, innovation, eskf)
            eskf.update(innovation.z, innovation.H, innovation.R, 64.0, "barometer", innovation.R_one)
            told[name] |= Doubt.BAROMETER_DRIFT in watch.doubts(eskf, None)
    assert told == {"drift": True, "gust": False}
