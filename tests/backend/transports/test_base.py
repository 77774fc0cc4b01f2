import asyncio

from backend.transports.base import Reconnecting, TransportError
from tests.backend.transports.inbox import Inbox


class Flaky(Reconnecting):
    """Fails three times, then receives once and ends, then stays."""

    def __init__(self) -> None:
        super().__init__("flaky", first_retry_s=0.0)
        self.sessions = 0
        self.settled = asyncio.Event()
        self.seen: list[str] = []

    async def session(self) -> None:
        self.seen.append(self.status)
        self.sessions += 1
        if self.sessions <= 3:
            message = f"fault {self.sessions}"
            raise OSError(message)
        if self.sessions == 4:
            self._received(b"data")
            return
        self.settled.set()
        await asyncio.Event().wait()


async def test_sessions_follow_each_other_and_say_why() -> None:
    transport, inbox = Flaky(), Inbox()
    await transport.open(inbox)
    async with asyncio.timeout(10.0):
        await transport.settled.wait()
    await transport.close()

    assert inbox.data == b"data"
    assert transport.seen == [
        "flaky: not open",
        "flaky: fault 1; trying again",
        "flaky: fault 2; trying again",
        "flaky: fault 3; trying again",
        "flaky: the other side closed the connection; trying again",
    ]
    assert transport.status == "flaky: closed"


def test_an_error_names_the_connection_and_the_reason() -> None:
    error = TransportError("udpin:x", "no port")

    assert (error.connection, error.reason, str(error)) == ("udpin:x", "no port", "'udpin:x': no port")
