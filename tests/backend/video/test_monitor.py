from __future__ import annotations

from dataclasses import replace

import av
import numpy as np
import pytest

from backend.video.decoder import PictureDecoder
from backend.video.frames import VideoStatus
from backend.video.monitor import VideoMonitor
from backend.video.pictures import grey_from_frame
from estimator.types import Image
from tests.backend.video.coded import encoded_frames

T0_US = 1_760_000_000_000_000
FRAME = encoded_frames(1)[0]
NOISE = np.random.default_rng(1).normal(128, 30, (240, 320)).clip(0, 255).astype(np.uint8)


def play(monitor: VideoMonitor, pictures: list[Image], t0_us: int = T0_US, step_us: int = 40_000) -> int:
    t_us = t0_us
    for n, picture in enumerate(pictures):
        t_us = t0_us + step_us * n
        monitor.arrived(replace(FRAME, frame_id=n, t_wire_us=t_us - 3_000), t_us)
        monitor.decoded(picture, t_us - 3_000, t_us)
    return t_us


def test_waiting_says_for_what() -> None:
    health = VideoMonitor().health(T0_US, "waiting for MPEG-TS", 1, 0)

    assert (health.status, health.text, health.last_frame_age_s) == (VideoStatus.WAITING, "waiting for MPEG-TS", None)


def test_flowing() -> None:
    monitor = VideoMonitor()
    end_us = play(monitor, [np.roll(NOISE, 3 * n, axis=1) for n in range(100)])

    health = monitor.health(end_us + 10_000, "receiving", 4, 2)

    assert health.status is VideoStatus.FLOWING
    assert health.fps == pytest.approx(25)
    assert (health.width, health.height, health.codec, health.epoch, health.decode_errors) == (320, 240, "h264", 4, 2)
    assert health.latency_ms == pytest.approx(3)
    assert health.last_frame_age_s == pytest.approx(0.01)


def test_a_stop_is_seen_and_so_is_its_end() -> None:
    monitor = VideoMonitor()
    end_us = play(monitor, [np.roll(NOISE, 3 * n, axis=1) for n in range(50)])

    stopped = monitor.health(end_us + 3_200_000, "waiting for MPEG-TS", 1, 0)
    later_us = play(monitor, [np.roll(NOISE, 5 * n, axis=1) for n in range(50)], end_us + 5_000_000)

    assert stopped.status is VideoStatus.STOPPED
    assert stopped.text == "no picture for 3 s; waiting for MPEG-TS"
    assert stopped.fps == 0
    assert monitor.health(later_us, "", 1, 0).status is VideoStatus.FLOWING


@pytest.mark.parametrize(("still", "status"), [(20, VideoStatus.FLOWING), (40, VideoStatus.FROZEN)])
def test_the_same_picture_again_and_again_is_frozen(still: int, status: VideoStatus) -> None:
    monitor = VideoMonitor()
    end_us = play(monitor, [np.roll(NOISE, 3 * n, axis=1) for n in range(25)] + [NOISE] * still)

    assert monitor.health(end_us, "", 1, 0).status is status


def test_a_hovering_camera_is_not_frozen() -> None:
    """The scene stands still, but a live sensor's noise of two grey levels goes on."""
    rng = np.random.default_rng(2)
    monitor = VideoMonitor()
    end_us = play(monitor, [(NOISE + rng.normal(0, 2, NOISE.shape)).clip(0, 255).astype(np.uint8) for _ in range(75)])

    assert monitor.health(end_us, "", 1, 0).status is VideoStatus.FLOWING


def test_a_frozen_camera_is_seen_through_the_encoder() -> None:
    """Fault: the camera repeats one picture, coded with a key frame a second. Expected: frozen, and flowing before."""
    decoder = PictureDecoder("h264")
    frames = [grey_from_frame(p) for f in STILL for _, p in decoder.decode(f, 0)]
    monitor = VideoMonitor()

    end_us = play(monitor, frames)

    assert len(frames) == 100
    assert monitor.health(end_us, "", 1, 0).status is VideoStatus.FROZEN


def still_units() -> list[bytes]:
    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height, encoder.pix_fmt, encoder.framerate = 320, 240, "yuv420p", 25
    encoder.bit_rate = 1_000_000
    encoder.options = {"preset": "ultrafast", "tune": "zerolatency", "x264-params": "keyint=25:scenecut=0"}
    picture = av.VideoFrame.from_ndarray(NOISE, format="gray").reformat(format="yuv420p")
    units = []
    for n in range(100):
        picture.pts = n
        units += encoder.encode(picture)
    return [bytes(u) for u in units]


STILL = still_units()
