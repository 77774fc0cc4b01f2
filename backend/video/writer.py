"""Recording of live video: an MPEG-TS that plays whatever moment the process died."""

from __future__ import annotations

from fractions import Fraction
from pathlib import Path
from typing import Protocol, Self

import av

from backend.video.frames import EncodedFrame

_TICKS_PER_S = 90_000


class Output(Protocol):
    """Where the bytes go."""

    def write(self, data: bytes, /) -> int | None:
        """Take them."""

    def flush(self) -> None:
        """Hand them on."""

    def close(self) -> None:
        """No more come."""


class TsWriter:
    """Write H.264 frames as MPEG-TS, unchanged, each with the file or other output before `write` returns.

    The n-th frame written is frame n of the file: times follow ``t_us`` and are made to rise by at least a tick.
    """

    def __init__(self, out: Path | Output) -> None:
        self._file: Output = out.open("wb", buffering=0) if isinstance(out, Path) else out
        options = {"flush_packets": "1", "omit_video_pes_length": "0"}
        self._container = av.open(self._file, "w", format="mpegts", options=options)
        self._stream = self._container.add_mux_stream("h264")
        self._stream.time_base = Fraction(1, _TICKS_PER_S)
        self._first_us: int | None = None
        self._last_ticks = -1

    def write(self, frame: EncodedFrame) -> None:
        """Append a frame.

        Raises
        ------
        ValueError
            The frame is not H.264.
        OSError
            The disk does not take it.
        """
        if frame.codec != "h264":
            raise ValueError(f"frame {frame.frame_id} is {frame.codec}: an MPEG-TS recording takes H.264")
        if self._first_us is None:
            self._first_us = frame.t_us
        self._last_ticks = max(self._last_ticks + 1, (frame.t_us - self._first_us) * 9 // 100)
        packet = av.Packet(frame.payload)
        packet.time_base = Fraction(1, _TICKS_PER_S)
        packet.pts = packet.dts = self._last_ticks
        packet.is_keyframe = frame.key
        packet.stream = self._stream
        self._container.mux(packet)

    def flush(self) -> None:
        """Nothing waits here: every frame has left with its `write`."""
        self._file.flush()

    def close(self) -> None:
        """End the file."""
        self._container.close()
        self._file.close()

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
