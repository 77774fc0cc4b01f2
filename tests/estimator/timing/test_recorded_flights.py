"""The clock offset of the flights of the evaluation data, through the station's own link and video reader."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

from backend.link.events import SampleEvent
from backend.link.tlog import LinkReplay
from backend.navigation.setup import camera_of, mount_of
from backend.video.recorded import RecordedVideo
from estimator.geometry.camera import Mount
from estimator.geometry.rotation import matrix_from_q
from estimator.history import AttitudeTrack
from estimator.odometry.image_gyro import ImageGyro, ImageTurn
from estimator.timing.camera_clock import CameraClock
from estimator.timing.offset import OffsetEstimate
from estimator.types import AttitudeSample, InertialSample, Sample
from geodata.flight import FlightFolder
from tests.shared_data import shared_data


@dataclass(frozen=True)
class _Recorded:
    mount: Mount
    samples: list[Sample]
    turns: list[ImageTurn]


def _recorded(name: str, seconds: float) -> _Recorded:
    folder = FlightFolder.open(shared_data(f"flights/{name}"))
    mount = mount_of(folder.camera)
    samples, attitudes = _samples(folder)
    gyro = ImageGyro(camera_of(folder.camera))
    turns: list[ImageTurn] = []
    first_us: int | None = None
    assert folder.video_path is not None
    for frame in RecordedVideo.open(folder.video_path).frames():
        t_us = folder.frame_time_us(frame.index, frame.pts_s)
        assert t_us is not None
        first_us = t_us if first_us is None else first_us
        if t_us - first_us > seconds * 1e6:
            break
        # half a second late: nothing is known of the offset when pictures are turned into turns
        attitude = attitudes.at(t_us + 500_000)
        assert attitude is not None
        turn = gyro.step(t_us, frame.image, (matrix_from_q(attitude) @ mount.body_from_camera)[2])
        if turn is not None:
            turns.append(turn)
    return _Recorded(mount, samples, turns)


def _samples(folder: FlightFolder) -> tuple[list[Sample], AttitudeTrack]:
    link, attitudes = LinkReplay(), AttitudeTrack(keep_s=1e6)
    samples: list[Sample] = []
    for t_us, packet in folder.telemetry():
        for event in link.feed(t_us, packet):
            if isinstance(event, SampleEvent) and isinstance(event.sample, InertialSample | AttitudeSample):
                samples.append(event.sample)
                if isinstance(event.sample, AttitudeSample):
                    attitudes.add(event.sample.t_us, event.sample.q_ned_from_body)
    return sorted(samples, key=lambda sample: sample.t_us), attitudes


def _found(
    flight: _Recorded, from_s: float, to_s: float, added_s: float = 0.0, attitude_every: int = 0
) -> OffsetEstimate:
    """The estimate from a piece of the flight; ``attitude_every`` leaves only each such attitude, no gyroscopes."""
    clock = CameraClock(flight.mount, "fixed")
    count = 0
    end_us = flight.turns[0].t_first_us + (to_s + 2.0) * 1e6
    for sample in flight.samples:
        if sample.t_us > end_us:
            break
        count += isinstance(sample, AttitudeSample)
        if attitude_every and (isinstance(sample, InertialSample) or count % attitude_every):
            continue
        clock.offer(sample)
    for turn in flight.turns:
        if from_s <= (turn.t_first_us - flight.turns[0].t_first_us) / 1e6 < to_s:
            late_us = round(added_s * 1e6)
            clock.add_turn(
                turn.t_first_us + late_us, turn.t_second_us + late_us, turn.rotvec_camera_rad, turn.cov_rotvec_rad2
            )
    return clock.estimate()


@pytest.fixture(scope="module")
def copter() -> _Recorded:
    return _recorded("copter_120m", 40.0)


@pytest.fixture(scope="module")
def plane() -> _Recorded:
    return _recorded("plane_80m", 80.0)


@pytest.mark.parametrize("added_s", [-0.5, -0.2, 0.0, 0.2, 0.5])
def test_copter_whose_offset_is_stated_as_zero(copter: _Recorded, added_s: float) -> None:
    found = _found(copter, 0.0, 40.0, added_s)

    assert found.observable, found.reason
    assert abs(found.offset_s + added_s) < 2.0 * found.std_s
    assert found.std_s < 0.006
    # the mount is as stated
    assert (np.abs(found.boresight_rad) < 3.0 * np.sqrt(np.diag(found.cov_boresight_rad2))).all()


@pytest.mark.parametrize("attitude_every", [1, 3, 6])
def test_copter_with_attitude_alone(copter: _Recorded, attitude_every: int) -> None:
    """25, 8 and 4 attitudes per second, and no gyroscopes."""
    found = _found(copter, 0.0, 40.0, 0.3, attitude_every)

    assert found.observable, found.reason
    assert abs(found.offset_s + 0.3) < 2.0 * found.std_s


def test_halves_of_the_plane_agree(plane: _Recorded) -> None:
    """Delay and misalignment that nobody states: two halves of the flight find the same."""
    first, second = _found(plane, 0.0, 40.0), _found(plane, 40.0, 80.0)

    assert first.observable
    assert second.observable
    # both have the delay of the same sensors in their sigmas, so that they differ by less
    assert abs(first.offset_s - second.offset_s) < 0.002
    assert -0.3 < first.offset_s < -0.05
    difference = first.boresight_rad - second.boresight_rad
    std_rad = np.sqrt(np.diag(first.cov_boresight_rad2 + second.cov_boresight_rad2))
    assert (np.abs(difference) < 3.0 * std_rad).all()
    assert math.radians(0.4) < np.linalg.norm(first.boresight_rad) < math.radians(1.6)


def test_plane_with_attitude_alone_agrees_with_its_gyroscopes(plane: _Recorded) -> None:
    by_gyro, by_attitude = _found(plane, 0.0, 80.0), _found(plane, 0.0, 80.0, attitude_every=4)

    assert by_attitude.observable, by_attitude.reason
    assert abs(by_attitude.offset_s - by_gyro.offset_s) < math.hypot(by_attitude.std_s, by_gyro.std_s)
