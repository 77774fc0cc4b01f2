"""Runs ``pilotage demo`` as a process of its own and ends it by its id."""

from __future__ import annotations

import os
import queue
import re
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path

ROOT = Path(__file__).resolve().parents[2]
OUTPUT = Path(__file__).resolve().parent / "output"

_ADDRESS = re.compile(r"(http://127\.0\.0\.1:\d+)")
_END_S = 20.0


@dataclass(frozen=True, slots=True)
class Deadline:
    """One budget of time for everything that is waited for."""

    end_s: float

    @classmethod
    def after(cls, seconds: float) -> Deadline:
        return cls(time.monotonic() + seconds)

    @property
    def left_s(self) -> float:
        return max(0.1, self.end_s - time.monotonic())

    @property
    def left_ms(self) -> float:
        return 1e3 * self.left_s


@dataclass(slots=True)
class RunningDemo:
    """A demonstration that serves its page."""

    address: str
    process: subprocess.Popen[str]
    said: list[str] = field(default_factory=list)

    @property
    def ended(self) -> bool:
        return self.process.poll() is not None


@contextmanager
def running_demo(data_dir: Path, worlds: Path, seed: int, deadline: Deadline) -> Iterator[RunningDemo]:
    """``pilotage demo`` from its command line on a free port; finished worlds are kept below ``worlds``."""
    command = [sys.executable, "-m", "backend.cli", "demo", "--no-browser", "--port", "0"]
    command += ["--data-dir", str(data_dir), "--seed", str(seed)]
    process = subprocess.Popen(
        command, cwd=ROOT, env={**os.environ, "XDG_CACHE_HOME": str(worlds)}, text=True,
        stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
    )  # fmt: skip
    lines: queue.Queue[str | None] = queue.Queue()
    said: list[str] = []
    reader = threading.Thread(target=_read, args=(process, lines, said), daemon=True)
    reader.start()
    try:
        yield RunningDemo(_address(lines, said, deadline), process, said)
    finally:
        process.send_signal(signal.SIGINT)
        try:
            process.wait(_END_S)
        except subprocess.TimeoutExpired:
            process.kill()
            process.wait()
        reader.join(_END_S)


def _read(process: subprocess.Popen[str], lines: queue.Queue[str | None], said: list[str]) -> None:
    assert process.stdout is not None
    for line in process.stdout:
        said.append(line)
        lines.put(line)
    lines.put(None)


def _address(lines: queue.Queue[str | None], said: list[str], deadline: Deadline) -> str:
    while True:
        try:
            line = lines.get(timeout=deadline.left_s)
        except queue.Empty:
            raise AssertionError(f"the demonstration did not say its address: {''.join(said)}") from None
        if line is None:
            raise AssertionError(f"the demonstration ended at its start: {''.join(said)}")
        if found := _ADDRESS.search(line):
            return found[1]
