"""The pad of a flight: given inline or by file, surveyed or not, and every fault named with its field."""

import json
from pathlib import Path
from typing import Any

import pytest

from estimator.landing.pad import circle_pad
from geodata.errors import FlightFolderError, PadFileError
from geodata.flight import FlightFolder
from geodata.flight_pad import pad_of_flight
from geodata.pad_file import as_description, write_pad
from tests.backend.replay.flown import write_known_flight

PAD = circle_pad("roof", 1.5, 0.3)
PLACED = {"lat_deg": 47.0, "lon_deg": 8.0, "alt_amsl_m": 400.0}


def _flight(folder: Path, pad: Any) -> FlightFolder:
    write_known_flight(folder, 1.0, truth=False)
    write_pad(folder / "pad.json", PAD)
    path = folder / "flight.json"
    path.write_text(json.dumps({**json.loads(path.read_text()), "pad": pad}))
    return FlightFolder.open(folder)


def test_a_flight_without_a_pad_has_none(tmp_path: Path) -> None:
    assert pad_of_flight(_flight(tmp_path / "f", None)) is None


@pytest.mark.parametrize("section", [{"file": "pad.json"}, as_description(PAD)])
def test_a_pad_is_named_or_described_and_may_be_surveyed(tmp_path: Path, section: dict[str, Any]) -> None:
    plain = pad_of_flight(_flight(tmp_path / "plain", section))
    placed = pad_of_flight(_flight(tmp_path / "placed", {**section, **PLACED, "std_m": 0.02}))

    assert plain is not None
    assert plain.pad == PAD
    assert plain.survey is None
    assert placed is not None
    assert placed.pad == PAD
    assert placed.survey is not None
    assert placed.survey.model_dump() == {**PLACED, "std_m": 0.02}


@pytest.mark.parametrize(
    ("section", "words"),
    [
        ({"file": 7}, "pad.file"),
        ({"file": ""}, "pad.file"),
        ({"file": "pad.json", "kind": "circles"}, "both 'file' and 'kind'"),
        ({"file": "pad.json", "lat_deg": 47.0}, "pad.lon_deg"),
        ({"file": "pad.json", **PLACED, "lat_deg": 470.0}, "pad.lat_deg"),
        ({"file": "pad.json", **PLACED, "std_m": 0.0}, "pad.std_m"),
        ({"kind": "circles", "name": "x"}, "schema"),
        ({**as_description(PAD), "sidem": 1.0}, "sidem"),
    ],
)
def test_a_fault_is_named(tmp_path: Path, section: dict[str, Any], words: str) -> None:
    with pytest.raises(PadFileError, match=r"flight\.json") as caught:
        pad_of_flight(_flight(tmp_path / "f", section))
    assert words in str(caught.value)


def test_a_file_that_is_not_there_or_outside_is_refused(tmp_path: Path) -> None:
    for name, words in (("other.json", "does not hold it"), ("../pad.json", "outside the folder")):
        flight = _flight(tmp_path / words.replace(" ", ""), {"file": name})
        with pytest.raises(FlightFolderError, match=words):
            pad_of_flight(flight)
