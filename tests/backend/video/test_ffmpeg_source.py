"""Video through FFmpeg: servers that speak something else, or hang up, are told and tried again."""

from __future__ import annotations

import random
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import pytest

from backend.video.frames import VideoStatus
from tests.backend.video.collector import WAIT_S, Collector


@contextmanager
def server(answer: bytes) -> Iterator[tuple[int, threading.Semaphore]]:
    """Answers every connection with the same bytes and hangs up; counts them."""
    came = threading.Semaphore(0)
    with socket.create_server(("127.0.0.1", 0)) as listener:

        def serve() -> None:
            while True:
                try:
                    connection, _ = listener.accept()
                except OSError:
                    return
                with connection:
                    came.release()
                    try:
                        connection.sendall(answer)
                    except OSError:
                        continue

        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield listener.getsockname()[1], came
        finally:
            listener.shutdown(socket.SHUT_RDWR)
            thread.join(WAIT_S)


@pytest.mark.parametrize(
    "answer",
    [
        random.Random(4).randbytes(4000), b"", b"RTSP/1.0 404 Not Found\r\nCSeq: 1\r\n\r\n", b"HTTP/1.1 200 OK\r\n\r\n",
        b"RTSP/1.0 200 OK\r\nCSeq: 1\r\nContent-Length: 99999999\r\n\r\nv=0",
    ],
    ids=["random", "nothing", "not found", "HTTP", "cut off"],
)  # fmt: skip
def test_a_server_that_speaks_something_else_is_tried_again_and_again(answer: bytes) -> None:
    with server(answer) as (port, came), Collector(f"rtsp://127.0.0.1:{port}/stream") as taking:
        assert came.acquire(timeout=WAIT_S)
        assert came.acquire(timeout=WAIT_S)
        taking.wait_for_text("trying again")
        health = taking.channel.health()

    assert health.status is VideoStatus.WAITING
    assert f"rtsp://127.0.0.1:{port}/stream" in health.text
    assert taking.encoded == []
