import asyncio
import socket
from collections.abc import AsyncIterator

import pytest

from backend.transports.base import TransportError
from backend.transports.tcp import TcpClientTransport, TcpServerTransport
from tests.backend.transports.inbox import Inbox, turns

HOST = "127.0.0.1"


@pytest.fixture
async def listener() -> AsyncIterator[tuple[TcpServerTransport, Inbox]]:
    inbox, transport = Inbox(), TcpServerTransport(HOST, 0)
    await transport.open(inbox)
    yield transport, inbox
    await transport.close()


async def _connected(port: int) -> tuple[TcpClientTransport, Inbox]:
    inbox, client = Inbox(), TcpClientTransport(HOST, port, first_retry_s=0.01)
    await client.open(inbox)
    await turns(lambda: "connected" in client.status)
    return client, inbox


async def test_bytes_both_ways(listener: tuple[TcpServerTransport, Inbox]) -> None:
    server, heard = listener
    assert server.status.endswith("waiting for a connection")
    client, answers = await _connected(server.local_port)
    client.write(b"telemetry")
    await heard.until(b"telemetry")
    server.write(b"command")
    await answers.until(b"command")

    assert "connected with 127.0.0.1" in server.status
    assert client.status.endswith("receiving")
    await client.close()
    await turns(lambda: server.status.endswith("waiting for a connection"))


async def test_a_client_waits_for_its_server_and_connects_again() -> None:
    with socket.socket() as probe:
        probe.bind((HOST, 0))
        port = probe.getsockname()[1]
    client, heard = TcpClientTransport(HOST, port, first_retry_s=0.01), Inbox()
    await client.open(heard)
    async with asyncio.timeout(10.0):
        while "trying again" not in client.status:
            await asyncio.sleep(0)
    assert "Connect call failed" in client.status

    for word in (b"first", b"second"):
        server, inbox = TcpServerTransport(HOST, port), Inbox()
        await server.open(inbox)
        async with asyncio.timeout(10.0):
            while "connected" not in client.status:
                await asyncio.sleep(0.005)
        client.write(word)
        await inbox.until(word)
        server.write(word)
        await heard.until(word)
        await server.close()
    await client.close()


async def test_the_newest_connection_is_the_vehicle(listener: tuple[TcpServerTransport, Inbox]) -> None:
    server, heard = listener
    old, _ = await _connected(server.local_port)
    old.write(b"old")
    await heard.until(b"old")
    await old.close()
    new, answers = await _connected(server.local_port)
    new.write(b"new")
    await heard.until(b"new")
    server.write(b"to the new one")
    await answers.until(b"to the new one")
    await new.close()


async def test_a_second_connection_takes_over_from_one_that_is_dead(
    listener: tuple[TcpServerTransport, Inbox],
) -> None:
    server, heard = listener
    dead_reader, dead_writer = await asyncio.open_connection(HOST, server.local_port)
    dead_writer.write(b"then silence")
    await heard.until(b"then silence")
    client, _ = await _connected(server.local_port)
    client.write(b"here again")
    await heard.until(b"here again")

    # The old one was closed, not left hanging.
    with pytest.raises((ConnectionResetError, asyncio.IncompleteReadError)):
        await dead_reader.readexactly(1)
    dead_writer.close()
    await client.close()


async def test_a_taken_port_is_a_clear_error(listener: tuple[TcpServerTransport, Inbox]) -> None:
    server, _ = listener
    with pytest.raises(TransportError, match=f"cannot listen on TCP port {server.local_port} "):
        await TcpServerTransport(HOST, server.local_port).open(Inbox())


async def test_a_peer_that_does_not_read_cannot_fill_the_memory(listener: tuple[TcpServerTransport, Inbox]) -> None:
    server, heard = listener
    _, writer = await asyncio.open_connection(HOST, server.local_port)
    writer.transport.pause_reading()
    writer.write(b"hello")
    await heard.until(b"hello")
    for _ in range(2_000):
        server.write(bytes(10_000))
        await asyncio.sleep(0)
    connection = server._writer
    assert connection is not None
    assert connection.transport.get_write_buffer_size() < 100_000
    writer.transport.abort()


async def test_closing_while_it_cannot_connect() -> None:
    client = TcpClientTransport(HOST, 1, first_retry_s=60.0)
    await client.open(Inbox())
    client.write(b"x")
    await client.close()
    await client.close()
    assert client.status.endswith("closed")
