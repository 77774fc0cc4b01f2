"""``pilotage replay`` and ``pilotage evaluate``."""

from __future__ import annotations

import json
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Annotated

import typer
from rich.console import Console
from rich.progress import Progress, TimeRemainingColumn
from rich.table import Table

from backend.errors import StationError
from backend.link.dialect import message_layouts
from backend.replay.denial import StationDenial, denied_spans, vehicle_id_of
from backend.replay.live import Downlink, moments, play
from backend.replay.offline import ReplayOptions, ReplayResult, replay_flight
from backend.replay.offset import calibrate
from backend.settings import DEFAULT_PORT
from backend.transports.address import Connection
from backend.transports.base import TransportError
from backend.video.errors import VideoError
from estimator.errors import CalibrationError
from estimator.navigator import NavigatorConfig
from estimator.registration.alignment import COMPARED, MatcherConfig
from estimator.registration.calibration import parse_calibration
from geodata.errors import GeodataError
from geodata.flight import FlightFolder

DEFAULT_VIDEO = "udp://127.0.0.1:5600"
DEFAULT_STATION = f"http://127.0.0.1:{DEFAULT_PORT}"
LeaveOut = Annotated[
    list[str] | None, typer.Option("--leave-out", help="A MAVLink message to take out of the log; repeatable.")
]
Offset = Annotated[
    float | None, typer.Option("--time-offset-s", help="Added to frame times, instead of what the folder says.")
]
Calibrated = Annotated[
    Path | None, typer.Option("--calibration", help="A file of pilotage fit-likelihood: its channel and its numbers.")
]

Unaligned = Annotated[
    bool, typer.Option("--without-alignments", help="As if no operator had laid a picture on the map.")
]


def register(app: typer.Typer) -> None:
    """Add the commands to the application."""
    app.command("replay")(replay)
    app.command("evaluate")(evaluate)
    app.command("map-offset")(calibrate)


def replay(
    flight: Annotated[Path, typer.Argument(help="A flight folder, the one that holds flight.json.")],
    out: Annotated[
        Path | None,
        typer.Option("--out", help="Folder for estimate.csv, fixes.csv, targets.csv, sightings.csv, reports."),
    ] = None,
    leave_out: LeaveOut = None,
    time_offset_s: Offset = None,
    calibration: Calibrated = None,
    without_alignments: Unaligned = False,
    live: Annotated[
        bool, typer.Option("--live", help="Instead: send telemetry and video to a running station, in real time.")
    ] = False,
    mavlink: Annotated[str, typer.Option(help="With --live: where MAVLink goes.")] = "udpout:127.0.0.1:14550",
    video: Annotated[str, typer.Option(help="With --live: where MPEG-TS goes; none sends none.")] = DEFAULT_VIDEO,
    start_s: Annotated[float, typer.Option(min=0.0, help="With --live: begin so long after its beginning.")] = 0.0,
    station: Annotated[
        str,
        typer.Option(help="With --live: the station's page, asked to deny GPS when the flight does; none asks nobody."),
    ] = DEFAULT_STATION,
) -> None:
    """Run the estimator over a recorded flight, as fast as it goes; or play it into a running station.

    Examples: pilotage replay flights/2026-05-01 --out results

    pilotage replay flights/2026-05-01 --live
    """
    console = Console(stderr=True)
    if live:
        if out is not None or leave_out or time_offset_s is not None or calibration is not None or without_alignments:
            raise typer.BadParameter("--live goes with --mavlink, --video, --start-s and --station only")
        with _reported_errors(console):
            _play_live(flight, mavlink, video, start_s, station, console)
        return
    if out is None:
        raise typer.BadParameter("say where the results go with --out DIR, or give --live")
    with _reported_errors(console):
        result = _replayed(flight, out, _options(leave_out, time_offset_s, calibration, without_alignments), console)
        timing = result.report["timing"]
        typer.echo(
            f"{result.report['flight']}: {timing['flight_s']:.0f} s in {timing['elapsed_s']:.1f} s "
            f"({timing['times_real_time']:.1f}x real time), {result.report['fixes']['accepted']} of "
            f"{result.report['fixes']['attempted']} fixes accepted; written to {out}"
        )
        _print_errors([(result.report["flight"], result)])


def evaluate(
    flights: Annotated[list[Path], typer.Argument(help="Flight folders that have a truth.csv.")],
    leave_out: LeaveOut = None,
    time_offset_s: Offset = None,
    calibration: Calibrated = None,
    without_alignments: Unaligned = False,
    as_json: Annotated[bool, typer.Option("--json", help="Print the whole result as JSON.")] = False,
) -> None:
    """Replay flights and print the errors against their truth.

    Example: pilotage evaluate flights/one flights/two
    """
    console = Console(stderr=True)
    results: list[tuple[str, ReplayResult]] = []
    with _reported_errors(console), tempfile.TemporaryDirectory() as scratch:
        for number, flight in enumerate(flights):
            options = _options(leave_out, time_offset_s, calibration, without_alignments)
            result = _replayed(flight, Path(scratch) / str(number), options, console)
            if result.evaluation is None:
                raise StationError(f"{flight}: no truth.csv that overlaps the flight; nothing to evaluate against")
            results.append((result.report["flight"], result))
        if as_json:
            typer.echo(json.dumps([result.report for _, result in results], indent=1))
        else:
            _print_errors(results)


def _play_live(flight: Path, mavlink: str, video: str, start_s: float, station: str, console: Console) -> None:
    folder = FlightFolder.open(flight)
    start_us, end_us = folder.telemetry_span()
    if round(start_s * 1e6) >= end_us - start_us:
        raise StationError(f"{flight}: --start-s {start_s:g} is after its end at {(end_us - start_us) / 1e6:.0f} s")
    mavlink_to = _udp_target("--mavlink", mavlink, ("udpout", "udp"))
    video_to = None if video == "none" else _udp_target("--video", video, ("udp",))
    begun_s: float | None = None

    def wait_until(t_us: int) -> None:
        nonlocal begun_s
        # The first moment is ready only when the video has been looked through.
        begun_s = time.monotonic() if begun_s is None else begun_s
        time.sleep(max(begun_s + t_us / 1e6 - time.monotonic(), 0.0))

    with ExitStack() as stack:
        denial = _denial(folder, start_us + round(start_s * 1e6), station, console)
        if denial is not None:
            denial.start()
            stack.callback(denial.close)
        downlink = stack.enter_context(Downlink(mavlink_to, video_to))
        tell = stack.enter_context(_progress(console, folder.name))
        sent = play(
            moments(folder, start_s), downlink.send_packet, downlink.send_frame, wait_until,
            lambda t_us: tell((t_us - start_us) / max(end_us - start_us, 1)),
            (lambda _: None) if denial is None else denial.want,
        )  # fmt: skip
    if denial is not None and denial.problem is not None:
        console.print(f"warning: GPS: {denial.problem}", style="yellow", markup=False)
    for warning in folder.warnings:
        console.print(f"warning: {warning}", style="yellow", markup=False)
    typer.echo(f"{folder.name}: {sent} packets and pictures sent to {mavlink} and {video}")


def _denial(folder: FlightFolder, from_us: int, station: str, console: Console) -> StationDenial | None:
    """Who asks the station to deny GPS; None where the flight has no such time to come, or nobody is to be asked."""
    if not any(end_us > from_us for _, end_us in denied_spans(folder)):
        return None
    if station == "none":
        console.print("warning: the station keeps its GPS where the flight was without", style="yellow", markup=False)
        return None
    return StationDenial(station, vehicle_id_of(folder))


def _udp_target(option: str, text: str, schemes: tuple[str, ...]) -> tuple[str, int]:
    try:
        connection = Connection.parse(text)
        if connection.scheme not in schemes:
            raise StationError(f"{option}: '{text}' is not {schemes[0]}:HOST:PORT; a flight is played over UDP")
        return connection.host_and_port()
    except TransportError as error:
        raise StationError(f"{option}: {error}") from None


def _options(
    leave_out: list[str] | None, time_offset_s: float | None, calibration: Path | None, without_alignments: bool
) -> ReplayOptions:
    ids = frozenset(_known_id(name) for name in leave_out or [])
    config = NavigatorConfig() if calibration is None else NavigatorConfig(matcher=_matcher(calibration))
    return ReplayOptions(leave_out=ids, time_offset_s=time_offset_s, config=config, alignments=not without_alignments)


def _matcher(path: Path) -> MatcherConfig:
    try:
        calibration = parse_calibration(path.read_text(encoding="utf-8"), str(path))
        if calibration.channel not in COMPARED:
            raise CalibrationError(str(path), f"channel {calibration.channel!r} is none of: {', '.join(COMPARED)}")
    except (OSError, UnicodeDecodeError, CalibrationError) as error:
        raise typer.BadParameter(f"--calibration '{path}': {error}") from None
    return MatcherConfig(channels=calibration.channel, calibration=calibration)


def _known_id(name: str) -> int:
    for msg_id, layout in message_layouts().items():
        if layout.name == name.upper():
            return msg_id
    raise typer.BadParameter(f"no MAVLink message is called {name!r}")


def _replayed(flight: Path, out: Path, options: ReplayOptions, console: Console) -> ReplayResult:
    folder = FlightFolder.open(flight)
    for warning in folder.warnings:
        console.print(f"warning: {warning}", style="yellow", markup=False)
    with _progress(console, folder.name) as tell:
        return replay_flight(folder, out, tell, options)


@contextmanager
def _progress(console: Console, what: str) -> Iterator[Callable[[float], None]]:
    with Progress(*Progress.get_default_columns(), TimeRemainingColumn(), console=console, transient=True) as bar:
        task = bar.add_task(what, total=1.0)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def _reported_errors(console: Console) -> Iterator[None]:
    try:
        yield
    except (StationError, GeodataError, VideoError, OSError) as error:
        console.print(f"error: {error}", style="red", markup=False)
        raise typer.Exit(1) from None


def _print_errors(results: list[tuple[str, ReplayResult]]) -> None:
    table = Table("flight", "rms m", "median m", "95 % m", "max m", "vertical rms m", "inside 95 %", "NEES", "gap s")
    for name, result in results:
        e = result.evaluation
        if e is not None:
            h = e.horizontal_m
            figures = (h.rms, h.p50, h.p95, h.largest, e.vertical_m.rms, e.inside_95_ellipse, e.nees_2d_mean)
            table.add_row(name, *(f"{value:.2f}" for value in figures), f"{e.longest_gap_s:.2f}")
    if table.row_count:
        Console().print(table)
