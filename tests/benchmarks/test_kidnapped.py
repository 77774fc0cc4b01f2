"""What counts as found and as a false lock, what a trial is told, and what is kept between runs."""

import math
import pickle
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from benchmarks import kidnapped_flights
from benchmarks.kidnapped import CUT_M, Ground, Records, Trial, _turned, without_track
from benchmarks.kidnapped_flights import Flight, flown
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.local import LocalFrame
from estimator.types import AttitudeSample, BarometerSample, HomeSample, Sample
from geodata.imagery import ImageryGrid

FOUND = Trial(
    world=400, map=400, start_s=0.0, found_s=50.0, error_m=3.0, sigmas=0.5, later_m=1.0, heading_deg=0.2, cpu_share=0.2
)  # fmt: skip


def _flight(north_m: float) -> Flight:
    """From west to east through a world at 10 m/s."""
    t_s = np.arange(0.0, 700.0)
    truth = np.stack((t_s * 1e6, 0.0 * t_s + north_m, 10.0 * t_s - 900.0, 0.0 * t_s - 100.0, 0.0 * t_s), axis=-1)
    camera = Camera.from_hfov(320, 240, 1.0)
    return Flight([BarometerSample(1, 100.0)], [(5, b"jpeg")], truth, camera, Mount(0, 0, 0, np.zeros(3)), _FRAME)


_FRAME = LocalFrame(1.0, 0.2, 80.0)


@pytest.mark.parametrize(
    ("trial", "right", "false_lock"),
    [
        (FOUND, True, False),
        (replace(FOUND, error_m=400.0), False, True),
        (replace(FOUND, map=399), False, True),
        (replace(FOUND, cut=True), False, True),
        (replace(FOUND, found_s=None, error_m=None), False, False),
    ],
)
def test_what_counts(trial: Trial, right: bool, false_lock: bool) -> None:
    assert (trial.right, trial.false_lock) == (right, false_lock)


def test_a_trial_is_told_no_place_and_no_heading() -> None:
    level = np.array([1.0, 0.0, 0.0, 0.0])
    samples: list[Sample] = [
        BarometerSample(1, 100.0), HomeSample(5, 0.8, 0.2, 100.0), AttitudeSample(6, level, np.zeros(3)),
    ]  # fmt: skip

    told = list(_turned(samples, math.pi / 2, first_us=5))

    assert len(told) == 1
    assert isinstance(told[0], AttitudeSample)
    np.testing.assert_allclose(told[0].q_ned_from_body, [math.sqrt(0.5), 0.0, 0.0, math.sqrt(0.5)], atol=1e-12)


def test_a_cut_map_shows_nothing_that_is_flown_over() -> None:
    side = 401
    whole = ImageryGrid(np.full((side, side), 90, np.uint8), np.ones((side, side), bool), 1000.0, -1000.0, 5.0)

    cut = without_track(Ground(whole, _Flat()), _flight(100.0), 20.0).reference

    assert isinstance(cut, ImageryGrid)
    north_m = 1000.0 - 5.0 * np.arange(side)
    # the track of this trial begins 200 m after the flight does, at 700 m west
    above = cut.valid[:, 100]
    np.testing.assert_array_equal(above[np.abs(north_m - 100.0) < CUT_M - 10.0], False)
    np.testing.assert_array_equal(above[np.abs(north_m - 100.0) > CUT_M + 10.0], True)
    assert (cut.image[~cut.valid] == 0).all()
    assert cut.valid[180, -1]
    assert whole.valid.all()


class _Flat:
    def alt_amsl_m(self, north_m: np.ndarray, east_m: np.ndarray) -> np.ndarray:
        return 0.0 * (north_m + east_m)


def test_what_this_code_has_tried_is_resumed(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    first = Records.opened(path, "code", resume=False)
    first.add(FOUND)
    first.add(replace(FOUND, cut=True, found_s=None, error_m=None))

    again = Records.opened(path, "code", resume=True)

    assert again.of(400, 400, False, 0.0) == FOUND
    assert again.of(400, 400, True, 0.0) == replace(FOUND, cut=True, found_s=None, error_m=None)
    assert again.of(400, 400, False, 120.0) is None


def test_what_other_code_has_tried_is_not(tmp_path: Path) -> None:
    path = tmp_path / "trials.jsonl"
    Records.opened(path, "older code", resume=False).add(FOUND)
    assert Records.opened(path, "code", resume=True).of(400, 400, False, 0.0) is None
    Records.opened(path, "code", resume=False)
    assert path.read_text() == ""


def test_a_flight_is_flown_once(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    flights = []

    def fly(world: object, seed: int, duration_s: float) -> Flight:
        flights.append((world, seed, duration_s))
        return _flight(0.0)

    monkeypatch.setattr(kidnapped_flights, "fly", fly)
    monkeypatch.setattr(kidnapped_flights, "world_of", lambda seed, *_: f"world {seed}")

    first, again = (flown(7, 300.0, 20.0, tmp_path, "code") for _ in range(2))
    assert flights == [("world 7", 7, 20.0)]
    np.testing.assert_array_equal(first.truth, again.truth)
    assert again.pictures == [(5, b"jpeg")]

    flown(7, 300.0, 20.0, tmp_path, "other code")
    flown(7, 310.0, 20.0, tmp_path, "code")
    flown(8, 300.0, 20.0, tmp_path, "code")
    assert len(flights) == 4


def test_a_file_that_holds_no_flight_is_named(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """
    Fault: something else lies where the flight is kept.
    Expected: an error that names the file.
    """
    monkeypatch.setattr(kidnapped_flights, "fly", lambda *_: _flight(0.0))
    monkeypatch.setattr(kidnapped_flights, "world_of", lambda *_: None)
    flown(7, 300.0, 20.0, tmp_path, "code")
    (path,) = (tmp_path / "flights").iterdir()
    path.write_bytes(pickle.dumps("no flight"))
    with pytest.raises(TypeError, match=path.name):
        flown(7, 300.0, 20.0, tmp_path, "code")
