"""Events over real sockets of the loopback: told, told again, taken back, and trouble that stays with its receiver."""

from __future__ import annotations

import asyncio
import contextlib
import socket
from collections.abc import AsyncIterator
from datetime import datetime

import pytest

from backend.errors import StartError
from backend.exports.destination import Destination
from backend.exports.peer import CotPeer, Notice
from backend.exports.sender import REPEAT_S, CotSender
from backend.metrics import Metrics
from backend.store.targets import Target
from tests.backend.exports.receivers import HOST, free_port, tcp_receiver, udp_receiver, until
from tests.backend.exports.samples import target

GROUP = "239.2.3.1"


@contextlib.asynccontextmanager
async def sending(
    *destinations: str, kept: list[Target] | None = None, repeat_s: float = 600
) -> AsyncIterator[CotSender]:
    targets = kept if kept is not None else []
    sender = CotSender(destinations, lambda: targets, Metrics(), repeat_s=repeat_s)
    sender.start()
    try:
        yield sender
    finally:
        await sender.close()


@contextlib.asynccontextmanager
async def one_peer(destination: str, kept: list[Target], **options: float) -> AsyncIterator[CotPeer]:
    options = {"first_retry_s": 0.01, **options}
    peer = CotPeer(Destination.parse(destination), lambda: kept, Metrics(), **options)  # type: ignore[arg-type]
    peer.start()
    try:
        yield peer
    finally:
        await peer.close()


async def test_kept_new_changed_and_deleted_over_udp() -> None:
    async with udp_receiver() as receiver, sending(f"udp://{HOST}:{receiver.port}", kept=[target()]) as sender:
        kept = await receiver.event_of("Bridge")
        sender.changed(target(name="Quay"))
        changed = await receiver.event_of("Quay")
        sender.deleted(target(name="Quay"))
        deleted = await receiver.event()
        await until(lambda: sender.states()[0].sent == 3)

        assert kept.get("uid") == changed.get("uid") == deleted.get("uid")
        moments = [datetime.fromisoformat(changed.get(name)) for name in ("start", "stale")]
        assert (moments[1] - moments[0]).total_seconds() == 300
        assert deleted.get("stale") == deleted.get("time")
        assert receiver.is_silent
        assert sender.states()[0].last_error is None
        assert sender.waiting_for() == []


async def test_a_group_hears_on_the_chosen_interface() -> None:
    async with (
        udp_receiver(group=GROUP) as receiver,
        sending(f"udp://{GROUP}:{receiver.port}?interface=127.0.0.1", kept=[target()]),
    ):
        assert (await receiver.event()).get("type") == "a-u-G"


async def test_targets_are_repeated_before_they_are_stale() -> None:
    assert 2 * REPEAT_S < 300
    async with (
        udp_receiver() as receiver,
        sending(f"udp://{HOST}:{receiver.port}", kept=[target()], repeat_s=0.01),
    ):
        times = [(await receiver.event()).get("time") for _ in range(5)]

    assert times == sorted(times)
    assert times[0] < times[-1]


async def test_udp_to_a_listener_that_comes_later() -> None:
    """The refusal comes back as an error of a later datagram, which is sent all the same."""
    port = free_port(socket.SOCK_DGRAM)
    async with sending(f"udp://{HOST}:{port}", kept=[target()], repeat_s=0.02) as sender:
        await until(lambda: sender.states()[0].failures > 0)
        assert sender.waiting_for() == [f"CoT to udp://{HOST}:{port}: nobody listens on UDP port {port} of {HOST}"]
        async with udp_receiver(port) as receiver:
            await receiver.event_of("Bridge")
            await until(lambda: sender.states()[0].problem is None)

        assert "nobody listens" in (sender.states()[0].last_error or "")


async def test_tcp_events_one_after_the_other() -> None:
    async with tcp_receiver() as receiver, sending(f"tcp://{HOST}:{receiver.port}", kept=[target()]) as sender:
        first = await receiver.event()
        sender.changed(target(id="2", name="</event>"))
        sender.changed(target(id="3", name="Брод & \n"))
        names = [(await receiver.event()).find("detail/contact").get("callsign") for _ in range(2)]

        assert first.find("detail/contact").get("callsign") == "Bridge"
        assert names == ["</event>", "Брод &"]


async def test_tcp_connects_again_and_tells_all_anew() -> None:
    kept = [target(), target(id="2", name="Quay")]
    async with tcp_receiver() as receiver, one_peer(f"tcp://{HOST}:{receiver.port}", kept) as peer:
        assert {(await receiver.event()).get("uid")[-2:] for _ in range(2)} == {"11", ".2"}
        receiver.hang_up()
        assert {(await receiver.event()).get("uid")[-2:] for _ in range(2)} == {"11", ".2"}

        assert receiver.connections == 2
        assert peer.state.failures >= 1
        assert peer.state.last_error is not None
        assert peer.state.problem is None


async def test_tcp_waits_for_a_receiver_that_comes_later_and_deletes_then() -> None:
    port = free_port(socket.SOCK_STREAM)
    kept: list[Target] = []
    async with one_peer(f"tcp://{HOST}:{port}", kept) as peer:
        await until(lambda: peer.state.failures >= 2)
        assert peer.state.problem
        peer.put(Notice(target(), deleted=True))
        async with tcp_receiver(port) as receiver:
            event = await receiver.event()

    assert event.get("stale") == event.get("time")


async def test_a_queue_is_bounded_drops_the_oldest_and_keeps_only_the_newest_of_a_target() -> None:
    port = free_port(socket.SOCK_STREAM)
    async with one_peer(f"tcp://{HOST}:{port}", [], most_waiting=3) as peer:
        for number in range(5):
            peer.put(Notice(target(id=str(number))))
        peer.put(Notice(target(id="4", name="Newest")))
        assert peer.state.dropped == 2
        async with tcp_receiver(port) as receiver:
            events = [await receiver.event() for _ in range(3)]

    assert [event.get("uid") for event in events] == ["pilotage.2", "pilotage.3", "pilotage.4"]
    assert events[-1].find("detail/contact").get("callsign") == "Newest"


async def test_a_receiver_that_does_not_read_holds_up_nobody() -> None:
    """It is cut off, and the other one hears all the while."""
    kept = [target(id=str(number), name="x" * 200) for number in range(3000)]
    async with (
        tcp_receiver(deaf=True) as deaf,
        udp_receiver() as receiver,
        one_peer(f"tcp://{HOST}:{deaf.port}", kept, send_timeout_s=0.2) as stuck,
        sending(f"udp://{HOST}:{receiver.port}") as sender,
    ):
        for number in range(20):
            sender.changed(target(name=f"T{number}"))
            await receiver.event_of(f"T{number}")
        await until(lambda: "has not read" in (stuck.state.last_error or ""))
        await until(lambda: deaf.connections > 1)

        assert stuck.state.dropped == 0
        assert sender.states()[0].failures == 0


async def test_a_host_without_an_address_is_said_and_tried_again() -> None:
    async with one_peer("tcp://no-such-host.invalid:8087", []) as peer:
        await until(lambda: peer.state.failures >= 2)
        assert peer.state.problem


async def test_ending_while_nothing_can_be_sent() -> None:
    async with sending(f"tcp://{HOST}:{free_port(socket.SOCK_STREAM)}", kept=[target()]) as sender:
        await asyncio.sleep(0)
        async with asyncio.timeout(5):
            await sender.close()


async def test_an_interface_that_is_not_there_is_told_at_the_start() -> None:
    sender = CotSender([f"udp://{GROUP}:6969?interface=wlan99"], list, Metrics())

    with pytest.raises(StartError, match=r"--cot udp://.*no interface 'wlan99'"):
        sender.start()


async def test_without_a_destination_nothing_runs() -> None:
    before = asyncio.all_tasks()
    async with sending(kept=[target()]) as sender:
        sender.changed(target())
        assert asyncio.all_tasks() == before
        assert sender.states() == []
