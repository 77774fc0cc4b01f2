"""Computes a flight's estimate in a process of its own: ``python -m backend.playback.compute FLIGHT OUT``.

Prints the part done, one number a line; on failure the last line of standard error says why.
"""

from __future__ import annotations

import os
import sys
from pathlib import Path

from backend.replay.offline import replay_flight
from geodata.errors import GeodataError
from geodata.flight import FlightFolder


def main(arguments: list[str]) -> int:
    """Compute; returns the exit status."""
    flight, out = Path(arguments[0]), Path(arguments[1])
    os.nice(10)

    def progress(done: float) -> None:
        sys.stdout.write(f"{done:.4f}\n")
        sys.stdout.flush()

    try:
        replay_flight(FlightFolder.open(flight), out, progress)
    except (GeodataError, OSError, ValueError) as error:
        sys.stderr.write(f"{error}\n")
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
