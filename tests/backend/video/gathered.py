"""Takes what a source delivers, and waits for it without sleeping."""

from __future__ import annotations

import threading
from collections.abc import Callable

from backend.video.frames import VideoUnit
from estimator.types import Image

WAIT_S = 20.0


class Gathered:
    """What came, in order: units, pictures, and None for an interruption."""

    def __init__(self) -> None:
        self.all: list[VideoUnit | Image | None] = []
        self._changed = threading.Condition()

    def unit(self, unit: VideoUnit) -> None:
        self._note(unit)

    def picture(self, image: Image, pts_us: int | None, t_wire_us: int) -> None:
        self._note(image)

    def interrupted(self) -> None:
        self._note(None)

    @property
    def units(self) -> list[VideoUnit]:
        return [item for item in self.all if isinstance(item, VideoUnit)]

    @property
    def interruptions(self) -> int:
        return sum(item is None for item in self.all)

    def wait_for(self, done: Callable[[], bool]) -> None:
        """Until it holds; looked at with each delivery, and now and then."""
        with self._changed:
            for _ in range(int(WAIT_S / 0.02)):
                if done():
                    return
                self._changed.wait(0.02)
        raise AssertionError(f"not in {WAIT_S} s; {len(self.units)} units, {self.interruptions} interruptions")

    def _note(self, item: VideoUnit | Image | None) -> None:
        with self._changed:
            self.all.append(item)
            self._changed.notify_all()
