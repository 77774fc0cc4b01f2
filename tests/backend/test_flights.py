"""The shelf of flights: names, order, changes on the disk, and what may be removed."""

from __future__ import annotations

import json
from pathlib import Path

import pytest

from backend.errors import ConflictError, UnknownFlightError
from backend.flights import FlightShelf
from tests.backend.flight_maker import T0_US
from tests.backend.replay.flown import packets, write_known_flight


def test_flights_of_one_name_in_two_folders_keep_apart(tmp_path: Path) -> None:
    write_known_flight(tmp_path / "own" / "alpha")
    write_known_flight(tmp_path / "other" / "alpha")
    shelf = FlightShelf(tmp_path / "own", [tmp_path / "other"])
    ids = [entry.id for entry in shelf.all()]

    assert len(set(ids)) == 2
    assert {shelf.get(name).path for name in ids} == {tmp_path / "own" / "alpha", tmp_path / "other" / "alpha"}
    assert [shelf.get(name).read_only for name in sorted(ids)] == [False, True]


def test_the_newest_comes_first_and_broken_ones_last(tmp_path: Path) -> None:
    later = [(t + 3_600_000_000, data) for t, data in packets(2.0)]
    write_known_flight(tmp_path / "a", 2.0)
    write_known_flight(tmp_path / "b", 2.0, truth=False, log=later)
    (tmp_path / "c").mkdir()
    (tmp_path / ".hidden").mkdir()
    (tmp_path / "file.txt").write_text("no flight")
    entries = FlightShelf(tmp_path).all()

    assert [entry.id for entry in entries] == ["b", "a", "c"]
    assert [entry.start_unix_us for entry in entries] == [T0_US + 3_600_000_000, T0_US, None]
    assert "flight.json" in (entries[2].problem or "")
    assert [entry.has_truth for entry in entries] == [False, True, False]


def test_a_flight_mended_or_broken_meanwhile_is_seen_anew(tmp_path: Path) -> None:
    flight = write_known_flight(tmp_path / "a", 2.0)
    shelf = FlightShelf(tmp_path)
    good = shelf.get("a")
    text = (flight.path / "flight.json").read_text()
    (flight.path / "flight.json").write_text(text[:-20])
    broken = shelf.get("a")
    (flight.path / "flight.json").write_text(text)

    assert good.problem is None
    assert "flight.json" in (broken.problem or "")
    assert shelf.get("a").problem is None


def test_a_clock_set_back_makes_no_negative_duration(tmp_path: Path) -> None:
    log = packets(4.0)
    write_known_flight(tmp_path / "a", log=[*log[:-1], (T0_US - 60_000_000, log[-1][1])])
    duration_s = FlightShelf(tmp_path).get("a").duration_s

    assert duration_s is not None
    assert duration_s >= 0.0


def test_only_own_flights_can_be_removed(tmp_path: Path) -> None:
    write_known_flight(tmp_path / "own" / "a", 2.0)
    write_known_flight(tmp_path / "other" / "b", 2.0)
    shelf = FlightShelf(tmp_path / "own", [tmp_path / "other"])
    shelf.delete("a")
    with pytest.raises(ConflictError, match="read only"):
        shelf.delete("b")
    for name in ("a", "..", "", "other"):
        with pytest.raises(UnknownFlightError):
            shelf.delete(name)

    assert not (tmp_path / "own" / "a").exists()
    assert json.loads((tmp_path / "other" / "b" / "flight.json").read_text())


def test_the_folder_pointed_at_may_be_a_flight_itself(tmp_path: Path) -> None:
    write_known_flight(tmp_path / "a b!", 2.0)

    assert [entry.id for entry in FlightShelf(tmp_path / "none", [tmp_path / "a b!"]).all()] == ["a-b"]
