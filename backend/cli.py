"""The ``pilotage`` command: assembles the parts' commands and keeps tracebacks from users."""

from __future__ import annotations

import asyncio
import os
import sys
from importlib.metadata import entry_points
from pathlib import Path
from typing import Annotated

import typer

from backend.demo import DemoScenario, run_demo
from backend.errors import StationError
from backend.server import configure_logging, run_station
from backend.settings import load_settings
from backend.station import Station
from backend.version import package_version
from geodata.errors import GeodataError

COMMANDS_GROUP = "pilotage.commands"
FAILED, INTERRUPTED = 1, 130


def build_app() -> typer.Typer:
    """The whole command: this file's own commands, and every part's."""
    app = typer.Typer(
        name="pilotage", no_args_is_help=True, add_completion=False, pretty_exceptions_enable=False,
        help="A ground-control station that navigates by looking at the ground.",
    )  # fmt: skip
    app.callback()(_options)
    app.command(epilog="Example: pilotage serve --mavlink udpin:0.0.0.0:14550 --video udp://0.0.0.0:5600")(serve)
    app.command(epilog="Example: pilotage demo --seed 7")(demo)
    for entry in sorted(entry_points(group=COMMANDS_GROUP), key=lambda entry: entry.name):
        try:
            register = entry.load()
        except ImportError as error:
            # A part that is not installed (an extra) takes only its own commands away.
            _say(f"command '{entry.name}' is not available: {error}")
            continue
        register(app)
    return app


def main(arguments: list[str] | None = None) -> None:
    """Run the command; ends the process with 0 done, 1 failed, 2 misused."""
    sys.exit(run(sys.argv[1:] if arguments is None else arguments))


def run(arguments: list[str]) -> int:
    """Run the command and return its exit status; errors are told in one line on standard error."""
    try:
        # Prints usage errors itself, and tells the status by SystemExit.
        build_app()(args=arguments, prog_name="pilotage")
    except SystemExit as error:
        return error.code if isinstance(error.code, int) else FAILED
    except KeyboardInterrupt:
        _say("interrupted")
        return INTERRUPTED
    except Exception as error:  # whatever went wrong, a user is told in words
        if os.environ.get("PILOTAGE_DEBUG"):
            raise
        if isinstance(error, StationError | GeodataError):
            _say(str(error))
        else:
            _say(f"{type(error).__name__}: {error} (PILOTAGE_DEBUG=1 shows where)")
        return FAILED
    return 0


def serve(
    config: Annotated[Path | None, typer.Option(help="TOML file with any of these settings.")] = None,
    host: Annotated[str | None, typer.Option(help="Address to listen on  [127.0.0.1]")] = None,
    port: Annotated[int | None, typer.Option(help="Port to listen on; 0 takes a free one  [8700]")] = None,
    data_dir: Annotated[Path | None, typer.Option(help="Folder for targets, maps and flights.")] = None,
    mavlink: Annotated[
        list[str] | None,
        typer.Option(help="MAVLink endpoint: udpin:, udpout:, tcp:, tcpin:, serial:  (repeatable)"),
    ] = None,
    video: Annotated[
        str | None, typer.Option(help="Video: udp://, rtp:FILE.sdp, rtsp://, device:, file:, none")
    ] = None,
    map: Annotated[str | None, typer.Option(help="Reference map: a file, or a map of the library.")] = None,
    camera: Annotated[Path | None, typer.Option(help="Camera file: the camera section of a flight.json.")] = None,
    pad: Annotated[Path | None, typer.Option(help="Landing pad: the description that 'pilotage pad' writes.")] = None,
    time_offset_s: Annotated[float | None, typer.Option(help="Added to the times of unstamped video.")] = None,
    flights: Annotated[
        list[Path] | None, typer.Option(help="Further folders of flights, read only  (repeatable)")
    ] = None,
    cot: Annotated[
        list[str] | None,
        typer.Option(help="Send targets as CoT: udp://HOST:PORT[?interface=], tcp://HOST:PORT  (repeatable)"),
    ] = None,
    record: Annotated[bool, typer.Option("--record", help="Record from the start.")] = False,
) -> None:
    """Run the station until Ctrl-C."""
    configure_logging()
    settings = load_settings(
        config, host=host, port=port, data_dir=data_dir, mavlink=tuple(mavlink) if mavlink else None, video=video,
        map=map, camera=camera, pad=pad, time_offset_s=time_offset_s, flights=tuple(flights) if flights else None,
        cot=tuple(cot) if cot else None, record=record or None,
    )  # fmt: skip

    async def alongside(station: Station, address: str, ending: asyncio.Event) -> None:
        announce(station, address)
        await ending.wait()

    run_station(settings, alongside)


def demo(
    port: Annotated[int, typer.Option(help="Port of the console; 0 takes a free one.")] = 8700,
    seed: Annotated[int, typer.Option(help="Another seed is another world, wind and noise.")] = 1,
    scenario: Annotated[
        DemoScenario, typer.Option(help="A flight about the country, or to a landing pad, without GPS.")
    ] = DemoScenario.DEMO,
    no_browser: Annotated[bool, typer.Option("--no-browser", help="Do not open a browser.")] = False,
    data_dir: Annotated[Path | None, typer.Option(help="Folder for targets, maps and flights.")] = None,
) -> None:
    """Run a station, a simulated helicopter and a browser page; nothing to configure. Ctrl-C ends all."""
    configure_logging()
    run_demo(port, seed, not no_browser, data_dir, scenario)


def announce(station: Station, address: str) -> None:
    """Say where the console is and what the station waits for."""
    _say(f"Pilotage {station.version}: {address}")
    if not station.has_console:
        _say("the console is not built: run 'make setup', or 'npm ci && npm run build' in frontend/")
    for wait in station.waiting_for():
        _say(f"waiting for {wait}")


def _show_version(wanted: bool) -> None:
    if wanted:
        typer.echo(f"pilotage {package_version()}")
        raise typer.Exit


def _options(
    version: Annotated[
        bool, typer.Option("--version", help="Show the version and end.", is_eager=True, callback=_show_version)
    ] = False,
) -> None:
    del version


def _say(text: str) -> None:
    typer.echo(text, err=True)


if __name__ == "__main__":
    main()
