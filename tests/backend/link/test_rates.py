from backend.link.events import CommandResult, CommandStatus
from backend.link.rates import RateRequests

T_US = 1_760_000_000_000_000


def _answer(command_id: int, status: CommandStatus) -> CommandResult:
    return CommandResult(T_US, 1, command_id, 511, status, "")


def test_a_request_gives_the_interval() -> None:
    requests = RateRequests({105: 50.0})
    assert requests.begin() == [(105, 50.0)]

    assert requests.step(9, 105, 50.0).params == (105.0, 20_000.0)


def test_a_granted_rate_is_remembered() -> None:
    requests = RateRequests({105: 50.0})
    requests.step(9, 105, 50.0)

    assert requests.result(_answer(9, CommandStatus.ACCEPTED)) is None
    assert requests.granted_hz == {105: 50.0}


def test_a_refused_rate_is_halved_once() -> None:
    requests = RateRequests({105: 50.0})
    requests.step(9, 105, 50.0)
    assert requests.result(_answer(9, CommandStatus.DENIED)) == (105, 25.0)

    requests.step(10, 105, 25.0)
    assert requests.result(_answer(10, CommandStatus.DENIED)) is None


def test_an_autopilot_that_does_not_know_the_command_gets_streams() -> None:
    requests = RateRequests({105: 50.0})
    requests.step(9, 105, 50.0)
    requests.result(_answer(9, CommandStatus.UNSUPPORTED))

    assert requests.fell_back
    streams = requests.fallback_messages(3, 1)
    assert {m.req_stream_id for m in streams} == {1, 2, 6, 10, 11, 12}
    assert all((m.target_system, m.start_stop) == (3, 1) for m in streams)
    assert requests.fallback_messages(3, 1) == []


def test_one_unknown_message_among_granted_ones_is_no_reason_to_fall_back() -> None:
    requests = RateRequests({30: 25.0, 285: 10.0})
    requests.step(9, 30, 25.0)
    requests.step(10, 285, 10.0)
    requests.result(_answer(9, CommandStatus.ACCEPTED))
    requests.result(_answer(10, CommandStatus.UNSUPPORTED))

    assert not requests.fell_back
