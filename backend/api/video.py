"""Video to browsers: encoded frames with their identity, and single frames as JPEG."""

from __future__ import annotations

import asyncio
import contextlib
import struct
from typing import Annotated

import orjson
from fastapi import APIRouter, Depends, Response, WebSocket, WebSocketDisconnect

from backend.api.access import station_of_socket, the_station
from backend.clock import unix_us
from backend.errors import UnknownSourceError
from backend.fleet.viewers import Viewer
from backend.station import Station
from backend.video.frames import EncodedFrame

router = APIRouter(tags=["video"])

NOT_FOUND = 4404
UNSUPPORTED = 4400


@router.websocket("/api/v1/video/{source}")
async def video(socket: WebSocket, source: str, codec: str = "h264") -> None:
    """Frames as they come: uint32 big-endian header length, JSON header, payload. The first is a key frame.

    With ``codec=jpeg`` every frame is a picture of its own; with ``h264`` a source that has no H.264 sends JPEG.
    """
    station = station_of_socket(socket)
    await socket.accept()
    if codec not in ("h264", "jpeg"):
        await socket.close(UNSUPPORTED, "codec is h264 or jpeg")
        return
    try:
        feed = station.feed(source)
    except UnknownSourceError as error:
        await socket.close(NOT_FOUND, str(error))
        return
    audience = feed.jpeg_audience if codec == "jpeg" else feed.audience
    viewer = audience.join()
    sender = asyncio.create_task(_send(socket, viewer, station))
    listener = asyncio.create_task(_until_closed(socket))
    try:
        await asyncio.wait({sender, listener}, return_when=asyncio.FIRST_COMPLETED)
    finally:
        audience.leave(viewer)
        for task in (sender, listener):
            task.cancel()
        await asyncio.gather(sender, listener, return_exceptions=True)
        with contextlib.suppress(RuntimeError, WebSocketDisconnect):
            await socket.close()


@router.get(
    "/api/v1/video/{source}/frames/{frame_id}.jpg",
    response_class=Response, responses={200: {"content": {"image/jpeg": {}}}},
)  # fmt: skip
async def get_frame(source: str, frame_id: int, station: Annotated[Station, Depends(the_station)]) -> Response:
    """One frame of the last minute as JPEG."""
    content = await station.feed(source).jpeg(frame_id)
    return Response(content, media_type="image/jpeg", headers={"Cache-Control": "no-store"})


def pack(frame: EncodedFrame, now_us: int) -> bytes:
    """A frame as the socket carries it. ``latency_ms`` is from its first byte on the wire to this moment."""
    header = orjson.dumps(
        {
            "frame_id": frame.frame_id, "epoch": frame.epoch, "t_unix_us": frame.t_us,
            "t_wire_unix_us": frame.t_wire_us, "codec": frame.codec, "codec_string": frame.codec_string,
            "key": frame.key, "width": frame.width, "height": frame.height,
            "latency_ms": max(now_us - frame.t_wire_us, 0) / 1e3,
        }
    )  # fmt: skip
    return struct.pack(">I", len(header)) + header + frame.payload


async def _send(socket: WebSocket, viewer: Viewer, station: Station) -> None:
    while (frame := await viewer.take()) is not None:
        now_us = unix_us()
        await socket.send_bytes(pack(frame, now_us))
        station.metrics.stage.labels("video_wire_to_socket").observe(max(now_us - frame.t_wire_us, 0) / 1e6)


async def _until_closed(socket: WebSocket) -> None:
    while (await socket.receive())["type"] != "websocket.disconnect":
        pass
