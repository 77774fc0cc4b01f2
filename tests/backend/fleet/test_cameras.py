"""Pictures at the calibrated size, in the order they were taken."""

from pathlib import Path

import numpy as np

from backend.demo import free_udp_ports
from backend.fleet.cameras import LiveCamera, fitted
from backend.metrics import Metrics
from backend.navigation.setup import CameraProfile
from backend.recorder.recorder import Recorder
from backend.video.frames import DecodedFrame
from estimator.types import FrameSample
from geodata.flight_meta import CameraMeta, MapMeta

CAMERA = CameraMeta(width_px=640, height_px=480, fx_px=500.0, fy_px=500.0, cx_px=319.5, cy_px=239.5)


def test_the_calibrated_size_is_passed_as_it_is() -> None:
    image = np.zeros((480, 640), np.uint8)

    assert fitted(image, CAMERA)[0] is image


def test_a_scaled_video_is_brought_to_size() -> None:
    ramp = np.tile(np.linspace(0, 255, 1280).astype(np.uint8), (960, 1))
    image, problem = fitted(ramp, CAMERA)

    assert problem is None
    assert image is not None
    assert image.shape == (480, 640)
    assert abs(int(image[100, 320]) - 128) <= 1


def test_another_shape_is_refused_in_words() -> None:
    image, problem = fitted(np.zeros((720, 1280), np.uint8), CAMERA)

    assert image is None
    assert "1280 x 720" in (problem or "")
    assert "640 x 480" in (problem or "")


async def test_the_estimator_never_sees_time_run_backwards(tmp_path: Path) -> None:
    """
    Fault: pictures 2 and 3 are dated back because the delay proved smaller; later the machine's clock is set back by
    an hour, and the source reconnects.
    Expected: 2 and 3 are left out, everything after the changes of clock and epoch is not.
    """
    given: list[FrameSample] = []
    (port,) = free_udp_ports(1)
    camera = LiveCamera(
        f"udp://127.0.0.1:{port}", 0.0, CameraProfile(CAMERA, MapMeta(), None), Metrics(), Recorder(tmp_path),
        given.append, lambda _: None,
    )  # fmt: skip
    hour_us = 3_600_000_000
    times = [(1, 10_000), (1, 50_000), (1, 20_000), (1, 50_000), (1, 90_000), (1, 90_000 - hour_us), (2, 20_000)]
    for number, (epoch, t_us) in enumerate(times):
        camera._take_decoded(DecodedFrame(number, epoch, hour_us + t_us, np.zeros((480, 640), np.uint8)))

    assert [picture.frame_id for picture in given] == [0, 1, 4, 5, 6]
