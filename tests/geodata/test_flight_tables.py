from __future__ import annotations

import itertools
import math
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from geodata.errors import FlightFolderError
from geodata.flight_tables import (
    CLICK_COLUMNS,
    FRAME_COLUMNS,
    FrameTimes,
    _longest_rise,
    parse_click,
    parse_frames,
    parse_rows,
    parse_truth,
    read_table,
)
from tests.shared_data import shared_data

T_US = 1_795_354_995_921_418


def frames(path: Path, content: bytes, warnings: list[str] | None = None) -> FrameTimes:
    path.write_bytes(content)
    return parse_frames(read_table(path, FRAME_COLUMNS), (warnings if warnings is not None else []).append)


@pytest.mark.parametrize(
    "content",
    [
        b"frame,time_us\n0,1000\n2,3000\n",
        b"\xef\xbb\xbfframe,time_us\r\n0,1000\r\n\r\n2,3000\r\n",
        b"# from a logger\nTime_us , Frame, exposure_ms\n1000,0,5\n3000 , 2,4\n",
        b"frame;time_us\n0;1000\n2;3000",
        b'"frame","time_us"\n"0","1000.0"\n2,3000,,\n',
        b"frame\ttime_us\n0\t1000\n2\t3000\n",
    ],
)
def test_all_the_ways_to_write_a_table(tmp_path: Path, content: bytes) -> None:
    times = frames(tmp_path / "frames.csv", content)
    assert times.frame.tolist() == [0, 2]
    assert times.t_video_us.tolist() == [1000, 3000]
    assert times.of_frame(2) == 3000
    assert times.of_frame(1) is None
    assert times.of_frame(99) is None


def test_microseconds_keep_all_their_digits(tmp_path: Path) -> None:
    times = frames(tmp_path / "frames.csv", f"frame,time_us\n0,{T_US}\n1,{T_US + 1}\n".encode())
    assert times.t_video_us.tolist() == [T_US, T_US + 1]


@pytest.mark.parametrize(
    ("content", "words"),
    [
        (b"", "is empty"),
        (b"frame,t\n0,1\n", "has no column time_us"),
        (b"frame,time_us\n", "lists no frame"),
        (b"frame,time_us\n0,1000\n0,1100\n2,1200\n", "line 3: frame 0 follows frame 0"),
        (b"frame,time_us\n0,x\n1,1100\n", "line 2, column time_us: 'x' is not a number"),
        (b"frame,time_us\n0,1.79535E+15\n", "not a whole number of microseconds"),
        (b"frame,time_us\n-1,1000\n", "'-1' is not a frame number"),
        (b"frame,time_us\n0\n1,1100\n", "line 2 has 1 cells, not 2"),
        (b"\xff\xfe\x00f", "not UTF-8"),
    ],
)
def test_frames_that_cannot_be_placed_name_line_and_reason(tmp_path: Path, content: bytes, words: str) -> None:
    with pytest.raises(FlightFolderError, match=r"frames\.csv") as caught:
        frames(tmp_path / "frames.csv", content)
    assert words in str(caught.value)


@pytest.mark.parametrize(
    ("times", "kept"),
    [
        ([1000, 900, 1100], [1, 2]),
        ([1000, 2000, 900, 3000, 4000], [0, 1, 3, 4]),
        ([9000, 1000, 2000, 3000], [1, 2, 3]),
        ([1000, 2000, 2000, 3000], [0, 1, 3]),
        ([1000, 1300, 1400, 1500, 1040, 1080, 1120, 1160, 1200, 1600], [0, 4, 5, 6, 7, 8, 9]),
        ([3000, 2000, 1000], [2]),
    ],
)
def test_a_time_that_runs_backwards_costs_only_its_frame(tmp_path: Path, times: list[int], kept: list[int]) -> None:
    """
    Fault: single frame times, or those of a recording's first moments, lie after those of later frames.
    Expected: as few frames as possible are left out, with a warning that names the line of the first.
    """
    content = "frame,time_us\n" + "".join(f"{n},{t}\n" for n, t in enumerate(times))
    warnings: list[str] = []
    found = frames(tmp_path / "frames.csv", content.encode(), warnings)

    assert np.all(np.diff(found.t_video_us) > 0)
    assert len(found.frame) == len(kept)
    assert found.t_video_us.tolist() == [times[n] for n in found.frame]
    (warning,) = warnings
    first = min(set(range(len(times))) - set(found.frame.tolist()))
    assert f"line {first + 2}: time {times[first]} of frame {first}" in warning


@given(st.lists(st.integers(0, 12), min_size=1, max_size=9))
def test_no_longer_rise_is_overlooked(values: list[int]) -> None:
    """Against trying every choice."""
    kept = _longest_rise(np.array(values, dtype=np.int64)).tolist()
    chosen = [values[n] for n in kept]
    choices = (c for size in range(1, len(values) + 1) for c in itertools.combinations(values, size))
    longest = max(len(c) for c in choices if all(a < b for a, b in itertools.pairwise(c)))

    assert kept == sorted(kept)
    assert all(a < b for a, b in itertools.pairwise(chosen))
    assert len(kept) == longest


@pytest.mark.parametrize("tail", [b"2", b"2,", b"2,17", b"2,1795"])
def test_unfinished_last_line_of_a_killed_recorder_is_left_out(tmp_path: Path, tail: bytes) -> None:
    """Also where the cut goes through the number and leaves a smaller one."""
    content = b"frame,time_us\n0,179535499592\n1,179535499692\n" + tail
    assert frames(tmp_path / "frames.csv", content).frame.tolist() == [0, 1]


def test_truth_is_read_in_radians_and_gaps_are_nan(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text(
        "time_us,lat_deg,lon_deg,alt_amsl_m,yaw_deg,vn_mps,ve_mps,vd_mps\n"
        f"{T_US},32.5,35.25,690.5,90,1,2,3\n{T_US + 5},32.6,35.35,691.5,,4,5,6\n"
    )
    truth = parse_truth(read_table(path, ("time_us",)), [].append)
    assert_allclose(np.degrees(truth.lat_rad), [32.5, 32.6])
    assert_allclose(truth.yaw_rad, [math.pi / 2, math.nan])
    assert np.isnan(truth.roll_rad).all()
    assert_allclose(truth.vel_ned_m_s, [[1, 2, 3], [4, 5, 6]])


def test_truth_out_of_order_is_put_in_order_with_a_warning(tmp_path: Path) -> None:
    path = tmp_path / "truth.csv"
    path.write_text("time_us,lat_deg,lon_deg,alt_amsl_m\n30,3,0,0\n10,1,0,0\n20,2,0,0\n20,9,0,0\n")
    warnings: list[str] = []
    truth = parse_truth(read_table(path, ("time_us",)), warnings.append)
    assert truth.t_unix_us.tolist() == [10, 20, 30]
    assert_allclose(np.degrees(truth.lat_rad), [1, 9, 3])
    assert "do not run forward" in warnings[0]


def test_real_truth_has_every_line(tmp_path: Path) -> None:
    path = shared_data("flights/plane_80m/truth.csv")
    warnings: list[str] = []
    truth = parse_truth(read_table(path, ("time_us",)), warnings.append)
    lines = path.read_text().splitlines()
    last = lines[-1].split(",")
    assert len(truth.t_unix_us) == len(lines) - 1
    assert truth.t_unix_us[-1] == int(last[0])
    assert math.degrees(truth.roll_rad[-1]) == pytest.approx(float(last[4]))
    assert not warnings


def test_bad_click_costs_only_itself(tmp_path: Path) -> None:
    path = tmp_path / "clicks.csv"
    path.write_text("time_us,u_px,v_px,target\n10,1.5,2.5,A\n20,nan,2,B\n30,x,2,C\n40,4,5,D\n")
    warnings: list[str] = []
    clicks = parse_rows(read_table(path, CLICK_COLUMNS), parse_click, warnings.append)
    assert [click.target for click in clicks] == ["A", "D"]
    assert len(warnings) == 1
    assert "line 3" in warnings[0]
    assert "1 more" in warnings[0]


def test_clicks_may_say_where_the_thing_stands(tmp_path: Path) -> None:
    path = tmp_path / "clicks.csv"
    head = "time_us,u_px,v_px,target,height_above_ground_m,ground\n"
    path.write_text(head + "1,2,3,a,4.5,flat\n2,2,3,b,,\n3,2,3,c\n4,2,3,d,1,sea\n5,2,3,e,high,flat\n", encoding="utf-8")
    warnings: list[str] = []

    found = parse_rows(read_table(path, CLICK_COLUMNS), parse_click, warnings.append)

    assert [(c.target, c.height_above_ground_m, c.ground) for c in found] == [
        ("a", 4.5, "flat"), ("b", 0.0, "terrain"), ("c", 0.0, "terrain"),
    ]  # fmt: skip
    assert "'sea' is no ground" in warnings[0]
