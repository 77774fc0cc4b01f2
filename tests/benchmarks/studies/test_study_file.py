"""Studies from TOML: a scenario changed in every row, and faults told with file, place and remedy."""

from __future__ import annotations

from pathlib import Path

import pytest

from benchmarks.studies.catalogue import STUDIES
from benchmarks.studies.study import FlownRow
from benchmarks.studies.study_file import StudyError, load_study


def written(tmp_path: Path, text: str) -> str:
    path = tmp_path / "mine.toml"
    path.write_text(text)
    return str(path)


def test_a_scenario_is_changed_in_every_row_and_only_where_said(tmp_path: Path) -> None:
    path = written(tmp_path, 'study = "odometry"\n[scenario.flight]\nheight_agl_m = [60, 70]\n')
    mine, base = load_study(path, True, STUDIES), STUDIES["odometry"](True)

    assert mine.name == "mine"
    assert len(mine.rows) == len(base.rows)
    for row, original in zip(mine.rows, base.rows, strict=True):
        assert isinstance(row, FlownRow)
        assert isinstance(original, FlownRow)
        assert row.scenario.flight.height_agl_m == (60.0, 70.0)
        assert row.scenario.flight.hover_stops == original.scenario.flight.hover_stops == 0
        assert row.scenario.duration_s == original.scenario.duration_s
        assert row.config == original.config


def test_rows_are_kept_by_name(tmp_path: Path) -> None:
    mine = load_study(written(tmp_path, 'study = "ladder"\nname = "two"\nrows = ["+ rays", "2009"]\n'), True, STUDIES)

    assert [row.name for row in mine.rows] == ["+ rays", "2009"]
    assert mine.name == "two"


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("study = ", "not TOML"),
        ("seeds = 3\n", "study"),
        ('study = "ladder"\nspeed = 3\n', "speed"),
        ('study = "ladder"\nname = "../x"\n', "name"),
        ('study = "lader"\n', "lader.*ladder"),
        ('study = "ladder"\nrows = ["2007"]\n', "2007.*2009"),
        ('study = "ladder"\nrows = []\n', "rows is empty"),
        ('study = "ladder"\n[scenario.flight]\nspeed_m_s = -1\n', r"flight\.speed_m_s"),
        ('study = "ladder"\n[scenario.camera]\nzoom = 2\n', r"camera\.zoom"),
        ('study = "altitude"\n[scenario]\nduration_s = 9\n', "flies no scenario"),
    ],
)
def test_faults_are_told_with_file_and_place(text: str, told: str, tmp_path: Path) -> None:
    with pytest.raises(StudyError, match=told) as error:
        load_study(written(tmp_path, text), True, STUDIES)
    assert "mine.toml" in str(error.value)


def test_what_is_no_text_is_told(tmp_path: Path) -> None:
    path = tmp_path / "mine.toml"
    path.write_bytes(b"\xff\xfe\x00")
    with pytest.raises(StudyError, match="not TOML"):
        load_study(str(path), True, STUDIES)
