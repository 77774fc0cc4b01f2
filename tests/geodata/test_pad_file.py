"""Descriptions of pads: written and read alike, and every fault named with its field."""

import json
from pathlib import Path
from typing import Any

import pytest

from estimator.landing.pad import Pad, circle_pad, tag_pad
from geodata.errors import PadFileError
from geodata.pad_file import as_description, read_pad, write_pad


@pytest.mark.parametrize("pad", [circle_pad("roof", 1.5, 0.3), tag_pad("yard", 0.9, sizes=2)])
def test_what_is_written_is_read(tmp_path: Path, pad: Pad) -> None:
    write_pad(tmp_path / "pad.json", pad)

    assert read_pad(tmp_path / "pad.json") == pad


def _broken(change: dict[str, Any]) -> str:
    return json.dumps({**as_description(circle_pad("roof", 1.5, 0.3)), **change})


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("{", "is not JSON"),
        ("[1, 2]", "valid dictionary"),
        (_broken({"schema": "pilotage.pad/9"}), "schema"),
        (_broken({"kind": "squares"}), "circles"),
        (_broken({"triples": []}), "triples"),
        (_broken({"triples": [{"side_m": -1.5, "radius_m": 0.3, "ratios": [0.3, 0.5, 0.7]}]}), "triples.0.side_m"),
        (_broken({"triples": [{"side_m": 1.5, "radius_m": 0.3, "ratios": [0.3, 0.5]}]}), "ratios"),
        (_broken({"triples": [{"side_m": 1.5, "radius_m": 0.3, "ratios": [0.7, 0.5, 0.3]}]}), "mirrored"),
        (_broken({"triples": [{"side_m": 1.5, "radius_m": 0.9, "ratios": [0.3, 0.5, 0.7]}]}), "make the side longer"),
        (_broken({"sidem": 2.0}), "sidem"),
    ],
)
def test_a_fault_is_named(tmp_path: Path, text: str, words: str) -> None:
    path = tmp_path / "pad.json"
    path.write_text(text)

    with pytest.raises(PadFileError, match=words) as caught:
        read_pad(path)

    assert str(path) in str(caught.value)


def test_files_that_cannot_be_read_are_named(tmp_path: Path) -> None:
    with pytest.raises(PadFileError, match="no such file"):
        read_pad(tmp_path / "none.json")
    with pytest.raises(PadFileError, match="cannot be read"):
        read_pad(tmp_path)
    (tmp_path / "latin.json").write_bytes(b'{"name": "\xff"}')
    with pytest.raises(PadFileError, match="not JSON"):
        read_pad(tmp_path / "latin.json")
