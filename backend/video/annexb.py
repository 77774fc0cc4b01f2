"""H.264 as a byte stream (ITU-T H.264, annex B): units, parameter sets, what a decoder has to be told. Pure."""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass
from itertools import zip_longest

SLICE_NON_IDR = 1
SLICE_IDR = 5
SEI = 6
SPS = 7
PPS = 8
ACCESS_UNIT_DELIMITER = 9

START_CODE = b"\x00\x00\x00\x01"
_START = re.compile(rb"\x00\x00\x01")

# Profiles whose SPS carries chroma format and bit depths (7.3.2.1.1).
_HIGH_PROFILES = frozenset({100, 110, 122, 244, 44, 83, 86, 118, 128, 138, 139, 134, 135})
_MAX_MACROBLOCKS_A_SIDE = 1024


@dataclass(frozen=True, slots=True)
class SequenceParameters:
    """What a sequence parameter set says: picture size after cropping, and the name WebCodecs wants."""

    width_px: int
    height_px: int
    codec_string: str


def nal_units(annexb: bytes) -> Iterator[bytes]:
    """Units of a byte stream without their start codes, in order; empty ones are skipped."""
    starts = [m.end() for m in _START.finditer(annexb)]
    for begin, following in zip_longest(starts, starts[1:], fillvalue=len(annexb) + 3):
        # A four-byte start code's extra zero, and any trailing zeros, belong to no unit (B.1.1).
        unit = annexb[begin : following - 3].rstrip(b"\x00")
        if unit:
            yield unit


def nal_type(unit: bytes) -> int:
    """Kind of one unit (table 7-1)."""
    return unit[0] & 0x1F


def is_key(annexb: bytes) -> bool:
    """Whether an access unit holds an IDR slice, the only place a fresh decoder may start."""
    return any(nal_type(u) == SLICE_IDR for u in nal_units(annexb))


def has_picture(annexb: bytes) -> bool:
    """Whether an access unit holds a slice at all."""
    return any(SLICE_NON_IDR <= nal_type(u) <= SLICE_IDR for u in nal_units(annexb))


def unescaped(unit: bytes) -> bytes:
    """Unit payload with emulation prevention bytes taken out (7.4.1)."""
    return re.sub(rb"\x00\x00\x03(?=[\x00-\x03]|$)", b"\x00\x00", unit)


def escaped(payload: bytes) -> bytes:
    """Payload with emulation prevention bytes put in; inverse of `unescaped`."""
    out = bytearray()
    zeros = 0
    for byte in payload:
        if zeros == 2 and byte <= 3:
            out.append(3)
            zeros = 0
        out.append(byte)
        zeros = zeros + 1 if byte == 0 else 0
    return bytes(out)


class ParameterSets:
    """The last SPS and PPS of a stream, so that every key frame can carry them."""

    def __init__(self) -> None:
        self._sps: bytes | None = None
        self._pps: dict[bytes, bytes] = {}
        self.sequence: SequenceParameters | None = None

    def complete(self, annexb: bytes) -> bytes:
        """Learn the access unit's parameter sets; a key frame without an SPS comes back with the known ones in front.

        A broken SPS is not learnt.
        """
        units = list(nal_units(annexb))
        seen = {nal_type(u) for u in units}
        for unit in units:
            kind = nal_type(unit)
            if kind == SPS:
                self._learn_sps(unit)
            elif kind == PPS:
                # pps_id is the first Exp-Golomb code; ids below 31 sit in the first byte or two, which tell them apart.
                self._pps[unit[1:3] if len(unit) > 2 and unit[1] < 0x08 else unit[1:2]] = unit
        if SLICE_IDR in seen and SPS not in seen and self._sps is not None:
            known = b"".join(START_CODE + u for u in (self._sps, *self._pps.values()))
            return known + annexb
        return annexb

    def _learn_sps(self, unit: bytes) -> None:
        try:
            parameters = parse_sps(unit)
        except ValueError:
            return
        if self._sps is not None and unit != self._sps:
            self._pps.clear()
        self._sps = unit
        self.sequence = parameters


def parse_sps(unit: bytes) -> SequenceParameters:
    """Size and codec name from an SPS unit.

    Raises
    ------
    ValueError
        The unit ends early or describes an impossible picture.
    """
    data = unescaped(unit)
    if len(data) < 4:
        raise ValueError("sequence parameter set is cut short")
    profile, constraints, level = data[1], data[2], data[3]
    bits = _BitReader(data[4:])
    bits.ue()  # seq_parameter_set_id
    chroma_format = 1
    if profile in _HIGH_PROFILES:
        chroma_format = _skip_high_profile_fields(bits)
    bits.ue()  # log2_max_frame_num_minus4
    _skip_picture_order_count(bits)
    bits.ue()  # max_num_ref_frames
    bits.u(1)
    width_mbs = bits.ue() + 1
    height_map_units = bits.ue() + 1
    frame_mbs_only = bits.u(1)
    if not frame_mbs_only:
        bits.u(1)
    bits.u(1)  # direct_8x8_inference_flag
    crop = [bits.ue() for _ in range(4)] if bits.u(1) else [0, 0, 0, 0]
    if max(width_mbs, height_map_units) > _MAX_MACROBLOCKS_A_SIDE:
        raise ValueError(f"sequence parameter set claims {width_mbs} x {height_map_units} macroblocks")
    crop_x = 2 if chroma_format in (1, 2) else 1
    crop_y = (2 if chroma_format == 1 else 1) * (2 - frame_mbs_only)
    width = 16 * width_mbs - crop_x * (crop[0] + crop[1])
    height = 16 * height_map_units * (2 - frame_mbs_only) - crop_y * (crop[2] + crop[3])
    if width <= 0 or height <= 0:
        raise ValueError(f"sequence parameter set claims a picture of {width} x {height}")
    return SequenceParameters(width, height, f"avc1.{profile:02x}{constraints:02x}{level:02x}")


def _skip_high_profile_fields(bits: _BitReader) -> int:
    """Walk over the fields that only high profiles have; returns chroma_format_idc."""
    chroma_format = bits.ue()
    if chroma_format == 3:
        bits.u(1)
    bits.ue()
    bits.ue()
    bits.u(1)
    if bits.u(1):  # seq_scaling_matrix_present_flag
        for index in range(8 if chroma_format != 3 else 12):
            if bits.u(1):
                _skip_scaling_list(bits, 16 if index < 6 else 64)
    return chroma_format


def _skip_scaling_list(bits: _BitReader, size: int) -> None:
    last, following = 8, 8
    for _ in range(size):
        if following:
            following = (last + bits.se()) % 256
        last = following or last


def _skip_picture_order_count(bits: _BitReader) -> None:
    kind = bits.ue()
    if kind == 0:
        bits.ue()
    elif kind == 1:
        bits.u(1)
        bits.se()
        bits.se()
        cycle = bits.ue()
        if cycle > 255:
            raise ValueError("sequence parameter set has an impossible picture order count cycle")
        for _ in range(cycle):
            bits.se()


class _BitReader:
    """Bits of a raw byte sequence payload, most significant first (clause 9.1)."""

    def __init__(self, data: bytes) -> None:
        self._value = int.from_bytes(data, "big")
        self._left = 8 * len(data)

    def u(self, count: int) -> int:
        if count > self._left:
            raise ValueError("sequence parameter set is cut short")
        self._left -= count
        return (self._value >> self._left) & ((1 << count) - 1)

    def ue(self) -> int:
        zeros = 0
        while self.u(1) == 0:
            zeros += 1
            if zeros > 31:
                raise ValueError("sequence parameter set holds an overlong code")
        return (1 << zeros) - 1 + self.u(zeros)

    def se(self) -> int:
        code = self.ue()
        return (code + 1) // 2 if code % 2 else -(code // 2)
