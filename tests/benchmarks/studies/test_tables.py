"""Pages say what was run and what failed; JSON has no number that JSON does not know."""

from __future__ import annotations

import json
from pathlib import Path

from benchmarks.studies.run import Result
from benchmarks.studies.study import Column, ComputedRow, Study
from benchmarks.studies.tables import table, write_results

STUDY = Study(
    "s", "A title", "What it is about.", (ComputedRow("r", "c", lambda _: {}),),
    (Column("rms, m", "rms_m"), Column("share", "share", 1, percent=True)), "rms_m", "rms, m",
)  # fmt: skip
RESULTS = [
    Result("first", "nothing", {"rms_m": 1.234, "share": 0.987, "seeds": 2}, {}),
    Result("second", "all", {"rms_m": float("inf"), "seeds": 1}, {4: "no estimate"}),
]


def test_a_row_for_each_result_and_a_dash_for_what_is_not_known() -> None:
    lines = table(STUDY, RESULTS).splitlines()

    assert lines[0] == "| row | what changes | rms, m | share |"
    assert lines[2] == "| first | nothing | 1.23 | 98.7 % |"
    assert lines[3] == "| second (1 failed) | all | – | – |"


def test_page_and_json_say_what_was_run(tmp_path: Path) -> None:
    page = write_results(STUDY, RESULTS, "pilotage monte-carlo s --seeds 3-4", [3, 4], tmp_path / "new" / "folder")
    text = page.read_text()

    assert "Run: `pilotage monte-carlo s --seeds 3-4`, 2 seeds (3 to 4)." in text
    assert "* second, seed 4: no estimate" in text

    def refuse(constant: str) -> None:
        raise AssertionError(constant)

    stored = json.loads(page.with_suffix(".json").read_text(), parse_constant=refuse)
    assert stored["rows"][0]["figures"]["rms_m"] == 1.234
    assert stored["rows"][1]["figures"]["rms_m"] is None
    assert stored["rows"][1]["failures"] == {"4": "no estimate"}
    assert stored["seeds"] == [3, 4]


def test_seeds_that_are_no_range_are_listed(tmp_path: Path) -> None:
    assert "3 seeds (1, 2, 5)" in write_results(STUDY, RESULTS, "c", [1, 2, 5], tmp_path).read_text()
