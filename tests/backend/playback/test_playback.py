"""One replay on its own: which frame an id names, jumps, what it says, video that breaks off."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import AsyncIterator
from contextlib import asynccontextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import orjson
import pytest

from backend.errors import FrameGoneError, NoStateForFrameError
from backend.hub import Hub
from backend.playback.estimate import EstimateTable
from backend.playback.playback import Playback
from backend.playback.recording import read_recording
from backend.video.frames import EncodedFrame
from backend.video.jpeg import jpeg_size_px
from geodata.flight import FlightFolder
from geodata.flight_write import write_flight_json
from tests.backend.flight_maker import LAT_DEG, SIZE, T0_US, write_flight

PATIENCE_S = 30.0
SECONDS = 4.0
COUNT = 100


class Viewer:
    """Collects what a feed shows, in place of the viewers of a socket."""

    def __init__(self, playback: Playback) -> None:
        self.frames: list[EncodedFrame] = []
        self.came = asyncio.Event()
        show = playback.audience.show

        def noted(frame: EncodedFrame) -> None:
            self.frames.append(frame)
            self.came.set()
            show(frame)

        playback.audience.show = noted  # type: ignore[method-assign]

    async def until(self, count: int) -> None:
        async with asyncio.timeout(PATIENCE_S):
            while len(self.frames) < count:
                self.came.clear()
                await self.came.wait()


def said_by(hub: Hub) -> list[dict[str, Any]]:
    """Everything that is published from now on."""
    found: list[dict[str, Any]] = []
    publish = hub.publish

    def noted(kind: str, /, **fields: Any) -> None:
        found.append({"type": kind, **orjson.loads(orjson.dumps(fields))})
        publish(kind, **fields)

    hub.publish = noted  # type: ignore[method-assign]
    return found


@asynccontextmanager
async def played(
    folder: Path, speed: float = 1.0, start_s: float = 0.0, hub: Hub | None = None
) -> AsyncIterator[Playback]:
    playback = Playback("f", read_recording(folder, lambda _: None), hub or Hub(), speed, start_s)
    if (folder / "estimate.csv").exists():
        playback.use_estimate(EstimateTable.read(folder / "estimate.csv"))
    try:
        yield playback
    finally:
        await playback.close()


async def test_an_id_names_the_same_picture_in_every_epoch_and_no_other(tmp_path: Path) -> None:
    write_flight(tmp_path / "f", SECONDS)
    async with played(tmp_path / "f") as playback:
        first = playback.identify(1 * COUNT + 7)
        with pytest.raises(FrameGoneError):
            playback.identify(2 * COUNT + 7)  # of an epoch that has not begun
        playback.change(None, None, T0_US + 2_000_000)
        again = playback.identify(2 * COUNT + 7)
        for gone in (7, COUNT - 1, 3 * COUNT, -1):
            with pytest.raises(FrameGoneError):
                playback.identify(gone)
        shown = await playback.jpeg(COUNT + 7)
        with pytest.raises(FrameGoneError):
            await playback.jpeg(7)

    assert (first.t_us, again.t_us) == (T0_US + 7 * 40_000,) * 2
    assert (first.width_px, first.height_px) == SIZE
    assert playback.exposure_us(first) == first.t_us
    assert jpeg_size_px(shown) == SIZE


async def test_every_picture_is_shown_once_in_order_at_its_time(tmp_path: Path) -> None:
    write_flight(tmp_path / "f", SECONDS)
    async with played(tmp_path / "f", speed=16.0) as playback:
        viewer = Viewer(playback)
        playback.start()
        await viewer.until(COUNT - 1)
        async with asyncio.timeout(PATIENCE_S):
            while not playback.ended:
                await asyncio.sleep(0.01)

    times = [frame.t_us for frame in viewer.frames]
    assert times == [T0_US + 40_000 * n for n in range(len(times))]
    assert [frame.frame_id for frame in viewer.frames] == [COUNT + n for n in range(len(times))]
    assert viewer.frames[0].key


async def test_a_paused_replay_stands_still_and_still_shows_where_it_jumps(tmp_path: Path) -> None:
    write_flight(tmp_path / "f", SECONDS)
    hub = Hub()
    said = said_by(hub)
    async with played(tmp_path / "f", hub=hub) as playback:
        viewer = Viewer(playback)
        playback.change(True, 2.0, None)
        playback.start()
        await viewer.until(1)
        playback.change(None, None, T0_US + 2_020_000)
        await viewer.until(2)
        body = playback.body()

    assert (body.t_unix_us, body.paused, body.speed, body.ended) == (T0_US + 2_020_000, True, 2.0, False)
    # the picture of that time is built on the key frame of its second, which comes with it
    after = [frame for frame in viewer.frames if frame.epoch == 2]
    assert after[0].key
    assert after[-1].t_us <= T0_US + 2_020_000
    states = [message for message in said if message["type"] == "state"]
    assert states[-1]["t_state_unix_us"] == T0_US + 2_020_000
    # 5 m/s to the north
    assert states[-1]["lat_deg"] == pytest.approx(LAT_DEG + 10.1 / 111_200, abs=1e-6)


@pytest.mark.parametrize(("wanted_s", "reached_s"), [(-100.0, 0.0), (1.5, 1.5), (1e6, None)])
async def test_a_jump_ends_within_the_flight(tmp_path: Path, wanted_s: float, reached_s: float | None) -> None:
    write_flight(tmp_path / "f", SECONDS)
    async with played(tmp_path / "f") as playback:
        playback.change(None, None, T0_US + round(wanted_s * 1e6))
        body = playback.body()

    goal_us = body.end_unix_us if reached_s is None else T0_US + round(reached_s * 1e6)
    assert body.t_unix_us == goal_us
    assert body.ended is (reached_s is None)


async def test_tracks_are_those_of_the_time_shown(tmp_path: Path) -> None:
    """A jump back takes away what lies ahead."""
    write_flight(tmp_path / "f", SECONDS)
    async with played(tmp_path / "f", start_s=3.0) as playback:
        late = {name: ring.pieces(0)[-1][-1].t_us for name, ring in playback.tracks.items()}
        playback.change(None, None, T0_US + 1_000_000)
        early = {name: ring.pieces(0)[-1][-1] for name, ring in playback.tracks.items()}

    assert set(late) == set(early) == {"gps", "vision"}
    assert all(T0_US + 2_700_000 <= t_us <= T0_US + 3_000_000 for t_us in late.values())
    assert all(T0_US + 700_000 <= point.t_us <= T0_US + 1_000_000 for point in early.values())
    assert {point.epoch for point in early.values()} == {2}


async def test_gps_is_shown_as_denied_where_the_flight_says_so(tmp_path: Path) -> None:
    write_flight(tmp_path / "f", SECONDS)
    meta = FlightFolder.open(tmp_path / "f").meta
    write_flight_json(tmp_path / "f", meta.model_copy(update={"gps_denied": ((T0_US + 1_000_000, T0_US + 2_000_000),)}))
    async with played(tmp_path / "f") as playback:
        denied = []
        for at_us in (500_000, 1_500_000, 2_500_000):
            playback.change(None, None, T0_US + at_us)
            message = playback.state_message()
            assert message is not None
            denied.append(message["gps_denied"])

    assert denied == [False, True, False]


async def test_a_picture_without_a_time_cannot_be_placed(tmp_path: Path) -> None:
    write_flight(tmp_path / "f", SECONDS)
    lines = (tmp_path / "f" / "frames.csv").read_text().splitlines()
    (tmp_path / "f" / "frames.csv").write_text("\n".join([*lines[:11], *lines[12:]]) + "\n")  # not picture 10
    async with played(tmp_path / "f") as playback:
        with pytest.raises(NoStateForFrameError, match="when it was taken"):
            playback.identify(COUNT + 10)
        assert playback.identify(COUNT + 11).t_us == T0_US + 11 * 40_000


async def test_a_flight_without_estimate_and_video_has_a_time_and_nothing_else(tmp_path: Path) -> None:
    write_flight(tmp_path / "f", SECONDS, with_estimate=False)
    for name in ("estimate.csv", "video.ts", "frames.csv"):
        (tmp_path / "f" / name).unlink()
    data = orjson.loads((tmp_path / "f" / "flight.json").read_bytes())
    data["video"] = {}
    (tmp_path / "f" / "flight.json").write_bytes(orjson.dumps(data))
    async with played(tmp_path / "f", speed=16.0) as playback:
        playback.start()
        async with asyncio.timeout(PATIENCE_S):
            while not playback.ended:
                await asyncio.sleep(0.01)
        assert playback.video_source is None
        assert playback.state_message() is None
        assert await playback.state_at(T0_US) is None
        assert playback.assumption_at(T0_US) is None
        with pytest.raises(FrameGoneError):
            playback.identify(COUNT)


async def test_video_that_breaks_off_lets_the_flight_go_on(tmp_path: Path) -> None:
    """
    Fault: the video file vanishes between the opening of the replay and its playing.
    Expected: time, states and tracks run to the end.
    """
    write_flight(tmp_path / "f", SECONDS)
    async with played(tmp_path / "f", speed=16.0) as playback:
        (tmp_path / "f" / "video.ts").unlink()
        viewer = Viewer(playback)
        playback.start()
        async with asyncio.timeout(PATIENCE_S):
            while not playback.ended:
                await asyncio.sleep(0.01)
        with pytest.raises(FrameGoneError):
            await playback.jpeg(COUNT + 3)

    assert viewer.frames == []
    assert playback.tracks["vision"].pieces(0)[-1][-1].t_us >= T0_US + round((SECONDS - 0.2) * 1e6)


async def test_hindsight_is_of_the_stations_own_estimates_and_comes_once(tmp_path: Path) -> None:
    """An estimate that does not tell how good its attitude is was made by others: it stays as it is."""
    write_flight(tmp_path / "f", SECONDS)
    table = EstimateTable.read(tmp_path / "f" / "estimate.csv")
    bare = replace(table, cov_camera_pose=table.cov_camera_pose * math.nan)
    t_us = T0_US + 1_000_000
    async with played(tmp_path / "f") as playback:
        setup = playback.setup
        assert setup is not None
        assert playback.expects_more(0)
        assert playback.hindsight(0, setup) is None
        playback.use_hindsight(table, found_offset_us=500_000)
        known = playback.hindsight(0, setup)
        assert not playback.expects_more(0)
        assert known is not None
        assert known.is_final(t_us)
        later = known.at(t_us)
        playback.use_estimate(bare)
        others = known.at(t_us)
        playback.use_hindsight(None)
        assert not playback.expects_more(0)

    assert later is not None
    assert later.t_us == t_us + 500_000  # the video's clock as the better estimate found it
    assert others is None


async def test_a_flight_whose_map_is_broken_is_replayed_without_it(tmp_path: Path) -> None:
    write_flight(tmp_path / "f", SECONDS)
    meta = json.loads((tmp_path / "f" / "flight.json").read_text())
    meta["map"]["reference"] = "reference.tif"
    (tmp_path / "f" / "flight.json").write_text(json.dumps(meta))
    (tmp_path / "f" / "reference.tif").write_bytes(b"no picture")
    recording = read_recording(tmp_path / "f", lambda _: None)

    assert recording.setup is not None
    assert recording.setup.reference is None
    assert any("clicks are not registered" in warning for warning in recording.folder.warnings)
