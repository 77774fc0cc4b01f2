"""A video file or a folder of pictures played as if it were live."""

from __future__ import annotations

import math
from pathlib import Path

from backend.video.errors import RecordedVideoError
from backend.video.frames import VideoUnit
from backend.video.recorded import RecordedVideo
from backend.video.source import Clock, Gone, SourceOutput, VideoSource

# A folder of pictures has no clock of its own.
_PICTURES_PER_S = 10.0


class FileSource(VideoSource):
    """Plays at the file's own pace, once or for ever."""

    def __init__(self, path: Path, output: SourceOutput, clock: Clock, *, loop: bool = False) -> None:
        super().__init__(output, clock)
        self._path = path
        self._loop = loop
        self.status = f"waiting for the file {path}"

    def session(self) -> None:
        """See `VideoSource`."""
        try:
            video = RecordedVideo.open(self._path)
        except RecordedVideoError as error:
            raise Gone(f"waiting for the file {self._path}: {error.reason}") from error
        self.status = f"playing {self._path}"
        while not self.stopping.is_set():
            self._play(video)
            if not self._loop:
                self.status = f"{self._path} has been played to its end"
                self.stopping.wait()
                return
            self.output.interrupted()

    def _play(self, video: RecordedVideo) -> None:
        begun_us = self.clock()
        for packet in video.packets():
            pts_s = packet.pts_s if math.isfinite(packet.pts_s) else packet.index / _PICTURES_PER_S
            due_us = begun_us + int(pts_s * 1e6)
            if self.stopping.wait(max(0.0, (due_us - self.clock()) / 1e6)):
                return
            self.deliver(VideoUnit(packet.codec, packet.payload, int(pts_s * 1e6), self.clock()))
