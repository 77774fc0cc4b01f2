import cv2
import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.ground import ground_point_by_pose
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from estimator.measurements.terrain_fix import centre_by_pose
from estimator.registration.alignment import CameraPose, Match, Registrar
from estimator.registration.refine import RefineConfig, Refinement, Windows, cut_windows, refine
from tests.estimator.registration.textured_map import (
    CAMERA,
    MAP,
    NADIR_TOP_NORTH,
    ORIGIN_ALT_M,
    FlatGround,
    PaintedMap,
    seen_by,
    straight_road,
)

TRUE_POS = np.array([14.0, -22.0, -110.0])
PRIOR_STD = np.array([3.0, 3.0, 3.0, 0.02, 0.02, 0.03])
HEADINGS = np.deg2rad(np.array([-4.5, -3.0, -1.5, 0.0, 1.5, 3.0, 4.5]))
SCALES = np.array([-0.04, -0.02, 0.0, 0.02, 0.04])
CONFIG = RefineConfig()
FIXED_SIZE = RefineConfig(min_window_px=32, max_window_px=32)


def _through_another_sensor(picture: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """Another gamma, gain and offset, half of them inverted, and noise of eight grey values."""
    share = (picture / 255.0) ** rng.uniform(0.6, 1.6)
    share = 1.0 - share if rng.random() < 0.5 else share
    grey = 20.0 + 255.0 * rng.uniform(0.5, 0.9) * share + rng.normal(0.0, 8.0, size=picture.shape)
    return np.clip(grey, 0.0, 255.0).astype(np.uint8)


def _registered(
    picture: np.ndarray, predicted: CameraPose, scene: PaintedMap = MAP, prior_std: np.ndarray = PRIOR_STD
) -> tuple[Match, Refinement | None]:
    registrar = Registrar(CAMERA, scene, FlatGround(), ORIGIN_ALT_M)
    match = registrar.register(picture, predicted, 20.0, HEADINGS, SCALES)
    assert isinstance(match, Match)
    return match, registrar.refine(match, match.displacement_ne_m, np.diag(prior_std**2))


def _displaced(error: np.ndarray) -> CameraPose:
    """The prediction whose true pose lies at an error (6,) from it, as the filter counts errors."""
    turn = matrix_from_q(q_from_rotvec(-error[3:]))
    return CameraPose(TRUE_POS - error[:3], turn @ NADIR_TOP_NORTH)


def _trial(seed: int, std: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """
    What is left of a random pose error (6,), its covariance by prior and picture, and the middle's derivative (2, 6).
    """
    rng = np.random.default_rng(seed)
    error = rng.normal(0.0, std)
    picture = _through_another_sensor(seen_by(TRUE_POS, NADIR_TOP_NORTH), rng)
    predicted = _displaced(error)
    match, refinement = _registered(picture, predicted)
    assert refinement is not None
    assert refinement.agreement > 0.8
    cov = np.linalg.inv(refinement.information + np.diag(1.0 / PRIOR_STD**2))
    return refinement.x - error, cov, centre_by_pose(match.centre_ned_m, predicted.pos_ned_m)


def _squared(error: np.ndarray, cov: np.ndarray) -> float:
    return float(error @ np.linalg.solve(cov, error))


def test_pose_errors_are_found_within_the_stated_sigmas() -> None:
    """Errors of 1.5 m in place and height, 0.6 degrees of tilt and 0.9 of heading; noise and another contrast."""
    trials = [_trial(seed, 0.5 * PRIOR_STD) for seed in range(20)]

    nees = [_squared(left, cov) for left, cov, _ in trials]
    # six degrees of freedom: the mean over 20 has a deviation of 0.8; a scatter of 12 windows makes the tail longer
    assert 2.0 < np.mean(nees) < 9.0
    assert np.median(nees) < 7.0
    middle = np.array([J @ left for left, _, J in trials])
    # a map pixel is a metre: the middle lies within a tenth of it, and is said to
    assert np.sqrt(np.mean(middle**2)) < 0.1
    assert all(np.sqrt(np.diag(J @ cov @ J.T)).max() < 0.15 for _, cov, J in trials)
    # tilt is what distinguishes place from attitude: better than the prior, by windows of 32 pixels
    left = np.array([left for left, _, _ in trials])
    assert (np.sqrt(np.mean(left**2, axis=0)) < 0.3 * PRIOR_STD).all()


def test_large_pose_errors_are_found_within_three_times_the_sigmas() -> None:
    """
    Errors twice as large: 3 m, 1.1 degrees of tilt, 1.7 of heading. Windows are not turned while they are compared, so
    what they disagree by is no longer chance alone; the fix widens what is stated threefold for that.
    """
    trials = [_trial(100 + seed, PRIOR_STD) for seed in range(20)]

    assert np.mean([_squared(left, 9.0 * cov) for left, cov, _ in trials]) < 6.0
    middle = np.array([J @ left for left, _, J in trials])
    assert np.abs(middle).max() < 0.4
    left = np.array([left for left, _, _ in trials])
    assert (np.sqrt(np.mean(left**2, axis=0)) < 0.4 * PRIOR_STD).all()


def test_second_look_from_the_refined_pose_agrees() -> None:
    """What is left after one refinement is smaller after the next, and within its sigmas."""
    error = np.array([4.0, -5.0, 4.0, 0.03, -0.025, 0.05])
    picture = _through_another_sensor(seen_by(TRUE_POS, NADIR_TOP_NORTH), np.random.default_rng(8))
    predicted = _displaced(error)
    _, first = _registered(picture, predicted, prior_std=2.0 * PRIOR_STD)
    assert first is not None
    turn = matrix_from_q(q_from_rotvec(first.x[3:]))
    corrected = CameraPose(predicted.pos_ned_m + first.x[:3], turn @ predicted.ned_from_camera)

    match, second = _registered(picture, corrected, prior_std=2.0 * PRIOR_STD)

    assert second is not None
    left = np.concatenate((TRUE_POS - corrected.pos_ned_m - second.x[:3], np.zeros(3)))
    J = centre_by_pose(match.centre_ned_m, corrected.pos_ned_m)
    turned = matrix_from_q(q_from_rotvec(second.x[3:])) @ corrected.ned_from_camera @ NADIR_TOP_NORTH.T
    left[3:] = 0.5 * np.array(
        [turned[1, 2] - turned[2, 1], turned[2, 0] - turned[0, 2], turned[0, 1] - turned[1, 0]]
    )  # fmt: skip
    cov = np.linalg.inv(second.information + np.diag(0.25 / PRIOR_STD**2))
    # the 0.999 quantile of six degrees of freedom, with the scatter of 12 windows
    assert _squared(left, cov) < 22.5
    assert np.abs(J @ left).max() < 0.15


def _middle_std_m(refinement: Refinement, J: np.ndarray) -> float:
    """The largest deviation of the picture's middle by prior and picture."""
    cov = np.linalg.inv(refinement.information + np.diag(1.0 / PRIOR_STD**2))
    return float(np.sqrt(np.linalg.eigvalsh(J @ cov @ J.T)[-1]))


def test_tight_prior_holds_the_pose_and_not_what_the_picture_says() -> None:
    """The prior is wrong and sure: x stays with it, while ``best`` and ``information`` are the picture's alone."""
    error = np.array([1.2, -0.8, 0.0, 0.0, 0.0, 0.0])
    picture = seen_by(TRUE_POS, NADIR_TOP_NORTH)

    _, loose = _registered(picture, _displaced(error))
    match, tight = _registered(picture, _displaced(error), prior_std=1e-3 * PRIOR_STD)

    assert loose is not None
    assert tight is not None
    assert np.abs(tight.x[:2]).max() < 0.1
    J = centre_by_pose(match.centre_ned_m, TRUE_POS - error[:3])
    # a single step from the prior, more than a pixel away on the windows' flanks: its length is not to be relied on
    toward = (J @ error) / np.linalg.norm(J @ error)
    assert toward @ J @ tight.best > 0.5
    assert_allclose(J @ loose.best, J @ error, atol=0.1)
    # away from the windows' tops their slopes do not average to zero: less is claimed there
    assert _middle_std_m(tight, J) > 2.0 * _middle_std_m(loose, J)


@pytest.mark.parametrize("bearing_deg", [0.0, 30.0, 75.0, 140.0])
def test_windows_of_a_straight_road_do_not_agree_along_it(bearing_deg: float) -> None:
    """
    Nothing but one road: most windows hold noise, and the others may lie anywhere along it.

    A sum of such windows has a top too, by chance: that it is not one must show in how few of them are near it.
    """
    road = straight_road(np.deg2rad(bearing_deg), (14.0, -22.0))
    rng = np.random.default_rng(3)
    picture = seen_by(TRUE_POS, NADIR_TOP_NORTH, road)
    picture = np.clip(picture + rng.normal(0.0, 8.0, size=picture.shape), 0, 255).astype(np.uint8)

    _, refinement = _registered(picture, _displaced(np.array([1.5, -1.0, 0.0, 0.0, 0.0, 0.0])), road)

    # a circle of two pixels in a square of thirteen holds a thirteenth by chance, and the search climbs to more
    assert refinement is None or refinement.agreement <= 1.0 / 3.0


def _geometry(count: int) -> np.ndarray:
    """Displacements (k, 2, 6) in rows and columns of windows on a grid below a camera at 100 m, metre pixels."""
    slope = np.stack(np.meshgrid(np.linspace(0.5, -0.5, count), np.linspace(-0.5, 0.5, count)), axis=-1).reshape(-1, 2)
    return np.diag([-1.0, 1.0]) @ ground_point_by_pose(slope, np.full(len(slope), 100.0))


def _bumps(place_px: np.ndarray, width_px: tuple[float, float] = (1.8, 1.8)) -> Windows:
    """Surfaces with a bump at a place (k, 2) relative to the middle."""
    i, j = np.mgrid[-6:7, -6:7]
    d_row = (i[None] - place_px[:, 0, None, None]) / width_px[0]
    d_col = (j[None] - place_px[:, 1, None, None]) / width_px[1]
    surface = np.exp(-0.5 * (d_row**2 + d_col**2)).astype(np.float32)
    return Windows(surface, np.zeros(len(place_px)), np.zeros(len(place_px)))


def _refined(windows: Windows, jacobian: np.ndarray, offset: np.ndarray | None = None) -> Refinement:
    flat_prior = np.diag(1.0 / np.array([10.0, 10.0, 10.0, 0.1, 0.1, 0.1]) ** 2)
    offset = np.zeros((len(jacobian), 2)) if offset is None else offset
    refinement = refine(windows, jacobian, offset, np.zeros(6), flat_prior, CONFIG)
    assert refinement is not None
    return refinement


def test_pose_is_read_off_the_windows_places() -> None:
    """Thirty-six windows whose bumps lie where a pose error puts them, about middles that were cut elsewhere."""
    jacobian = _geometry(6)
    error = np.array([0.5, -0.7, 0.8, 0.006, -0.004, 0.01])
    offset = np.random.default_rng(1).uniform(-0.5, 0.5, size=(36, 2))

    refinement = _refined(_bumps(jacobian @ error - offset, (2.5, 2.5)), jacobian, offset)

    # the surfaces are read between their samples by straight lines
    assert_allclose(jacobian @ refinement.best, jacobian @ error, atol=0.1)
    assert refinement.agreement == 1.0
    assert refinement.windows == 36
    assert_allclose(refinement.information, refinement.information.T)
    assert (np.linalg.eigvalsh(refinement.information) > 0.0).all()


@pytest.mark.parametrize("scatter_px", [0.2, 0.4, 0.8])
def test_windows_that_disagree_widen_the_sigma_by_as_much(scatter_px: float) -> None:
    """
    The place of each window is off by chance, and nobody tells the refinement by how much.

    The sigmas that follow from the scatter alone are those of least squares with that scatter; the errors match them.
    """
    jacobian = _geometry(6)
    flat = jacobian.reshape(-1, 6)
    expected = np.linalg.inv(flat.T @ flat) * scatter_px**2
    nees, ratios = [], []
    for seed in range(30):
        chance = np.random.default_rng(seed).normal(0.0, scatter_px, size=(36, 2))
        refinement = _refined(_bumps(chance), jacobian)
        nees.append(refinement.best @ refinement.information @ refinement.best)
        stated = np.linalg.inv(refinement.information)
        ratios.append(np.sqrt(np.diag(stated) / np.diag(expected)))

    # smoothing by 0.8 pixels and straight lines between samples count for a few per cent, a bump's flanks for more
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.2)
    # six degrees of freedom: the mean over 30 has a deviation of 0.63
    assert 4.0 < np.mean(nees) < 8.5


def test_agreement_is_the_share_of_windows_near_the_common_place() -> None:
    jacobian = _geometry(6)
    place = np.zeros((36, 2))
    place[:9] = [4.5, -4.0]

    refinement = _refined(_bumps(place), jacobian)

    assert refinement.agreement == pytest.approx(0.75)


def test_ridges_in_all_windows_leave_the_direction_along_them_open() -> None:
    """Bumps ten times as long along the columns: the information along is a hundredth and less of that across."""
    jacobian = _geometry(6)
    chance = np.random.default_rng(5).normal(0.0, 0.3, size=(36, 2)) * [1.0, 10.0]

    information = _refined(_bumps(chance, (1.2, 12.0)), jacobian).information

    assert information[1, 1] < 0.02 * information[0, 0]


def _texture(rows: int, cols: int, seed: int = 4) -> np.ndarray:
    noise = np.random.default_rng(seed).normal(size=(2, rows, cols)).astype(np.float32)
    return np.stack([cv2.GaussianBlur(one, (0, 0), 1.5) for one in noise])


def test_windows_show_where_the_template_lies_in_the_area() -> None:
    """A template cut out at (13, 17) and looked for at (11, 20): every window's best place is (+2, -3)."""
    area = _texture(180, 200)
    template = area[:, 13:143, 17:181]
    mask = np.ones(template.shape[1:], dtype=np.bool_)

    windows = cut_windows(template, mask, area, 11, 20, FIXED_SIZE)

    assert windows is not None
    assert len(windows.surface) == 4 * 5
    peak = windows.surface.reshape(20, -1).argmax(axis=1)
    assert_allclose(peak // 13 - 6, 2)
    assert_allclose(peak % 13 - 6, -3)
    # centres on a grid of the window's size in the middle of the template
    assert_allclose(np.unique(windows.row), 1.0 + 15.5 + 32.0 * np.arange(4))
    assert_allclose(np.unique(windows.col), 2.0 + 15.5 + 32.0 * np.arange(5))


def test_windows_without_picture_or_without_room_are_left_out() -> None:
    area = _texture(180, 200)
    template = area[:, 13:143, 17:181]
    mask = np.ones(template.shape[1:], dtype=np.bool_)
    half = mask.copy()
    half[:, :98] = False

    windows = cut_windows(template, half, area, 13, 17, FIXED_SIZE)

    assert windows is not None
    assert len(windows.surface) == 4 * 2
    # the area ends above the first row of windows
    shifted = cut_windows(template, mask, area, 0, 17, FIXED_SIZE)
    assert shifted is not None
    assert windows.row.min() < 32.0 < shifted.row.min()


def test_too_few_windows_give_nothing() -> None:
    area = _texture(180, 200)
    small = area[:, 40:110, 40:150]
    few = np.ones((130, 164), dtype=np.bool_)
    few[:, 40:] = False

    assert cut_windows(small, np.ones(small.shape[1:], dtype=np.bool_), area, 40, 40, FIXED_SIZE) is None
    assert cut_windows(area[:, 13:143, 17:181], few, area, 13, 17, FIXED_SIZE) is None
    assert cut_windows(area[:, 13:143, 17:181], few | True, area, 13, 500, FIXED_SIZE) is None


@pytest.mark.parametrize(("shape", "side_px"), [((60, 80), 13), ((104, 139), 22), ((224, 224), 32)])
def test_windows_are_smaller_in_a_smaller_template(shape: tuple[int, int], side_px: int) -> None:
    """About thirty of them, so that a few that err do not decide, and at most 32 pixels wide."""
    area = _texture(300, 300)
    template = area[:, 20 : 20 + shape[0], 20 : 20 + shape[1]]

    windows = cut_windows(template, np.ones(shape, dtype=np.bool_), area, 20, 20, CONFIG)

    assert windows is not None
    assert_allclose(np.diff(np.unique(windows.col)), side_px)


def test_low_camera_has_too_few_windows() -> None:
    """From 36 m the picture covers about 40 by 30 map pixels: registered, but not refined."""
    low = TRUE_POS * np.array([1.0, 1.0, 36.0 / 110.0])
    picture = seen_by(low, NADIR_TOP_NORTH)

    _, refinement = _registered(picture, CameraPose(low + np.array([1.0, 1.0, 0.0]), NADIR_TOP_NORTH))

    assert refinement is None


def test_windows_that_run_off_their_surfaces_give_nothing() -> None:
    """
    Fault: the start lies ten pixels from where the windows were cut.
    Expected: no refinement, rather than one from the surfaces' rims.
    """
    jacobian = _geometry(6)
    start = np.array([10.0, 0.0, 0.0, 0.0, 0.0, 0.0])

    assert refine(_bumps(np.zeros((36, 2))), jacobian, np.zeros((36, 2)), start, np.eye(6), CONFIG) is None
