from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import numpy as np
import pytest

from estimator.filters.initialise import InitialGuess
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.local import LocalFrame
from estimator.navigator import Navigator, NavigatorConfig, Outlook
from estimator.types import (
    AttitudeSample,
    BarometerSample,
    Doubt,
    FixReport,
    FrameSample,
    GnssSample,
    InertialSample,
    Mode,
    OffsetSource,
)
from tests.estimator.registration.textured_map import MAP, NADIR_TOP_NORTH, FlatGround, TexturedMap, Window, seen_by

FRAME = LocalFrame(np.deg2rad(47.0), np.deg2rad(8.0), 250.0)
CAMERA = Camera.from_hfov(240, 180, np.deg2rad(60.0))
MOUNT = Mount(0.0, -np.pi / 2, 0.0, np.zeros(3))
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
T0_US = 1_700_000_000_000_000
SPEED = 8.0
START = np.array([-70.0, 10.0, -110.0])


def _truth(t_s: float) -> np.ndarray:
    """Level flight due north."""
    return START + np.array([SPEED * t_s, 0.0, 0.0])


def _picture(pos_ned_m: np.ndarray) -> np.ndarray:
    return seen_by(pos_ned_m, NADIR_TOP_NORTH, camera=CAMERA)


def _t_us(t_s: float) -> int:
    return T0_US + round(t_s * 1e6)


def _gnss(t_s: float, offset_ned_m: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> GnssSample:
    lat, lon, alt = FRAME.geodetic_from_ned(_truth(t_s) + np.array(offset_ned_m))
    vel = np.array([SPEED, 0.0, 0.0])
    return GnssSample(_t_us(t_s), float(lat), float(lon), float(alt), vel, 1.5, 2.5, 12)


def _navigator(reference: TexturedMap | None = MAP, **changes: object) -> Navigator:
    return Navigator(NavigatorConfig(**changes), CAMERA, MOUNT, "fixed", FRAME, reference, FlatGround())


def _fly(
    navigator: Navigator,
    start_s: float,
    end_s: float,
    *,
    gnss: bool = True,
    frames: bool = True,
    inertial: bool = True,
    stamped: bool = False,
) -> list[FixReport]:
    """Offer and process all that the vehicle reports in a span."""
    reports: list[FixReport] = []
    support = np.array([0.0, 0.0, -9.8065])
    for k in range(round(start_s * 20), round(end_s * 20)):
        t_s = k / 20.0
        if inertial:
            navigator.offer(InertialSample(_t_us(t_s), np.zeros(3), support))
        if k % 4 == 0:
            navigator.offer(AttitudeSample(_t_us(t_s), LEVEL, np.zeros(3)))
            navigator.offer(BarometerSample(_t_us(t_s), 360.0))
        if gnss and k % 20 == 0:
            navigator.offer(_gnss(t_s))
        if frames and k % 10 == 5:
            navigator.offer(FrameSample(_t_us(t_s), k, _picture(_truth(t_s)), stamped=stamped))
        reports += navigator.advance(_t_us(t_s))
    return reports


def _error_m(navigator: Navigator) -> float:
    state = navigator.state
    assert state is not None
    truth = _truth((state.t_us - T0_US) / 1e6)
    return float(np.hypot(*(state.pos_ned_m - truth)[:2]))


@pytest.mark.parametrize("inertial", [True, False])
def test_gps_denied_keeps_following_by_vision(inertial: bool) -> None:
    """
    Fault: satellites are denied after three seconds, for twelve.
    Expected: map fixes hold the position within the map's own resolution, and the mode says vision.
    """
    navigator = _navigator()
    _fly(navigator, 0.0, 3.0, inertial=inertial)
    assert navigator.state is not None
    assert navigator.state.mode is Mode.GPS
    assert navigator.state.process_model == ("inertial" if inertial else "attitude")
    navigator.gps_denied = True

    reports = _fly(navigator, 3.0, 15.0, inertial=inertial)

    assert sum(report.accepted for report in reports) >= 15
    assert navigator.state.mode is Mode.VISION
    # one map pixel is a metre
    assert _error_m(navigator) < 1.5
    std = np.sqrt(np.linalg.eigvalsh(navigator.state.cov_pos_ned_m2[:2, :2])[-1])
    assert 0.05 < std < 3.0
    assert _error_m(navigator) < 3.0 * std
    assert navigator.state.last_fix_age_s < 2.0


def test_without_map_or_satellites_it_is_dead_reckoning_and_grows_unsure() -> None:
    navigator = _navigator(reference=None)
    _fly(navigator, 0.0, 3.0)
    before = navigator.state
    navigator.gps_denied = True

    reports = _fly(navigator, 3.0, 12.0)

    after = navigator.state
    assert before is not None
    assert after is not None
    assert reports == []
    assert after.mode is Mode.DEAD_RECKONING
    assert after.cov_pos_ned_m2[0, 0] > before.cov_pos_ned_m2[0, 0]
    # odometry over 70 m of flight
    assert _error_m(navigator) < 3.0


def test_every_velocity_of_the_receiver_counts_and_a_position_a_second() -> None:
    navigator = _navigator(reference=None)
    _fly(navigator, 0.0, 2.0, frames=False)
    before = dict(navigator.counts)

    for k in range(40):
        _fly(navigator, 2.0 + k / 20, 2.0 + (k + 1) / 20, gnss=False, frames=False)
        if k % 4 == 0:
            navigator.offer(_gnss(2.0 + k / 20))

    # the samples of the last moments wait for what may still come
    assert navigator.counts["gnss_velocity"] - before["gnss_velocity"] >= 8
    assert navigator.counts["gnss"] - before["gnss"] <= 3


def test_gps_denied_blocks_satellites() -> None:
    """
    Fault: the receiver is spoofed 60 m away while its use is denied.
    Expected: not one fix reaches the filter, the count stays.
    """
    navigator = _navigator(reference=None)
    _fly(navigator, 0.0, 3.0, frames=False)
    navigator.gps_denied = True
    fused = navigator.counts["gnss"]

    for k in range(3):
        navigator.offer(_gnss(3.0 + k, (60.0, 0.0, 0.0)))
    _fly(navigator, 3.0, 6.0, gnss=False, frames=False)

    assert navigator.counts["gnss"] == fused
    assert navigator.counts.get("gnss_rejected", 0) == 0
    assert _error_m(navigator) < 6.0


def test_gps_denied_blocks_alignment_by_satellites() -> None:
    navigator = _navigator(initial=InitialGuess(patience_s=1e3))
    navigator.gps_denied = True

    _fly(navigator, 0.0, 3.0, frames=False)

    assert navigator.state is None
    assert navigator.waiting_for is not None
    assert "position" in navigator.waiting_for


def test_gnss_spike_is_gated() -> None:
    """
    Fault: one position fix 80 m off, mid-flight.
    Expected: it is rejected and counted; the estimate does not move.
    """
    navigator = _navigator(reference=None)
    _fly(navigator, 0.0, 6.0, frames=False)

    navigator.offer(_gnss(6.0, (0.0, 80.0, 0.0)))
    _fly(navigator, 6.0, 6.5, gnss=False, frames=False)

    assert navigator.counts["gnss_rejected"] == 1
    assert _error_m(navigator) < 2.0


def test_late_samples_are_refused_and_counted() -> None:
    navigator = _navigator(reference=None)
    _fly(navigator, 0.0, 3.0, frames=False)
    state = navigator.state
    assert navigator.counts["late"] == 0

    navigator.offer(BarometerSample(_t_us(1.0), 900.0))
    navigator.offer(_gnss(1.5, (500.0, 0.0, 0.0)))
    navigator.advance(_t_us(2.95))

    assert navigator.counts["late"] == 2
    assert state is not None
    assert navigator.state is not None
    np.testing.assert_array_equal(navigator.state.pos_ned_m, state.pos_ned_m)


def test_order_of_arrival_within_the_horizon_does_not_matter() -> None:
    """The same samples offered forwards and backwards before one advance: the same state to the last bit."""
    states = []
    for reverse in (False, True):
        navigator = _navigator(reference=None)
        _fly(navigator, 0.0, 2.0, frames=False)
        samples = [InertialSample(_t_us(2.0 + k / 50), np.zeros(3), np.array([0.1, 0.0, -9.8])) for k in range(25)]
        samples.append(_gnss(2.21))
        samples.append(BarometerSample(_t_us(2.33), 360.4))
        for sample in reversed(samples) if reverse else samples:
            navigator.offer(sample)
        navigator.advance(_t_us(2.5))
        states.append(navigator.state)

    first, second = states
    assert first is not None
    assert second is not None
    np.testing.assert_array_equal(first.pos_ned_m, second.pos_ned_m)
    np.testing.assert_array_equal(first.cov_pos_ned_m2, second.cov_pos_ned_m2)


def test_frozen_pictures_are_not_motion() -> None:
    """
    Fault: the video repeats its last picture while the vehicle flies on.
    Expected: no odometry says that it stands still, no fix places it back; the speed stays.
    """
    navigator = _navigator()
    _fly(navigator, 0.0, 4.0)
    navigator.gps_denied = True
    _fly(navigator, 4.0, 5.0, gnss=False)
    odometry = navigator.counts["odometry"]
    last = _picture(_truth(4.75))
    reports: list[FixReport] = []

    for k in range(10, 18):
        navigator.offer(FrameSample(_t_us(k * 0.5 + 0.01), 1000 + k, last))
        reports += _fly(navigator, k * 0.5, k * 0.5 + 0.5, gnss=False, frames=False)

    assert navigator.counts["odometry"] == odometry
    assert reports == []
    assert navigator.state is not None
    # four seconds without a position
    assert navigator.state.vel_ned_m_s[0] == pytest.approx(SPEED, abs=1.0)
    assert _error_m(navigator) < 4.0


def test_a_dark_picture_is_neither_followed_nor_matched_and_is_told() -> None:
    """
    Fault: the camera shows nothing but its noise for five seconds.
    Expected: no odometry, no fix, the doubt stands and ends, and vision comes back with the light.
    """
    navigator = _navigator()
    _fly(navigator, 0.0, 4.0)
    navigator.gps_denied = True
    _fly(navigator, 4.0, 5.0, gnss=False)
    odometry, rng = navigator.counts["odometry"], np.random.default_rng(4)
    reports: list[FixReport] = []
    for k in range(10, 20):
        dark = rng.integers(0, 12, (180, 240)).astype(np.uint8)
        navigator.offer(FrameSample(_t_us(k * 0.5 + 0.01), 1000 + k, dark))
        reports += _fly(navigator, k * 0.5, k * 0.5 + 0.5, gnss=False, frames=False)
    blind = navigator.state

    assert navigator.counts["odometry"] == odometry
    assert reports == []
    assert blind is not None
    assert blind.doubts == (Doubt.NO_TEXTURE,)
    # five seconds without a position
    assert _error_m(navigator) < 5.0
    _fly(navigator, 10.0, 13.0, gnss=False)
    assert navigator.state is not None
    assert navigator.state.doubts == ()
    assert navigator.state.mode is Mode.VISION


def test_a_displaced_map_is_learned_and_serves_once_satellites_are_denied() -> None:
    """
    Fault: the map lies 25 m north of where it should.
    Expected: told while there are satellites, and taken off when there are none.
    """
    reference = _Displaced(MAP, 25.0)
    navigator = _navigator(reference=reference)
    _fly(navigator, 0.0, 14.0)
    told = navigator.state
    navigator.gps_denied = True
    reports = _fly(navigator, 14.0, 20.0, gnss=False)

    assert told is not None
    assert Doubt.MAP_OFFSET in told.doubts
    assert sum(report.accepted for report in reports) >= 6
    assert navigator.state is not None
    assert navigator.state.mode is Mode.VISION
    # a receiver's metre and a half and the map's own metre pixels
    assert _error_m(navigator) < 3.0


class _Displaced:
    """A map that shows everything further north than it is."""

    def __init__(self, scene: TexturedMap, north_m: float) -> None:
        self.gsd_m = scene.gsd_m
        south, west, north, east = scene.bounds_ne_m
        self.bounds_ne_m = (south + north_m, west, north + north_m, east)
        self._scene, self._north_m = scene, north_m

    def window(self, north_min_m: float, east_min_m: float, north_max_m: float, east_max_m: float) -> Window:
        inner = self._scene.window(north_min_m - self._north_m, east_min_m, north_max_m - self._north_m, east_max_m)
        return replace(inner, north_max_m=inner.north_max_m + self._north_m)


def test_prediction_carries_on_and_leaves_the_filter_alone() -> None:
    navigator = _navigator(reference=None)
    _fly(navigator, 0.0, 4.0, frames=False)
    state = navigator.state
    assert state is not None

    ahead = navigator.predict(state.t_us + 500_000)

    assert ahead is not None
    np.testing.assert_allclose(ahead.pos_ned_m - state.pos_ned_m, state.vel_ned_m_s * 0.5, atol=0.05)
    assert ahead.cov_pos_ned_m2[0, 0] > state.cov_pos_ned_m2[0, 0]
    assert navigator.state is not None
    np.testing.assert_array_equal(navigator.state.pos_ned_m, state.pos_ned_m)


def test_history_answers_for_the_past_only() -> None:
    navigator = _navigator(reference=None)
    assert navigator.predict(_t_us(1.0)) is None
    _fly(navigator, 0.0, 4.0, frames=False)

    past = navigator.state_at(_t_us(2.5))

    assert past is not None
    assert past.t_us == _t_us(2.5)
    assert past.pos_ned_m[0] == pytest.approx(_truth(2.5)[0], abs=1.5)
    assert navigator.state_at(_t_us(60.0)) is None


class EdgeOfTerrain:
    """Ground that is known only in the south."""

    def alt_amsl_m(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return np.where(np.asarray(north_m) > -55.0, np.nan, 250.0)


def test_flying_off_the_elevation_model_stops_nothing() -> None:
    """
    Fault: no ground height below the vehicle from some place on.
    Expected: fixes are refused with that reason, and the filter goes on.
    """
    navigator = Navigator(NavigatorConfig(), CAMERA, MOUNT, "fixed", FRAME, MAP, EdgeOfTerrain())

    reports = _fly(navigator, 0.0, 5.0)

    assert "ground height unknown" in {report.reason for report in reports}
    assert navigator.state is not None
    assert np.isfinite(navigator.state.pos_ned_m).all()


@pytest.mark.parametrize("stamped", [True, False])
def test_only_pictures_without_the_vehicles_stamp_wait_for_the_videos_clock(stamped: bool) -> None:
    """Level and straight flight tells nothing of the clock: pictures that need it are held back, the state is not."""
    navigator = _navigator(find_video_offset=True)
    reports = _fly(navigator, 0.0, 5.0, stamped=stamped)

    assert bool(reports) is stamped
    state = navigator.state
    assert state is not None
    # the horizon does not lag while the clock is searched
    assert _t_us(5.0) - state.t_us <= 50_000
    assert state.video_offset is not None
    assert state.video_offset.source is (OffsetSource.STAMPED if stamped else OffsetSource.SEARCHING)
    assert bool(state.video_offset.reason) is not stamped


def test_the_cameras_misalignment_is_part_of_the_state() -> None:
    navigator = _navigator()
    _fly(navigator, 0.0, 3.0, frames=False)
    prior = navigator.state
    _fly(navigator, 3.0, 10.0)
    told = navigator.state

    assert prior is not None
    assert told is not None
    assert prior.cov_boresight_rad2 is not None
    assert told.boresight_rad is not None
    assert told.cov_boresight_rad2 is not None
    first_rad = np.sqrt(np.diag(prior.cov_boresight_rad2))
    assert first_rad == pytest.approx(np.full(3, InitialGuess().boresight_std_rad), rel=0.05)
    # the true misalignment is none; map fixes tell of roll and pitch
    std_rad = np.sqrt(np.diag(told.cov_boresight_rad2))
    assert (std_rad[:2] < first_rad[:2]).all()
    assert (np.abs(told.boresight_rad) < 3.0 * std_rad).all()
    assert told.video_offset is not None
    assert told.video_offset.source is OffsetSource.GIVEN


def test_who_asks_while_a_picture_is_worked_on_gets_what_was_known_before() -> None:
    """The answer of a prediction made just then, to the last bit, whatever the work changes."""
    navigator = _navigator()
    _fly(navigator, 0.0, 4.0)
    for k in range(12):
        navigator.offer(InertialSample(_t_us(4.0 + 0.05 * k), np.array([0.0, 0.0, 0.01]), np.array([0.1, 0.0, -9.8])))
    ahead_us, answers = _t_us(4.5), []

    @contextmanager
    def busy(outlook: Outlook) -> Iterator[None]:
        predicted = navigator.predict(ahead_us)
        answers.append((outlook(ahead_us, ()), predicted))
        answers.append((outlook(_t_us(2.0), ()), navigator.state_at(_t_us(2.0))))
        yield
        # the filter has changed by now, the outlook has not
        answers.append((outlook(ahead_us, ()), predicted))

    navigator.while_busy = busy
    navigator.offer(FrameSample(_t_us(4.3), 80, _picture(_truth(4.3))))
    before = navigator.state
    (report,) = navigator.advance(_t_us(4.3))
    assert report.accepted  # there was work, and it moved the filter
    assert before is not None
    assert navigator.state is not None
    assert not np.array_equal(before.cov_pos_ned_m2, navigator.state.cov_pos_ned_m2)

    assert len(answers) == 3
    for found, expected in answers:
        assert found is not None
        assert expected is not None
        assert found.t_us == expected.t_us
        assert np.array_equal(found.pos_ned_m, expected.pos_ned_m)
        assert np.array_equal(found.q_ned_from_camera, expected.q_ned_from_camera)
        assert np.array_equal(found.cov_camera_pose, expected.cov_camera_pose)


def test_an_outlook_takes_in_the_readings_that_have_come_since() -> None:
    """The same as if they had been offered: in a turn the attitude of a moment ago points elsewhere."""
    navigator = _navigator()
    _fly(navigator, 0.0, 4.0, frames=False)
    turning = [
        InertialSample(_t_us(4.0 + 0.02 * k), np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -9.8])) for k in range(8)
    ]
    outlook, ahead_us = navigator.outlook(), turning[-1].t_us
    told, held = outlook(ahead_us, turning), outlook(ahead_us, ())
    for sample in turning:
        navigator.offer(sample)
    offered = navigator.predict(ahead_us)

    assert told is not None
    assert held is not None
    assert offered is not None
    assert np.array_equal(told.q_ned_from_camera, offered.q_ned_from_camera)
    assert np.abs(held.q_ned_from_camera - told.q_ned_from_camera).max() > 0.02


def test_nothing_is_known_before_alignment() -> None:
    assert _navigator().outlook()(_t_us(0.0), ()) is None
