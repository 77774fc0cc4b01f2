"""Flight modes and vehicle kinds: heartbeat numbers to words and back."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

from pymavlink.dialects.v20 import ardupilotmega as _dialect

from backend.link.events import Autopilot, VehicleType

_FLAG_CUSTOM_MODE = 1
_TYPE_TO_KIND = {
    1: VehicleType.FIXED_WING,
    2: VehicleType.MULTIROTOR,
    3: VehicleType.HELICOPTER,
    4: VehicleType.HELICOPTER,
    13: VehicleType.MULTIROTOR,
    14: VehicleType.MULTIROTOR,
    15: VehicleType.MULTIROTOR,
    29: VehicleType.MULTIROTOR,
    35: VehicleType.MULTIROTOR,
    **dict.fromkeys(range(19, 26), VehicleType.VTOL),
}
_ENUM_OF_KIND = {
    VehicleType.HELICOPTER: "COPTER_MODE",
    VehicleType.MULTIROTOR: "COPTER_MODE",
    VehicleType.FIXED_WING: "PLANE_MODE",
    VehicleType.VTOL: "PLANE_MODE",
}
_PX4_MAIN = {
    1: "MANUAL",
    2: "ALTCTL",
    3: "POSCTL",
    4: "AUTO",
    5: "ACRO",
    6: "OFFBOARD",
    7: "STABILIZED",
    8: "RATTITUDE",
}
_PX4_MAIN_AUTO = 4
_PX4_AUTO = {
    1: "READY",
    2: "TAKEOFF",
    3: "LOITER",
    4: "MISSION",
    5: "RTL",
    6: "LAND",
    8: "FOLLOW_TARGET",
    9: "PRECLAND",
}


@dataclass(frozen=True, slots=True)
class ModeNumbers:
    """Parameters 2 and 3 of MAV_CMD_DO_SET_MODE; ArduPilot uses the first only."""

    main: int
    sub: int = 0


def autopilot_from_heartbeat(autopilot: int) -> Autopilot:
    """The family of MAV_AUTOPILOT."""
    return {3: Autopilot.ARDUPILOT, 12: Autopilot.PX4}.get(autopilot, Autopilot.OTHER)


def vehicle_type_from_heartbeat(mav_type: int) -> VehicleType:
    """The kind of MAV_TYPE."""
    return _TYPE_TO_KIND.get(mav_type, VehicleType.OTHER)


def mode_name(autopilot: Autopilot, vehicle_type: VehicleType, base_mode: int, custom_mode: int) -> str:
    """The mode's name as the autopilot's own documents have it; a number where it is not known."""
    if not base_mode & _FLAG_CUSTOM_MODE:
        return f"BASE {base_mode}"
    if autopilot is Autopilot.PX4:
        main, sub = custom_mode >> 16 & 0xFF, custom_mode >> 24 & 0xFF
        name = _PX4_MAIN.get(main, f"MODE {main}")
        return f"{name} {_PX4_AUTO.get(sub, sub)}" if main == _PX4_MAIN_AUTO else name
    if autopilot is Autopilot.ARDUPILOT:
        return _ardupilot_modes(vehicle_type).get(custom_mode, f"MODE {custom_mode}")
    return f"MODE {custom_mode}"


def mode_numbers(autopilot: Autopilot, vehicle_type: VehicleType, name: str) -> ModeNumbers:
    """The numbers of a mode named as ``mode_name`` names it. Raises ValueError for a mode the vehicle has not."""
    if autopilot is Autopilot.PX4:
        main_name, _, sub_name = name.partition(" ")
        main = {word: number for number, word in _PX4_MAIN.items()}.get(main_name)
        sub = {word: number for number, word in _PX4_AUTO.items()}.get(sub_name, 0)
        if main is not None and bool(sub) == bool(sub_name):
            return ModeNumbers(main, sub)
    elif autopilot is Autopilot.ARDUPILOT:
        for number, word in _ardupilot_modes(vehicle_type).items():
            if word == name:
                return ModeNumbers(number)
    message = f"a {vehicle_type} with autopilot {autopilot} has no mode {name!r}"
    raise ValueError(message)


@cache
def _ardupilot_modes(vehicle_type: VehicleType) -> dict[int, str]:
    enum = _ENUM_OF_KIND.get(vehicle_type)
    if enum is None:
        return {}
    return {
        number: entry.name.removeprefix(f"{enum}_")
        for number, entry in _dialect.enums[enum].items()
        if not entry.name.endswith("ENUM_END")
    }
