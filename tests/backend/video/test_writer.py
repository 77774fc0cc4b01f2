from __future__ import annotations

import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from backend.video.recorded import RecordedVideo
from backend.video.writer import TsWriter
from tests.backend.video.coded import encoded_frames
from tests.backend.video.pictures_with_numbers import number_in

KILLED = """
import sys
from pathlib import Path
from backend.video.writer import TsWriter
from tests.backend.video.coded import encoded_frames
writer = TsWriter(Path(sys.argv[1]))
for frame in encoded_frames(30):
    writer.write(frame)
print("written", flush=True)
sys.stdin.read()
"""


def test_the_nth_frame_written_is_frame_n(tmp_path: Path) -> None:
    """Also where exposure times repeat or run back, as after a clock was set."""
    frames = encoded_frames(50)
    frames[10] = replace(frames[10], t_us=frames[9].t_us)
    frames[20] = replace(frames[20], t_us=frames[0].t_us)
    with TsWriter(tmp_path / "video.ts") as writer:
        for frame in frames:
            writer.write(frame)

    shown = list(RecordedVideo.open(tmp_path / "video.ts").frames())

    assert [f.index for f in shown] == list(range(50)) == [number_in(f.image) for f in shown]
    assert shown[49].pts_s == pytest.approx(49 * 0.04, abs=1e-4)


def test_a_killed_process_leaves_every_written_frame(tmp_path: Path) -> None:
    """Fault: SIGKILL with the file open. Expected: it plays, and lacks nothing."""
    path = tmp_path / "video.ts"
    root = Path(__file__).resolve().parents[3]
    with subprocess.Popen(
        [sys.executable, "-c", KILLED, str(path)], cwd=root, stdin=subprocess.PIPE, stdout=subprocess.PIPE
    ) as process:
        assert process.stdout is not None
        assert process.stdout.readline() == b"written\n"
        os.kill(process.pid, signal.SIGKILL)
        process.wait()

    assert [number_in(f.image) for f in RecordedVideo.open(path).frames()] == list(range(30))


def test_pictures_are_refused(tmp_path: Path) -> None:
    with TsWriter(tmp_path / "video.ts") as writer, pytest.raises(ValueError, match="an MPEG-TS recording takes"):
        writer.write(replace(encoded_frames(1)[0], codec="jpeg"))
