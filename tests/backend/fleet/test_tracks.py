"""Track rings: pace, span, gaps."""

from backend.fleet.tracks import MAX_POINTS, TrackPoint, TrackRing


def point(t_s: float, epoch: int = 1) -> TrackPoint:
    return TrackPoint(round(t_s * 1e6), epoch, 47.0, 8.0, 500.0)


def test_five_points_a_second_are_kept_of_a_faster_source() -> None:
    ring = TrackRing()
    for n in range(1000):
        ring.add(point(n * 0.01))

    (piece,) = ring.pieces()

    assert 48 <= len(piece) <= 53  # ten seconds


def test_more_than_an_hour_at_five_a_second_fits() -> None:
    ring = TrackRing()
    for n in range(MAX_POINTS + 5000):
        ring.add(point(n * 0.2))

    (piece,) = ring.pieces()

    assert piece[-1].t_us - piece[0].t_us >= 3600e6


def test_gaps_and_epochs_cut_the_line() -> None:
    ring = TrackRing()
    for p in (point(0), point(1), point(20), point(21), point(21.1, epoch=2), point(22, epoch=2)):
        ring.add(p)

    assert [[round(p.t_us / 1e6, 1) for p in piece] for piece in ring.pieces()] == [[0, 1], [20, 21], [21.1, 22]]


def test_since_leaves_out_what_is_known() -> None:
    ring = TrackRing()
    for n in range(10):
        ring.add(point(n))

    assert [p.t_us for piece in ring.pieces(since_us=7_000_000) for p in piece] == [8_000_000, 9_000_000]


def test_time_running_backwards_adds_nothing() -> None:
    ring = TrackRing()
    ring.add(point(10))

    assert not ring.add(point(9))
