"""Files and folders of pictures as live video: order, pace, repetition, files that are not there or not whole."""

from __future__ import annotations

import itertools
from pathlib import Path

import cv2
import pytest

from backend.clock import mono_us
from backend.video.file_source import FileSource
from backend.video.frames import VideoUnit
from backend.video.recorded import RecordedVideo
from backend.video.writer import TsWriter
from tests.backend.video.coded import encoded_frames
from tests.backend.video.gathered import Gathered
from tests.backend.video.pictures_with_numbers import picture_with_number

COUNT = 12


def film(path: Path) -> Path:
    writer = TsWriter(path)
    for frame in encoded_frames(COUNT, (160, 120)):
        writer.write(frame)
    writer.close()
    return path


def test_a_file_is_delivered_whole_in_order_and_not_before_its_time(tmp_path: Path) -> None:
    path, output = film(tmp_path / "v.ts"), Gathered()
    source = FileSource(path, output, mono_us)
    begun_us = mono_us()
    source.start()
    output.wait_for(lambda: "to its end" in source.status)
    source.close()

    expected = list(RecordedVideo.open(path).packets())
    assert [unit.payload for unit in output.units] == [packet.payload for packet in expected]
    assert [unit.pts_us for unit in output.units] == [40_000 * n for n in range(len(expected))]
    assert all(unit.t_wire_us - begun_us >= (unit.pts_us or 0) for unit in output.units)
    assert output.interruptions == 0  # at its end it waits: nothing has broken off


def test_a_repeated_file_says_that_it_jumps(tmp_path: Path) -> None:
    output = Gathered()
    source = FileSource(film(tmp_path / "v.ts"), output, mono_us, loop=True)
    source.start()
    output.wait_for(lambda: output.interruptions >= 2)
    source.close()

    first, second = _rounds(output)[:2]
    assert [unit.pts_us for unit in first] == [unit.pts_us for unit in second]
    assert [unit.payload for unit in first] == [unit.payload for unit in second]


def _rounds(output: Gathered) -> list[list[VideoUnit]]:
    groups = itertools.groupby(output.all, lambda item: item is None)
    return [[unit for unit in part if isinstance(unit, VideoUnit)] for is_jump, part in groups if not is_jump]


def test_a_file_that_comes_later_is_played_then(tmp_path: Path) -> None:
    path, output = tmp_path / "v.ts", Gathered()
    source = FileSource(path, output, mono_us)
    assert source.status == f"waiting for the file {path}"
    source.start()
    output.wait_for(lambda: output.interruptions >= 1)
    assert "no such file" in source.status
    film(tmp_path / "part").rename(path)
    output.wait_for(lambda: bool(output.units))
    source.close()


@pytest.mark.parametrize("content", [b"", b"this is no video" * 500], ids=["empty", "text"])
def test_a_file_that_is_no_video_is_named(tmp_path: Path, content: bytes) -> None:
    path, output = tmp_path / "v.ts", Gathered()
    path.write_bytes(content)
    source = FileSource(path, output, mono_us)
    source.start()
    output.wait_for(lambda: output.interruptions >= 1)
    source.close()

    assert str(path) in source.status
    assert output.units == []


def test_a_file_that_is_cut_while_it_is_repeated_is_tried_again(tmp_path: Path) -> None:
    """
    Fault: the file is emptied between two rounds, and whole again later.
    Expected: the source says so, and plays on when it can.
    """
    path, output = film(tmp_path / "v.ts"), Gathered()
    whole = path.read_bytes()
    source = FileSource(path, output, mono_us, loop=True)
    source.start()
    output.wait_for(lambda: bool(output.units))
    path.write_bytes(b"")
    output.wait_for(lambda: "playing" not in source.status)
    path.write_bytes(whole)
    before = len(output.units)
    output.wait_for(lambda: len(output.units) > before)
    source.close()


def test_pictures_come_ten_a_second(tmp_path: Path) -> None:
    folder, output = tmp_path / "frames", Gathered()
    folder.mkdir()
    for n in (3, 4, 5):
        cv2.imwrite(str(folder / f"{n:06d}.jpg"), picture_with_number(n, (160, 120)))
    source = FileSource(folder, output, mono_us)
    source.start()
    output.wait_for(lambda: len(output.units) == 3)
    source.close()

    assert [(unit.codec, unit.pts_us) for unit in output.units] == [("jpeg", 100_000 * n) for n in (3, 4, 5)]


def test_closing_does_not_wait_for_the_next_picture(tmp_path: Path) -> None:
    """Its clock stands still, so that the second picture is never due."""
    output = Gathered()
    source = FileSource(film(tmp_path / "v.ts"), output, lambda: 0)
    source.start()
    output.wait_for(lambda: bool(output.units))
    source.close()

    assert not source._thread.is_alive()
