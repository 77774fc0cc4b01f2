"""One receiver of Cursor on Target events: what waits for it, and the task that sends it."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections import OrderedDict
from collections.abc import Callable
from dataclasses import asdict, dataclass

import structlog

from backend.clock import unix_us
from backend.exports.cot import cot_event
from backend.exports.destination import Destination
from backend.metrics import Metrics
from backend.store.targets import Target
from backend.transports.base import FIRST_RETRY_S, LONGEST_RETRY_S

MOST_WAITING = 10_000
_READ_BYTES = 65_536
_SEND_BUFFER_BYTES = 65_536
_CONNECT_TIMEOUT_S = 5.0
# A receiver that does not read for so long is cut off, and connected to anew.
SEND_TIMEOUT_S = 10.0
# A flood of datagrams is lost on a radio link, and keeps the event loop from others.
_UDP_BURST, _UDP_PAUSE_S = 20, 0.02

_log = structlog.get_logger(__name__)


@dataclass(frozen=True, slots=True)
class Notice:
    """A target to tell of, or (``deleted``) to take back."""

    target: Target
    deleted: bool = False


@dataclass(slots=True)
class PeerState:
    """Counts since the start; ``last_error`` stays, ``problem`` is None again when events go out."""

    destination: str
    sent: int = 0
    failures: int = 0
    dropped: int = 0
    problem: str | None = None
    last_error: str | None = None


class CotPeer:
    """Sends to one destination for ever; nothing here makes the station wait.

    Of each target only the newest notice waits, ``most_waiting`` at most; beyond that the oldest is dropped and
    counted. An event is written when it goes out, so that its times are right however long it waited. ``current()`` is
    what a new connection is told first.
    """

    def __init__(
        self, destination: Destination, current: Callable[[], list[Target]], metrics: Metrics, *,
        first_retry_s: float = FIRST_RETRY_S, send_timeout_s: float = SEND_TIMEOUT_S, most_waiting: int = MOST_WAITING,
    ) -> None:  # fmt: skip
        self._destination = destination
        self._current = current
        self._sent_count = metrics.cot_events.labels(destination.text)
        self._failure_count = metrics.cot_failures.labels(destination.text)
        self._dropped_count = metrics.cot_dropped.labels(destination.text)
        self._first_retry_s = first_retry_s
        self._send_timeout_s = send_timeout_s
        self._most_waiting = most_waiting
        self._state = PeerState(destination.text)
        self._waiting: OrderedDict[str, Notice] = OrderedDict()
        self._ready = asyncio.Event()
        self._task: asyncio.Task[None] | None = None
        self._sent_since_retry = False

    @property
    def state(self) -> PeerState:
        """A copy of the counts."""
        return PeerState(**asdict(self._state))

    def start(self) -> None:
        """Begin."""
        self._task = asyncio.create_task(self._run(), name=f"CoT to {self._destination.text}")

    async def close(self) -> None:
        """End; what waits is not sent."""
        task, self._task = self._task, None
        if task is not None:
            task.cancel()
            await asyncio.gather(task, return_exceptions=True)

    def put(self, notice: Notice) -> None:
        """Have it sent; returns at once."""
        self._waiting.pop(notice.target.id, None)
        self._waiting[notice.target.id] = notice
        if len(self._waiting) > self._most_waiting:
            self._waiting.popitem(last=False)
            self._state.dropped += 1
            self._dropped_count.inc()
        self._ready.set()

    async def _run(self) -> None:
        retry_s = self._first_retry_s
        session = self._udp if self._destination.scheme == "udp" else self._tcp
        while True:
            self._sent_since_retry = False
            try:
                await session()
            except (OSError, ValueError) as error:
                self._failed(str(getattr(error, "strerror", None) or error) or type(error).__name__)
            if self._sent_since_retry:
                retry_s = self._first_retry_s
            await asyncio.sleep(retry_s)
            retry_s = min(2.0 * retry_s, LONGEST_RETRY_S)

    async def _udp(self) -> None:
        host, port = self._destination.host, self._destination.port
        found = await asyncio.get_running_loop().getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        family, kind, protocol, _, address = found[0]
        with socket.socket(family, kind, protocol) as sock:
            sock.setblocking(False)
            self._destination.prepare(sock)
            sock.connect(address)
            self._state.problem = None
            self._greet()
            while True:
                await self._something()
                for _ in range(_UDP_BURST):
                    if not self._waiting:
                        break
                    self._send_datagram(sock)
                await asyncio.sleep(_UDP_PAUSE_S)

    def _send_datagram(self, sock: socket.socket) -> None:
        notice = self._take()
        refused = False
        try:
            data = self._event(notice)
            try:
                sock.send(data)
            except ConnectionRefusedError:
                # The ICMP answer to an earlier datagram: nobody listens yet. This one has not been sent.
                refused = True
                sock.send(data)
        except BlockingIOError:
            self._give_back(notice)
            return
        except OSError:
            self._give_back(notice)
            raise
        if refused:
            self._failed(f"nobody listens on UDP port {self._destination.port} of {self._destination.host}")
        else:
            self._state.problem = None
        self._sent()

    async def _tcp(self) -> None:
        host, port = self._destination.host, self._destination.port
        try:
            async with asyncio.timeout(_CONNECT_TIMEOUT_S):
                reader, writer = await asyncio.open_connection(host, port)
        except TimeoutError:
            message = f"no answer within {_CONNECT_TIMEOUT_S:g} s"
            raise OSError(message) from None
        # Or megabytes of events would grow old in the system's buffer before a receiver's silence is noticed.
        writer.get_extra_info("socket").setsockopt(socket.SOL_SOCKET, socket.SO_SNDBUF, _SEND_BUFFER_BYTES)
        # With no room in our own buffer `drain` waits until the system has taken all.
        writer.transport.set_write_buffer_limits(high=0)
        reading = asyncio.create_task(self._discard(reader))
        try:
            self._state.problem = None
            self._greet()
            while not reading.done():
                if self._waiting:
                    await self._write(writer)
                else:
                    await self._something()
            message = "the other side closed the connection"
            raise OSError(message)
        finally:
            reading.cancel()
            writer.transport.abort()
            await asyncio.gather(reading, return_exceptions=True)

    async def _write(self, writer: asyncio.StreamWriter) -> None:
        notice = self._take()
        try:
            writer.write(self._event(notice))
            async with asyncio.timeout(self._send_timeout_s):
                await writer.drain()
        except TimeoutError:
            self._give_back(notice)
            message = f"the other side has not read for {self._send_timeout_s:g} s"
            raise OSError(message) from None
        except OSError:
            self._give_back(notice)
            raise
        self._sent()

    async def _discard(self, reader: asyncio.StreamReader) -> None:
        """Read what a server sends to all, or it would wait for us; ends with the connection."""
        with contextlib.suppress(OSError):
            while await reader.read(_READ_BYTES):
                continue
        self._ready.set()

    def _greet(self) -> None:
        for target in self._current():
            if target.id not in self._waiting:
                self.put(Notice(target))

    async def _something(self) -> None:
        """Wait until there is something to send, or the connection ends."""
        if not self._waiting:
            self._ready.clear()
        await self._ready.wait()

    def _take(self) -> Notice:
        return self._waiting.popitem(last=False)[1]

    def _give_back(self, notice: Notice) -> None:
        if notice.target.id not in self._waiting:
            self._waiting[notice.target.id] = notice
            self._waiting.move_to_end(notice.target.id, last=False)
            self._ready.set()

    def _event(self, notice: Notice) -> bytes:
        return cot_event(notice.target, unix_us(), deleted=notice.deleted)

    def _sent(self) -> None:
        self._state.sent += 1
        self._sent_count.inc()
        self._sent_since_retry = True

    def _failed(self, reason: str) -> None:
        if reason != self._state.problem:
            _log.warning("CoT events do not go out", destination=self._destination.text, error=reason)
        self._state.failures += 1
        self._failure_count.inc()
        self._state.problem = self._state.last_error = reason
