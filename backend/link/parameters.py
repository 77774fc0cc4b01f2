"""Parameters of one vehicle by name: read and written one at a time, repeated until answered. Sans I/O.

MAVLink's parameter protocol (mavlink.io, "Parameter Protocol"). The value travels in a float: PX4 puts the bytes of an
integer into it, ArduPilot the number. A name that the vehicle does not know is not answered at all by ArduPilot, so
that silence to the end of the repeats, from a vehicle that lives, means "not known". Names change between versions:
where a name is not known its other spelling is tried.
"""

from __future__ import annotations

import math
import struct
from collections import deque
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as _dialect

from backend.link.events import Autopilot, ParameterNews, ParameterStatus

PARAM_VALUE = 22
MAX_NAME = 16
_ANSWER_TIMEOUT_US = 1_000_000
_ATTEMPTS = 3
# One after the other over a radio takes half a second each; so many in flight still leave the link to the rest.
_IN_FLIGHT = 4
_REAL32 = 9
_SINGLE_STEPS = 2.0**24
# MAV_PARAM_TYPE to struct's format of the value's bytes, the rest of the four zero.
_FORMATS = {1: "<Bxxx", 2: "<bxxx", 3: "<Hxx", 4: "<hxx", 5: "<I", 6: "<i", _REAL32: "<f"}
_RANGES = {
    1: (0, 2**8 - 1), 2: (-(2**7), 2**7 - 1), 3: (0, 2**16 - 1), 4: (-(2**15), 2**15 - 1), 5: (0, 2**32 - 1),
    6: (-(2**31), 2**31 - 1),
}  # fmt: skip
_SPELLINGS = (
    ("GPS1_TYPE", "GPS_TYPE"), ("GPS2_TYPE", "GPS_TYPE2"), ("MAV_SYSID", "SYSID_THISMAV"),
    ("EKF2_AGP0_CTRL", "EKF2_AGP_CTRL"),
)  # fmt: skip


def spellings(name: str) -> tuple[str, ...]:
    """A parameter's name, then the one that it has in other versions."""
    for pair in _SPELLINGS:
        if name in pair:
            return (name, pair[1 - pair.index(name)])
    return (name,)


def check_name(name: str) -> None:
    """Raise ValueError for what can be no parameter's name."""
    if not (0 < len(name) <= MAX_NAME and name.isascii() and name.replace("_", "").isalnum()):
        message = f"'{name}' is no parameter's name: up to {MAX_NAME} letters, digits and underscores"
        raise ValueError(message)


def decode_value(value: float, param_type: int, autopilot: Autopilot) -> float:
    """The number that a PARAM_VALUE carries; ValueError for a type that fits into no float."""
    if param_type not in _FORMATS:
        message = f"a parameter of type {param_type} does not fit into PARAM_VALUE"
        raise ValueError(message)
    if autopilot is not Autopilot.PX4 or param_type == _REAL32:
        return float(value)
    return float(struct.unpack(_FORMATS[param_type], struct.pack("<f", value))[0])


def encode_value(value: float, param_type: int, autopilot: Autopilot) -> float:
    """What PARAM_SET carries for a number; ValueError where the vehicle could not hold it."""
    if not math.isfinite(value):
        message = f"a parameter cannot be {value}"
        raise ValueError(message)
    if param_type == _REAL32:
        return value
    if param_type not in _RANGES:
        message = f"a parameter of type {param_type} does not fit into PARAM_SET"
        raise ValueError(message)
    low, high = _RANGES[param_type]
    if value != round(value) or not low <= value <= high:
        message = f"the parameter is a whole number from {low} to {high}, not {value:g}"
        raise ValueError(message)
    if autopilot is Autopilot.PX4:
        return float(struct.unpack("<f", struct.pack(_FORMATS[param_type], int(value)))[0])
    if abs(value) > _SINGLE_STEPS:
        message = f"{value:g} is too large to reach ArduPilot exactly: it is sent as a float"
        raise ValueError(message)
    return value


@dataclass(slots=True)
class _Request:
    """One parameter asked for; ``wanted`` is what it shall be, None to read. A write reads first, for the type."""

    request_id: int
    asked: str
    names: deque[str]
    wanted: float | None
    param_type: int | None = None
    before: float | None = None
    attempts: int = 0
    deadline_us: int = 0

    @property
    def name(self) -> str:
        return self.names[0]


class ParameterChannel:
    """The parameters asked of one vehicle; what is to be sent lies in ``take_messages``."""

    def __init__(self, system_id: int, component_id: int, autopilot: Autopilot) -> None:
        self._system_id, self._component_id, self._autopilot = system_id, component_id, autopilot
        self._waiting: deque[_Request] = deque()
        self._running: dict[str, _Request] = {}
        self._outbox: list[Any] = []

    def read(self, request_id: int, names: Sequence[str]) -> None:
        """Queue reads; each name gets one news under the id. ValueError for what can be no name."""
        for name in names:
            check_name(name)
        for name in dict.fromkeys(names):
            self._waiting.append(_Request(request_id, name, deque(spellings(name)), None))

    def write(self, request_id: int, name: str, value: float) -> None:
        """Queue a write. ValueError for what can be no name or no value."""
        check_name(name)
        if not math.isfinite(value):
            message = f"a parameter cannot be {value}"
            raise ValueError(message)
        self._waiting.append(_Request(request_id, name, deque(spellings(name)), value))

    def take_messages(self) -> list[Any]:
        """Messages to send now; each is given once."""
        out, self._outbox = self._outbox, []
        return out

    def receive(self, m: Any, t_us: int) -> list[ParameterNews]:
        """Take a PARAM_VALUE from the vehicle; one that was not asked for, or comes twice, gives nothing."""
        run = self._running.get(m.param_id)
        if run is None:
            return []
        try:
            value = decode_value(m.param_value, m.param_type, self._autopilot)
            if run.wanted is None:
                return [self._end(run, t_us, ParameterStatus.KNOWN, f"is {value:g}", value)]
            if run.param_type is None:
                encode_value(run.wanted, m.param_type, self._autopilot)
        except ValueError as error:
            return [self._end(run, t_us, ParameterStatus.REFUSED, str(error))]
        return self._on_value(run, run.wanted, value, m.param_type, t_us)

    def _on_value(self, run: _Request, wanted: float, value: float, param_type: int, t_us: int) -> list[ParameterNews]:
        """A value of what is to be written: the one before, or what the vehicle made of ours."""
        if run.param_type is None:
            run.param_type, run.before, run.attempts = param_type, value, 0
            self._say(run, t_us)
            return []
        if _same(value, wanted):
            return [self._end(run, t_us, ParameterStatus.WRITTEN, f"was {run.before:g}, is {value:g}", value)]
        # The reading's answer once more, or a vehicle that does not keep it: asked again, it shows which.
        if run.attempts < _ATTEMPTS:
            return []
        text = f"the vehicle keeps it at {value:g} instead of {wanted:g}"
        return [self._end(run, t_us, ParameterStatus.REFUSED, text, value)]

    def tick(self, t_us: int) -> list[ParameterNews]:
        """Let time pass: begin what waits, repeat, give up."""
        news: list[ParameterNews] = []
        for run in list(self._running.values()):
            if t_us >= run.deadline_us:
                news += self._overdue(run, t_us)
        for run in list(self._waiting):
            if len(self._running) >= _IN_FLIGHT:
                break
            if run.name not in self._running:
                self._waiting.remove(run)
                self._say(run, t_us)
        return news

    def restarted(self, t_us: int) -> list[ParameterNews]:
        """The vehicle has restarted: what is being written may be lost, what is read is asked for again."""
        news = []
        for run in list(self._running.values()):
            if run.wanted is not None:
                text = "the vehicle restarted meanwhile: read it again"
                news.append(self._end(run, t_us, ParameterStatus.TIMEOUT, text))
            else:
                run.attempts = 0
                self._say(run, t_us)
        return news

    def abandon(self, t_us: int) -> list[ParameterNews]:
        """The vehicle is gone: nothing will be answered."""
        open_requests = [*self._running.values(), *self._waiting]
        self._waiting.clear()
        return [self._end(run, t_us, ParameterStatus.TIMEOUT, "the vehicle fell silent") for run in open_requests]

    def clock_set_back(self, t_us: int) -> None:
        """The station's clock was set back to ``t_us``: repeat at the usual time from there."""
        for run in self._running.values():
            run.deadline_us = min(run.deadline_us, t_us + _ANSWER_TIMEOUT_US)

    def _overdue(self, run: _Request, t_us: int) -> list[ParameterNews]:
        if run.attempts < _ATTEMPTS:
            self._say(run, t_us)
            return []
        if run.param_type is not None:
            text = "the vehicle did not say what it made of it: read it again"
            return [self._end(run, t_us, ParameterStatus.TIMEOUT, text)]
        if len(run.names) == 1:
            return [self._end(run, t_us, ParameterStatus.UNKNOWN, "the vehicle has none of that name, or is silent")]
        del self._running[run.name]
        run.names.popleft()
        run.attempts = 0
        self._waiting.appendleft(run)
        return []

    def _say(self, run: _Request, t_us: int) -> None:
        self._running[run.name] = run
        run.attempts += 1
        run.deadline_us = t_us + _ANSWER_TIMEOUT_US
        to, name = (self._system_id, self._component_id), run.name.encode()
        if run.param_type is None or run.wanted is None:
            self._outbox.append(_dialect.MAVLink_param_request_read_message(*to, name, -1))
        else:
            value = encode_value(run.wanted, run.param_type, self._autopilot)
            self._outbox.append(_dialect.MAVLink_param_set_message(*to, name, value, run.param_type))

    def _end(
        self, run: _Request, t_us: int, status: ParameterStatus, text: str, value: float | None = None
    ) -> ParameterNews:
        if self._running.get(run.name) is run:
            del self._running[run.name]
        return ParameterNews(t_us, self._system_id, run.request_id, run.asked, run.name, status, text, value)


def _same(value: float, wanted: float) -> bool:
    """Whether what came back is what was sent, through a float of 32 bits."""
    return abs(value - wanted) <= 1e-6 * max(abs(wanted), 1.0)
