from backend.link.sources import SourceSelector

BEST, SECOND = 105, 27


def _run(selector: SourceSelector, periods_us: dict[int, int], start_us: int, end_us: int) -> list[tuple[int, int]]:
    stamps = sorted((t, i) for i, period in periods_us.items() for t in range(start_us, end_us, period))
    return [(t, i) for t, i in stamps if selector.accept(i, t)]


def _selector() -> SourceSelector:
    return SourceSelector((BEST, SECOND), enough_interval_us=50_000)


def test_the_best_of_two_frequent_ones_is_used_alone() -> None:
    used = _run(_selector(), {BEST: 20_000, SECOND: 20_000}, 0, 5_000_000)

    assert {i for t, i in used if t > 1_000_000} == {BEST}


def test_the_other_takes_over_after_a_second_of_silence() -> None:
    selector = _selector()
    _run(selector, {BEST: 20_000, SECOND: 20_000}, 0, 5_000_000)
    used = _run(selector, {SECOND: 20_000}, 5_000_000, 8_000_000)

    assert 5_900_000 < used[0][0] < 6_100_000
    assert len(used) > 90


def test_the_best_is_taken_again_when_it_returns() -> None:
    selector = _selector()
    _run(selector, {SECOND: 20_000}, 0, 5_000_000)
    used = _run(selector, {BEST: 20_000, SECOND: 20_000}, 5_000_000, 8_000_000)

    assert {i for t, i in used if t > 6_500_000} == {BEST}


def test_a_slow_best_gives_way_to_a_frequent_second() -> None:
    """A plane streams RAW_IMU at 4 Hz beside SCALED_IMU at 25 Hz."""
    used = _run(_selector(), {BEST: 250_000, SECOND: 40_000}, 0, 10_000_000)

    assert {i for t, i in used if t > 4_000_000} == {SECOND}


def test_equally_slow_ones_do_not_flap() -> None:
    used = _run(_selector(), {BEST: 500_000, SECOND: 400_000}, 0, 20_000_000)

    assert len({i for t, i in used if t > 5_000_000}) == 1
