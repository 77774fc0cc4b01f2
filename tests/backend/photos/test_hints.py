from pathlib import Path

import pytest

from backend.photos.hints import HintError, Hints, hints_of_photo, read_priors
from geodata.errors import FlightFolderError
from geodata.photo import PhotoMeta


def test_what_is_said_first_wins_and_kinds_do_not_mix() -> None:
    line = Hints(lat_deg=41.0, lon_deg=-83.0, sigma_m=20.0, alt_amsl_m=300.0)
    option = Hints(lat_deg=1.0, lon_deg=2.0, radius_m=100.0, agl_m=60.0, hfov_deg=70.0)

    both = line.over(option)

    assert (both.lat_deg, both.lon_deg, both.hfov_deg) == (41.0, -83.0, 70.0)
    # a bound and a deviation, or two heights, would contradict each other
    assert (both.sigma_m, both.radius_m) == (20.0, None)
    assert (both.alt_amsl_m, both.agl_m) == (300.0, None)


@pytest.mark.parametrize("wrong", [
    {"lat_deg": 91.0, "lon_deg": 0.0}, {"lat_deg": 41.0}, {"agl_m": -3.0}, {"pitch_deg": 10.0}, {"hfov_deg": 400.0},
])  # fmt: skip
def test_values_out_of_range_are_named(wrong: dict[str, float]) -> None:
    with pytest.raises(HintError, match=next(iter(wrong)) if len(wrong) == 1 and "lat_deg" not in wrong else "l"):
        Hints(**wrong)


def test_a_photos_own_position_counts_only_where_it_is_asked_for() -> None:
    meta = PhotoMeta(4000, 3000, lat_deg=46.8, lon_deg=-92.0, alt_amsl_m=198.0, rel_alt_m=40.0, pitch_deg=-90.3)

    assert hints_of_photo(meta, use_gps=False).lat_deg is None
    with_gps = hints_of_photo(meta, use_gps=True)
    assert (with_gps.lat_deg, with_gps.agl_m, with_gps.alt_amsl_m, with_gps.pitch_deg) == (46.8, 40.0, None, -90.0)
    assert not with_gps.attitude_is_known


def test_priors_are_read_by_photo_and_empty_cells_are_unknown(tmp_path: Path) -> None:
    table = tmp_path / "priors.csv"
    table.write_text("photo,lat_deg,lon_deg,radius_m,agl_m,heading_deg\na.jpg,41.0,-83.0,100,63,\nsub/b.jpg,,,,60,90\n")

    priors = read_priors(table)

    assert priors["a.jpg"] == Hints(lat_deg=41.0, lon_deg=-83.0, radius_m=100.0, agl_m=63.0)
    assert priors["b.jpg"] == Hints(agl_m=60.0, heading_deg=90.0)


@pytest.mark.parametrize(("text", "problem"), [
    ("photo,lat_deg,lon_deg\na.jpg,north,5\n", "'north' is not a number"),
    ("photo,lat_deg,lon_deg\na.jpg,95,5\n", "line 2: lat_deg is -90 to 90"),
    ("file,lat_deg\na.jpg,95\n", "no column photo"),
])  # fmt: skip
def test_a_bad_table_is_told_by_its_line(tmp_path: Path, text: str, problem: str) -> None:
    table = tmp_path / "priors.csv"
    table.write_text(text)

    with pytest.raises((HintError, FlightFolderError), match=problem):
        read_priors(table)
