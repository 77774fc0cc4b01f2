"""Commands to one vehicle: one at a time per command number, repeated until acknowledged, with a result for each.

COMMAND_ACK names only the command's number, so two of the same number cannot be in flight together: the second waits.
"""

from __future__ import annotations

import math
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as _dialect

from backend.link.dialect import INT32_MAX, command_name
from backend.link.events import CommandResult, CommandStatus

_ACK_TIMEOUT_US = 1_500_000
_ATTEMPTS = 4
_PROGRESS_TIMEOUT_US = 30_000_000
_ACCEPTED, _IN_PROGRESS = 0, 5
RESULTS = {
    0: CommandStatus.ACCEPTED,
    1: CommandStatus.TEMPORARILY_REJECTED,
    2: CommandStatus.DENIED,
    3: CommandStatus.UNSUPPORTED,
    4: CommandStatus.FAILED,
    5: CommandStatus.IN_PROGRESS,
    6: CommandStatus.CANCELLED,
}
_PARAMETERS = 7


@dataclass(frozen=True, slots=True)
class CommandStep:
    """One MAV_CMD. ``params`` are parameters 1 to 7, short ones filled with 0.

    With ``frame`` (MAV_FRAME) it is sent as COMMAND_INT and parameters 5 and 6 are integers (degrees times 1e7 for a
    position); without, as COMMAND_LONG.
    """

    command: int
    params: tuple[float, ...] = ()
    frame: int | None = None

    def __post_init__(self) -> None:
        if len(self.params) > _PARAMETERS:
            message = f"command {self.command}: {len(self.params)} parameters given, MAVLink has {_PARAMETERS}"
            raise ValueError(message)
        if self.frame is not None and any(abs(value) > INT32_MAX for value in self.params[4:6]):
            message = f"command {self.command}: parameters 5 and 6 exceed 32 bits: {self.params[4:6]}"
            raise ValueError(message)


@dataclass(slots=True)
class _Running:
    command_id: int
    steps: deque[CommandStep]
    quiet: bool
    attempts: int = 0
    deadline_us: int = 0

    @property
    def step(self) -> CommandStep:
        return self.steps[0]


@dataclass(slots=True)
class CommandChannel:
    """The commands in flight to one vehicle; sans I/O: messages to send are given to the caller."""

    system_id: int
    component_id: int
    _waiting: deque[_Running] = field(default_factory=deque)
    _running: dict[int, _Running] = field(default_factory=dict)

    def start(self, command_id: int, steps: Sequence[CommandStep], *, quiet: bool = False) -> None:
        """Queue a command of one or more steps, each sent when the one before was accepted.

        ``quiet`` ones are the link's own: their results go to the caller, not to the user.
        """
        if not steps:
            message = "a command needs at least one step"
            raise ValueError(message)
        self._waiting.append(_Running(command_id, deque(steps), quiet))

    def tick(self, t_us: int) -> tuple[list[Any], list[tuple[CommandResult, bool]]]:
        """Messages to send now, and the commands given up, each with whether it is quiet."""
        messages: list[Any] = []
        results: list[tuple[CommandResult, bool]] = []
        for number, running in list(self._running.items()):
            if t_us < running.deadline_us:
                continue
            if running.attempts >= _ATTEMPTS:
                del self._running[number]
                results.append((self._result(t_us, running, CommandStatus.TIMEOUT), running.quiet))
            else:
                messages.append(self._send(running, t_us))
        for running in list(self._waiting):
            if running.step.command not in self._running:
                self._waiting.remove(running)
                self._running[running.step.command] = running
                messages.append(self._send(running, t_us))
        return messages, results

    def acknowledge(self, m: Any, t_us: int) -> list[tuple[CommandResult, bool]]:
        """Take a COMMAND_ACK from the vehicle; one that answers nothing of ours gives nothing."""
        running = self._running.get(m.command)
        if running is None:
            return []
        status = RESULTS.get(m.result, CommandStatus.FAILED)
        if status is CommandStatus.IN_PROGRESS:
            running.deadline_us = t_us + _PROGRESS_TIMEOUT_US
            running.attempts = _ATTEMPTS
            progress = None if m.progress > 100 else m.progress
            return [(self._result(t_us, running, status, progress), running.quiet)]
        del self._running[m.command]
        if status is CommandStatus.ACCEPTED and len(running.steps) > 1:
            running.steps.popleft()
            running.attempts = 0
            self._waiting.appendleft(running)
            return []
        return [(self._result(t_us, running, status), running.quiet)]

    def abandon(self, t_us: int) -> list[tuple[CommandResult, bool]]:
        """The vehicle is gone: every open command ends with a time-out."""
        open_commands = [*self._running.values(), *self._waiting]
        self._running.clear()
        self._waiting.clear()
        return [(self._result(t_us, running, CommandStatus.TIMEOUT), running.quiet) for running in open_commands]

    def clock_set_back(self, t_us: int) -> None:
        """The station's clock was set back to ``t_us``: repeat what is in flight at the usual time from there."""
        for running in self._running.values():
            running.deadline_us = min(running.deadline_us, t_us + _ACK_TIMEOUT_US)

    def _send(self, running: _Running, t_us: int) -> Any:
        running.deadline_us = t_us + _ACK_TIMEOUT_US
        step = running.step
        params = [*step.params, *([0.0] * (_PARAMETERS - len(step.params)))]
        confirmation = running.attempts
        running.attempts += 1
        if step.frame is None:
            return _dialect.MAVLink_command_long_message(
                self.system_id, self.component_id, step.command, confirmation, *params
            )
        x, y = (INT32_MAX if math.isnan(value) else round(value) for value in params[4:6])
        return _dialect.MAVLink_command_int_message(
            self.system_id, self.component_id, step.frame, step.command, 0, 0, *params[:4], x, y, params[6]
        )

    def _result(
        self, t_us: int, running: _Running, status: CommandStatus, progress_pct: int | None = None
    ) -> CommandResult:
        number = running.step.command
        name = command_name(number)
        what = {
            CommandStatus.TIMEOUT: "no answer from the vehicle",
            CommandStatus.ACCEPTED: "accepted",
            CommandStatus.IN_PROGRESS: "in progress",
        }.get(status, f"{status.value.replace('_', ' ')} by the vehicle")
        return CommandResult(t_us, self.system_id, running.command_id, number, status, f"{name}: {what}", progress_pct)
