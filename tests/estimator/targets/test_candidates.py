"""What candidates do over several pictures."""

import numpy as np
import pytest

from estimator.targets.candidates import Candidate, Chain, Going, Pursuit
from estimator.targets.search import Match
from estimator.targets.tracker_config import TrackerConfig
from estimator.types import Float

NORTHWARD = Going(np.array([0.0, -10.0]), 3.5, True, True)


def _chain(vel_m_s: Float, seconds: float) -> Chain:
    """One that has gone evenly, judged by its last second."""
    one = Candidate(Match(np.zeros(2), np.eye(2), 0.45, 0.0, 1.0), 6.0, float("nan"), np.zeros(2))
    times_s = np.linspace(seconds - 1.0, seconds, 6)
    path = [vel_m_s * t for t in times_s]
    return Chain([round(1e6 * t) for t in times_s], [one] * 6, path, [])


@pytest.mark.parametrize(
    ("vel_m_s", "seconds", "as_expected"),
    [
        ((1.0, -9.0), 2.0, True),
        ((1.0, -9.0), 1.2, False),  # not far enough
        ((-1.0, 9.0), 3.0, False),  # comes the other way
        ((9.0, -3.0), 3.0, False),  # crosses
    ],
)
def test_a_car_is_known_by_the_way_it_has_come_where_the_target_was_going(
    vel_m_s: tuple[float, float], seconds: float, as_expected: bool
) -> None:
    pursuit = Pursuit(TrackerConfig())
    assert pursuit.drives_as_expected(_chain(np.array(vel_m_s), seconds), NORTHWARD) is as_expected


def test_what_stands_tells_how_fast_the_ground_seems_to_move() -> None:
    pursuit = Pursuit(TrackerConfig())
    pursuit.ground_m_s = np.array([0.0, -3.0])
    assert pursuit.drives_as_expected(_chain(np.array([0.0, -16.5]), 2.0), NORTHWARD)
    pursuit.ground_m_s = np.zeros(2)
    assert not pursuit.drives_as_expected(_chain(np.array([0.0, -16.5]), 2.0), NORTHWARD)
