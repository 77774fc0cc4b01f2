"""The landing table of a replay: written where a pad is named, empty cells for what is not known."""

import csv
import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from backend.replay.landing import LANDING_COLUMNS, LandingTrack, surveyed_place
from backend.replay.offline import replay_flight
from estimator.geometry.local import LocalFrame
from estimator.landing.pad import circle_pad
from estimator.types import PadMode, PadRelative
from geodata.errors import PadFileError
from geodata.flight import FlightFolder
from geodata.flight_pad import FlightPad, PadSurvey
from geodata.pad_file import as_description
from tests.backend.flight_maker import GROUND_M, LAT_DEG, LON_DEG
from tests.backend.replay.flown import write_known_flight

PAD = circle_pad("roof", 1.5, 0.3)
RELATIVE = PadRelative(
    PadMode.TRACKING, np.array([1.0, -2.0, -15.0]), np.array([0.1, 0.2, 1.3]), np.diag([0.01, 0.04, 0.09]),
    np.eye(3) * 0.0025, np.array([1.0, 0.0, 0.0, 0.0]), 0.02,
)  # fmt: skip
NOWHERE = replace(
    RELATIVE, mode=PadMode.SEARCHING, pos_ned_m=np.full(3, np.nan), cov_pos_ned_m2=np.full((3, 3), np.nan),
    age_s=float("inf"), reason="no pad in view",
)  # fmt: skip


def _rows(path: Path) -> list[dict[str, str]]:
    with path.open() as file:
        return list(csv.DictReader(file))


def _with_pad(folder: Path, pad: object) -> FlightFolder:
    write_known_flight(folder, 6.0)
    path = folder / "flight.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "pad": pad}))
    return FlightFolder.open(folder)


def test_a_row_holds_numbers_or_nothing(tmp_path: Path) -> None:
    track = LandingTrack()
    for t_us, pad in ((0, NOWHERE), (5_000, RELATIVE), (20_000, RELATIVE), (40_000, None)):
        track.note(SimpleNamespace(t_us=t_us, pad=pad))  # type: ignore[arg-type]
    track.write(tmp_path / "landing.csv")

    first, second = _rows(tmp_path / "landing.csv")
    assert tuple(first) == LANDING_COLUMNS
    assert [first[name] for name in ("north_m", "std_d_m", "age_s", "mode", "reason")] == [
        "", "", "", "searching", "no pad in view",
    ]  # fmt: skip
    assert second["time_us"] == "20000"
    assert [float(second[name]) for name in LANDING_COLUMNS[1:13]] == [
        1.0, -2.0, -15.0, 0.1, 0.2, 1.3, 0.1, 0.2, 0.3, 0.05, 0.05, 0.05,
    ]  # fmt: skip
    assert track.modes() == {"searching": 0.5, "tracking": 0.5}


def test_a_replay_writes_it_where_a_pad_is_named_and_only_there(tmp_path: Path) -> None:
    plain = write_known_flight(tmp_path / "plain", 6.0)
    named = _with_pad(tmp_path / "named", as_description(PAD))
    out = tmp_path / "out"

    report = replay_flight(named, out).report
    rows = _rows(out / "landing.csv")
    assert len(rows) > 20
    # the flight has no pictures
    assert {row["mode"] for row in rows} == {"searching"}
    assert report["landing"] == {"modes": {"searching": 1.0}}

    assert replay_flight(plain, out).report["landing"] is None
    assert not (out / "landing.csv").exists()


def test_the_survey_is_laid_into_the_local_frame() -> None:
    frame = LocalFrame(np.radians(LAT_DEG), np.radians(LON_DEG), GROUND_M)
    survey = PadSurvey(lat_deg=LAT_DEG, lon_deg=LON_DEG, alt_amsl_m=GROUND_M - 2.5, std_m=0.1)

    place = surveyed_place(FlightPad(PAD, survey), frame)

    assert place is not None
    assert place.pos_ned_m == pytest.approx([0.0, 0.0, 2.5], abs=1e-3)
    assert place.std_m == 0.1
    assert surveyed_place(FlightPad(PAD, None), frame) is None


def test_a_bad_pad_is_told_before_anything_is_replayed(tmp_path: Path) -> None:
    flight = _with_pad(tmp_path / "f", {**as_description(PAD), "triples": []})
    with pytest.raises(PadFileError, match=r"flight\.json: .*triples"):
        replay_flight(flight, tmp_path / "out")
    assert not (tmp_path / "out").exists()
