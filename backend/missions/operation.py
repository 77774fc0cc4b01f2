"""What is done with a plan and a vehicle, as a row of transfers. No I/O: each result gives the next step or the end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from backend.link.events import Autopilot, CommandStatus, TransferAction, TransferNews
from backend.link.mission_items import home_of_vehicle, items_of_vehicle
from backend.missions.compare import compare, told
from backend.missions.parts import fence_of_items, rally_of_items
from backend.missions.plan import RallyPoint
from guidance.geofence import Geofence
from guidance.mission import Mission, MissionItem, MissionType


@dataclass(frozen=True, slots=True)
class Step:
    """The transfer to begin next."""

    action: TransferAction
    kind: MissionType
    items: tuple[MissionItem, ...] = ()


@dataclass(frozen=True, slots=True)
class End:
    """How it all ended, in the operator's words."""

    status: CommandStatus
    text: str
    same: bool | None = None
    """Of a comparison: whether the vehicle holds the plan."""


@dataclass(frozen=True, slots=True)
class Downloaded:
    """What a vehicle holds; a part that it does not support is empty and named in ``unsupported``."""

    mission: Mission
    fence: Geofence
    rally: tuple[RallyPoint, ...]
    unsupported: tuple[str, ...] = ()


def _own(kind: MissionType, items: tuple[MissionItem, ...], autopilot: Autopilot) -> tuple[MissionItem, ...]:
    """Without the home that ArduPilot counts as an item of the mission."""
    return items_of_vehicle(items, autopilot) if kind is MissionType.MISSION else items


class Sending:
    """Gives a vehicle lists of items (an empty one clears), and reads each back before it counts as there.

    ``parts`` are as the vehicle counts them.
    """

    def __init__(self, parts: Sequence[tuple[MissionType, tuple[MissionItem, ...]]], autopilot: Autopilot) -> None:
        if not parts:
            message = "nothing to send"
            raise ValueError(message)
        self._parts = list(parts)
        self._autopilot = autopilot
        self._done: list[str] = []
        self._notes: list[str] = []

    def begin(self) -> Step:
        """The first transfer."""
        return self._put()

    def take(self, news: TransferNews) -> Step | End:
        """The result of the last transfer; what comes next."""
        kind, items = self._parts[0]
        if news.action is not TransferAction.DOWNLOAD:
            if news.status is CommandStatus.ACCEPTED or news.unconfirmed:
                return Step(TransferAction.DOWNLOAD, kind)
            return self._failed(news.status, news.text)
        if news.status is not CommandStatus.ACCEPTED:
            return self._failed(news.status, f"sent, but reading it back failed: {news.text}")
        sent, held = (_own(kind, part, self._autopilot) for part in (items, news.items))
        comparison = compare(sent, held)
        if not comparison.same:
            reason = f"{kind.words}: the vehicle holds something else: {told(comparison.wrong)}"
            return self._failed(CommandStatus.FAILED, reason)
        if comparison.dropped:
            self._notes.append(f"{kind.words}: not kept by the vehicle: {told(comparison.dropped)}")
        self._done.append(f"{kind.words} of {len(sent)} items" if sent else f"{kind.words} cleared")
        del self._parts[0]
        if self._parts:
            return self._put()
        text = f"on the vehicle, read back and compared: {', '.join(self._done)}"
        return End(CommandStatus.ACCEPTED, "; ".join([text, *self._notes]))

    def _put(self) -> Step:
        kind, items = self._parts[0]
        return Step(TransferAction.UPLOAD if items else TransferAction.CLEAR, kind, items)

    def _failed(self, status: CommandStatus, reason: str) -> End:
        before = f"; on the vehicle already: {', '.join(self._done)}" if self._done else ""
        return End(status, reason + before)


class Checking:
    """Reads all three lists of a vehicle and tells how they differ from a plan's; nothing is changed on either side.

    ``parts`` are as the vehicle counts them.
    """

    def __init__(self, parts: Sequence[tuple[MissionType, tuple[MissionItem, ...]]], autopilot: Autopilot) -> None:
        self._parts = list(parts)
        self._autopilot = autopilot
        self._same: list[str] = []
        self._different: list[str] = []

    def begin(self) -> Step:
        """The first transfer."""
        return Step(TransferAction.DOWNLOAD, self._parts[0][0])

    def take(self, news: TransferNews) -> Step | End:
        """The result of the last transfer; what comes next."""
        kind, items = self._parts.pop(0)
        if news.status is CommandStatus.ACCEPTED:
            ours, its = (_own(kind, part, self._autopilot) for part in (items, news.items))
            comparison = compare(ours, its)
            if comparison.same:
                self._same.append(f"{kind.words} of {len(ours)} items")
            else:
                self._different.append(f"{kind.words}: {told(comparison.wrong)}")
        elif news.status is not CommandStatus.UNSUPPORTED or kind is MissionType.MISSION:
            return End(news.status, news.text)
        elif items:
            self._different.append(f"{kind.words}: the vehicle supports none")
        if self._parts:
            return self.begin()
        if self._different:
            text = f"the vehicle holds something else than the plan: {'; '.join(self._different)}"
            return End(CommandStatus.ACCEPTED, text, same=False)
        return End(CommandStatus.ACCEPTED, f"the vehicle holds this plan: {', '.join(self._same)}", same=True)


class Fetching:
    """Reads all three lists of a vehicle. One without fence or rally points says so, and has none."""

    def __init__(self, autopilot: Autopilot) -> None:
        self._autopilot = autopilot
        self._kinds = list(MissionType)
        self._held: dict[MissionType, tuple[MissionItem, ...]] = {}
        self._unsupported: list[str] = []

    def begin(self) -> Step:
        """The first transfer."""
        return Step(TransferAction.DOWNLOAD, self._kinds[0])

    def take(self, news: TransferNews) -> Step | End | Downloaded:
        """The result of the last transfer; what comes next."""
        kind = self._kinds[0]
        if news.status is CommandStatus.ACCEPTED:
            self._held[kind] = news.items
        elif news.status is CommandStatus.UNSUPPORTED and kind is not MissionType.MISSION:
            self._unsupported.append(kind.words)
        else:
            return End(news.status, news.text)
        del self._kinds[0]
        if self._kinds:
            return Step(TransferAction.DOWNLOAD, self._kinds[0])
        try:
            items = self._held[MissionType.MISSION]
            mission = Mission(items_of_vehicle(items, self._autopilot), home_of_vehicle(items, self._autopilot))
            fence = fence_of_items(self._held.get(MissionType.FENCE, ()))
            rally = rally_of_items(self._held.get(MissionType.RALLY, ()))
        except ValueError as error:
            return End(CommandStatus.FAILED, f"what the vehicle holds makes no plan: {error}")
        return Downloaded(mission, fence, rally, tuple(self._unsupported))
