"""Where plans are kept: one ``.plan`` file a vehicle in the data folder, whole or not at all."""

from __future__ import annotations

from pathlib import Path

from backend.errors import NoPlanError, PlanFileError, StationError
from backend.missions.plan import Plan
from backend.missions.plan_file import read_plan, write_plan
from geodata.flight_write import write_atomically


class PlanShelf:
    """Reads and writes at once; an event loop calls it in a thread."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder

    def find(self, vehicle_id: str) -> Plan | None:
        """The plan of a vehicle, None where none is kept; PlanFileError when its file has been spoilt."""
        path = self._path(vehicle_id)
        try:
            return read_plan(path.read_bytes())
        except FileNotFoundError:
            return None
        except PlanFileError as error:
            raise PlanFileError(f"kept plan '{path.name}': {error.where}", f"{error.reason}; PUT it again") from None
        except OSError as error:
            raise StationError(f"the plan '{path}' cannot be read: {error.strerror or error}") from None

    def get(self, vehicle_id: str) -> Plan:
        """The plan of a vehicle, NoPlanError where none is kept; else as ``find``."""
        plan = self.find(vehicle_id)
        if plan is None:
            raise NoPlanError(vehicle_id)
        return plan

    def keep(self, vehicle_id: str, plan: Plan) -> None:
        """Keep a plan in place of the one before; when this returns it is on the disk."""
        try:
            self._folder.mkdir(parents=True, exist_ok=True)
            write_atomically(self._path(vehicle_id), write_plan(plan))
        except OSError as error:
            raise StationError(f"the plan cannot be kept: {error.strerror or error}") from None

    def remove(self, vehicle_id: str) -> None:
        """Keep none any more."""
        try:
            self._path(vehicle_id).unlink(missing_ok=True)
        except OSError as error:
            raise StationError(f"the plan cannot be removed: {error.strerror or error}") from None

    def _path(self, vehicle_id: str) -> Path:
        return self._folder / f"vehicle-{vehicle_id}.plan"
