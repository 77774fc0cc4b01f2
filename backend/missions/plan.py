"""A plan as the station keeps it: mission, fence, rally points, and the file that they came from."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from guidance.geofence import Geofence, InclusionRule
from guidance.mission import Mission, check_place

MAX_RALLY_POINTS = 255


@dataclass(frozen=True, slots=True)
class RallyPoint:
    """Where a vehicle may wait or land instead of at home: WGS-84 degrees, metres above home."""

    lat_deg: float
    lon_deg: float
    alt_rel_m: float

    def __post_init__(self) -> None:
        check_place(self.lat_deg, self.lon_deg)


@dataclass(frozen=True, slots=True)
class Plan:
    """``document`` is the QGroundControl plan that the rest was read from, with all that is not understood here."""

    mission: Mission
    fence: Geofence
    rally: tuple[RallyPoint, ...]
    document: dict[str, Any] = field(compare=False, repr=False)

    def warnings(self, rule: InclusionRule) -> list[str]:
        """What of it an operator should look at; ``rule`` is the vehicle's, of several zones to stay inside of."""
        found = [
            f"fence polygon {number} crosses itself: what is inside of it is not clear"
            for number, zone in enumerate(self.fence.polygons, 1)
            if zone.crosses_itself()
        ]
        places = [
            (f"item {number}", item.place_deg)
            for number, item in enumerate(self.mission.items, 1) if item.place_deg is not None
        ]  # fmt: skip
        if self.mission.home is not None:
            places.append(("the planned home", (self.mission.home.lat_deg, self.mission.home.lon_deg)))
        places += [(f"rally point {n}", (point.lat_deg, point.lon_deg)) for n, point in enumerate(self.rally, 1)]
        outside = [name for name, place in places if place is not None and not self.fence.allows(*place, rule)]
        return found + [f"{name} lies where the fence does not allow it" for name in outside]
