"""A mission as autopilots take it: MAVLink commands in order. Pure; checked when it is made.

An item has a command (MAV_CMD), a frame (MAV_FRAME) and seven parameters. Of a command that takes a place, parameters
5 and 6 are latitude and longitude in degrees and 7 is the altitude in metres, on the datum that the frame says; in
local frames the three are metres. Of any other command they are numbers. NaN means "the vehicle's own choice".

Items are counted from 1, and so are the targets of DO_JUMP, whatever the vehicle's own numbers are.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from enum import IntEnum, StrEnum

DO_JUMP = 177
NAV_WAYPOINT = 16
# MAV_FRAME: WGS-84 with altitudes above mean sea level, and above home.
FRAME_GLOBAL, FRAME_GLOBAL_RELATIVE_ALT = 0, 3
MAX_ITEMS = 5000
PARAMETERS = 7

# MAV_CMDs whose parameters 5 to 7 are a place: ``has_location`` in common.xml and ardupilotmega.xml.
PLACE_COMMANDS = frozenset(
    {*(16, 17, 18, 19, 21, 22, 23, 24, 25, 31, 34, 35, 36, 80, 81, 82, 84, 85, 94, 179, 188, 189, 192, 195, 201, 252),
     *(4001, 4501, 5000, 5001, 5002, 5003, 5004, 5100, 30001, *range(31000, 31010), 43003)}
)  # fmt: skip

_FLOAT32_MAX = 3.4028234663852886e38
_INT32_MAX = 0x7FFFFFFF
_COUNTS_PER_DEGREE = 1e7
_COUNTS_PER_METRE = 1e4
# MAVLink calls the frames with _INT in their name superseded by those without: they say the same.
_PLAIN_FRAME = {5: 0, 6: 3, 11: 10}
_LOCAL_FRAMES = frozenset({1, 4, 7, 8, 9, 12, 20, 21})
_MISSION_FRAME = 2


class AltitudeDatum(StrEnum):
    """From where an altitude counts: mean sea level, home, or the ground below."""

    AMSL = "amsl"
    HOME = "home"
    GROUND = "ground"


_DATUM_OF_FRAME = {
    FRAME_GLOBAL: AltitudeDatum.AMSL, FRAME_GLOBAL_RELATIVE_ALT: AltitudeDatum.HOME, 10: AltitudeDatum.GROUND,
}  # fmt: skip


class MissionType(IntEnum):
    """MAV_MISSION_TYPE: the three lists that a vehicle keeps."""

    MISSION = 0
    FENCE = 1
    RALLY = 2

    @property
    def words(self) -> str:
        """What an operator calls it."""
        return ("mission", "fence", "rally points")[self]


@dataclass(frozen=True, slots=True)
class MissionItem:
    """One item; ValueError says what of it MAVLink cannot carry. ``params`` are parameters 1 to 7."""

    command: int
    frame: int
    params: tuple[float, float, float, float, float, float, float]
    auto_continue: bool = True

    def __post_init__(self) -> None:
        if not 0 <= self.command <= 0xFFFF:
            message = f"command {self.command} is not a MAV_CMD (0 to 65535)"
            raise ValueError(message)
        if self.plain_frame not in _DATUM_OF_FRAME and self.frame not in _LOCAL_FRAMES | {_MISSION_FRAME}:
            message = f"frame {self.frame} is not a MAV_FRAME of missions"
            raise ValueError(message)
        if len(self.params) != PARAMETERS:
            message = f"{len(self.params)} parameters given, an item has {PARAMETERS}"
            raise ValueError(message)
        for number, value in enumerate(self.params, 1):
            if math.isinf(value) or abs(value) > _FLOAT32_MAX:
                message = f"parameter {number} is {value}: not a number that fits 32 bits"
                raise ValueError(message)
        if self.has_place:
            check_place(*self.params[4:6])
        for number, value in zip((5, 6), self.params[4:6], strict=True):
            if abs(value) * self.counts_per_unit >= _INT32_MAX:
                message = f"parameter {number} is {value}: too large for frame {self.frame}"
                raise ValueError(message)

    @property
    def plain_frame(self) -> int:
        """The frame under its older name where it has two."""
        return _PLAIN_FRAME.get(self.frame, self.frame)

    @property
    def counts_per_unit(self) -> float:
        """What parameters 5 and 6 are multiplied by in MISSION_ITEM_INT, where both are whole numbers."""
        if self.has_place:
            return _COUNTS_PER_DEGREE
        return _COUNTS_PER_METRE if self.command in PLACE_COMMANDS and self.frame in _LOCAL_FRAMES else 1.0

    @property
    def has_place(self) -> bool:
        """Whether parameters 5 to 7 are latitude, longitude and altitude."""
        return self.command in PLACE_COMMANDS and self.plain_frame in _DATUM_OF_FRAME

    @property
    def place_deg(self) -> tuple[float, float] | None:
        """Latitude and longitude (WGS-84, degrees), None where it has none; 0, 0 is "here" to autopilots."""
        lat_deg, lon_deg = self.params[4:6]
        if not self.has_place or math.isnan(lat_deg) or math.isnan(lon_deg) or (lat_deg, lon_deg) == (0.0, 0.0):
            return None
        return lat_deg, lon_deg

    @property
    def alt_m(self) -> float | None:
        """Its altitude above ``datum``, None where it has none."""
        return self.params[6] if self.has_place and not math.isnan(self.params[6]) else None

    @property
    def datum(self) -> AltitudeDatum | None:
        """From where ``alt_m`` counts."""
        return _DATUM_OF_FRAME[self.plain_frame] if self.has_place else None


@dataclass(frozen=True, slots=True)
class Home:
    """Where a plan has its start: WGS-84 degrees, metres above mean sea level."""

    lat_deg: float
    lon_deg: float
    alt_amsl_m: float

    def __post_init__(self) -> None:
        check_place(self.lat_deg, self.lon_deg)
        if not all(map(math.isfinite, (self.lat_deg, self.lon_deg, self.alt_amsl_m))):
            message = f"home is not a place: {self.lat_deg}, {self.lon_deg}, {self.alt_amsl_m}"
            raise ValueError(message)


class MissionError(ValueError):
    """Item ``number`` (from 1) does not fit its mission: ``reason``."""

    def __init__(self, number: int, reason: str) -> None:
        self.number = number
        self.reason = reason
        super().__init__(f"item {number}: {reason}")


@dataclass(frozen=True, slots=True)
class Mission:
    """Items in their order, and the planned home. MissionError says which item does not fit the others."""

    items: tuple[MissionItem, ...] = ()
    home: Home | None = None

    def __post_init__(self) -> None:
        if len(self.items) > MAX_ITEMS:
            raise MissionError(MAX_ITEMS + 1, f"a mission has at most {MAX_ITEMS} items")
        for number, item in enumerate(self.items, 1):
            target = item.params[0]
            if item.command == DO_JUMP and target not in range(1, len(self.items) + 1):
                raise MissionError(number, f"jumps to item {target:g}, the mission has 1 to {len(self.items)}")


def check_place(lat_deg: float, lon_deg: float) -> None:
    """ValueError when a latitude or longitude (degrees) is none; NaN passes."""
    if abs(lat_deg) > 90.0:
        message = f"latitude {lat_deg} is not within -90 to 90 degrees"
        raise ValueError(message)
    if abs(lon_deg) > 180.0:
        message = f"longitude {lon_deg} is not within -180 to 180 degrees"
        raise ValueError(message)
