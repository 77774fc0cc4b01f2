"""Who watches a video: each viewer has a short queue; a slow one loses whole groups of pictures, never a part."""

from __future__ import annotations

import asyncio
from collections import deque

from backend.video.frames import EncodedFrame

MAX_WAITING_FRAMES = 30
MAX_WAITING_BYTES = 4_000_000


class Viewer:
    """One viewer's queue. What it hands out always begins with a key frame and has no hole within a group."""

    def __init__(self) -> None:
        self._frames: deque[EncodedFrame] = deque()
        self._bytes = 0
        self._need_key = True
        self._ready = asyncio.Event()
        self.dropped = 0
        self.closed = False

    def put(self, frame: EncodedFrame) -> None:
        """Queue a frame; when too much waits, everything is dropped up to the next key frame."""
        if self._need_key and not frame.key:
            self.dropped += 1
            return
        if len(self._frames) >= MAX_WAITING_FRAMES or self._bytes + len(frame.payload) > MAX_WAITING_BYTES:
            self.dropped += len(self._frames)
            self._frames.clear()
            self._bytes = 0
            if not frame.key:
                self._need_key = True
                self.dropped += 1
                self._ready.clear()
                return
        self._need_key = False
        self._frames.append(frame)
        self._bytes += len(frame.payload)
        self._ready.set()

    def restart(self) -> None:
        """Drop what waits and begin again at a key frame: the video has jumped."""
        self._frames.clear()
        self._bytes = 0
        self._need_key = True
        self._ready.clear()

    def close(self) -> None:
        """End `take`: the source is gone."""
        self.closed = True
        self._ready.set()

    async def take(self) -> EncodedFrame | None:
        """The next frame; None at the end."""
        while not self._frames:
            if self.closed:
                return None
            self._ready.clear()
            await self._ready.wait()
        frame = self._frames.popleft()
        self._bytes -= len(frame.payload)
        return frame


class Audience:
    """The viewers of one source, and what a newcomer is shown first."""

    def __init__(self) -> None:
        self._viewers: set[Viewer] = set()
        self._group: list[EncodedFrame] = []
        self._group_bytes = 0

    @property
    def size(self) -> int:
        """How many watch."""
        return len(self._viewers)

    def show(self, frame: EncodedFrame) -> None:
        """Hand a frame to everybody."""
        if frame.key:
            self._group.clear()
            self._group_bytes = 0
        if frame.key or self._group:
            self._group.append(frame)
            self._group_bytes += len(frame.payload)
            if len(self._group) > 10 * MAX_WAITING_FRAMES or self._group_bytes > 4 * MAX_WAITING_BYTES:
                self._group.clear()  # key frames are too rare to keep a whole group
        for viewer in self._viewers:
            viewer.put(frame)

    def join(self) -> Viewer:
        """A new viewer, who sees a picture at once: the group of the present picture comes first if it is short."""
        viewer = Viewer()
        if len(self._group) < MAX_WAITING_FRAMES:
            for frame in self._group:
                viewer.put(frame)
        self._viewers.add(viewer)
        return viewer

    def leave(self, viewer: Viewer) -> None:
        """Stop showing."""
        self._viewers.discard(viewer)

    def restart(self) -> None:
        """The video has jumped: everybody begins at the next key frame."""
        self._group.clear()
        self._group_bytes = 0
        for viewer in self._viewers:
            viewer.restart()

    def close(self) -> None:
        """The source is gone."""
        for viewer in self._viewers:
            viewer.close()
