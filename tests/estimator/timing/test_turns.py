import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.geometry.rotation import q_from_rotvec, q_multiply
from estimator.timing.turns import TurnTrack

T_S = np.arange(0.0, 10.0, 0.05)


def _rates(t_s: np.ndarray) -> np.ndarray:
    return np.stack((0.4 * np.sin(2.0 * t_s), 0.2 * np.cos(3.0 * t_s), np.full_like(t_s, 0.3)), axis=-1)


def _attitudes(t_s: np.ndarray) -> np.ndarray:
    """The same turn composed in steps of a millisecond, each about the body's axes of the moment."""
    fine_s = np.arange(0.0, t_s[-1] + 1e-9, 0.001)
    q = np.array([1.0, 0.0, 0.0, 0.0])
    every = round((t_s[1] - t_s[0]) / 0.001)
    out = [q]
    for index, rate in enumerate(_rates(fine_s[:-1] + 0.0005), start=1):
        q = q_multiply(q, q_from_rotvec(rate * 0.001))
        if index % every == 0:
            out.append(q)
    return np.array(out[: len(t_s)])


def _angles(first_s: np.ndarray, second_s: np.ndarray) -> np.ndarray:
    """The integral of the rates, by hand."""
    return np.stack(
        (
            -0.2 * (np.cos(2.0 * second_s) - np.cos(2.0 * first_s)),
            0.2 / 3.0 * (np.sin(3.0 * second_s) - np.sin(3.0 * first_s)),
            0.3 * (second_s - first_s),
        ),
        axis=-1,
    )


def _made(how: str) -> TurnTrack:
    if how == "rates":
        track = TurnTrack.from_rates(T_S, _rates(T_S), 0.5)
    else:
        track = TurnTrack.from_attitudes(T_S, _attitudes(T_S), _rates(T_S) if how == "both" else None, 0.5)
    assert track is not None
    return track


@pytest.mark.parametrize("how", ["rates", "attitudes", "both"])
def test_turn_is_the_integral_of_the_rate(how: str) -> None:
    first = np.linspace(0.5, 9.0, 40)
    track = _made(how)

    # coning of the attitudes' steps, third order in 0.05 s, stays below this
    assert_allclose(track.turned(first, first + 0.08), _angles(first, first + 0.08), atol=2e-5)
    assert_allclose(track.rate(first), _rates(first), atol=2e-3)


def test_gap_is_not_bridged() -> None:
    kept = (T_S < 4.0) | (T_S > 5.0)
    track = TurnTrack.from_rates(T_S[kept], _rates(T_S[kept]), 0.5)
    assert track is not None
    first = np.array([3.0, 3.9, 4.2, 4.9, 5.2, -0.1, 9.9])

    assert track.covers(first, first + 0.2).tolist() == [True, False, False, False, True, False, False]


def test_noise_of_the_rates_is_measured() -> None:
    rng = np.random.default_rng(1)
    track = TurnTrack.from_rates(T_S, _rates(T_S) + rng.normal(0.0, (0.01, 0.02, 0.03), size=(len(T_S), 3)), 0.5)
    assert track is not None

    # 200 knots: a median deviation is good to about 10 %
    assert_allclose(track.rate_noise_rad_s, (0.01, 0.02, 0.03), rtol=0.3)
    assert track.interval_s == pytest.approx(0.05)


def test_too_few_knots_give_nothing() -> None:
    assert TurnTrack.from_rates(T_S[:3], _rates(T_S[:3]), 0.5) is None
    assert TurnTrack.from_attitudes(T_S[:3], _attitudes(T_S[:3]), None, 0.5) is None
