"""A simulated helicopter over a landing pad and a station beside it, each a process of its own, ended by their ids."""

from __future__ import annotations

import json
import os
import re
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path

from backend.demo import free_udp_ports
from tests.e2e.demo_process import OUTPUT, ROOT, Deadline

WORLDS = OUTPUT / "worlds"
SEED = 5
# A small picture at ten a second from eight metres: what two busy cores can draw, look at and show.
SCENARIO = """
name = "landing"
gps_denied_s = [[14.0, 1e6]]
gps_cut_s = [[14.0, 1e6]]
[world]
half_size_m = 150.0
[camera]
gimbal = "pan_tilt"
width_px = 320
height_px = 240
hfov_deg = 50.0
frames_per_s = 10.0
[flight]
speed_m_s = 2.0
height_agl_m = [8.0, 8.0]
hover_stops = 1
hover_s = 3600.0
wind_m_s = 2.0
gust_std_m_s = 0.5
by_belief = true
[pad]
height_m = 8.0
away_m = 1.5
circle_m = 8.0
"""
_ADDRESS = re.compile(r"(http://127\.0\.0\.1:\d+)")
_END_S = 20.0


@dataclass(frozen=True, slots=True)
class Flown:
    """A station that serves its page, the pad's description to give it, and the folder of the flight's truth.

    That is complete when ``aircraft`` is closed.
    """

    address: str
    pad_file: Path
    truth: Path
    aircraft: ExitStack


@contextmanager
def landing_scene(folder: Path, deadline: Deadline) -> Iterator[Flown]:
    """The station does not know the pad yet."""
    folder.mkdir(parents=True, exist_ok=True)
    scenario, world, truth = folder / "landing.toml", folder / "world", folder / "flown"
    scenario.write_text(SCENARIO)
    _run("sim", str(scenario), "--seed", str(SEED), "--prepare", str(world), deadline=deadline)
    flight = json.loads((world / "flight.json").read_text())
    camera, pad_file = folder / "camera.json", folder / "pad.json"
    pad_file.write_text(json.dumps(flight.pop("pad")))
    camera.write_text(json.dumps(flight))
    mavlink, video = free_udp_ports(2)
    with ExitStack() as stack:
        station = stack.enter_context(_process(
            "serve", "--port", "0", "--data-dir", str(folder / "data"), "--mavlink", f"udpin:127.0.0.1:{mavlink}",
            "--video", f"udp://127.0.0.1:{video}", "--camera", str(camera), "--map", str(world / "reference.tif"),
            stderr=subprocess.PIPE,
        ))  # fmt: skip
        address = _address(station)
        aircraft = stack.enter_context(ExitStack())
        aircraft.enter_context(_process(
            "sim", str(scenario), "--seed", str(SEED), "--mavlink", f"udpout:127.0.0.1:{mavlink}", "--video",
            f"udp://127.0.0.1:{video}", "--record", str(truth),
        ))  # fmt: skip
        yield Flown(address, pad_file, truth, aircraft)


def _run(*arguments: str, deadline: Deadline) -> None:
    done = subprocess.run(
        _command(*arguments), cwd=ROOT, env=_environment(), capture_output=True, text=True, check=False,
        stdin=subprocess.DEVNULL, timeout=deadline.left_s,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr


@contextmanager
def _process(*arguments: str, stderr: int = subprocess.DEVNULL) -> Iterator[subprocess.Popen[str]]:
    process = subprocess.Popen(
        _command(*arguments), cwd=ROOT, env=_environment(), text=True, stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL, stderr=stderr,
    )  # fmt: skip
    try:
        yield process
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        if process.stderr is not None:
            process.stderr.close()


def _address(station: subprocess.Popen[str]) -> str:
    assert station.stderr is not None
    said = ""
    for line in station.stderr:
        said += line
        if found := _ADDRESS.search(line):
            return found[1]
    raise AssertionError(f"the station ended at its start: {said}")


def _command(*arguments: str) -> list[str]:
    return [sys.executable, "-m", "backend.cli", *arguments]


def _environment() -> dict[str, str]:
    return {**os.environ, "XDG_CACHE_HOME": str(WORLDS)}
