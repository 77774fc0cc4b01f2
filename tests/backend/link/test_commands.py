import math
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from backend.link.commands import CommandChannel, CommandStep
from backend.link.events import CommandStatus

T_US = 1_760_000_000_000_000
SECOND_US = 1_000_000
ARM, MODE = 400, 176


def _ack(command: int, result: int, progress: int = 255) -> Any:
    return dialect.MAVLink_command_ack_message(command, result, progress, 0, 255, 190)


def _channel(*steps: CommandStep) -> CommandChannel:
    channel = CommandChannel(1, 1)
    channel.start(5, steps)
    return channel


def test_an_accepted_command() -> None:
    channel = _channel(CommandStep(ARM, (1.0,)))
    (message,), results = channel.tick(T_US)
    assert (message.command, message.param1, message.param7, message.confirmation) == (ARM, 1.0, 0.0, 0)
    assert results == []

    ((result, quiet),) = channel.acknowledge(_ack(ARM, 0), T_US + 100)
    assert (result.command_id, result.status, result.final, quiet) == (5, CommandStatus.ACCEPTED, True, False)
    assert result.text == "COMPONENT_ARM_DISARM: accepted"
    assert channel.tick(T_US + 60 * SECOND_US) == ([], [])


def test_lost_packets_are_repeated_then_given_up() -> None:
    channel = _channel(CommandStep(ARM, (1.0,)))
    confirmations, ended = [], []
    for i in range(100):
        messages, results = channel.tick(T_US + i * SECOND_US // 10)
        confirmations += [message.confirmation for message in messages]
        ended += [result for result, _ in results]

    assert confirmations == [0, 1, 2, 3]
    assert [result.status for result in ended] == [CommandStatus.TIMEOUT]
    assert channel.acknowledge(_ack(ARM, 0), T_US + 100 * SECOND_US) == []


@pytest.mark.parametrize(
    ("result", "status"),
    [
        (1, CommandStatus.TEMPORARILY_REJECTED),
        (2, CommandStatus.DENIED),
        (3, CommandStatus.UNSUPPORTED),
        (4, CommandStatus.FAILED),
        (6, CommandStatus.CANCELLED),
        (99, CommandStatus.FAILED),
    ],
)
def test_refusals_end_a_command(result: int, status: CommandStatus) -> None:
    channel = _channel(CommandStep(MODE), CommandStep(ARM))
    channel.tick(T_US)

    assert [r.status for r, _ in channel.acknowledge(_ack(MODE, result), T_US)] == [status]
    assert channel.tick(T_US + SECOND_US) == ([], [])


def test_progress_lengthens_the_wait_and_stops_the_repeats() -> None:
    channel = _channel(CommandStep(ARM))
    channel.tick(T_US)
    ((progress, _),) = channel.acknowledge(_ack(ARM, 5, progress=40), T_US + SECOND_US)
    assert (progress.status, progress.progress_pct, progress.final) == (CommandStatus.IN_PROGRESS, 40, False)

    assert channel.tick(T_US + 20 * SECOND_US) == ([], [])
    assert [r.status for r, _ in channel.tick(T_US + 32 * SECOND_US)[1]] == [CommandStatus.TIMEOUT]


def test_steps_follow_each_other_and_end_in_one_result() -> None:
    channel = _channel(CommandStep(MODE, (1.0, 4.0)), CommandStep(ARM, (1.0,)))
    (first,), _ = channel.tick(T_US)
    assert first.command == MODE
    assert channel.acknowledge(_ack(MODE, 0), T_US + 1) == []

    (second,), _ = channel.tick(T_US + 2)
    assert second.command == ARM
    assert [r.command_id for r, _ in channel.acknowledge(_ack(ARM, 0), T_US + 3)] == [5]


def test_two_of_one_number_wait_for_each_other_and_others_do_not() -> None:
    channel = _channel(CommandStep(ARM, (1.0,)))
    channel.start(6, [CommandStep(ARM, (0.0,))])
    channel.start(7, [CommandStep(MODE)])
    messages, _ = channel.tick(T_US)
    assert [(m.command, m.param1) for m in messages] == [(ARM, 1.0), (MODE, 0.0)]

    assert [r.command_id for r, _ in channel.acknowledge(_ack(ARM, 0), T_US)] == [5]
    (message,), _ = channel.tick(T_US)
    assert (message.command, message.param1) == (ARM, 0.0)


def test_the_integer_form() -> None:
    step = CommandStep(192, (-1.0, 1.0, 0.0, math.nan, 583_000_000.0, math.nan, 120.0), frame=0)
    (message,), _ = _channel(step).tick(T_US)

    assert message.get_type() == "COMMAND_INT"
    assert (message.frame, message.x, message.y, message.z) == (0, 583_000_000, 2**31 - 1, 120.0)
    assert math.isnan(message.param4)


def test_misuse_is_refused() -> None:
    with pytest.raises(ValueError, match="8 parameters"):
        CommandStep(ARM, (0.0,) * 8)
    with pytest.raises(ValueError, match="32 bits"):
        CommandStep(192, (0.0, 0.0, 0.0, 0.0, 5e9, 0.0), frame=0)
    with pytest.raises(ValueError, match="at least one step"):
        _channel()


def test_a_lost_vehicle_ends_every_command() -> None:
    channel = _channel(CommandStep(ARM))
    channel.start(6, [CommandStep(ARM)])
    channel.tick(T_US)

    assert {(r.command_id, r.status) for r, _ in channel.abandon(T_US)} == {
        (5, CommandStatus.TIMEOUT),
        (6, CommandStatus.TIMEOUT),
    }
