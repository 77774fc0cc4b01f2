import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.rotation import matrix_from_euler, matrix_from_q, q_from_rotvec
from estimator.registration.alignment import (
    COMPARED,
    CameraPose,
    HeadingSource,
    Match,
    MatcherConfig,
    NoMatch,
    Registrar,
)
from estimator.registration.calibration import calibration_of
from tests.estimator.registration.textured_map import (
    CAMERA,
    MAP,
    NADIR_TOP_NORTH,
    ORIGIN_ALT_M,
    FlatGround,
    seen_by,
)

TRUE_POS = np.array([14.0, -22.0, -110.0])
HEADINGS = np.deg2rad(np.array([-6.0, -4.5, -3.0, -1.5, 0.0, 1.5, 3.0, 4.5, 6.0]))
SCALES = np.array([-0.06, -0.04, -0.02, 0.0, 0.02, 0.04, 0.06])
NO_SCALES = np.zeros(1)


def _yaw(angle_rad: float) -> np.ndarray:
    return matrix_from_q(q_from_rotvec(np.array([0.0, 0.0, angle_rad])))


def _registrar(**changes: object) -> Registrar:
    return Registrar(CAMERA, MAP, FlatGround(), ORIGIN_ALT_M, MatcherConfig(**changes))


def _register(
    picture: np.ndarray, predicted: CameraPose, headings=HEADINGS, scales=NO_SCALES, radius_m: float = 25.0
) -> Match:
    match = _registrar().register(picture, predicted, radius_m, headings, scales)
    assert isinstance(match, Match)
    return match


@pytest.mark.parametrize("error_ne_m", [(0.0, 0.0), (9.0, 0.0), (0.0, -13.0), (-8.4, 11.3)])
def test_displacement_is_true_minus_predicted(error_ne_m: tuple[float, float]) -> None:
    picture = seen_by(TRUE_POS, NADIR_TOP_NORTH)
    predicted = TRUE_POS + np.array([*error_ne_m, 0.0])

    match = _register(picture, CameraPose(predicted, NADIR_TOP_NORTH))

    # a third of a map pixel
    assert_allclose(match.displacement_ne_m, -np.array(error_ne_m), atol=0.33)
    assert match.peak.value > 0.5
    assert match.outlier_probability < 0.05
    assert abs(match.heading_rad) < np.deg2rad(0.5)


@pytest.mark.parametrize("tilt_rad", [(0.0, 0.0), (0.25, -0.2), (-0.1, 0.4)])
@pytest.mark.parametrize("yaw_rad", [0.7, -2.4])
def test_tilted_and_turned_cameras_are_rectified(tilt_rad: tuple[float, float], yaw_rad: float) -> None:
    ned_from_camera = matrix_from_euler(tilt_rad[0], tilt_rad[1], yaw_rad) @ NADIR_TOP_NORTH
    picture = seen_by(TRUE_POS, ned_from_camera)
    predicted = TRUE_POS + np.array([6.0, -7.0, 0.0])

    match = _register(picture, CameraPose(predicted, ned_from_camera))

    assert_allclose(match.displacement_ne_m, [-6.0, 7.0], atol=0.4)


@pytest.mark.parametrize("error_deg", [-4.0, -1.5, 2.2, 5.0])
def test_heading_correction_turns_the_prediction_onto_the_truth(error_deg: float) -> None:
    """R_true = Exp(correction about down) R_predicted: the correction is minus the prediction's error."""
    picture = seen_by(TRUE_POS, NADIR_TOP_NORTH)
    predicted = CameraPose(TRUE_POS + np.array([5.0, 4.0, 0.0]), _yaw(np.deg2rad(error_deg)) @ NADIR_TOP_NORTH)

    match = _register(picture, predicted)

    assert np.rad2deg(match.heading_rad) == pytest.approx(-error_deg, abs=0.5)
    assert np.isfinite(match.heading_std_rad)
    # the displacement is of the ground point at the patch's centre, whose arm about the camera's foot is short
    centre = match.centre_ned_m[:2] - predicted.pos_ned_m[:2]
    turned = _yaw(np.deg2rad(-error_deg))[:2, :2] @ centre
    assert_allclose(match.displacement_ne_m, turned - centre - np.array([5.0, 4.0]), atol=0.5)


@pytest.mark.parametrize("height_ratio", [0.965, 1.03])
def test_scale_is_true_height_over_predicted_less_one(height_ratio: float) -> None:
    picture = seen_by(TRUE_POS, NADIR_TOP_NORTH)
    predicted = CameraPose(TRUE_POS * np.array([1.0, 1.0, 1.0 / height_ratio]), NADIR_TOP_NORTH)

    match = _register(picture, predicted, scales=SCALES)

    assert match.scale == pytest.approx(height_ratio - 1.0, abs=0.008)
    assert np.isfinite(match.scale_std)


def test_hypotheses_beyond_those_tried_are_not_invented() -> None:
    """
    Fault: the heading is wrong by six degrees, only one and a half are tried.
    Expected: the correction stays at the outermost hypothesis with a deviation of at least a step.
    """
    picture = seen_by(TRUE_POS, NADIR_TOP_NORTH)
    predicted = CameraPose(TRUE_POS, _yaw(np.deg2rad(6.0)) @ NADIR_TOP_NORTH)
    headings = np.deg2rad([-1.5, 0.0, 1.5])

    match = _register(picture, predicted, headings=headings)

    assert match.heading_rad == pytest.approx(np.deg2rad(-1.5))
    assert match.heading_std_rad >= np.deg2rad(1.4)


def test_inverted_contrast_changes_nothing() -> None:
    """Snow on dark fields: gradients point the other way, the double-angle channels do not mind."""
    picture = 255 - seen_by(TRUE_POS, NADIR_TOP_NORTH)

    match = _register(picture, CameraPose(TRUE_POS + np.array([7.0, 3.0, 0.0]), NADIR_TOP_NORTH))

    assert_allclose(match.displacement_ne_m, [-7.0, -3.0], atol=0.33)


def test_wrong_place_is_called_an_outlier() -> None:
    """The truth lies outside the search: whatever peak there is must not be believed."""
    picture = seen_by(TRUE_POS + np.array([90.0, 60.0, 0.0]), NADIR_TOP_NORTH)

    match = _register(picture, CameraPose(TRUE_POS, NADIR_TOP_NORTH), radius_m=20.0)

    assert match.outlier_probability > 0.5


def test_structureless_picture_is_called_an_outlier() -> None:
    rng = np.random.default_rng(3)
    picture = np.clip(rng.normal(120.0, 3.0, size=(CAMERA.height_px, CAMERA.width_px)), 0, 255).astype(np.uint8)

    match = _register(picture, CameraPose(TRUE_POS, NADIR_TOP_NORTH))

    assert match.outlier_probability > 0.5


def test_ground_height_enters_through_the_terrain_model() -> None:
    """The same picture over ground 20 m lower than the frame's origin, with the camera 20 m lower."""

    class LowGround:
        def alt_amsl_m(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
            return np.full(np.shape(north_m), ORIGIN_ALT_M - 20.0)

    picture = seen_by(TRUE_POS, NADIR_TOP_NORTH)
    registrar = Registrar(CAMERA, MAP, LowGround(), ORIGIN_ALT_M)
    pose = CameraPose(TRUE_POS + np.array([4.0, 0.0, 20.0]), NADIR_TOP_NORTH)

    match = registrar.register(picture, pose, 20.0, HEADINGS, SCALES)

    assert isinstance(match, Match)
    assert_allclose(match.displacement_ne_m, [-4.0, 0.0], atol=0.33)
    assert match.centre_ned_m[2] == pytest.approx(20.0)
    assert abs(match.scale) < 0.006


@pytest.mark.parametrize(
    ("pose", "reason"),
    [
        (CameraPose(np.array([3000.0, 0.0, -110.0]), NADIR_TOP_NORTH), "outside the reference map"),
        (CameraPose(TRUE_POS, matrix_from_euler(0.0, 1.5, 0.0) @ NADIR_TOP_NORTH), "horizon"),
        (CameraPose(np.array([0.0, 0.0, -8.0]), NADIR_TOP_NORTH), "map pixels"),
    ],
)
def test_what_cannot_be_registered_says_why(pose: CameraPose, reason: str) -> None:
    picture = np.zeros((CAMERA.height_px, CAMERA.width_px), dtype=np.uint8)

    match = _registrar().register(picture, pose, 20.0, HEADINGS, NO_SCALES)

    assert isinstance(match, NoMatch)
    assert reason in match.reason


def test_unknown_channels_are_refused_with_the_known_ones() -> None:
    with pytest.raises(ValueError, match="double_angle"):
        _registrar(channels="colour")


@pytest.mark.parametrize("channels", sorted(COMPARED))
@pytest.mark.parametrize("reversed_contrast", [False, True])
def test_every_measure_finds_a_known_displacement(channels: str, reversed_contrast: bool) -> None:
    """All but grey values find it in the negative as well, where what was bright is dark."""
    picture = seen_by(TRUE_POS, NADIR_TOP_NORTH)
    shown = 255 - picture if reversed_contrast else picture
    predicted = CameraPose(TRUE_POS + np.array([7.0, -9.0, 0.0]), NADIR_TOP_NORTH)

    match = _registrar(channels=channels).register(shown, predicted, 20.0, NO_SCALES, NO_SCALES)

    assert isinstance(match, Match)
    missed_m = float(np.hypot(*(match.displacement_ne_m - np.array([-7.0, 9.0]))))
    if channels == "intensity" and reversed_contrast:
        assert missed_m > 3.0
    else:
        # half a pixel of the map; edges have no slope between their pixels
        assert missed_m < 0.7


def test_a_measure_that_is_not_there_is_named_with_those_that_are() -> None:
    with pytest.raises(ValueError, match="edge_overlap"):
        _registrar(channels="sift")


def test_lines_suggest_a_heading_beyond_the_grid() -> None:
    """
    Fault: the predicted heading is 14 degrees wrong, and the filter would have three tried.
    Expected: the lines of the blocks lead there, and the correlation takes it.
    """
    predicted = CameraPose(TRUE_POS + np.array([4.0, -3.0, 0.0]), _yaw(np.deg2rad(-14.0)) @ NADIR_TOP_NORTH)
    grid = np.deg2rad(np.array([-1.5, 0.0, 1.5]))
    picture = seen_by(TRUE_POS, NADIR_TOP_NORTH)

    by_lines = _registrar(heading_from=HeadingSource.LINES).register(picture, predicted, 20.0, grid, NO_SCALES)
    by_grid = _registrar().register(picture, predicted, 20.0, grid, NO_SCALES)

    assert isinstance(by_lines, Match)
    assert isinstance(by_grid, Match)
    assert by_lines.heading_rad == pytest.approx(np.deg2rad(14.0), abs=np.deg2rad(1.0))
    assert by_lines.peak.value > by_grid.peak.value + 0.2
    assert_allclose(by_lines.displacement_ne_m, [-4.0, 3.0], atol=1.0)


def test_calibration_is_that_of_the_channels_and_no_other() -> None:
    assert _registrar(channels="mind").calibration == calibration_of("mind")
    with pytest.raises(ValueError, match=r"double_angle.*not of the channels 'mind'"):
        _registrar(channels="mind", calibration=calibration_of("double_angle"))
