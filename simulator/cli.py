"""The command ``pilotage sim``."""

from __future__ import annotations

import os
import re
import signal
import sys
import threading
import time
from collections.abc import Callable
from pathlib import Path
from typing import Annotated

import cv2
import numpy as np
import typer
from rich.console import Console

from simulator.datagrams import DatagramLink
from simulator.errors import LinkAddressError, SimulatorError
from simulator.offline import record_offline
from simulator.realtime import RealTimeRun
from simulator.recording import write_map
from simulator.scenario import SCENARIOS, Scenario, load_scenario
from simulator.simulation import Simulation
from simulator.world.world import World, world_for

_VIDEO = re.compile(r"^udp:(?://)?([^:/@?]+):(\d+)/?$")
_EXAMPLES = """Examples:

  pilotage sim demo

  pilotage sim demo --seed 3 --offline --record flights/demo-3

  pilotage sim my_scenario.toml --mavlink udpout:192.168.1.20:14550 --video udp://192.168.1.20:5600
"""

# A picture takes one core's time; more threads only take it from the station on the same machine.
_THREADS = 1


def register(app: typer.Typer) -> None:
    """Add the command to an application."""
    app.command("sim", help="Fly a simulated aircraft: MAVLink and video out, MAVLink in.", epilog=_EXAMPLES)(sim)


def sim(
    scenario: Annotated[str, typer.Argument(help=f"One of: {', '.join(sorted(SCENARIOS))}; or a TOML file.")] = "demo",
    seed: Annotated[int, typer.Option(min=0, help="World, route, weather and sensor errors follow from it.")] = 1,
    mavlink: Annotated[str, typer.Option(help="Where MAVLink goes; empty for nowhere.")] = "udpout:127.0.0.1:14550",
    video: Annotated[
        str, typer.Option(help="Where video goes as MPEG-TS; empty for nowhere.")
    ] = "udp://127.0.0.1:5600",
    record: Annotated[Path | None, typer.Option(help="Write a flight folder with truth here.")] = None,
    offline: Annotated[bool, typer.Option("--offline", help="As fast as it goes, no network; needs --record.")] = False,
    duration: Annotated[
        float | None, typer.Option(min=0.1, help="Seconds to fly; else endless or the scenario's.")
    ] = None,
    prepare: Annotated[Path | None, typer.Option(help="Only write map, elevation and flight.json here.")] = None,
    cache: Annotated[Path | None, typer.Option(help="Folder that keeps finished worlds.")] = None,
) -> None:
    """Fly a simulated aircraft."""
    console = Console(stderr=True)
    if offline and record is None:
        console.print("--offline writes a flight folder: say where with --record DIR", style="red", markup=False)
        raise typer.Exit(2)
    try:
        run_sim(
            load_scenario(scenario),
            seed,
            mavlink=mavlink,
            video=video,
            record=record,
            offline=offline,
            duration_s=duration,
            prepare=prepare,
            cache=cache,
            say=lambda text: console.print(text, markup=False, highlight=False),
        )
    except SimulatorError as error:
        console.print(f"Error: {error}", style="red", markup=False)
        raise typer.Exit(2 if isinstance(error, LinkAddressError) else 1) from error
    except OSError as error:
        console.print(f"Error: {error.filename or ''} {error.strerror}: check folder and free space", style="red")
        raise typer.Exit(1) from error


def run_sim(
    scenario: Scenario,
    seed: int,
    *,
    mavlink: str = "",
    video: str = "",
    record: Path | None = None,
    offline: bool = False,
    duration_s: float | None = None,
    prepare: Path | None = None,
    cache: Path | None = None,
    stop: threading.Event | None = None,
    say: Callable[[str], None] = lambda _: None,
) -> None:
    """Prepare, record or fly a scenario; ends early when ``stop`` is set or the process is asked to terminate."""
    stop = threading.Event() if stop is None else stop
    restore = _stop_on_signals(stop)
    try:
        video_address = parse_video(video) if video and not offline else None
        link = DatagramLink(mavlink) if mavlink and not offline and prepare is None else None
        cv2.setNumThreads(_THREADS)
        begin = time.monotonic()
        world = world_for(scenario.world.spec(seed), cache or default_cache())
        say(f"World {seed} ready after {time.monotonic() - begin:.1f} s")
        if prepare is not None:
            _prepare(scenario, world, seed, prepare)
            say(f"Map and set-up are in {prepare}")
        elif offline and record is not None:
            _offline(scenario, world, seed, record, duration_s, stop, say)
        else:
            say(f"Flying {scenario.name!r}: MAVLink {mavlink or 'off'}, video {video or 'off'}. Ctrl-C ends it.")
            run = RealTimeRun(scenario, world, seed, link, video_address, record)
            done = run.run(stop, duration_s)
            for failure in done.failures:
                say(f"Warning: {failure}")
            say(f"{done.pictures} pictures ({done.pictures_skipped} skipped), {done.packets} packets sent")
        if link is not None:
            link.close()
    finally:
        restore()


def _prepare(scenario: Scenario, world: World, seed: int, folder: Path) -> None:
    folder.mkdir(parents=True, exist_ok=True)
    home = Simulation(scenario, world, seed, scenario.start_unix_us).home_ned_m
    write_map(folder, scenario, world, np.asarray(home), None)


def _offline(
    scenario: Scenario,
    world: World,
    seed: int,
    folder: Path,
    duration_s: float | None,
    stop: threading.Event,
    say: Callable[[str], None],
) -> None:
    if duration_s is not None:
        scenario = scenario.model_copy(update={"duration_s": duration_s})
    begin = time.monotonic()
    told = [begin]

    def progress(flown_s: float) -> None:
        if time.monotonic() - told[0] > 5.0:
            told[0] = time.monotonic()
            say(f"{flown_s:.0f} of {scenario.duration_s:.0f} s flown, {flown_s / (told[0] - begin):.1f} x real time")

    flown_s = record_offline(scenario, world, seed, folder, stop, progress)
    say(f"{flown_s:.0f} s recorded in {folder}, {flown_s / (time.monotonic() - begin):.1f} x real time")


def default_cache() -> Path:
    """Where finished worlds are kept: the user's cache folder."""
    base = os.environ.get("XDG_CACHE_HOME") or str(Path.home() / ".cache")
    return Path(base) / "pilotage" / "worlds"


def parse_video(address: str) -> tuple[str, int]:
    """Host and port of ``udp://host:port``.

    Raises
    ------
    LinkAddressError
        It is not one.
    """
    match = _VIDEO.match(address.strip())
    if match is None or not 0 < int(match[2]) < 65536:
        raise LinkAddressError(address, "is not a place to send video to", "udp://127.0.0.1:5600")
    return match[1], int(match[2])


def _stop_on_signals(stop: threading.Event) -> Callable[[], None]:
    """Set ``stop`` on Ctrl-C and termination; returns what undoes it. Elsewhere than in the main thread: nothing."""
    if threading.current_thread() is not threading.main_thread():
        return lambda: None

    def ask(*_: object) -> None:
        if stop.is_set():
            # The second time somebody means it.
            sys.exit(130)
        stop.set()

    before = {number: signal.signal(number, ask) for number in (signal.SIGINT, signal.SIGTERM)}

    def restore() -> None:
        for number, handler in before.items():
            signal.signal(number, handler)

    return restore


app = typer.Typer(add_completion=False)
register(app)
