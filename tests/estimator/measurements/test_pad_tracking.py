"""A pad followed through drawn pictures: begun without a jump, carried on, lost, refused with the reason."""

from collections.abc import Callable

import numpy as np
import pytest
from numpy.testing import assert_allclose

from benchmarks.pad_scenes import VGA, Look, PadScene
from estimator.filters.eskf import ErrorStateFilter, ProcessNoise
from estimator.filters.nominal import PAD_GROUPS, Layout, Nominal
from estimator.filters.strapdown import EarthModel, Motion
from estimator.geometry.camera import Mount
from estimator.geometry.rotation import matrix_from_euler, matrix_from_q
from estimator.landing.pad import Pad, circle_pad, tag_pad
from estimator.landing.pose import PadPose
from estimator.measurements.camera_attitude import CameraAttitude, CameraAttitudeModel, Gimbal
from estimator.measurements.innovation import Innovation
from estimator.measurements.pad_tracking import PadTracker, SurveyedPlace
from estimator.types import Float, Image, PadMode
from tests.estimator.landing.test_detector import GROUND

PAD = circle_pad("p", 1.5, 0.3)
POS = np.array([40.0, -30.0, -10.0])
PAD_AT = np.array([40.5, -30.4, 0.3])
NED_FROM_PAD = matrix_from_euler(0.01, -0.015, 2.0)
OFF_M = np.array([3.0, -3.0, 0.6])
EVERY_US = 50_000


class Flight:
    """A vehicle that hangs level above a pad, with a filter that is metres off and a tracker.

    ``manoeuvre`` is how far the filter takes the velocity to wander, in metres a second in one second.
    """

    def __init__(self, pad: Pad = PAD, surveyed: SurveyedPlace | None = None, manoeuvre: float = 0.03) -> None:
        layout = Layout.of(("position", "velocity", "attitude", "boresight", *PAD_GROUPS))
        level = np.array([1.0, 0.0, 0.0, 0.0])
        nominal = Nominal(
            Motion(POS + OFF_M, np.zeros(3), level), np.zeros(3), np.zeros(3), 0.0, np.zeros(3), np.zeros(3)
        )
        noise = ProcessNoise(manoeuvre_m_s2_rt_s=(manoeuvre,) * 3, attitude_bias_std_rad=(0.004,) * 3)
        std = np.concatenate([np.full(3, s) for s in (5.0, 0.05, 0.004, 0.004, 0.0, 0.0)])
        earth = EarthModel.at(0.8, 300.0)
        self.eskf = ErrorStateFilter(nominal, np.diag(std**2), layout, earth, noise)
        self.tracker = PadTracker(VGA, pad, surveyed=surveyed)
        self.t_us = 0
        self.applied: list[str] = []
        self._model = CameraAttitudeModel(Mount(0.0, -np.pi / 2, 0.0, np.zeros(3)), Gimbal.FIXED)

    def camera(self, eskf: ErrorStateFilter) -> tuple[CameraAttitude, Float]:
        motion = eskf.nominal.motion
        return self._model.at(0, motion.q_ned_from_body, eskf.nominal.boresight_rad), motion.pos_ned_m

    def see(self, image: Image, after_us: int = EVERY_US) -> bool:
        self.t_us += after_us
        self.eskf.predict_by_reports(None, None, after_us / 1e6)
        return self.tracker.fuse(self.t_us, 7, image, self.eskf, self.camera, self._apply)

    def _apply(self, what: str, innovation: Innovation | None, gate_sigmas: float) -> bool:
        if innovation is None:
            return False
        gate = gate_sigmas**2 * len(innovation.z)
        accepted, _ = self.eskf.update(innovation.z, innovation.H, innovation.R, gate, what, innovation.R_one)
        self.applied += [what] if accepted else []
        return accepted

    @property
    def off_m(self) -> Float:
        off: Float = self.tracker.relative(self.eskf, self.t_us).pos_ned_m - (POS - PAD_AT)
        return off


def _drawn(pad: Pad | None = PAD, pad_at: Float = PAD_AT) -> Callable[[int], Image]:
    """Pictures by number; each has its own noise."""
    scene = PadScene(GROUND, VGA, pad, corner_px=(300.0, 300.0))
    camera_from_ned = Mount(0.0, -np.pi / 2, 0.0, np.zeros(3)).body_from_camera.T
    pose = PadPose(camera_from_ned @ NED_FROM_PAD, camera_from_ned @ (pad_at - POS))
    return lambda number: scene.render(pose, Look(jpeg=80), np.random.default_rng(number))


PICTURES = [_drawn()(number) for number in range(4)]


def test_the_first_picture_places_the_pad_and_leaves_the_vehicle_where_it_was() -> None:
    flight = Flight()
    before = flight.eskf.nominal.motion.pos_ned_m.copy()
    searching = flight.tracker.relative(flight.eskf, 0)

    assert flight.see(PICTURES[0])

    assert searching.mode is PadMode.SEARCHING
    assert np.isnan(searching.pos_ned_m).all()
    assert_allclose(flight.eskf.nominal.motion.pos_ned_m, before, atol=0.01)
    relative = flight.tracker.relative(flight.eskf, flight.t_us)
    assert relative.mode is PadMode.TRACKING
    assert relative.reason == ""
    assert relative.seen is not None
    # metres off on the map, and to centimetres from the pad
    sigma = np.sqrt(np.diag(relative.cov_pos_ned_m2))
    assert np.all(sigma < 0.15)
    assert np.all(np.abs(flight.off_m) < 3.0 * sigma)
    assert np.sqrt(flight.eskf.cov("position")[0, 0]) == pytest.approx(5.0, rel=0.02)
    # the heading of the pad is that of the print
    told = matrix_from_q(relative.q_ned_from_pad)
    assert np.degrees(np.arccos(np.clip(told[:, 0] @ NED_FROM_PAD[:, 0], -1.0, 1.0))) < 2.0


def test_later_pictures_keep_it_and_stay_within_what_is_said() -> None:
    flight = Flight()
    for picture in PICTURES:
        assert flight.see(picture)

    later = flight.tracker.relative(flight.eskf, flight.t_us)
    # ten metres by what is not known of the camera's tilt, 0.3 degrees
    assert np.sqrt(np.diag(later.cov_pos_ned_m2)[:2]) == pytest.approx(0.06, abs=0.03)
    assert np.sqrt(later.cov_pos_ned_m2[2, 2]) < 0.03
    assert flight.off_m @ np.linalg.solve(later.cov_pos_ned_m2, flight.off_m) < 11.3  # 99 % of three degrees of freedom


def test_a_surveyed_pad_is_a_fix_on_the_map() -> None:
    flight = Flight(surveyed=SurveyedPlace(PAD_AT, 0.05))
    before = flight.tracker.relative(flight.eskf, 0)

    assert flight.see(PICTURES[0])

    assert before.mode is PadMode.SEARCHING
    assert_allclose(before.pos_ned_m, POS + OFF_M - PAD_AT)
    assert flight.applied == ["pad", "pad_survey"]
    assert np.linalg.norm(flight.eskf.nominal.motion.pos_ned_m - POS) < 0.3
    assert np.sqrt(flight.eskf.cov("position")[0, 0]) < 0.15


def test_a_survey_that_cannot_be_true_does_not_move_the_vehicle() -> None:
    flight = Flight(surveyed=SurveyedPlace(PAD_AT + np.array([200.0, 0.0, 0.0]), 0.05))
    assert flight.see(PICTURES[0])
    assert flight.applied == ["pad"]
    assert np.linalg.norm(flight.off_m) < 0.3


def test_without_pictures_it_is_carried_on_and_then_lost() -> None:
    flight = Flight(manoeuvre=0.3)
    flight.see(PICTURES[0])
    dark = np.random.default_rng(5).integers(0, 4, PICTURES[0].shape).astype(np.uint8)

    modes = []
    for number in range(16):
        assert not flight.see(np.roll(dark, number), after_us=150_000)
        modes.append(flight.tracker.relative(flight.eskf, flight.t_us).mode)

    assert modes[0] is PadMode.TRACKING
    assert PadMode.DEAD_RECKONING in modes
    assert modes[-1] is PadMode.LOST
    assert "no pad" in flight.tracker.relative(flight.eskf, flight.t_us).reason
    assert not flight.tracker.followed(flight.t_us)
    assert flight.see(PICTURES[1], after_us=150_000)
    assert flight.tracker.relative(flight.eskf, flight.t_us).mode is PadMode.TRACKING
    assert np.linalg.norm(flight.off_m) < 0.3


def test_a_picture_that_repeats_the_last_is_not_used() -> None:
    flight = Flight()
    assert flight.see(PICTURES[0])
    assert not flight.see(PICTURES[0])
    assert "repeats" in flight.tracker.relative(flight.eskf, flight.t_us).reason


def test_a_picture_of_another_size_is_refused_with_the_reason() -> None:
    flight = Flight()
    assert not flight.see(PICTURES[0][:240, :320])
    assert "320 x 240" in flight.tracker.relative(flight.eskf, flight.t_us).reason


def test_ground_without_a_pad_is_refused_with_the_reason() -> None:
    flight = Flight()
    assert not flight.see(_drawn(None)(1))
    assert "no pad" in flight.tracker.relative(flight.eskf, flight.t_us).reason
    assert flight.eskf.nominal.pad is None


def test_a_pad_that_was_carried_elsewhere_is_refused_a_while_and_then_believed() -> None:
    """
    Fault: the pad jumps by a metre while the vehicle knows its own motion to centimetres.
    Expected: refused for a second, then taken for where it is.
    """
    flight = Flight()
    for picture in PICTURES:
        flight.see(picture)
    moved = _drawn(pad_at=PAD_AT + np.array([1.0, 0.0, 0.0]))

    used = [flight.see(moved(number), after_us=200_000) for number in range(8)]

    assert not any(used[:5])
    assert used[-1]
    assert_allclose(flight.off_m, [-1.0, 0.0, 0.0], atol=0.3)


def test_a_board_of_tags_is_followed_as_well() -> None:
    board = tag_pad("b", 0.9)
    flight = Flight(board)
    pictures = _drawn(board)

    assert flight.see(pictures(0))
    assert flight.see(pictures(1))

    relative = flight.tracker.relative(flight.eskf, flight.t_us)
    assert relative.seen is not None
    assert relative.seen.triple == -1
    assert np.linalg.norm(flight.off_m) < 0.4
