import cv2
import numpy as np
from numpy.testing import assert_allclose

from estimator.geometry.camera import Camera
from estimator.odometry.tracker import CornerTracker, TrackerConfig

CAMERA = Camera.from_hfov(320, 240, 1.0)


def _scene() -> np.ndarray:
    rng = np.random.default_rng(4)
    image = np.full((400, 500), 100, dtype=np.uint8)
    for _ in range(260):
        u, v = (int(x) for x in rng.integers(0, 500, size=2))
        width, height = (int(x) for x in rng.integers(8, 40, size=2))
        cv2.rectangle(image, (u, v), (u + width, v + height), int(rng.integers(20, 235)), -1)
    return cv2.GaussianBlur(image, (0, 0), 1.2)


SCENE = _scene()


def _view(u_px: float, v_px: float) -> np.ndarray:
    """The scene seen through a window whose first pixel lies at (u, v)."""
    matrix = np.array([[1.0, 0.0, -u_px], [0.0, 1.0, -v_px]])
    return cv2.warpAffine(SCENE, matrix, (320, 240), flags=cv2.INTER_LINEAR)


def test_tracks_show_the_shift_with_its_sign() -> None:
    """The window moves right and down: what it shows moves left and up."""
    tracker = CornerTracker(CAMERA)
    assert tracker.track(_view(50.0, 60.0)) is None

    tracks = tracker.track(_view(56.4, 57.7))

    assert tracks is not None
    assert len(tracks.present_uv_px) > 60
    moved = tracks.present_uv_px - tracks.previous_uv_px
    assert_allclose(np.median(moved, axis=0), [-6.4, 2.3], atol=0.1)
    assert np.mean(np.hypot(*(moved - [-6.4, 2.3]).T) < 0.5) > 0.9


def test_prediction_finds_what_is_too_far_to_search() -> None:
    config = TrackerConfig(levels=0)
    blind, told = CornerTracker(CAMERA, config), CornerTracker(CAMERA, config)
    for tracker in (blind, told):
        tracker.track(_view(20.0, 40.0))

    def found(tracks) -> int:
        if tracks is None:
            return 0
        moved = tracks.present_uv_px - tracks.previous_uv_px
        return int((np.hypot(*(moved - [-60.0, -45.0]).T) < 0.5).sum())

    alone = found(blind.track(_view(80.0, 85.0)))
    helped = found(told.track(_view(80.0, 85.0), told.corners_uv_px - [58.0, 46.0]))

    assert helped > 40
    assert alone < 0.2 * helped


def test_unknown_predictions_count_as_no_motion() -> None:
    tracker = CornerTracker(CAMERA)
    tracker.track(_view(50.0, 60.0))

    tracks = tracker.track(_view(52.0, 60.0), np.full(tracker.corners_uv_px.shape, np.nan))

    assert tracks is not None
    assert_allclose(np.median(tracks.present_uv_px - tracks.previous_uv_px, axis=0), [-2.0, 0.0], atol=0.1)


def test_corners_stay_inside_the_border_and_are_replenished() -> None:
    tracker = CornerTracker(CAMERA)
    tracker.track(_view(0.0, 60.0))
    first = len(tracker.corners_uv_px)
    for k in range(1, 12):
        tracks = tracker.track(_view(10.0 * k, 60.0))
        assert tracks is not None
        border = tracker.config.border_px
        assert (tracks.present_uv_px > border).all()
        assert (tracks.present_uv_px < np.array([319.0, 239.0]) - border).all()

    # more than a third of the first picture has left the view
    assert len(tracker.corners_uv_px) > 0.6 * min(first, tracker.config.min_corners)


def test_blank_pictures_give_no_tracks_and_texture_starts_again() -> None:
    blank = np.full((240, 320), 80, dtype=np.uint8)
    tracker = CornerTracker(CAMERA)

    assert tracker.track(blank) is None
    assert tracker.track(blank) is None
    assert tracker.corners_uv_px.shape == (0, 2)
    assert tracker.track(_view(50.0, 60.0)) is None
    assert tracker.track(_view(51.0, 60.0)) is not None


def test_reset_forgets_the_last_picture() -> None:
    tracker = CornerTracker(CAMERA)
    tracker.track(_view(50.0, 60.0))
    tracker.reset()

    assert len(tracker.corners_uv_px) == 0
    assert tracker.track(_view(51.0, 60.0)) is None
