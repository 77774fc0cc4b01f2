"""Runs ``pilotage serve`` as a process of its own, and sends it what an aircraft would."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
import threading
import urllib.request
from pathlib import Path

from backend.clock import unix_us
from simulator.video_out import H264TsSender
from tests.backend.flight_maker import SIZE
from tests.backend.link.wire import Sender
from tests.backend.video.pictures_with_numbers import picture_with_number

PATIENCE_S = 60.0


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


def start(data_dir: Path, port: int, *options: str) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "backend.cli", "serve", "--port", str(port), "--data-dir", str(data_dir)]
    command += options or ("--video", "none", "--mavlink", "none")
    return subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True)


def await_words(process: subprocess.Popen[str], words: str) -> str:
    """Read standard error up to a line with some words."""
    assert process.stderr is not None
    seen = ""
    for line in process.stderr:
        seen += line
        if words in line:
            return seen
    raise AssertionError(f"ended without saying {words!r}: {seen}")


def request(address: str, path: str, body: dict[str, object] | None = None) -> dict[str, object]:
    data = None if body is None else json.dumps(body).encode()
    made = urllib.request.Request(address + path, data, {"Content-Type": "application/json"})  # noqa: S310
    with urllib.request.urlopen(made, timeout=PATIENCE_S) as answer:  # noqa: S310
        return dict(json.load(answer))


class Downlink:
    """Sends telemetry and video to a station until told to end, from a thread of its own."""

    def __init__(self, mavlink_port: int, video_port: int) -> None:
        self._ending = threading.Event()
        self._ports = mavlink_port, video_port
        self._thread = threading.Thread(target=self._run)
        self._thread.start()

    def close(self) -> None:
        self._ending.set()
        self._thread.join(PATIENCE_S)

    def _run(self) -> None:
        wire, count = Sender(), 0
        mavlink = ("127.0.0.1", self._ports[0])
        with (
            socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as out,
            H264TsSender("127.0.0.1", self._ports[1], *SIZE, fps=25.0) as video,
        ):
            while not self._ending.wait(0.02):
                if count % 25 == 0:
                    out.sendto(wire.heartbeat(), mavlink)
                out.sendto(wire.attitude(count * 20), mavlink)
                video.send(picture_with_number(count % 100, SIZE), unix_us())
                count += 1
