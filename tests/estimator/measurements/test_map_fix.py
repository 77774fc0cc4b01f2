from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.filters.eskf import ErrorStateFilter, ProcessNoise
from estimator.filters.nominal import Layout, Nominal
from estimator.filters.strapdown import EarthModel, Motion
from estimator.geometry.camera import Mount
from estimator.geometry.rotation import matrix_from_q, q_conjugate, q_from_rotvec, q_multiply, rotvec_from_q
from estimator.measurements.camera_attitude import CameraAttitudeModel, Gimbal
from estimator.measurements.map_fix import Acceptance, HandOver, MapFixConfig, MapFixer
from estimator.measurements.sliding_window import SlidingWindowConfig
from estimator.registration.alignment import Registrar
from estimator.types import FixReport, FrameSample
from tests.estimator.registration.textured_map import (
    CAMERA,
    MAP,
    ORIGIN_ALT_M,
    FlatGround,
    PaintedMap,
    TexturedMap,
    seen_by,
    straight_road,
)

GROUPS = ("position", "velocity", "attitude", "boresight", "ground_bias", "map_bias", "map_region")
LAYOUT = Layout.of(GROUPS)
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
MODEL = CameraAttitudeModel(Mount(0.0, -np.pi / 2, 0.0, np.zeros(3)), Gimbal.FIXED)
TRUE_POS = np.array([14.0, -22.0, -110.0])
STD = {
    "position": (6.0, 6.0, 3.0), "velocity": (0.1, 0.1, 0.1), "attitude": (0.01, 0.01, 0.02), "boresight": 1e-3,
    "ground_bias": (0.5, 0.5), "map_bias": 0.5, "map_region": 0.0,
}  # fmt: skip


def _fixer(scene: PaintedMap = MAP, **changes: object) -> MapFixer:
    registrar = Registrar(CAMERA, scene, FlatGround(), ORIGIN_ALT_M)
    return MapFixer(registrar, MapFixConfig(**changes), clock_s=lambda: 0.0)


def _filter(error: np.ndarray, true_pos: np.ndarray = TRUE_POS, std: dict = STD) -> ErrorStateFilter:
    """A filter whose position NED and attitude are wrong by an error (6,), true minus estimated."""
    zero = np.zeros(3)
    q = q_multiply(q_from_rotvec(-error[3:]), LEVEL)
    nominal = Nominal(Motion(true_pos - error[:3], zero, q), zero, zero, 0.0, zero, zero)
    sigma = np.zeros(LAYOUT.size)
    for name, value in std.items():
        sigma[LAYOUT.slices[name]] = value
    eskf = ErrorStateFilter(nominal, np.diag(sigma**2), LAYOUT, EarthModel.at(0.8, 300.0), ProcessNoise())
    eskf.map_bias_std_m = 0.5
    return eskf


def _noisy(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Another gamma and gain, and noise of eight grey values."""
    grey = 220.0 * (picture / 255.0) ** rng.uniform(0.6, 1.6) + rng.normal(0.0, 8.0, size=picture.shape)
    return np.clip(grey, 0.0, 255.0).astype(np.uint8)


def _picture(rng: np.random.Generator, scene: PaintedMap = MAP, true_pos: np.ndarray = TRUE_POS) -> np.ndarray:
    return _noisy(seen_by(true_pos, MODEL.at(0, LEVEL, np.zeros(3)).ned_from_camera, scene), rng)


def _attempt(fixer: MapFixer, eskf: ErrorStateFilter, picture: np.ndarray, t_s: float = 0.0) -> FixReport:
    camera = MODEL.at(0, eskf.nominal.motion.q_ned_from_body, eskf.nominal.boresight_rad)
    frame = FrameSample(round(t_s * 1e6), round(10.0 * t_s), picture)
    return fixer.attempt(frame, eskf, camera, eskf.nominal.motion.pos_ned_m, eskf.nominal.ground_bias_m)


def _horizontal_m(eskf: ErrorStateFilter, true_pos: np.ndarray = TRUE_POS) -> float:
    return float(np.hypot(*(true_pos - eskf.nominal.motion.pos_ned_m)[:2]))


def _std_m(eskf: ErrorStateFilter) -> np.ndarray:
    return np.sqrt(np.linalg.eigvalsh(eskf.cov("position")[:2, :2]))


def _error(rng: np.random.Generator) -> np.ndarray:
    return rng.normal(0.0, np.concatenate((STD["position"], STD["attitude"])))


def test_fix_reduces_the_error_and_says_by_how_much() -> None:
    """
    Errors drawn from the filter's own prior, at sixteen poses; three pictures, because one that disagrees with a sure
    prior by three sigmas is rightly not believed at once.
    """
    squares, before, after = [], [], []
    for seed in range(16):
        rng = np.random.default_rng(seed)
        pos = np.array([*rng.uniform(-70.0, 70.0, size=2), rng.uniform(-130.0, -90.0)])
        eskf = _filter(_error(rng), pos)
        before.append(_horizontal_m(eskf, pos))

        fixer = _fixer()
        reports = [_attempt(fixer, eskf, _picture(rng, true_pos=pos), 0.4 * k) for k in range(3)]

        report = reports[-1]
        assert report.accepted, report.reason
        after.append(_horizontal_m(eskf, pos))
        left = (pos - eskf.nominal.motion.pos_ned_m)[:2]
        squares.append(left @ np.linalg.solve(eskf.cov("position")[:2, :2], left))
        # the prior's six metres; tilt of 0.6 degrees at 110 m is left to the position, and some of it is resolved
        assert _std_m(eskf)[-1] < 3.0
        assert report.kind == "registration"
        assert report.outlier_probability < 0.5
        assert_allclose([report.north_m, report.east_m], pos[:2], atol=6.0)

    assert np.sqrt(np.mean(np.square(after))) < 0.3 * np.sqrt(np.mean(np.square(before)))
    # two degrees of freedom: the mean over 16 of a consistent filter is below 3.5 in 99 of 100
    assert np.mean(squares) < 3.5
    assert np.max(squares) < 13.8


def test_fix_finds_heading_and_height_too() -> None:
    """Two degrees of heading and five metres of height, from one picture."""
    eskf = _filter(np.array([2.0, -3.0, 5.0, 0.0, 0.0, 0.035]))
    rng = np.random.default_rng(4)

    report = _attempt(_fixer(), eskf, _picture(rng))

    assert report.accepted
    turn = rotvec_from_q(q_multiply(LEVEL, q_conjugate(eskf.nominal.motion.q_ned_from_body)))
    assert abs(turn[2]) < 0.012
    above_seen_m = -eskf.nominal.motion.pos_ned_m[2] + eskf.nominal.ground_bias_m
    assert above_seen_m == pytest.approx(110.0, abs=2.0)


def test_refused_picture_does_not_count_twice() -> None:
    """
    Fault: a weak picture of a hovering aircraft, refused as ambiguous, comes again and again.
    Expected: as ambiguous as the first time; what the first said stays in the density, and the rest say the same.
    """
    picture = _picture(np.random.default_rng(11))
    eskf, fixer = _filter(np.zeros(6)), _fixer(TexturedMap(11), min_unimodality=1.01)

    first, *others = [_attempt(fixer, eskf, picture, 0.4 * k) for k in range(8)]

    assert "ambiguous" in first.reason
    assert not any(report.accepted for report in others)
    spread = [np.sqrt(np.linalg.eigvalsh(report.cov_ne_m2)) for report in (first, others[-1])]
    # seven more at three hundredths of their word each
    assert (spread[1] > 0.8 * spread[0]).all()


def test_sure_and_right_estimate_is_not_moved_by_more_than_its_sigma() -> None:
    std = {**STD, "position": (0.3, 0.3, 0.3), "attitude": (0.001, 0.001, 0.001)}
    eskf = _filter(np.zeros(6), std=std)

    report = _attempt(_fixer(), eskf, _picture(np.random.default_rng(5)))

    assert report.accepted
    assert _horizontal_m(eskf) < 0.3
    assert np.diag(eskf.cov("position")).max() <= 0.3**2 + 1e-9


def test_hovering_gives_no_false_certainty() -> None:
    """
    Fifty pictures of one place: what the imagery is displaced by there is the same in all of them.

    Neither their number nor their noise makes the position surer than the map, and what is wrong stays within sigma.
    """
    eskf, fixer, rng = _filter(np.array([3.0, -4.0, 1.0, 0.004, -0.003, 0.01])), _fixer(), np.random.default_rng(6)
    picture = seen_by(TRUE_POS, MODEL.at(0, LEVEL, np.zeros(3)).ned_from_camera)
    accepted = 0
    for k in range(50):
        accepted += _attempt(fixer, eskf, _noisy(picture, rng), 0.4 * k).accepted
        eskf.predict_attitude_driven(eskf.nominal.motion.q_ned_from_body, np.zeros(3), 60.0, 1e-6)

    assert accepted >= 45
    # the prior of the map bias is 0.5 m, and six metres of position cannot tell it: 6 x 0.5 / hypot(6, 0.5)
    assert (_std_m(eskf) > 0.45).all()
    left = (TRUE_POS - eskf.nominal.motion.pos_ned_m)[:2]
    assert left @ np.linalg.solve(eskf.cov("position")[:2, :2], left) < 9.2


def test_displaced_map_stays_within_the_map_bias() -> None:
    """
    Fault: the imagery shows everything 0.7 m too far north; hovering, nothing can tell.
    Expected: the position follows the map and its sigma covers that.
    """
    eskf, fixer, rng = _filter(np.array([-2.0, 2.0, 0.0, 0.0, 0.0, 0.0])), _fixer(), np.random.default_rng(7)
    # as if the camera stood 0.7 m further north
    picture = seen_by(TRUE_POS + np.array([0.7, 0.0, 0.0]), MODEL.at(0, LEVEL, np.zeros(3)).ned_from_camera)

    for k in range(30):
        _attempt(fixer, eskf, _noisy(picture, rng), 0.4 * k)

    left = (TRUE_POS - eskf.nominal.motion.pos_ned_m)[:2]
    assert left @ np.linalg.solve(eskf.cov("position")[:2, :2], left) < 9.2


def test_bare_road_tells_the_position_across_it_only() -> None:
    """Off by 4 m each way. What is along the road may stay wrong, but must not be called known."""
    bearing = np.deg2rad(30.0)
    along, across = np.array([np.cos(bearing), np.sin(bearing)]), np.array([-np.sin(bearing), np.cos(bearing)])
    road, rng = straight_road(bearing, (14.0, -22.0)), np.random.default_rng(8)
    std = {**STD, "attitude": (0.002, 0.002, 0.002), "position": (6.0, 6.0, 0.5)}
    eskf = _filter(np.array([*(4.0 * along + 4.0 * across), 0.0, 0.0, 0.0, 0.0]), std=std)
    fixer = _fixer(road)
    for k in range(5):
        _attempt(fixer, eskf, _picture(rng, road), 0.4 * k)

    cov, left = eskf.cov("position")[:2, :2], (TRUE_POS - eskf.nominal.motion.pos_ned_m)[:2]
    # five looks at one place and a tilt of a tenth of a degree: they share the map's displacement
    assert abs(left @ across) < 3.0 * np.sqrt(across @ cov @ across)
    assert np.sqrt(along @ cov @ along) > 1.5 * np.sqrt(across @ cov @ across)
    assert np.sqrt(along @ cov @ along) > 4.0
    assert abs(left @ along) < 3.0 * np.sqrt(along @ cov @ along)


@pytest.mark.parametrize(("least", "numbers"), [(0.3, 1), (0.0, 2)])
def test_axis_on_which_a_picture_tells_too_little_is_left_out(least: float, numbers: int) -> None:
    """A bare road at 0.3 rad: along it the density is as wide as the search, which is no measurement."""
    road = straight_road(0.3, (14.0, -22.0))
    eskf = _filter(np.array([2.0, -1.0, 0.0, 0.0, 0.0, 0.0]))

    report = _attempt(
        _fixer(road, use_windows=False, least_information=least), eskf, _picture(np.random.default_rng(4), road)
    )

    assert report.accepted
    assert eskf.innovations["fix"].numbers == numbers


@pytest.mark.parametrize("use_windows", [True, False])
def test_doubt_makes_a_match_count_less_and_its_innovation_no_smaller(use_windows: bool) -> None:
    """Its normalised square is of what a right match may be off by, however the probability of one is."""
    # The density says a place to a metre or two, windows to centimetres: the prior must not hide what they add.
    std = STD if use_windows else {**STD, "position": (1.0, 1.0, 1.0), "attitude": (0.001, 0.001, 0.001)}
    told, sure = [], []
    for probability in (0.0, 0.8):
        fixer, eskf = _fixer(use_windows=use_windows), _filter(np.array([1.0, -1.0, 0.0, 0.0, 0.0, 0.0]), std=std)
        register = fixer.registrar.register

        def doubted(*asked: object, register: Any = register, probability: float = probability) -> Any:
            return replace(register(*asked), outlier_probability=probability)

        fixer.registrar.register = doubted  # type: ignore[method-assign]
        report = _attempt(fixer, eskf, _picture(np.random.default_rng(4)))
        assert report.accepted, report.reason
        told.append(eskf.innovations["fix"].nis_per_dof)
        sure.append(_std_m(eskf)[-1])

    assert sure[1] > 1.1 * sure[0]
    assert told[1] == pytest.approx(told[0], rel=1e-6)


def test_off_the_map_is_refused_and_counted() -> None:
    far = np.array([5000.0, 0.0, -110.0])
    eskf, fixer = _filter(np.zeros(6), far), _fixer()
    before, P = eskf.nominal, eskf.P.copy()

    reports = [_attempt(fixer, eskf, _picture(np.random.default_rng(9)), 0.4 * k) for k in range(3)]

    assert not any(report.accepted for report in reports)
    assert "outside the reference map" in reports[0].reason
    assert fixer.rejected_in_row == 3
    assert eskf.nominal is before
    assert_allclose(eskf.P, P)
    assert np.isnan(reports[0].north_m)


@pytest.mark.parametrize(
    ("down_m", "ground_bias_m", "reason"),
    [(-1.0, 0.0, "too close to the ground"), (3.0, 0.0, "too close to the ground"), (-110.0, np.nan, "unknown")],
)
def test_ground_too_close_or_unknown_is_refused(down_m: float, ground_bias_m: float, reason: str) -> None:
    eskf, fixer = _filter(np.zeros(6), np.array([14.0, -22.0, down_m])), _fixer()
    camera = MODEL.at(0, LEVEL, np.zeros(3))
    frame = FrameSample(0, 1, _picture(np.random.default_rng(10)))

    report = fixer.attempt(frame, eskf, camera, eskf.nominal.motion.pos_ned_m, ground_bias_m)

    assert not report.accepted
    assert reason in report.reason
    assert fixer.rejected_in_row == 1


@pytest.mark.parametrize("seed", [11, 12, 13, 14])
def test_wrong_map_does_not_make_sure(seed: int) -> None:
    """
    Fault: the imagery is of another place altogether; ten pictures in a row.
    Expected: refused, or so weak that neither the position nor its sigma says what the pictures cannot know.
    """
    eskf, fixer, rng = _filter(np.zeros(6)), _fixer(TexturedMap(seed)), np.random.default_rng(seed)
    for k in range(10):
        _attempt(fixer, eskf, _picture(rng), 0.4 * k)

    left = (TRUE_POS - eskf.nominal.motion.pos_ned_m)[:2]
    # four sigmas; five is what counts as wrong and sure of it
    assert left @ np.linalg.solve(eskf.cov("position")[:2, :2], left) < 16.0
    assert _std_m(eskf)[0] > 1.2


def test_accepted_fix_ends_a_row_of_refusals() -> None:
    eskf, fixer, rng = _filter(np.array([2.0, 1.0, 0.0, 0.0, 0.0, 0.0])), _fixer(), np.random.default_rng(15)
    blank = np.full((CAMERA.height_px, CAMERA.width_px), 128, dtype=np.uint8)
    before = eskf.nominal
    for k in range(2):
        assert "says nothing" in _attempt(fixer, eskf, blank, 0.4 * k).reason
    assert eskf.nominal is before
    assert fixer.rejected_in_row == 2

    reports = [_attempt(fixer, eskf, _picture(rng), 1.0 + 0.4 * k) for k in range(4)]

    assert reports[-1].accepted
    assert fixer.rejected_in_row == 0
    assert fixer.lost_probability < 0.1
    assert _horizontal_m(eskf) < 2.0


def test_tilted_camera_is_fixed_at_the_ground_it_sees() -> None:
    """Twenty degrees of bank: the picture lies 40 m aside, the position below the aircraft is what must come right."""
    bank = q_from_rotvec(np.array([0.35, 0.0, 0.0]))
    eskf = _filter(np.array([3.0, -4.0, 0.0, 0.0, 0.0, 0.0]))
    motion = eskf.nominal.motion
    eskf.nominal = Nominal(
        Motion(motion.pos_ned_m, motion.vel_ned_m_s, bank), np.zeros(3), np.zeros(3), 0.0, np.zeros(3), np.zeros(3)
    )  # fmt: skip
    camera = MODEL.at(0, bank, np.zeros(3)).ned_from_camera
    assert (matrix_from_q(bank) @ np.array([0.0, 0.0, 1.0]))[1] < -0.3

    report = _attempt(_fixer(), eskf, _noisy(seen_by(TRUE_POS, camera), np.random.default_rng(16)))

    assert report.accepted
    assert _horizontal_m(eskf) < 2.0
    left = (TRUE_POS - eskf.nominal.motion.pos_ned_m)[:2]
    assert left @ np.linalg.solve(eskf.cov("position")[:2, :2], left) < 9.2


def test_uncoupled_fix_leaves_attitude_and_height_alone() -> None:
    """H = [I 0 0]: nothing but what is correlated with the horizontal position moves, and here nothing is."""
    coupled, uncoupled = _filter(np.zeros(6)), _filter(np.zeros(6))
    before = uncoupled.cov("attitude")
    changes = {"use_windows": False, "search_pose": False, "hand_over": HandOver.DENSITY}

    assert _attempt(_fixer(**changes), coupled, _picture(np.random.default_rng(5))).accepted
    assert _attempt(_fixer(**changes, couple_attitude=False), uncoupled, _picture(np.random.default_rng(5))).accepted

    assert_allclose(uncoupled.cov("attitude"), before)
    assert_allclose(uncoupled.cov("position")[2, 2], STD["position"][2] ** 2)
    assert np.abs(uncoupled.cov("position", "attitude")).max() < 1e-12
    # the lever arm of 110 m ties tilt to position
    assert np.abs(coupled.cov("position", "attitude")).max() > 1e-3


def test_density_handed_over_has_the_constant_sigma_and_lives_on() -> None:
    eskf = _filter(np.array([3.0, -4.0, 0.0, 0.0, 0.0, 0.0]))
    fixer = _fixer(
        hand_over=HandOver.DENSITY, couple_attitude=False, use_windows=False, search_pose=False, temper=False
    )
    prior = np.diag(eskf.cov("position"))[0] + np.diag(eskf.cov("map_bias"))[0]

    first = _attempt(fixer, eskf, _picture(np.random.default_rng(1)), 0.0)
    gain = STD["position"][0] ** 2 / (prior + 2.0**2)
    assert_allclose(eskf.cov("position")[0, 0], STD["position"][0] ** 2 * (1.0 - gain), rtol=1e-6)
    second = _attempt(fixer, eskf, _picture(np.random.default_rng(2)), 0.4)

    assert first.accepted
    assert second.accepted
    # a density that began anew would be as wide as the first
    assert np.linalg.det(second.cov_ne_m2) < np.linalg.det(first.cov_ne_m2)
    assert _horizontal_m(eskf) < 2.0


def test_without_tempering_a_hover_counts_every_picture_in_full() -> None:
    picture = _picture(np.random.default_rng(8))
    # sure of tilt and map, and no displacement of the map to put errors to: what the pictures add is what is left
    sure = {**STD, "attitude": (1e-4, 1e-4, 1e-4), "map_bias": 0.01}
    kept, tempered = (_filter(np.zeros(6), std=sure) for _ in range(2))
    for eskf, temper in ((kept, False), (tempered, True)):
        fixer = _fixer(temper=temper, use_windows=False, max_map_bias_m=0.05)
        for k in range(5):
            assert _attempt(fixer, eskf, picture, 0.4 * k).accepted

    assert _std_m(kept)[-1] < 0.8 * _std_m(tempered)[-1]


def test_sliding_window_waits_for_stable_matches_and_corrects_gradually() -> None:
    eskf = _filter(np.array([5.0, -4.0, 0.0, 0.0, 0.0, 0.0]))
    fixer = _fixer(acceptance=Acceptance.SLIDING_WINDOW, sliding_window=SlidingWindowConfig(size=6, parts=4))
    rng = np.random.default_rng(6)

    reports, errors = [], []
    for k in range(9):
        reports.append(_attempt(fixer, eskf, _picture(rng), 0.4 * k))
        errors.append(_horizontal_m(eskf))

    assert [report.accepted for report in reports] == [False] * 5 + [True] * 4
    assert all("not stable yet" in report.reason for report in reports[:5])
    assert errors[4] == pytest.approx(np.hypot(5.0, 4.0))
    # brought in little by little, and in the end it is there
    assert np.diff(errors[4:]).max() < 0.0
    assert errors[5] > 0.3 * errors[4]
    assert errors[-1] < 1.5


def test_open_heading_is_found_with_the_place_by_slices() -> None:
    """Six degrees of sigma, and a place that went wrong with the heading: errors are as large as stated."""
    std = {**STD, "position": (8.0, 8.0, 1.0), "attitude": (0.005, 0.005, 0.1)}
    axes = [LAYOUT.slices["position"].start, LAYOUT.slices["position"].start + 1, LAYOUT.slices["attitude"].start + 2]
    nees, headings = [], []
    for seed in range(8):
        rng = np.random.default_rng(seed)
        error = rng.normal(0.0, np.concatenate((std["position"], std["attitude"])))
        error[1] += 80.0 * error[5]  # eighty metres flown to the north by that heading
        eskf = _filter(error, std=std)
        J = np.eye(LAYOUT.size)
        J[axes[1], axes[2]] = 80.0
        eskf.P = J @ eskf.P @ J.T
        fixer = _fixer(slice_heading_rad=0.05, use_windows=False)

        report = _attempt(fixer, eskf, _picture(rng))

        assert report.accepted, report.reason
        assert report.cov_ne_m2.shape == (2, 2)
        left = (TRUE_POS - eskf.nominal.motion.pos_ned_m)[:2]
        turn = rotvec_from_q(q_multiply(LEVEL, q_conjugate(eskf.nominal.motion.q_ned_from_body)))[2]
        e = np.array([*left, turn])
        nees.append(float(e @ np.linalg.inv(eskf.P[np.ix_(axes, axes)]) @ e))
        headings.append(turn)

    # chi-square of 24 degrees of freedom: 99.9 % below 51; the stated sigmas have a margin on purpose
    assert sum(nees) < 51.0
    assert np.sqrt(np.mean(np.square(headings))) < 0.02


def test_refused_slices_live_on_with_their_headings() -> None:
    rng = np.random.default_rng(3)
    std = {**STD, "attitude": (0.005, 0.005, 0.1)}
    eskf = _filter(np.array([2.0, -1.0, 0.0, 0.0, 0.0, 0.06]), std=std)
    fixer = _fixer(slice_heading_rad=0.05, use_windows=False, min_unimodality=1.1)

    first = _attempt(fixer, eskf, _picture(rng))
    second = _attempt(fixer, eskf, _picture(rng), 0.5)

    assert not first.accepted
    assert not second.accepted
    assert second.reason.startswith("ambiguous")
    assert 0.0 < fixer.lost_probability < 0.5


def test_a_map_that_pictures_have_contradicted_gives_no_fix_until_it_is_begun_anew() -> None:
    """The picture alone would be accepted; what stands against the map outweighs it, and can be dropped."""
    rng = np.random.default_rng(4)
    eskf, fixer = _filter(np.zeros(6)), _fixer()
    fixer.evidence.against, fixer.evidence.log_odds = True, 6.0

    refused = _attempt(fixer, eskf, _picture(rng))
    believed = _attempt(_fixer(evidence=None), _filter(np.zeros(6)), _picture(rng))
    fixer.begin_anew()
    accepted = _attempt(fixer, eskf, _picture(rng), 0.4)

    assert "contradict the map" in refused.reason
    assert believed.accepted
    assert accepted.accepted


def test_the_search_reaches_as_far_as_it_is_told() -> None:
    """A position 35 m off that is thought sure: out of sight, unless something else says how far to look."""
    error = np.array([0.0, 35.0, 0.0, 0.0, 0.0, 0.0])
    sure = {**STD, "position": (1.0, 1.0, 1.0)}
    near, wide = _fixer(), _fixer()
    wide.least_reach_m = 45.0
    picture = _picture(np.random.default_rng(4))

    missed, seen = (_attempt(fixer, _filter(error, std=sure), picture) for fixer in (near, wide))

    assert np.hypot(missed.north_m - TRUE_POS[0], missed.east_m - TRUE_POS[1]) > 10.0
    assert np.hypot(seen.north_m - TRUE_POS[0], seen.east_m - TRUE_POS[1]) < 4.0
    assert seen.outlier_probability < missed.outlier_probability


def test_a_camera_that_is_being_turned_is_not_laid_on_the_map() -> None:
    eskf, fixer = _filter(np.zeros(6)), _fixer()
    camera = replace(MODEL.at(0, LEVEL, np.zeros(3)), slew_ned_rad_s=np.array((0.0, 0.0, 1.0)))
    frame = FrameSample(0, 1, _picture(np.random.default_rng(10)))

    report = fixer.attempt(frame, eskf, camera, eskf.nominal.motion.pos_ned_m, eskf.nominal.ground_bias_m)

    assert not report.accepted
    assert "turned" in report.reason
    # It is no fault of the map's.
    assert fixer.rejected_in_row == 0
