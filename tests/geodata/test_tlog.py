from __future__ import annotations

import struct
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from pymavlink import mavutil
from pymavlink.dialects.v20 import ardupilotmega as dialect

from geodata.tlog import TlogWriter, iter_tlog, tlog_span
from tests.shared_data import shared_data

T0_US = 1_795_354_990_000_000


def packets(count: int) -> list[tuple[int, bytes]]:
    """Real packets of both protocol versions, some signed."""
    made: list[tuple[int, bytes]] = []
    for i in range(count):
        mav = dialect.MAVLink(None, srcSystem=1, srcComponent=1)
        mav.seq = i % 256
        if i % 5 == 4:
            mav.signing.secret_key, mav.signing.sign_outgoing, mav.signing.link_id = bytes(range(32)), True, 3
            mav.signing.timestamp = 1000 + i
        message = dialect.MAVLink_attitude_message(i * 10, 0.1, -0.2, 0.01 * i, 0.0, 0.0, 0.0)
        made.append((T0_US + 20_000 * i, message.pack(mav, force_mavlink1=i % 3 == 2)))
    return made


def record(item: tuple[int, bytes]) -> bytes:
    return struct.pack(">Q", item[0]) + item[1]


def test_written_log_reads_back(tmp_path: Path) -> None:
    path, items = tmp_path / "a.tlog", packets(500)
    with TlogWriter(path) as writer:
        for item in items[:300]:
            writer.write(*item)
    with TlogWriter(path) as writer:
        for item in items[300:]:
            writer.write(*item)

    assert list(iter_tlog(path)) == items
    assert tlog_span(path) == (items[0][0], items[-1][0])


def test_packet_is_with_the_system_when_write_returns(tmp_path: Path) -> None:
    """Another reader sees it at once, while the writer is open: nothing waits in this process's memory."""
    path, items = tmp_path / "a.tlog", packets(3)
    writer = TlogWriter(path)
    for count, item in enumerate(items, start=1):
        writer.write(*item)
        assert list(iter_tlog(path)) == items[:count]
    writer.close()
    writer.close()


def test_log_agrees_with_pymavlink(tmp_path: Path) -> None:
    """An outside reader finds the same packets and times in what we write."""
    path, items = tmp_path / "a.tlog", packets(40)
    with TlogWriter(path) as writer:
        for item in items:
            writer.write(*item)
    log = mavutil.mavlink_connection(str(path), dialect="ardupilotmega")
    read = []
    while (message := log.recv_msg()) is not None:
        read.append((round(message._timestamp * 1e6), bytes(message.get_msgbuf())))
    assert read == items


@pytest.mark.parametrize("name", ["heli_loop", "plane_mission", "signed_link", "dronekit_flight", "px4_sih_loop"])
def test_real_logs_are_read_whole(name: str) -> None:
    """Every byte of the logs is a record, but for a few of bad data in the oldest."""
    path = shared_data(f"telemetry/{name}.tlog")
    used = sum(8 + len(packet) for _, packet in iter_tlog(path))
    assert path.stat().st_size - used <= (19 if name == "dronekit_flight" else 0)


@settings(max_examples=60, deadline=None)
@given(seed=st.integers(0, 2**32), noise_bytes=st.integers(1, 900), place=st.integers(0, 60))
def test_noise_costs_at_most_the_noise(
    tmp_path_factory: pytest.TempPathFactory, seed: int, noise_bytes: int, place: int
) -> None:
    """Random bytes between two records: all records are still there, in order."""
    items = packets(60)
    # No start marks: noise that is itself a plausible record is told by its checksum, which is the link's business.
    noise = bytes(byte for byte in np.random.default_rng(seed).bytes(noise_bytes) if byte not in (0xFD, 0xFE))
    path = tmp_path_factory.mktemp("noise") / "a.tlog"
    path.write_bytes(b"".join(map(record, items[:place])) + noise + b"".join(map(record, items[place:])))

    assert list(iter_tlog(path)) == items


def test_stray_start_marks_lose_no_packet(tmp_path: Path) -> None:
    items = packets(60)
    noise = b"\xfd\xfe\x00\xfd\xff\x00\x00\xfe\x10" * 9
    path = tmp_path / "a.tlog"
    path.write_bytes(b"".join(map(record, items[:30])) + noise + b"".join(map(record, items[30:])))
    assert set(items) <= set(iter_tlog(path))


def test_every_truncation_keeps_the_whole_records_before_it(tmp_path: Path) -> None:
    items = packets(6)
    whole = b"".join(map(record, items))
    ends = np.cumsum([len(record(item)) for item in items])
    path = tmp_path / "a.tlog"
    for length in range(len(whole) + 1):
        path.write_bytes(whole[:length])
        assert list(iter_tlog(path)) == items[: int(np.sum(ends <= length))]


def test_appending_after_a_cut_record_loses_only_that(tmp_path: Path) -> None:
    """A recorder was killed in the middle of a record and went on later."""
    items = packets(20)
    path = tmp_path / "a.tlog"
    path.write_bytes(b"".join(map(record, items[:10]))[:-7])
    with TlogWriter(path) as writer:
        for item in items[10:]:
            writer.write(*item)

    read = list(iter_tlog(path))

    assert read[:9] == items[:9]
    assert read[-9:] == items[-9:]


def test_time_running_backwards_is_passed_on(tmp_path: Path) -> None:
    """The link decides what a jump of the clock means; the reader must not lose packets over it."""
    items = packets(30)
    shuffled = items[15:] + [(t_us - 3_600_000_000, packet) for t_us, packet in items[:15]]
    path = tmp_path / "a.tlog"
    path.write_bytes(b"".join(map(record, shuffled)))
    assert list(iter_tlog(path)) == shuffled


@pytest.mark.parametrize("content", [b"", b"\x00" * 5000, bytes(range(256)) * 50, b"\xfd" * 3000])
def test_what_is_no_log_holds_no_packet(tmp_path: Path, content: bytes) -> None:
    path = tmp_path / "a.tlog"
    path.write_bytes(content)
    assert tlog_span(path) is None


def test_reading_needs_little_memory_ahead(tmp_path: Path) -> None:
    """The iterator yields the first record of a large log without reading it to its end."""
    path = tmp_path / "a.tlog"
    items = packets(1)
    path.write_bytes(record(items[0]) + b"\x00" * 30_000_000)
    stream: Iterator[tuple[int, bytes]] = iter_tlog(path)
    assert next(stream) == items[0]
