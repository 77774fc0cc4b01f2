"""Units become frames: number, epoch, exposure, and nothing that a decoder could not use. Pure."""

from __future__ import annotations

from backend.video.annexb import ParameterSets, has_picture, is_key
from backend.video.frames import EncodedFrame, VideoUnit
from backend.video.jpeg import jpeg_size_px
from backend.video.misp import read_sei
from backend.video.timing import ExposureClock

# Three seconds at 25 frames/s: encoders for low delay may refresh the picture in stripes and never send a key frame.
_PICTURES_WITHOUT_KEY = 75


class FrameMaker:
    """Frames of one source. One thread.

    After a loss, and at the beginning, pictures are left out up to the next key frame, because they would be built on
    what is not there. ``left_out`` counts them.
    """

    def __init__(self, clock: ExposureClock) -> None:
        self._clock = clock
        self._sets = ParameterSets()
        self._size: tuple[int, int] | None = None
        self._next_id = 0
        self._need_key = True
        self._keyless = 0
        self._key_seen = False
        self.epoch = 1
        self.left_out = 0

    @property
    def waits_for_key(self) -> bool:
        """Whether the next frame has to be a key frame."""
        return self._need_key

    @property
    def never_keyed(self) -> bool:
        """Whether this is a stream that has no key frames at all, and so cannot be passed on."""
        return not self._key_seen and self._keyless >= _PICTURES_WITHOUT_KEY

    def restart(self) -> None:
        """A new epoch: the source has reconnected or jumped."""
        if self._size is not None:
            self.epoch += 1
        self._size = None
        self._need_key = True
        self._keyless = 0
        self._key_seen = False
        self._sets = ParameterSets()
        self._clock.restart()

    def frame(self, unit: VideoUnit) -> EncodedFrame | None:
        """The frame of an H.264 or JPEG unit; None where it has to be left out."""
        if unit.codec == "jpeg":
            return self._jpeg_frame(unit)
        payload = self._sets.complete(unit.payload)
        if not has_picture(payload):
            return None
        key = is_key(payload)
        self._need_key = self._need_key or unit.after_loss
        if (self._need_key and not key) or self._sets.sequence is None:
            self.left_out += 1
            self._keyless += 1
            return None
        self._key_seen = self._key_seen or key
        self._need_key = False
        sequence = self._sets.sequence
        t_us = self.exposure_us(unit)
        return self._made(
            unit, payload, "h264", sequence.codec_string, key, (sequence.width_px, sequence.height_px), t_us
        )

    def transcoded(self, jpeg: bytes, size_px: tuple[int, int], t_us: int, unit: VideoUnit) -> EncodedFrame:
        """The frame of a picture that was decoded here and coded as JPEG; ``t_us`` from `exposure_us`."""
        return self._made(unit, jpeg, "jpeg", "jpeg", True, size_px, t_us)

    def exposure_us(self, unit: VideoUnit) -> int:
        """When a unit's picture was taken. Once for each unit, in the order of arrival."""
        stamp_us = read_sei(unit.payload) if unit.codec == "h264" else None
        return self._clock.exposure_us(stamp_us, unit.pts_us, unit.t_wire_us)

    def _jpeg_frame(self, unit: VideoUnit) -> EncodedFrame | None:
        try:
            size_px = jpeg_size_px(unit.payload)
        except ValueError:
            self.left_out += 1
            return None
        return self._made(unit, unit.payload, "jpeg", "jpeg", True, size_px, self.exposure_us(unit))

    def _made(
        self,
        unit: VideoUnit,
        payload: bytes,
        codec: str,
        codec_string: str,
        key: bool,
        size_px: tuple[int, int],
        t_us: int,
    ) -> EncodedFrame:
        if self._size is not None and size_px != self._size:
            self.epoch += 1
        self._size = size_px
        frame_id = self._next_id
        self._next_id += 1
        return EncodedFrame(
            frame_id, self.epoch, t_us, unit.t_wire_us, codec, codec_string, key, size_px[0], size_px[1], payload,
            self._clock.stamped,
        )  # fmt: skip
