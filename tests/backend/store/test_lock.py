"""One station for one data folder, also after a kill."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from backend.errors import StartError
from backend.store.lock import DataDirLock

HOLD = "import sys; from pathlib import Path; from backend.store.lock import DataDirLock; "
HOLD += "DataDirLock(Path(sys.argv[1])).acquire(); print('held', flush=True); sys.stdin.read()"


def test_a_folder_held_by_a_process_is_refused_with_its_number_and_free_after_a_kill(tmp_path: Path) -> None:
    """Fault: the holder dies without releasing anything. Expected: the next one may have the folder at once."""
    with subprocess.Popen(
        [sys.executable, "-c", HOLD, str(tmp_path)], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True
    ) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        with pytest.raises(StartError, match=f"process {holder.pid}"):
            DataDirLock(tmp_path).acquire()
        holder.send_signal(signal.SIGKILL)
        holder.wait(20)
    lock = DataDirLock(tmp_path)
    lock.acquire()
    lock.release()
    lock.release()


def test_a_folder_that_cannot_be_made_is_named(tmp_path: Path) -> None:
    (tmp_path / "file").write_text("")
    with pytest.raises(StartError, match="file"):
        DataDirLock(tmp_path / "file" / "data").acquire()


def test_the_holder_says_who_it_is(tmp_path: Path) -> None:
    lock = DataDirLock(tmp_path / "new" / "folder")
    lock.acquire()

    assert (tmp_path / "new" / "folder" / "station.lock").read_text() == str(os.getpid())
    lock.release()
