"""Every study can be built, and the ladder is one: a change a rung, from the published system to the defaults."""

from __future__ import annotations

import itertools
from dataclasses import asdict

import pytest

from benchmarks.studies.catalogue import STUDIES, rungs
from benchmarks.studies.study import ComputedRow, FlownRow
from estimator.navigator import NavigatorConfig
from estimator.registration.likelihood import LikelihoodForm


@pytest.mark.parametrize("short", [False, True])
@pytest.mark.parametrize("name", sorted(STUDIES))
def test_every_study_can_be_built_and_its_rows_differ(name: str, short: bool) -> None:
    study = STUDIES[name](short)

    assert study.name == name
    names = [row.name for row in study.rows]
    assert len(set(names)) == len(names) >= 3
    flown = [f"{row.scenario} {row.config} {row.degrade}" for row in study.rows if isinstance(row, FlownRow)]
    assert len(set(flown)) == len(flown)
    assert all("|" not in row.name + row.change for row in study.rows), "a bar would break the table"


def test_short_studies_fly_less() -> None:
    for build in STUDIES.values():
        full, short = build(False), build(True)
        seconds = [sum(r.scenario.duration_s for r in s.rows if isinstance(r, FlownRow)) for s in (full, short)]
        computed = [sum(isinstance(r, ComputedRow) for r in s.rows) for s in (full, short)]
        assert seconds[1] < seconds[0] or computed[1] < computed[0]


def test_the_ladder_begins_in_2009_and_ends_with_the_defaults() -> None:
    first, *_, last = rungs()

    assert last[2] == NavigatorConfig()
    config = first[2]
    assert config.matcher.channels == "intensity"
    assert config.matcher.calibration is not None
    assert config.matcher.calibration.likelihood.form is LikelihoodForm.SIMILARITY
    assert not config.map_fix.couple_attitude
    assert config.odometry.method == "homography"


def test_each_rung_changes_one_section_of_the_configuration() -> None:
    configurations = [asdict(config) for _, _, config in rungs()]
    for before, after in itertools.pairwise(configurations):
        changed = {name for name in before if before[name] != after[name]}
        # the reported attitude's sigma goes with the state of its slow error
        assert len(changed - {"reported_attitude_std_rad"}) == 1
