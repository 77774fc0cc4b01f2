from collections.abc import Iterator

import numpy as np
import pytest

from estimator.measurements import contenders
from estimator.measurements.contenders import Contenders, ContestConfig, GroundSeen, Searched, log_priors
from estimator.measurements.hypothesis import Fit, Piece
from estimator.odometry.mosaic import Mosaic
from estimator.registration.global_search import EdgeMap, Place, SearchConfig, Template
from estimator.registration.near_match import NearMatcher
from tests.estimator.wide_map import WideMap

SEARCH = SearchConfig(cell_m=3.0)
MATCHER = NearMatcher(EdgeMap(WideMap(3), SEARCH))
CONFIG = ContestConfig(accept_log_ratio=8.0, lead_log_ratio=5.0, min_pieces=3, reject_log_ratio=-4.0)
HERE, THERE = Place(np.array([50.0, 20.0]), 0.3, 1.0, 8.0), Place(np.array([-150.0, 20.0]), 1.3, 1.0, 7.0)


def _seen(number: int) -> GroundSeen:
    """A square of ground 100 m north of the one before."""
    mosaic = Mosaic(np.zeros((30, 30), np.float32), np.ones((30, 30), bool), np.array([100.0 * number, 0.0]), 1.0)
    template = Template(np.zeros((30, 30), np.float32), mosaic.known, np.array([15.0, 15.0]), 1.0, 15.0)
    piece = Piece(template, mosaic.place_m(template.centre_px), 60.0, 300.0, 1.0)
    return GroundSeen(mosaic, piece, 60.0, 300.0)


@pytest.fixture
def says(monkeypatch: pytest.MonkeyPatch) -> Iterator[dict[str, float | None]]:
    """What each piece of ground says of the hypotheses about ``HERE`` and elsewhere; None: off the map."""
    gains: dict[str, float | None] = {"here": 3.0, "there": -1.5}

    def followed(fit: Fit, *_: object) -> tuple[Fit, float] | None:
        gain = gains["here" if abs(fit.turn_rad - HERE.heading_rad) < 0.1 else "there"]
        return None if gain is None else (fit, gain)

    monkeypatch.setattr(contenders, "followed", followed)
    monkeypatch.setattr(contenders, "piece_of", lambda *_: _seen(0).piece)
    yield gains


def _contest(stretches: int) -> Contenders:
    """Both places, searched on the second and third stretch."""
    contest = Contenders(MATCHER, lambda _: 240.0, SEARCH, CONFIG)
    for number in range(stretches):
        contest.see(_seen(number))
    searched = Searched(_seen(1).fresh, 1, 2)
    contest.propose([HERE, THERE], searched, 0.0j)
    return contest


def _settle(contest: Contenders) -> int:
    steps = 0
    while contest.step():
        steps += 1
    return steps


def test_ground_before_and_after_the_search_counts_and_none_of_the_search(says: dict[str, float | None]) -> None:
    contest = _contest(5)
    # two stretches after, one before
    assert _settle(contest) == 6
    best = contest.best
    assert best is not None
    assert (best.compared, best.agreeing) == (3, 3)
    assert best.log_ratio == pytest.approx(9.0 + log_priors(2)[0])


def test_the_one_that_is_proved_is_accepted_and_not_before(says: dict[str, float | None]) -> None:
    contest = _contest(4)
    _settle(contest)
    assert contest.accepted(0.0j) is None
    contest.see(_seen(4))
    _settle(contest)
    best = contest.accepted(0.0j)
    assert best is not None
    assert best.ahead.turn_rad == pytest.approx(HERE.heading_rad)


def test_a_rival_as_good_holds_it_back(says: dict[str, float | None]) -> None:
    """
    Fault: two places look the same, as in a suburb laid out twice.
    Expected: none is believed.
    """
    says["there"] = 2.9
    contest = _contest(9)
    _settle(contest)
    assert contest.best is not None
    assert contest.best.log_ratio > CONFIG.accept_log_ratio
    assert contest.accepted(0.0j) is None


def test_few_pieces_prove_nothing_however_strong(says: dict[str, float | None]) -> None:
    says["here"] = 30.0
    contest = _contest(4)
    _settle(contest)
    assert contest.best is not None
    assert contest.best.log_ratio > CONFIG.accept_log_ratio
    assert contest.accepted(0.0j) is None


def test_the_refuted_and_those_off_the_map_are_dropped(says: dict[str, float | None]) -> None:
    says["here"], says["there"] = None, -2.5
    contest = _contest(6)
    _settle(contest)
    assert contest.left == []
    assert contest.best is None


def test_a_new_search_keeps_who_promises(says: dict[str, float | None]) -> None:
    says["there"] = -1.0
    contest = _contest(4)
    _settle(contest)
    before = contest.best
    contest.propose([HERE, THERE], Searched(_seen(2).fresh, 2, 3), 0.0j)
    assert before in contest.left
    # and THERE, which promised nothing, only as it is found anew
    assert len(contest.left) == 3


def test_one_that_has_drifted_does_not_keep_out_what_is_found_anew(monkeypatch: pytest.MonkeyPatch) -> None:
    """
    Fault: a hypothesis follows a scale that is wrong and lies 25 m off when a search finds its place again.
    Expected: the place found is a hypothesis too, and the one that is left when ground speaks for it.
    """
    found = complex(*HERE.centre_ne_m)

    def followed(fit: Fit, *_: object) -> tuple[Fit, float]:
        return fit, 4.0 if abs(fit.anchor_ne_m - found) < 5.0 else 1.5

    monkeypatch.setattr(contenders, "followed", followed)
    monkeypatch.setattr(contenders, "piece_of", lambda *_: _seen(0).piece)
    contest = Contenders(MATCHER, lambda _: 240.0, SEARCH, CONFIG)
    for number in range(5):
        contest.see(_seen(number))
    drifted = Place(HERE.centre_ne_m + 15.0 * np.sqrt(2.0), HERE.heading_rad, 1.1, 7.0)
    contest.propose([drifted], Searched(_seen(0).fresh, 0, 1), 0.0j)
    _settle(contest)
    contest.propose([HERE], Searched(_seen(4).fresh, 3, 4), 0.0j)
    assert len(contest.left) == 2
    _settle(contest)
    best = contest.accepted(0.0j)
    assert best is not None
    assert best.ahead.anchor_ne_m == pytest.approx(found)
    contest.propose([THERE], Searched(_seen(4).fresh, 3, 4), 0.0j)
    assert [one.ahead.turn_rad for one in contest.left] == pytest.approx([HERE.heading_rad, THERE.heading_rad])
    assert contest.left[0] is best


def test_ranks_are_a_likelihood_ratio() -> None:
    """Weighted by how often a false place has each rank, all alike, ratios are one on average; they fall."""
    ratios = np.exp(log_priors(80))
    assert ratios.mean() == pytest.approx(1.0)
    assert (np.diff(ratios) < 0.0).all()
