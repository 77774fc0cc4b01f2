"""One target that is followed: what a picture, with the vehicle's state at its exposure, says of it. No threads."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from backend.clicks import camera_pixel
from backend.errors import CannotFollowTargetError
from backend.evidence.collect import Sighting as Click
from backend.fleet.cameras import ColourPicture
from backend.fleet.feed import FrameIdentity
from backend.navigation.setup import NavigationSetup
from backend.pointing import CLICK_STD_PX, Pointing, cut, ground_for
from estimator.errors import GeometryError
from estimator.geometry.rotation import matrix_from_q
from estimator.targets.motion import MotionState, PlaceSighting, TargetMotion
from estimator.targets.ray import RayTarget
from estimator.targets.tracker import OUTSIDE, CannotFollowError, Sighting, TargetTracker
from estimator.targets.view import ExpectedView, Motion, expected_view
from estimator.types import Float, Mode, NavigationState

NO_STATE = "where the vehicle was is not known"
# What changes from picture to picture of a pose that is otherwise alike for seconds: jitter of its times and the gyros.
WHITE_ATTITUDE_STD_RAD = math.radians(0.1)
WHITE_POSITION_STD_M = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Look:
    """What came of one picture, exposed at ``t_us`` on the states' clock.

    ``reason`` is why the target was not seen, None where it was; ``uv_px`` (2,), in the video, ``size_px`` and
    ``confidence`` are of where it was. ``motion`` is that of the last sighting, ``last_seen_us`` its exposure.
    """

    target_id: str
    frame: FrameIdentity
    t_us: int
    reason: str | None
    uv_px: tuple[float, float] | None
    size_px: float | None
    confidence: float | None
    motion: MotionState
    last_seen_us: int
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float


class Follower:
    """Follows one target. One thread at a time; pictures in the order of their exposures."""

    def __init__(
        self, target_id: str, setup: NavigationSetup, pointing: Pointing, tracker: TargetTracker, frame: FrameIdentity
    ) -> None:
        self.target_id = target_id
        self.setup = setup
        self.frame = frame
        self.motion = TargetMotion()
        self._pointing = pointing
        self._tracker = tracker
        self._t_us = -1

    @classmethod
    def start(cls, target_id: str, click: Click, picture: ColourPicture) -> Follower:
        """Begin with a located click on a picture.

        Raises
        ------
        CannotFollowTargetError
            The picture does not show there what could be followed.
        """
        uv = np.array(click.camera_uv_px)
        state, setup, found = click.state, click.setup, click.found
        try:
            view = _view(state, setup, found.pos_ned_m, np.eye(2), None)
            tracker = TargetTracker.start(picture.image, uv, state.t_us, view.px_per_m)
        except (CannotFollowError, GeometryError, ValueError) as error:
            raise CannotFollowTargetError(str(error)) from None
        pointing = Pointing(click.height_above_ground_m, "flat" if click.target.ground == "flat" else "terrain")
        follower = cls(target_id, setup, pointing, tracker, picture.frame)
        follower._take(state, found, CLICK_STD_PX)
        return follower

    @property
    def lost(self) -> bool:
        """Whether it must be found again."""
        return self._tracker.lost

    @property
    def last_motion(self) -> MotionState:
        """That of the last sighting."""
        return self.motion.track[-1]  # a start is a sighting, so there is one

    def look(self, picture: ColourPicture, t_us: int, state: NavigationState | None) -> Look | None:
        """What a picture exposed at ``t_us`` shows of the target; None where it is no newer than the last one."""
        if t_us <= self._t_us:
            return None
        self._t_us = t_us
        if state is None or state.mode is Mode.LOST:
            return self._unseen(picture, t_us, NO_STATE)
        motion = self.motion.at(t_us)
        there = np.array([*motion.seen_ne_m, motion.pos_ned_m[2]])
        going = Motion(motion.seen_vel_ne_m_s, motion.cov_seen_vel_ne_m2_s2, *motion.course, motion.moving)
        try:
            view = _view(state, self.setup, there, motion.cov_seen_ne_m2, going)
        except (GeometryError, ValueError):
            return self._unseen(picture, t_us, OUTSIDE)
        answer = self._tracker.update(picture.image, t_us, view)
        if not isinstance(answer, Sighting):
            return self._unseen(picture, t_us, answer.reason)
        uv = (float(answer.uv_px[0]), float(answer.uv_px[1]))
        std_px = math.sqrt(float(np.linalg.eigvalsh(answer.cov_px2)[-1]))
        try:
            found = cut(state, self.setup, uv, self._pointing, ground_for(self.setup, self._pointing, state)).found
        except GeometryError as error:
            return self._unseen(picture, t_us, str(error))
        self._take(state, found, std_px, answer)
        return self._seen(picture, t_us, answer, view)

    def _take(self, state: NavigationState, found: RayTarget, std_px: float, answer: Sighting | None = None) -> None:
        jitter_px = self.setup.camera.fx_px * WHITE_ATTITUDE_STD_RAD
        own = found.cov_pixel_m2[:2, :2] * (std_px**2 + jitter_px**2) / CLICK_STD_PX**2
        own = own + WHITE_POSITION_STD_M**2 * np.eye(2)
        slow = (found.cov_ned_m2 - found.cov_pixel_m2)[:2, :2]
        down_std_m = math.sqrt(max(float(found.cov_ned_m2[2, 2]), 0.0))
        self._t_us = state.t_us
        place = PlaceSighting(state.t_us, found.pos_ned_m, own, slow, down_std_m)
        if answer is not None:
            place = replace(place, vel_ne_m_s=answer.vel_ne_m_s, vel_std_m_s=answer.vel_std_m_s)
        self.motion.update(place)

    def _seen(self, picture: ColourPicture, t_us: int, answer: Sighting, view: ExpectedView) -> Look:
        extent_px = self._tracker.config.size_m * math.sqrt(abs(float(np.linalg.det(view.px_per_m))))
        scale = picture.frame.width_px / self.setup.camera.width_px
        uv = video_pixel((float(answer.uv_px[0]), float(answer.uv_px[1])), picture.frame, self.setup)
        return self._as_look(picture, t_us, None, uv, extent_px * scale, answer.confidence)

    def _unseen(self, picture: ColourPicture, t_us: int, reason: str) -> Look:
        return self._as_look(picture, t_us, reason, None, None, None)

    def _as_look(
        self, picture: ColourPicture, t_us: int, reason: str | None, uv_px: tuple[float, float] | None,
        size_px: float | None, confidence: float | None,
    ) -> Look:  # fmt: skip
        last = self.last_motion
        lat, lon, alt = self.setup.frame.geodetic_from_ned(last.pos_ned_m)
        return Look(
            self.target_id, picture.frame, t_us, reason, uv_px, size_px, confidence, last, self._tracker.last_seen_us,
            math.degrees(float(lat)), math.degrees(float(lon)), float(alt),
        )  # fmt: skip


def video_pixel(camera_uv_px: tuple[float, float], frame: FrameIdentity, setup: NavigationSetup) -> tuple[float, float]:
    """The pixel of the video for one of the calibrated camera: `camera_pixel` the other way round."""
    (u_0, v_0), (u_1, v_1) = (camera_pixel(n, n, frame, setup) for n in (0.0, 1.0))
    return (camera_uv_px[0] - u_0) / (u_1 - u_0), (camera_uv_px[1] - v_0) / (v_1 - v_0)


def _view(
    state: NavigationState, setup: NavigationSetup, place_ned_m: Float, cov_ne_m2: Float, motion: Motion | None
) -> ExpectedView:
    pose = matrix_from_q(state.q_ned_from_camera)
    return expected_view(state.lens_ned_m, pose, setup.camera, place_ned_m, cov_ne_m2, motion)
