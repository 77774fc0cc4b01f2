"""The station's pad: given at the start, given by the page, kept, and refused in words."""

import json
from pathlib import Path

import pytest

from backend.errors import StartError
from backend.landing.pads import Pads
from estimator.landing.pad import circle_pad, tag_pad
from geodata.errors import PadFileError
from geodata.pad_file import as_description, write_pad


def test_what_the_page_gives_is_there_after_a_restart(tmp_path: Path) -> None:
    given = circle_pad("field", 1.2, 0.24)
    Pads(tmp_path).give(as_description(given))

    again = Pads(tmp_path)
    again.load(None)

    assert again.pad == given


def test_a_pad_given_at_the_start_goes_before_the_kept_one(tmp_path: Path) -> None:
    Pads(tmp_path).give(as_description(circle_pad("kept", 1.2, 0.24)))
    write_pad(tmp_path / "mine.json", tag_pad("given", 0.9))

    pads = Pads(tmp_path)
    pads.load(tmp_path / "mine.json")

    assert pads.pad is not None
    assert pads.pad.name == "given"


def test_a_removed_pad_stays_away(tmp_path: Path) -> None:
    pads = Pads(tmp_path)
    pads.give(as_description(circle_pad("field", 1.2, 0.24)))
    pads.remove()
    pads.remove()

    again = Pads(tmp_path)
    again.load(None)

    assert pads.pad is None
    assert again.pad is None


def test_a_description_that_makes_no_sense_leaves_the_pad_as_it_was(tmp_path: Path) -> None:
    pads = Pads(tmp_path)
    kept = pads.give(as_description(circle_pad("field", 1.2, 0.24)))
    wrong = as_description(circle_pad("field", 1.2, 0.24))
    wrong["triples"][0]["radius_m"] = 1.0

    with pytest.raises(PadFileError, match=r"the pad's description.*make the side longer"):
        pads.give(wrong)

    assert pads.pad is kept
    assert json.loads((tmp_path / "pad.json").read_text()) == as_description(kept)


def test_a_start_with_an_unusable_description_is_refused(tmp_path: Path) -> None:
    (tmp_path / "pad.json").write_text("{")

    with pytest.raises(StartError, match=r"landing pad: .*nowhere\.json: no such file"):
        Pads(tmp_path).load(tmp_path / "nowhere.json")
    with pytest.raises(StartError, match=r"is not JSON.*remove .*pad\.json"):
        Pads(tmp_path).load(None)


@pytest.mark.parametrize("described", ["inside", "beside"])
def test_a_camera_file_may_describe_the_pad(tmp_path: Path, described: str) -> None:
    """As a flight.json does, with the survey that a replay uses."""
    pad = circle_pad("of the flight", 1.2, 0.24)
    write_pad(tmp_path / "mine.json", pad)
    section = as_description(pad) if described == "inside" else {"file": "mine.json"}
    camera = tmp_path / "flight.json"
    camera.write_text(
        json.dumps({"camera": {}, "pad": {**section, "lat_deg": 47.0, "lon_deg": 8.0, "alt_amsl_m": 4.0}})
    )

    pads = Pads(tmp_path / "data")
    pads.load(None, camera)

    assert pads.pad == pad


@pytest.mark.parametrize("section", ["mine.json", {"file": "nowhere.json"}, {"kind": "circles"}])
def test_a_camera_file_with_an_unusable_pad_is_refused(tmp_path: Path, section: object) -> None:
    camera = tmp_path / "flight.json"
    camera.write_text(json.dumps({"camera": {}, "pad": section}))

    with pytest.raises(StartError, match="landing pad: "):
        Pads(tmp_path / "data").load(None, camera)
