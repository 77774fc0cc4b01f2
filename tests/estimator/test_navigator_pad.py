"""The navigator with a landing pad: hovering above one, taking it up, leaving it, and without one as ever."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.pad_scenes import VGA, Look, PadScene
from estimator.geometry.camera import Mount
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_euler, matrix_from_q
from estimator.landing.pad import CirclePad, circle_pad
from estimator.landing.pose import PadPose
from estimator.measurements.pad_tracking import SurveyedPlace
from estimator.navigator import Navigator, NavigatorConfig
from estimator.types import (
    AttitudeSample,
    BarometerSample,
    FrameSample,
    GnssSample,
    Image,
    InertialSample,
    Mode,
    NavigationState,
    PadMode,
)
from geodata.elevation import FlatGround
from tests.estimator.landing.test_detector import GROUND

FRAME = LocalFrame(np.deg2rad(47.0), np.deg2rad(8.0), 250.0)
MOUNT = Mount(0.0, -np.pi / 2, 0.0, np.array([0.2, 0.0, 0.1]))
LEVEL = np.array([1.0, 0.0, 0.0, 0.0])
T0_US = 1_700_000_000_000_000
PAD = circle_pad("p", 1.5, 0.3)
POS = np.array([12.0, -7.0, -9.0])
PAD_AT = np.array([11.6, -6.7, 0.0])
NED_FROM_PAD = matrix_from_euler(0.0, 0.0, 1.0)
RELATIVE = POS - PAD_AT


def _pictures(pad: CirclePad | None, count: int = 5) -> list[Image]:
    """What the camera sees, with noise of its own in each."""
    camera_from_ned = MOUNT.body_from_camera.T
    pose = PadPose(camera_from_ned @ NED_FROM_PAD, camera_from_ned @ (PAD_AT - POS - MOUNT.lever_arm_frd_m))
    scene = PadScene(GROUND, VGA, pad, corner_px=(400.0, 500.0))
    return [scene.render(pose, Look(jpeg=80), np.random.default_rng(number)) for number in range(count)]


SHOWN, BARE = _pictures(PAD), _pictures(None)


def _navigator(pad: CirclePad | None = PAD, pad_at: SurveyedPlace | None = None) -> Navigator:
    return Navigator(
        NavigatorConfig(), VGA, MOUNT, "fixed", FRAME, None, FlatGround(250.0), pad=pad, pad_at=pad_at
    )  # fmt: skip


def _t_us(t_s: float) -> int:
    return T0_US + round(t_s * 1e6)


def _hover(
    navigator: Navigator, start_s: float, end_s: float, pictures: list[Image], *, gnss: bool = True
) -> list[NavigationState]:
    """Offer and process what a vehicle tells that does not move; the states after each picture."""
    lat, lon, alt = FRAME.geodetic_from_ned(POS)
    states = []
    for k in range(round(start_s * 50), round(end_s * 50)):
        t_us = _t_us(k / 50.0)
        navigator.offer(InertialSample(t_us, np.zeros(3), np.array([0.0, 0.0, -9.8065])))
        if k % 10 == 0:
            navigator.offer(AttitudeSample(t_us, LEVEL, np.zeros(3)))
            navigator.offer(BarometerSample(t_us, 259.0))
            if gnss:
                fix = GnssSample(t_us, float(lat), float(lon), float(alt), np.zeros(3), 1.5, 2.5, 12)
                navigator.offer(fix)
        if k % 5 == 3:
            navigator.offer(FrameSample(t_us, k, pictures[(k // 5) % len(pictures)]))
        navigator.advance(t_us)
        if k % 5 == 3 and navigator.state is not None:
            states.append(navigator.state)
    return states


@pytest.fixture(scope="module")
def flown() -> tuple[Navigator, list[NavigationState], list[NavigationState], list[NavigationState]]:
    """Two seconds with satellites and no pad in view, three the other way round, and two with neither."""
    navigator = _navigator()
    before = _hover(navigator, 0.0, 2.0, BARE)
    navigator.gps_denied = True
    seen = _hover(navigator, 2.0, 5.0, SHOWN, gnss=False)
    return navigator, before, seen, _hover(navigator, 5.0, 7.0, BARE, gnss=False)


def test_without_a_pad_there_is_none() -> None:
    navigator = _navigator(pad=None)
    states = _hover(navigator, 0.0, 1.0, SHOWN)

    assert all(state.pad is None for state in states)
    assert "pad" not in navigator.counts
    assert "pad" not in navigator.stage_seconds


def test_the_place_relative_to_the_pad_is_known_to_what_is_said(flown) -> None:
    _, before, seen, _ = flown
    assert all(state.pad is not None and state.pad.mode is PadMode.SEARCHING for state in before)
    # the first picture may still wait for its turn to be searched
    for state in seen[2:]:
        assert state.pad is not None
        assert state.pad.mode is PadMode.TRACKING
        off = state.pad.pos_ned_m - RELATIVE
        assert off @ np.linalg.solve(state.pad.cov_pos_ned_m2, off) < 16.3  # one of a thousand is beyond
        assert np.sqrt(state.pad.cov_pos_ned_m2[2, 2]) < 0.05
    assert_allclose(matrix_from_q(seen[-1].pad.q_ned_from_pad), NED_FROM_PAD, atol=0.06)
    assert np.linalg.norm(seen[-1].vel_ned_m_s) < 0.05


def test_the_pad_is_taken_up_and_left_without_a_jump(flown) -> None:
    _, before, seen, after = flown
    pos = np.array([state.pos_ned_m for state in (*before[-3:], *seen, *after)])
    # metres off on the map as before, and no step is more than the estimate's own wander in a tenth of a second
    assert np.linalg.norm(np.diff(pos, axis=0), axis=1).max() < 0.1


def test_a_followed_pad_holds_the_place_where_there_is_no_map(flown) -> None:
    _, _, seen, after = flown
    assert seen[-1].mode is Mode.VISION
    std_m = [np.sqrt(state.cov_pos_ned_m2[0, 0]) for state in (seen[5], seen[-1])]
    assert std_m[1] < 1.05 * std_m[0]
    assert after[-1].mode is Mode.DEAD_RECKONING


def test_without_the_pad_in_view_it_is_carried_on_and_says_so(flown) -> None:
    _, _, _, after = flown
    pad = after[-1].pad
    assert pad is not None
    assert pad.mode is PadMode.DEAD_RECKONING
    assert pad.age_s == pytest.approx(2.0, abs=0.2)
    assert "no pad" in pad.reason
    assert np.linalg.norm(pad.pos_ned_m - RELATIVE) < 0.15
    assert np.trace(pad.cov_pos_ned_m2) > np.trace(after[0].pad.cov_pos_ned_m2)


def test_it_is_told_for_any_time(flown) -> None:
    navigator, _, seen, after = flown
    between_us = (seen[-3].t_us + seen[-2].t_us) // 2
    past, now = navigator.state_at(between_us), navigator.state
    ahead = navigator.predict(after[-1].t_us + 300_000)

    assert past is not None
    assert past.pad is not None
    low, high = np.sort([seen[-3].pad.pos_ned_m, seen[-2].pad.pos_ned_m], axis=0)
    assert np.all((past.pad.pos_ned_m > low - 0.05) & (past.pad.pos_ned_m < high + 0.05))
    assert ahead is not None
    assert ahead.pad is not None
    assert now is not None
    assert ahead.pad.age_s > now.pad.age_s
    assert_allclose(ahead.pad.pos_ned_m - now.pad.pos_ned_m, ahead.pos_ned_m - now.pos_ned_m, atol=1e-9)
    assert np.all(np.diag(ahead.pad.cov_pos_ned_m2) > np.diag(now.pad.cov_pos_ned_m2))


def test_a_state_carried_on_from_a_picture_of_the_pad_is_by_vision() -> None:
    navigator = _navigator()
    _hover(navigator, 0.0, 1.0, BARE)
    navigator.gps_denied = True
    last = _hover(navigator, 1.0, 2.0, SHOWN, gnss=False)[-1]

    ahead = navigator.predict(last.t_us + 500_000)

    assert ahead is not None
    assert (last.mode, ahead.mode) == (Mode.VISION, Mode.VISION)


def test_a_surveyed_pad_gives_the_place_on_the_map() -> None:
    navigator = _navigator(pad_at=SurveyedPlace(PAD_AT + np.array([3.0, 0.0, 0.0]), 0.05))
    navigator.gps_denied = False
    before = _hover(navigator, 0.0, 1.0, BARE)
    navigator.gps_denied = True
    seen = _hover(navigator, 1.0, 2.0, SHOWN, gnss=False)

    assert before[-1].pad is not None
    assert_allclose(before[-1].pad.pos_ned_m, RELATIVE - [3.0, 0.0, 0.0], atol=2.0)
    # satellites said otherwise, to metres; the survey is to centimetres
    assert_allclose(seen[-1].pos_ned_m, POS + np.array([3.0, 0.0, 0.0]), atol=0.3)
    assert_allclose(seen[-1].pad.pos_ned_m, RELATIVE, atol=0.2)
