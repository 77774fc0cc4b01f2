"""What an operator tells by pointing: alignments to the estimator, points to cameras, and what is refused of it."""

import asyncio
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backend.alignment import Shift, alignment_of, tilt_covariance
from backend.clicks import FrameView
from backend.errors import AlignmentRefusedError
from backend.fleet.feed import FrameIdentity
from backend.recorder.alignments import read_alignments
from backend.replay.offline import replay_flight
from estimator.types import NavigationState
from geodata.flight import FlightFolder
from tests.backend.aircraft import flying, frame_header
from tests.backend.evidence.flown import STRIDE, VEHICLE, hilly_station
from tests.backend.station_runner import next_of
from tests.backend.test_pointing import SETUP, looking_north

FRAME = FrameIdentity(5, 1_000_000, 640, 480)


class Seen:
    """A vehicle whose state is known."""

    id, setup = "1", SETUP

    def __init__(self, state: NavigationState) -> None:
        self.state = state

    def exposure_us(self, frame: FrameIdentity) -> int:
        return frame.t_us

    async def state_at(self, t_us: int) -> NavigationState:
        return self.state


async def told(down_deg: float, shift: Shift, age_s: float = 1.0) -> Any:
    vehicle: Any = Seen(looking_north(down_deg))
    return await alignment_of(vehicle, FRAME, shift, FRAME.t_us + round(age_s * 1e6))


async def test_the_measurement_is_the_place_that_was_dragged_to() -> None:
    sample = await told(90.0, Shift(12.0, -5.0, 2.0))

    assert (sample.t_us, sample.t_frame_us, sample.frame_id) == (2_000_000, 1_000_000, 5)
    assert sample.pos_ne_m.tolist() == [12.0, -5.0]
    # 0.01 rad of tilt at 100 m: one metre beside the operator's two
    np.testing.assert_allclose(sample.cov_ne_m2, (4.0 + 1.0) * np.eye(2), atol=1e-6)


def test_tilt_counts_more_the_flatter_the_camera_looks() -> None:
    """At 45 degrees a turn about east moves the middle by range over the sine: 141 m / 0.707 = 200 m a radian."""
    cov = tilt_covariance(FrameView(0, looking_north(45.0), SETUP))

    assert math.sqrt(cov[0, 0]) == pytest.approx(2.0, abs=1e-3)
    # about the vertical and along the track: both move it east, by 100 m a radian each
    assert math.sqrt(cov[1, 1]) == pytest.approx(math.hypot(1.0, 1.0), abs=1e-3)


@pytest.mark.parametrize(
    ("down_deg", "shift", "age_s", "said"),
    [
        (90.0, Shift(900.0, 0.0, 2.0), 1.0, "dragged by 900 m"),
        (90.0, Shift(5.0, 0.0, 2.0), 31.0, "31 s old"),
        (-5.0, Shift(5.0, 0.0, 2.0), 1.0, "horizon"),
    ],
)
async def test_what_cannot_be_meant_is_refused(down_deg: float, shift: Shift, age_s: float, said: str) -> None:
    with pytest.raises(AlignmentRefusedError, match=said):
        await told(down_deg, shift, age_s)


async def test_a_replay_cannot_be_changed_and_numbers_have_bounds(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        address = f"/api/v1/vehicles/{VEHICLE}/alignment"
        body = {"frame_id": STRIDE + 30, "north_m": 3.0, "east_m": 1.0, "std_m": 2.0}
        replayed = await running.client.post(address, json=body)
        sure = await running.client.post(address, json={**body, "std_m": 0.0})

    assert (replayed.status_code, sure.status_code) == (409, 422)
    assert "what happened cannot be changed" in replayed.json()["detail"]


async def test_the_estimator_follows_and_everybody_hears_of_the_fix(tmp_path: Path) -> None:
    async with flying(tmp_path) as (running, _, stream):
        await running.client.post("/api/v1/recording", json={"active": True})
        answer, before = None, None
        for _ in range(40):  # until the estimator covers a picture that the ring holds
            async with running.video("cam-1") as pictures:
                frame = await frame_header(pictures)
            before = await next_of(stream, "state")
            body = {"frame_id": frame["frame_id"], "north_m": 40.0, "east_m": 0.0, "std_m": 1.0, "by": "left seat"}
            answer = await running.client.post("/api/v1/vehicles/1/alignment", json=body)
            if answer.status_code == 202:
                break
        assert answer is not None
        assert answer.status_code == 202, answer.text
        while (fix := await next_of(stream, "fix"))["kind"] != "operator":
            pass
        ended = await running.client.post("/api/v1/recording", json={"active": False})
        assert ended.status_code == 200, ended.text
        (folder,) = (running.station.settings.data_dir / "flights").iterdir()
        (row,) = read_alignments(FlightFolder.open(folder))
    result = await asyncio.to_thread(replay_flight, FlightFolder.open(folder), tmp_path / "again")

    assert fix["accepted"], fix
    assert fix["frame_id"] == frame["frame_id"]
    assert answer.json()["std_n_m"] >= 1.0
    assert before is not None
    assert fix["lat_deg"] == pytest.approx(before["lat_deg"] + 40.0 / 111_200.0, abs=15.0 / 111_200.0)
    assert (row.north_m, row.east_m, row.std_m, row.by, row.system_id) == (40.0, 0.0, 1.0, "left seat", 1)
    assert row.t_frame_us == frame["t_unix_us"]
    assert row.std_ne_m == pytest.approx((answer.json()["std_n_m"], answer.json()["std_e_m"]), abs=1e-3)
    # a replay computed anew hears of it, at its time
    (again,) = [each for each in result.fixes if each.kind == "operator"]
    assert (again.t_us, again.accepted) == (row.t_us, True)


async def test_a_vehicle_whose_camera_does_not_track_refuses_a_point(tmp_path: Path) -> None:
    async with flying(tmp_path) as (running, _, stream):
        await next_of(stream, "state")
        async with running.video("cam-1") as pictures:
            frame = await frame_header(pictures)
        body = {"command": "track_point", "frame_id": frame["frame_id"], "u_px": 10.0, "v_px": 12.0}
        none = await running.client.post("/api/v1/vehicles/1/commands", json=body)
        outside = await running.client.post("/api/v1/vehicles/1/commands", json={**body, "u_px": 9999.0})
        gone = await running.client.post("/api/v1/vehicles/1/commands", json={**body, "frame_id": 10**9})

    assert (none.status_code, outside.status_code, gone.status_code) == (409, 400, 404)
    assert "no camera of vehicle 1 tracks points itself" in none.json()["detail"]
