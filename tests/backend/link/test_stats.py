from backend.link.stats import PacketStats


def _count(stats: PacketStats, seqs: list[int], component_id: int = 1) -> None:
    for seq in seqs:
        stats.count(component_id, seq % 256, 20, 30, signed=False, version=2)


def test_losses_are_gaps_in_the_sequence() -> None:
    stats = PacketStats()
    _count(stats, [250, 251, 254, 255, 0, 3])
    stats.close_second()

    assert stats.lost == 4
    assert stats.loss_pct() == 40.0


def test_each_component_counts_for_itself() -> None:
    stats = PacketStats()
    _count(stats, [1, 2, 3], component_id=1)
    _count(stats, [77, 78], component_id=154)

    assert stats.lost == 0


def test_an_overtaken_packet_is_no_loss() -> None:
    stats = PacketStats()
    _count(stats, [10, 12, 11, 13])

    assert stats.lost == 1


def test_rates_are_of_the_last_five_seconds() -> None:
    stats = PacketStats()
    for per_second in (100, 100, 10, 10, 10, 10, 10):
        _count(stats, list(range(per_second)))
        stats.close_second()

    assert stats.rates_hz() == {30: 10.0}
    assert stats.messages_per_s() == 10.0
    assert stats.bytes_per_s() == 200.0


def test_numbers_start_anywhere_after_a_silence() -> None:
    stats = PacketStats()
    _count(stats, [1, 2])
    stats.forget_sequence()
    _count(stats, [100, 101])

    assert stats.lost == 0
