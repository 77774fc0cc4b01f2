"""Runs a station with its web server in this process until it is told to end."""

from __future__ import annotations

import asyncio
import contextlib
import errno
import logging
import signal
import socket
import sys
from collections.abc import Awaitable, Callable, Iterator
from typing import TextIO, cast

import structlog
import uvicorn
import uvloop

from backend.app import create_app
from backend.errors import StartError
from backend.settings import Settings, is_loopback
from backend.station import Station

GRACE_S = 1  # for open sockets; the whole end has three seconds
BACKLOG = 256
SWITCH_INTERVAL_S = 0.0005


class _Server(uvicorn.Server):
    """Leaves signals to us: the station has recordings to close after the last request."""

    @contextlib.contextmanager
    def capture_signals(self) -> Iterator[None]:
        """Do nothing."""
        yield


def run_station(settings: Settings, alongside: Callable[[Station, str, asyncio.Event], Awaitable[None]]) -> None:
    """Run until SIGINT or SIGTERM, or until ``alongside(station, address, ending)`` returns or raises.

    ``alongside`` runs beside the server once it listens; ``ending`` is set when the end begins.

    Raises
    ------
    StartError
        The station cannot start; nothing has been left behind.
    """
    refuse_open_bind(settings.host)
    # The estimator's thread computes without pause: hand the interpreter to the sockets ten times sooner than usual.
    sys.setswitchinterval(SWITCH_INTERVAL_S)
    with (
        listening_socket(settings.host, settings.port) as listener,
        asyncio.Runner(loop_factory=uvloop.new_event_loop) as runner,
    ):
        runner.run(_run(settings, listener, alongside))


def refuse_open_bind(host: str) -> None:
    """Raise StartError for an address that others can reach: there is no login yet to protect it."""
    if not is_loopback(host):
        raise StartError(
            f"--host {host} can be reached from other machines, and this version has no login to protect it: "
            "bind to 127.0.0.1 and reach it through an SSH tunnel (ssh -L 8700:127.0.0.1:8700 THIS-MACHINE)"
        )


def listening_socket(host: str, port: int) -> socket.socket:
    """A listening TCP socket; StartError when the port is taken or the address is not this machine's."""
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listener = socket.socket(family, socket.SOCK_STREAM)
    listener.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listener.bind((host, port))
        listener.listen(BACKLOG)
    except OSError as error:
        listener.close()
        if error.errno == errno.EADDRINUSE:
            raise StartError(
                f"port {port} on {host} is taken, perhaps by a station that runs already "
                f"(http://{host}:{port}): use that one, or give another --port and --data-dir"
            ) from None
        raise StartError(f"cannot listen on {host} port {port}: {error.strerror or error}") from None
    listener.setblocking(False)
    return listener


def address_of(listener: socket.socket) -> str:
    """The address to open in a browser."""
    host, port = listener.getsockname()[:2]
    return f"http://[{host}]:{port}" if ":" in host else f"http://{host}:{port}"


class _Stderr:
    """Standard error as it is at the moment of writing.

    A terminal that has gone away, or a full disk behind a redirection, must not end whoever has something to say.
    """

    def write(self, text: str) -> int:
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.write(text)
        return len(text)

    def flush(self) -> None:
        with contextlib.suppress(OSError, ValueError):
            sys.stderr.flush()


def configure_logging() -> None:
    """Plain lines on standard error."""
    structlog.configure(
        processors=[
            structlog.contextvars.merge_contextvars,
            structlog.processors.add_log_level,
            structlog.processors.TimeStamper(fmt="%H:%M:%S", utc=False),
            structlog.dev.ConsoleRenderer(colors=sys.stderr.isatty()),
        ],
        wrapper_class=structlog.make_filtering_bound_logger(logging.INFO),
        logger_factory=structlog.PrintLoggerFactory(cast(TextIO, _Stderr())),
        cache_logger_on_first_use=False,
    )


async def _run(
    settings: Settings, listener: socket.socket, alongside: Callable[[Station, str, asyncio.Event], Awaitable[None]]
) -> None:
    app = create_app(settings)
    station: Station = app.state.station
    config = uvicorn.Config(
        app, lifespan="off", log_level="warning", access_log=False, timeout_graceful_shutdown=GRACE_S,
        # Compressing moving pictures only costs time.
        ws_per_message_deflate=False,
    )  # fmt: skip
    server = _Server(config)
    ending = asyncio.Event()
    loop = asyncio.get_running_loop()

    def end() -> None:
        server.force_exit = server.should_exit
        server.should_exit = True
        ending.set()

    for number in (signal.SIGINT, signal.SIGTERM, signal.SIGHUP):
        loop.add_signal_handler(number, end)
    await station.start()
    companion: asyncio.Task[None] | None = None
    try:
        companion = asyncio.ensure_future(_beside(alongside, station, address_of(listener), ending, end))
        await server.serve(sockets=[listener])
    finally:
        end()
        await station.stop()
        if companion is not None:
            await companion


async def _beside(
    alongside: Callable[[Station, str, asyncio.Event], Awaitable[None]], station: Station, address: str,
    ending: asyncio.Event, end: Callable[[], None],
) -> None:  # fmt: skip
    try:
        await alongside(station, address, ending)
    finally:
        if not ending.is_set():
            end()
