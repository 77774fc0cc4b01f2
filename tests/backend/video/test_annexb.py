from __future__ import annotations

import av
import pytest
from hypothesis import given
from hypothesis import strategies as st

from backend.video.annexb import (
    PPS,
    SPS,
    START_CODE,
    ParameterSets,
    escaped,
    has_picture,
    is_key,
    nal_type,
    nal_units,
    parse_sps,
    unescaped,
)
from tests.backend.video.pictures_with_numbers import picture_with_number


def encoded(count: int, size: tuple[int, int], options: dict[str, str]) -> list[bytes]:
    encoder = av.CodecContext.create("libx264", "w")
    encoder.width, encoder.height = size
    encoder.pix_fmt = "yuv420p"
    encoder.framerate = 25
    encoder.options = {"preset": "ultrafast", "tune": "zerolatency", **options}
    packets = []
    for n in range(count):
        picture = av.VideoFrame.from_ndarray(picture_with_number(n, size), format="gray").reformat(format="yuv420p")
        packets += encoder.encode(picture)
    return [bytes(p) for p in [*packets, *encoder.encode(None)]]


@pytest.mark.parametrize("size", [(640, 480), (322, 242), (1920, 1080)])
@pytest.mark.parametrize("profile", ["baseline", "main", "high"])
def test_sps_states_size_and_profile(size: tuple[int, int], profile: str) -> None:
    """Size after cropping and the profile agree with what the encoder was asked for."""
    (unit,) = encoded(1, size, {"preset": "fast", "profile": profile})
    sps = next(u for u in nal_units(unit) if nal_type(u) == SPS)

    parsed = parse_sps(sps)

    assert (parsed.width_px, parsed.height_px) == size
    assert parsed.codec_string.startswith({"baseline": "avc1.42", "main": "avc1.4d", "high": "avc1.64"}[profile])
    assert parsed.codec_string == f"avc1.{sps[1:4].hex()}"


def test_only_idr_pictures_are_keys() -> None:
    units = encoded(8, (320, 240), {"g": "4", "x264-params": "scenecut=0"})

    assert [is_key(u) for u in units] == [True, False, False, False] * 2
    assert all(has_picture(u) for u in units)


def test_parameter_sets_are_put_before_bare_key_frames() -> None:
    """Fault: an encoder sends SPS and PPS once. Expected: later key frames carry them, others stay as they are."""
    units = encoded(6, (320, 240), {"g": "3", "x264-params": "scenecut=0"})
    bare = b"".join(START_CODE + u for u in nal_units(units[3]) if nal_type(u) not in (SPS, PPS))
    sets = ParameterSets()

    first = sets.complete(units[0])
    completed = sets.complete(bare)

    assert first == units[0]
    assert sets.complete(units[1]) == units[1]
    assert [nal_type(u) for u in nal_units(completed)][:2] == [SPS, PPS]
    assert completed.endswith(bare)
    assert sets.sequence is not None
    assert (sets.sequence.width_px, sets.sequence.height_px) == (320, 240)


@given(st.binary(max_size=400))
def test_random_bytes_never_break_parsing(data: bytes) -> None:
    """Whatever arrives, units come out whole and a broken SPS is refused in one way only."""
    for unit in nal_units(START_CODE + data):
        assert unit
    sets = ParameterSets()
    sets.complete(START_CODE + bytes([0x67]) + data)
    try:
        parsed = parse_sps(bytes([0x67]) + data)
    except ValueError:
        return
    assert 0 < parsed.width_px <= 16384
    assert 0 < parsed.height_px <= 32768


@given(st.lists(st.sampled_from([0, 0, 0, 1, 2, 3, 4, 255]), max_size=200).map(bytes))
def test_escaping_hides_start_codes_and_comes_back(payload: bytes) -> None:
    hidden = escaped(payload)

    assert b"\x00\x00\x00" not in hidden
    assert b"\x00\x00\x01" not in hidden
    assert unescaped(hidden) == payload


def test_units_are_found_behind_either_start_code() -> None:
    stream = b"\x00\x00\x00\x01\x67abc\x00\x00\x01\x68de\x00\x00\x00\x01\x65fgh\x00\x00"

    assert list(nal_units(stream)) == [b"\x67abc", b"\x68de", b"\x65fgh"]
