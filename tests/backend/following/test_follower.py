"""One follower with states that are known: where the car is, how fast it goes, and what is not seen."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from backend.clicks import camera_pixel
from backend.errors import CannotFollowTargetError
from backend.evidence.collect import Sighting
from backend.fleet.cameras import ColourPicture
from backend.fleet.feed import FrameIdentity
from backend.following.follower import NO_STATE, Follower, video_pixel
from backend.following.messages import sighting_fields, update_of
from backend.navigation.setup import NavigationSetup
from backend.pointing import AT_THE_GROUND, CLICK_STD_PX, cut, ground_for
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.local import LocalFrame
from estimator.targets.tracker import OUTSIDE
from estimator.types import Float, Mode, NavigationState
from geodata.elevation import FlatGround
from tests.backend.flight_maker import CAMERA, GROUND_M, LAT_DEG, LON_DEG, SIZE, state
from tests.backend.following.scene import CENTRE_PX, M_PER_PX, SPEED_M_S, CircuitScene

STEP_US = 200_000
SETUP = NavigationSetup(
    Camera(*SIZE, CAMERA.fx_px, CAMERA.fy_px, CAMERA.cx_px, CAMERA.cy_px),
    Mount(0.0, -math.pi / 2, 0.0, np.zeros(3)), "fixed", True,
    LocalFrame(math.radians(LAT_DEG), math.radians(LON_DEG), GROUND_M), None, FlatGround(GROUND_M), 0.5, None,
)  # fmt: skip


def at(t_us: int, **changes: Any) -> NavigationState:
    pose = np.diag([0.3, 0.3, 0.3, 0.002, 0.002, 0.002]) ** 2
    return replace(state(t_us), cov_camera_pose=pose, **changes)


def shown(scene: CircuitScene, t_us: int) -> ColourPicture:
    return ColourPicture(FrameIdentity(t_us // 40_000, t_us, *SIZE), scene.picture(t_us))


def begun(scene: CircuitScene, t_us: int, uv_px: tuple[float, float] | None = None) -> Follower:
    uv = uv_px or scene.pixel(t_us)
    ground = ground_for(SETUP, AT_THE_GROUND, at(t_us))
    found = cut(at(t_us), SETUP, uv, AT_THE_GROUND, ground).found
    picture = shown(scene, t_us)
    target: Any = SimpleNamespace(ground="terrain")
    watched: Any = ground
    click = Sighting(
        target, picture.frame, at(t_us), SETUP, uv, CLICK_STD_PX, watched, found, None, 0.0, 0.5, 0.0, "ray"
    )
    return Follower.start("t", click, picture)


def truth_ne_m(scene: CircuitScene, t_us: int) -> Float:
    u, v = scene.pixel(t_us)
    return M_PER_PX * np.array([CENTRE_PX[1] - 0.5 - v, u - CENTRE_PX[0] + 0.5])


def test_a_driving_car_has_its_place_and_its_speed() -> None:
    scene = CircuitScene()
    follower = begun(scene, STEP_US)
    looks = [follower.look(shown(scene, n * STEP_US), n * STEP_US, at(n * STEP_US)) for n in range(2, 80)]

    seen = [look for look in looks if look is not None and look.reason is None]
    assert len(seen) > 70
    off = [float(np.hypot(*(look.motion.pos_ned_m[:2] - truth_ne_m(scene, look.t_us)))) for look in seen[10:]]
    assert np.sqrt(np.mean(np.square(off))) < 0.8
    last = seen[-1]
    assert last.motion.moving is True
    told = sighting_fields(last)
    assert told["track"]["speed_m_s"] == pytest.approx(SPEED_M_S, abs=1.5)
    # clockwise round the circle: east of its centre the car goes south
    course = math.degrees(math.atan2(-math.sin(scene.angle(last.t_us)), -math.cos(scene.angle(last.t_us)))) % 360.0
    assert abs((told["track"]["course_deg"] - course + 180.0) % 360.0 - 180.0) < 25.0
    assert told["u_px"] == pytest.approx(scene.pixel(last.t_us)[0], abs=3.0)
    assert told["size_px"] == pytest.approx(5.0 / M_PER_PX, rel=0.1)


def test_a_parked_car_stands_and_nothing_is_said_of_its_motion_before_that_is_known() -> None:
    scene = CircuitScene(speed_m_s=0.0)
    follower = begun(scene, STEP_US)
    first = follower.look(shown(scene, 2 * STEP_US), 2 * STEP_US, at(2 * STEP_US))
    last = None
    for n in range(3, 60):
        last = follower.look(shown(scene, n * STEP_US), n * STEP_US, at(n * STEP_US))

    assert first is not None
    if first.motion.moving is None:
        assert update_of(first).vel_n_m_s is None
    assert last is not None
    assert (last.motion.moving, sighting_fields(last)["track"]["speed_m_s"]) == (False, None)
    assert float(np.hypot(*(last.motion.pos_ned_m[:2] - truth_ne_m(scene, last.t_us)))) < 0.8


def test_what_is_not_seen_keeps_the_last_place_and_says_why() -> None:
    scene = CircuitScene(speed_m_s=0.0)
    follower = begun(scene, STEP_US)
    seen = follower.look(shown(scene, 2 * STEP_US), 2 * STEP_US, at(2 * STEP_US))
    away = at(3 * STEP_US, pos_ned_m=np.array([500.0, 0.0, -100.0]))
    outside = follower.look(shown(scene, 3 * STEP_US), 3 * STEP_US, away)
    nowhere = follower.look(shown(scene, 4 * STEP_US), 4 * STEP_US, None)
    lost = follower.look(shown(scene, 5 * STEP_US), 5 * STEP_US, at(5 * STEP_US, mode=Mode.LOST))
    again = follower.look(shown(scene, 5 * STEP_US), 5 * STEP_US, at(5 * STEP_US))

    assert seen is not None and outside is not None and nowhere is not None and lost is not None
    assert (outside.reason, nowhere.reason, lost.reason) == (OUTSIDE, NO_STATE, NO_STATE)
    assert (outside.lat_deg, outside.lon_deg) == (seen.lat_deg, seen.lon_deg)
    assert update_of(lost).seen_unix_us == seen.t_us
    assert sighting_fields(lost)["u_px"] is None
    assert again is None  # this picture was looked at


@pytest.mark.parametrize(("uv_px", "why"), [((3.0, 120.0), "border"), ((319.0, 239.0), "border")])
def test_a_click_that_shows_too_little_is_refused(uv_px: tuple[float, float], why: str) -> None:
    with pytest.raises(CannotFollowTargetError, match=why):
        begun(CircuitScene(), STEP_US, uv_px)


def test_a_scaled_videos_pixels_go_there_and_back() -> None:
    frame = FrameIdentity(1, 0, 2 * SIZE[0], 2 * SIZE[1])

    assert video_pixel(camera_pixel(17.0, 300.25, frame, SETUP), frame, SETUP) == pytest.approx((17.0, 300.25))
