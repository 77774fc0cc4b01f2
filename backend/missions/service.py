"""Plans of the station's vehicles: kept here, sent to them, fetched from them. Lives on the event loop."""

from __future__ import annotations

import asyncio
import uuid
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from backend.errors import CommandRefusedError, ConflictError, InvalidRequestError, PlanChangedError, StationError
from backend.fleet.links import LinkEndpoint
from backend.fleet.vehicle import LiveVehicle
from backend.link.events import Autopilot, CommandStatus, TransferNews
from backend.missions.operation import Checking, Downloaded, End, Fetching, Sending, Step
from backend.missions.parts import items_of_part
from backend.missions.plan import Plan
from backend.missions.plan_file import document_of, plan_of, read_plan
from backend.missions.shelf import ALWAYS, Condition, PlanShelf, etag_of, unchanged
from guidance.geofence import Geofence, InclusionRule
from guidance.mission import MissionItem, MissionType


@dataclass(slots=True)
class _Running:
    """One operation; ``before`` is the kept plan that a download may replace."""

    command_id: str
    command: str
    vehicle: LiveVehicle
    link: LinkEndpoint
    work: Sending | Checking | Fetching
    before: Plan | None = None
    transfer_id: int = -1


class Missions:
    """One operation a vehicle at a time; how it goes on is told by ``say`` as ``ack`` messages, as of commands."""

    def __init__(
        self, folder: Path, link_of: Callable[[LiveVehicle], LinkEndpoint | None], say: Callable[..., None]
    ) -> None:
        self._shelf = PlanShelf(folder)
        self._link_of = link_of
        self._say = say
        self._running: dict[str, _Running] = {}
        self._keeping: set[asyncio.Task[None]] = set()

    async def plan(self, vehicle_id: str) -> Plan:
        """The kept plan; its errors are those of ``PlanShelf.get``."""
        return await asyncio.to_thread(self._shelf.get, vehicle_id)

    async def fence_of(self, vehicle: LiveVehicle) -> tuple[Geofence, InclusionRule]:
        """The fence of a vehicle's kept plan, empty where none is kept, and how its autopilot reads inclusions."""
        plan = await asyncio.to_thread(self._shelf.find, vehicle.id)
        return Geofence() if plan is None else plan.fence, rule_of(vehicle.autopilot)

    async def keep(self, vehicle_id: str, content: bytes, condition: Condition = ALWAYS) -> Plan:
        """Keep the plan of a file in place of the one before, and say so to every page.

        PlanFileError says what is wrong with it, PlanChangedError that the ``condition`` does not hold.
        """
        plan = await asyncio.to_thread(self._read_and_keep, vehicle_id, content, condition)
        self._say_kept(vehicle_id, plan)
        return plan

    async def remove(self, vehicle_id: str, condition: Condition = ALWAYS) -> None:
        """Keep no plan any more; the vehicle's own is not touched. PlanChangedError as ``keep``."""
        await asyncio.to_thread(self._shelf.remove, vehicle_id, condition)
        self._say_kept(vehicle_id, None)

    async def upload(self, vehicle: LiveVehicle, parts: Sequence[MissionType] | None) -> str:
        """Begin to send the kept plan; returns the id of its acknowledgements.

        Without ``parts`` it is all that the plan has. A part that is named and empty is cleared on the vehicle.
        """
        found = await self._items(vehicle)
        wanted = [kind for kind in MissionType if (found[kind] if parts is None else kind in parts)]
        if not wanted:
            raise InvalidRequestError("the plan is empty: to clear the vehicle's, DELETE …/plan/vehicle")
        return self._begin(vehicle, "plan_upload", Sending([(kind, found[kind]) for kind in wanted], vehicle.autopilot))

    async def check(self, vehicle: LiveVehicle) -> str:
        """Begin to read what the vehicle holds and to compare it with the kept plan; neither is changed."""
        return self._begin(
            vehicle, "plan_compare", Checking([*(await self._items(vehicle)).items()], vehicle.autopilot)
        )

    async def _items(self, vehicle: LiveVehicle) -> dict[MissionType, tuple[MissionItem, ...]]:
        """The parts of the kept plan as its vehicle counts them."""
        plan = await self.plan(vehicle.id)
        try:
            return {kind: items_of_part(plan, kind, vehicle.autopilot) for kind in MissionType}
        except ValueError as error:
            raise CommandRefusedError(f"the plan cannot be sent: {error}") from None

    async def download(self, vehicle: LiveVehicle, *, replace: bool) -> str:
        """Begin to fetch what the vehicle holds, to be kept; ConflictError when that would replace a plan."""
        before = await asyncio.to_thread(self._shelf.find, vehicle.id)
        if before is not None and not replace:
            raise ConflictError(
                f"a plan is kept for vehicle '{vehicle.id}': say \"replace\": true to have the vehicle's in its place"
            )
        return self._begin(vehicle, "plan_download", Fetching(vehicle.autopilot), before)

    def clear(self, vehicle: LiveVehicle, parts: Sequence[MissionType]) -> str:
        """Begin to clear lists of the vehicle; the kept plan stays."""
        return self._begin(vehicle, "plan_clear", Sending([(kind, ()) for kind in parts], vehicle.autopilot))

    def on_transfer(self, endpoint: str, news: TransferNews) -> None:
        """Take news of a transfer from a link."""
        run = self._running.get(str(news.system_id))
        if run is None or run.link.name != endpoint or run.transfer_id != news.transfer_id:
            return
        if not news.final:
            back = isinstance(run.work, Sending) and news.action == "download"
            self._tell(run, CommandStatus.IN_PROGRESS, f"{news.text}{' read back' if back else ''}")
            return
        match run.work.take(news):
            case Step() as step:
                self._transfer(run, step)
            case End(status=status, text=text, same=same):
                self._end(run, status, text, same)
            case Downloaded() as found:
                task = asyncio.create_task(self._keep_downloaded(run, found))
                self._keeping.add(task)
                task.add_done_callback(self._keeping.discard)

    async def close(self) -> None:
        """Wait for what is being kept."""
        await asyncio.gather(*self._keeping, return_exceptions=True)

    def _begin(
        self, vehicle: LiveVehicle, command: str, work: Sending | Checking | Fetching, before: Plan | None = None
    ) -> str:
        if vehicle.id in self._running:
            running = self._running[vehicle.id].command
            raise ConflictError(f"vehicle '{vehicle.id}' is in the middle of {running}: wait for its acknowledgement")
        link = self._link_of(vehicle)
        if link is None or not vehicle.connected:
            raise CommandRefusedError(f"vehicle '{vehicle.id}' is not connected")
        run = _Running(str(uuid.uuid4()), command, vehicle, link, work, before)
        self._running[vehicle.id] = run
        self._transfer(run, work.begin())
        link.send_soon()
        return run.command_id

    def _transfer(self, run: _Running, step: Step) -> None:
        run.transfer_id = run.link.link.transfer(run.vehicle.system_id, step.action, step.kind, step.items)

    async def _keep_downloaded(self, run: _Running, found: Downloaded) -> None:
        try:
            text, plan = await asyncio.to_thread(self._keep_found, run, found)
        except StationError as error:
            self._end(run, CommandStatus.FAILED, str(error))
        else:
            self._say_kept(run.vehicle.id, plan)
            self._end(run, CommandStatus.ACCEPTED, text)

    def _keep_found(self, run: _Running, found: Downloaded) -> tuple[str, Plan]:
        autopilot, vehicle_type = run.vehicle.autopilot, run.vehicle.vehicle_type
        plan = plan_of(document_of(found.mission, found.fence, found.rally, autopilot, vehicle_type))
        try:
            self._shelf.keep(run.vehicle.id, plan, unchanged(run.before))
        except PlanChangedError:
            raise ConflictError("the kept plan was changed meanwhile, so it was not replaced: download again") from None
        text = (
            f"kept: mission of {len(found.mission.items)} items, fence of {len(found.fence.zones)} zones, "
            f"{len(found.rally)} rally points"
        )
        return text + "".join(f"; the vehicle supports no {name}" for name in found.unsupported), plan

    def _end(self, run: _Running, status: CommandStatus, text: str, same: bool | None = None) -> None:
        self._running.pop(run.vehicle.id, None)
        self._tell(run, status, text, same)

    def _say_kept(self, vehicle_id: str, plan: Plan | None) -> None:
        self._say("plan", vehicle_id=vehicle_id, etag=None if plan is None else etag_of(plan))

    def _tell(self, run: _Running, status: CommandStatus, text: str, same: bool | None = None) -> None:
        fields: dict[str, Any] = {"command_id": run.command_id, "vehicle_id": run.vehicle.id, "command": run.command}
        if same is not None:
            fields["same"] = same
        self._say("ack", **fields, status=str(status), text=text)

    def _read_and_keep(self, vehicle_id: str, content: bytes, condition: Condition) -> Plan:
        plan = read_plan(content)
        self._shelf.keep(vehicle_id, plan, condition)
        return plan


def rule_of(autopilot: Autopilot) -> InclusionRule:
    """How an autopilot takes several zones to stay inside of; where it is not known, the stricter way."""
    return InclusionRule.ANY if autopilot is Autopilot.PX4 else InclusionRule.ALL
