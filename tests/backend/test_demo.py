"""The demonstration's parts; the whole of it is driven by the browser tests."""

import asyncio
import socket
import sys
from pathlib import Path

import pytest

from backend import demo
from backend.errors import StartError
from geodata.maps import MapLibrary


def test_free_ports_are_different_and_free() -> None:
    ports = demo.free_udp_ports(3)

    assert len(set(ports)) == 3
    for port in ports:
        with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as found:
            found.bind(("127.0.0.1", port))


def test_a_simulator_that_fails_is_told_in_its_own_words(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    failing = [sys.executable, "-c", "import sys; sys.exit('no such world')"]
    monkeypatch.setattr(demo, "simulator_command", lambda *_, **__: failing)

    with pytest.raises(StartError, match="no such world"):
        demo.prepare_world(tmp_path / "world", 1, MapLibrary(tmp_path / "maps"))


async def test_the_simulator_ends_with_the_station(tmp_path: Path) -> None:
    ending = asyncio.Event()
    simulator = await asyncio.create_subprocess_exec(sys.executable, "-c", "import time; time.sleep(600)")
    beside = asyncio.create_task(demo._run_beside(simulator, ending, tmp_path / "log"))
    ending.set()
    await asyncio.wait_for(beside, 20)

    assert simulator.returncode is not None


async def test_a_simulator_that_dies_is_told(tmp_path: Path) -> None:
    (tmp_path / "log").write_text("Flying\nout of fuel\n")
    simulator = await asyncio.create_subprocess_exec(sys.executable, "-c", "raise SystemExit(3)")

    with pytest.raises(StartError, match=r"status 3.*out of fuel"):
        await asyncio.wait_for(demo._run_beside(simulator, asyncio.Event(), tmp_path / "log"), 20)
