"""``pilotage demo``: a prepared world, a station, a simulated helicopter and a browser page, which end together."""

from __future__ import annotations

import asyncio
import contextlib
import socket
import subprocess
import sys
import webbrowser
from enum import StrEnum
from pathlib import Path

import typer

from backend.errors import StartError
from backend.server import run_station
from backend.settings import default_data_dir, load_settings
from backend.station import Station
from geodata.maps import MapLibrary


class DemoScenario(StrEnum):
    """What the simulated helicopter flies: about the country, or to a landing pad."""

    DEMO = "demo"
    PAD = "pad"


END_TIMEOUT_S = 1.0


def run_demo(
    port: int, seed: int, open_browser: bool, data_dir: Path | None, scenario: DemoScenario = DemoScenario.DEMO
) -> None:
    """Run the demonstration until Ctrl-C; StartError when a part of it cannot start or ends by itself."""
    # Worlds of two scenarios lie at the same place, so their maps must not meet.
    folder = data_dir or default_data_dir() / ("demo" if scenario is DemoScenario.DEMO else f"demo-{scenario}")
    world = folder / "world" / f"seed-{seed}"
    map_id = prepare_world(world, seed, MapLibrary(folder / "maps"), scenario)
    mavlink_port, video_port = free_udp_ports(2)
    settings = load_settings(
        port=port, data_dir=folder, mavlink=(f"udpin:127.0.0.1:{mavlink_port}",),
        video=f"udp://127.0.0.1:{video_port}", map=map_id, camera=world / "flight.json",
    )  # fmt: skip

    async def alongside(station: Station, address: str, ending: asyncio.Event) -> None:
        typer.echo(f"Pilotage {station.version}: {address}", err=True)
        if not station.has_console:
            typer.echo(
                "the console is not built: run 'make setup', or 'npm ci && npm run build' in frontend/", err=True
            )
        elif open_browser:
            await asyncio.to_thread(webbrowser.open, address)
        log_path = folder / "simulator.log"
        arguments = ["--seed", str(seed), "--mavlink", f"udpout:127.0.0.1:{mavlink_port}"]
        arguments += ["--video", f"udp://127.0.0.1:{video_port}"]
        with log_path.open("wb") as log:
            simulator = await asyncio.create_subprocess_exec(
                *simulator_command(*arguments, scenario=scenario), stdin=subprocess.DEVNULL, stdout=log, stderr=log
            )
        await _run_beside(simulator, ending, log_path)

    run_station(settings, alongside)


def prepare_world(world: Path, seed: int, library: MapLibrary, scenario: DemoScenario = DemoScenario.DEMO) -> str:
    """Have the simulator write map, elevation and camera of its world, import both; returns the map's id."""
    if not (world / "flight.json").exists():
        typer.echo("preparing the world (once for each seed) ...", err=True)
        world.mkdir(parents=True, exist_ok=True)
        done = subprocess.run(
            simulator_command("--prepare", str(world), "--seed", str(seed), scenario=scenario),
            stdin=subprocess.DEVNULL, capture_output=True, text=True, check=False,
        )  # fmt: skip
        if done.returncode != 0:
            words = (done.stderr.strip() or done.stdout.strip()).splitlines()
            raise StartError(f"the simulated world cannot be prepared: {words[-1] if words else done.returncode}")
    record = library.import_file(world / "reference.tif", f"Demo world {seed}", "imagery")
    if (world / "elevation.tif").exists():
        library.import_file(world / "elevation.tif", f"Demo elevation {seed}", "elevation")
    return record.id


def simulator_command(*arguments: str, scenario: DemoScenario = DemoScenario.DEMO) -> list[str]:
    """The command line of a simulator of the demonstration, by the same interpreter."""
    return [sys.executable, "-m", "backend.cli", "sim", str(scenario), *arguments]


def free_udp_ports(count: int) -> list[int]:
    """Ports of the loopback that nobody uses."""
    with contextlib.ExitStack() as stack:
        sockets = [stack.enter_context(socket.socket(socket.AF_INET, socket.SOCK_DGRAM)) for _ in range(count)]
        for found in sockets:
            found.bind(("127.0.0.1", 0))
        return [found.getsockname()[1] for found in sockets]


async def _run_beside(simulator: asyncio.subprocess.Process, ending: asyncio.Event, log_path: Path) -> None:
    """Wait for the end of the station or of the simulator; end the simulator with the station."""
    ends = asyncio.create_task(ending.wait())
    dies = asyncio.create_task(simulator.wait())
    try:
        await asyncio.wait({ends, dies}, return_when=asyncio.FIRST_COMPLETED)
        if not ending.is_set():
            # A Ctrl-C reaches the whole terminal: the simulator may be the first to end.
            with contextlib.suppress(TimeoutError):
                await asyncio.wait_for(asyncio.shield(ends), 0.5)
        if not ending.is_set():
            raise StartError(f"the simulator ended with status {simulator.returncode}; it said: {last_words(log_path)}")
    finally:
        if simulator.returncode is None:
            with contextlib.suppress(ProcessLookupError):  # it may have ended without our having been told yet
                simulator.terminate()
            try:
                await asyncio.wait_for(asyncio.shield(dies), END_TIMEOUT_S)
            except TimeoutError:
                with contextlib.suppress(ProcessLookupError):
                    simulator.kill()
                await dies
        ends.cancel()


def last_words(path: Path) -> str:
    """The last line of a log."""
    with contextlib.suppress(OSError):
        lines = path.read_text(errors="replace").strip().splitlines()
        if lines:
            return lines[-1]
    return "nothing"
