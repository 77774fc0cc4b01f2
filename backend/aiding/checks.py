"""Whether an autopilot's parameters allow that it is told where it is: which ones, what they should be, in words.

What ArduPilot was seen flying with is in the recorded flights of ``tests/backend/link/test_aiding.py``; the others are
from the documentation of ArduPilot (EKF3 sources, non-GPS navigation) and PX4 (EKF2 external vision, AGP).
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from backend.link.aiding import AidingForm
from backend.link.events import Autopilot

_GPS, _EXTERNAL_NAV = 3, 6
_SETS = (1, 2, 3)


@dataclass(frozen=True, slots=True)
class Need:
    """A parameter, what it should be in words, whether a value is that, and what it is for."""

    name: str
    should_be: str
    fits: Callable[[float], bool]
    what_for: str


@dataclass(frozen=True, slots=True)
class Checked:
    """A need held against the vehicle's value; ``ok`` is None where the vehicle does not say."""

    name: str
    value: float | None
    should_be: str
    ok: bool | None
    text: str


def _one_of(*values: int) -> Callable[[float], bool]:
    return lambda value: value in values


def _bit_0(value: float) -> bool:
    return bool(int(value) & 1)


def _at_most(limit: float) -> Callable[[float], bool]:
    return lambda value: value <= limit


_EKF3 = Need("AHRS_EKF_TYPE", "3", _one_of(3), "EKF3 is the filter that takes it")
_NEEDS: dict[tuple[Autopilot, AidingForm], tuple[Need, ...]] = {
    (Autopilot.ARDUPILOT, AidingForm.EXTERNAL_POSITION): (
        _EKF3,
        Need("EK3_SRC1_POSXY", "3 (GPS)", _one_of(_GPS), "it stands in for a GPS that is lost, and for nothing else"),
    ),
    (Autopilot.ARDUPILOT, AidingForm.GPS_INPUT): (
        _EKF3,
        Need("GPS1_TYPE", "14 (MAVLink)", _one_of(14), "its first GPS receiver is then what the station sends"),
        Need("EK3_SRC1_POSXY", "3 (GPS)", _one_of(_GPS), "its position comes from that receiver"),
        Need("EK3_SRC1_VELXY", "3 (GPS) or 0 (none)", _one_of(_GPS, 0), "so does its velocity"),
    ),
    (Autopilot.PX4, AidingForm.GLOBAL_POSITION_SENSOR): (
        Need("EKF2_AGP0_CTRL", "1 (bit 0: horizontal)", _bit_0, "EKF2 takes positions from outside"),
    ),
    (Autopilot.PX4, AidingForm.ODOMETRY): (
        Need("EKF2_EV_CTRL", "1 or more with bit 0: horizontal position", _bit_0, "EKF2 takes external vision"),
        Need("EKF2_EV_DELAY", "100 or less", _at_most(100.0), "what is sent is carried on to the time of sending"),
    ),
}
_VISION = (
    Need("VISO_TYPE", "1 (MAVLink)", _one_of(1, 3), "visual odometry is taken from the link"),
    Need("VISO_DELAY_MS", "100 or less", _at_most(100.0), "what is sent is carried on to the time of sending"),
)


def _source_needs(number: int) -> tuple[Need, ...]:
    """What a set of EKF3's sources should be for ODOMETRY."""
    name = f"EK3_SRC{number}_"
    return (
        Need(name + "POSXY", "6 (external navigation)", _one_of(_EXTERNAL_NAV), "its position comes from the station"),
        Need(name + "VELXY", "6 (external navigation) or 0", _one_of(_EXTERNAL_NAV, 0), "its velocity, too, or none"),
        Need(name + "POSZ", "1 (barometer)", _one_of(1), "heights stay its own"),
        Need(
            name + "YAW", "1 (compass)", _one_of(1), "with 6 the heading, which the station has from it, would go round"
        ),
    )


def names_of(autopilot: Autopilot, form: AidingForm) -> tuple[str, ...]:
    """The parameters to read. Raises KeyError for a form that the autopilot does not take."""
    if (autopilot, form) == (Autopilot.ARDUPILOT, AidingForm.ODOMETRY):
        sources = tuple(need.name for number in _SETS for need in _source_needs(number))
        return (_EKF3.name, *(need.name for need in _VISION), *sources)
    return tuple(need.name for need in _NEEDS[autopilot, form])


def check(autopilot: Autopilot, form: AidingForm, values: Mapping[str, float | None]) -> tuple[list[Checked], str]:
    """Each parameter that counts, and what else there is to do, empty where nothing is.

    ``values`` are of ``names_of``, None where the vehicle does not say. Of EKF3's sets of sources that counts which
    has external navigation, else the first. Raises KeyError as ``names_of``.
    """
    if (autopilot, form) != (Autopilot.ARDUPILOT, AidingForm.ODOMETRY):
        return [_checked(need, values.get(need.name)) for need in _NEEDS[autopilot, form]], ""
    number = next((n for n in _SETS if values.get(f"EK3_SRC{n}_POSXY") == _EXTERNAL_NAV), 1)
    rows = [_checked(need, values.get(need.name)) for need in (_EKF3, *_VISION, *_source_needs(number))]
    if number == 1:
        return rows, ""
    return rows, (
        f"external navigation is in set {number} of its sources: when GPS is gone, have it switch there "
        f"(MAV_CMD_SET_EKF_SOURCE_SET with {number}, or the switch of the pilot's transmitter)"
    )


def verdict(rows: list[Checked]) -> bool | None:
    """Whether all is as it should be; None where something is not known and nothing is wrong."""
    if any(row.ok is False for row in rows):
        return False
    return None if any(row.ok is None for row in rows) else True


def _checked(need: Need, value: float | None) -> Checked:
    if value is None:
        text = f"the vehicle does not say; it should be {need.should_be}: {need.what_for}"
        return Checked(need.name, None, need.should_be, None, text)
    if need.fits(value):
        return Checked(need.name, value, need.should_be, True, need.what_for)
    text = f"is {value:g} and should be {need.should_be}: {need.what_for}"
    return Checked(need.name, value, need.should_be, False, text)
