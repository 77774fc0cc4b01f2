"""Video sockets: the header says which frame it is; what cannot be had is closed with a reason."""

from __future__ import annotations

import json
import struct
from pathlib import Path

import pytest
import websockets

from backend.api.video import pack
from backend.video.frames import EncodedFrame
from tests.backend.station_runner import running_station


def test_a_frame_carries_its_identity_and_its_payload_untouched() -> None:
    payload = b"\x00\x00\x00\x01\x65" + bytes(range(256))
    frame = EncodedFrame(7, 2, 1_000_000, 1_040_000, "h264", "avc1.42C01E", True, 640, 480, payload)
    packed = pack(frame, 1_045_500)
    (length,) = struct.unpack(">I", packed[:4])

    assert json.loads(packed[4 : 4 + length]) == {
        "frame_id": 7, "epoch": 2, "t_unix_us": 1_000_000, "t_wire_unix_us": 1_040_000, "codec": "h264",
        "codec_string": "avc1.42C01E", "key": True, "width": 640, "height": 480, "latency_ms": 5.5,
    }  # fmt: skip
    assert packed[4 + length :] == payload


def test_a_clock_set_back_makes_no_negative_latency() -> None:
    frame = EncodedFrame(7, 2, 1_000_000, 1_040_000, "jpeg", "jpeg", True, 640, 480, b"")
    packed = pack(frame, 40_000)

    assert json.loads(packed[4:])["latency_ms"] == 0.0


@pytest.mark.parametrize(
    ("path", "code", "words"),
    [("cam-9", 4404, "cam-9"), ("cam-9?codec=theora", 4400, "h264 or jpeg"), ("cam-replay-x", 4404, "cam-replay-x")],
)
async def test_what_cannot_be_had_is_closed_with_a_reason(tmp_path: Path, path: str, code: int, words: str) -> None:
    async with running_station(tmp_path) as running:
        async with running.video(path) as video:
            with pytest.raises(websockets.ConnectionClosed) as closed:
                await video.recv()
        picture = await running.client.get("/api/v1/video/cam-9/frames/1.jpg")

    assert closed.value.rcvd is not None
    assert closed.value.rcvd.code == code
    assert words in closed.value.rcvd.reason
    assert picture.status_code == 404
