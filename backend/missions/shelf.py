"""Where plans are kept: one ``.plan`` file a vehicle in the data folder, whole or not at all."""

from __future__ import annotations

import hashlib
import threading
from dataclasses import dataclass
from pathlib import Path

from backend.errors import NoPlanError, PlanChangedError, PlanFileError, StationError
from backend.missions.plan import Plan
from backend.missions.plan_file import read_plan, write_plan
from geodata.flight_write import write_atomically


@dataclass(frozen=True, slots=True)
class Condition:
    """What must be kept for a change to be made: one of ``etags``, any plan (``present``), or none (``absent``)."""

    etags: frozenset[str] | None = None
    present: bool = False
    absent: bool = False

    def holds(self, etag: str | None) -> bool:
        """Whether a change may be made of a plan with this ``etag``, None where none is kept."""
        if self.absent:
            return etag is None
        if self.etags is not None:
            return etag in self.etags
        return etag is not None or not self.present


ALWAYS = Condition()


def etag_of(plan: Plan) -> str:
    """The same for the same content only, whoever has put it."""
    return hashlib.sha256(write_plan(plan)).hexdigest()[:32]


def unchanged(plan: Plan | None) -> Condition:
    """That what is kept is still this."""
    return Condition(absent=True) if plan is None else Condition(frozenset((etag_of(plan),)))


class PlanShelf:
    """Reads and writes at once; an event loop calls it in a thread."""

    def __init__(self, folder: Path) -> None:
        self._folder = folder
        self._lock = threading.Lock()

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

    def keep(self, vehicle_id: str, plan: Plan, condition: Condition = ALWAYS) -> None:
        """Keep a plan in place of the one before; when this returns it is on the disk.

        PlanChangedError where the ``condition`` does not hold: nothing is changed then.
        """
        with self._lock:
            self._check(vehicle_id, condition)
            try:
                self._folder.mkdir(parents=True, exist_ok=True)
                write_atomically(self._path(vehicle_id), write_plan(plan))
            except OSError as error:
                raise StationError(f"the plan cannot be kept: {error.strerror or error}") from None

    def remove(self, vehicle_id: str, condition: Condition = ALWAYS) -> None:
        """Keep none any more; PlanChangedError as ``keep``."""
        with self._lock:
            self._check(vehicle_id, condition)
            try:
                self._path(vehicle_id).unlink(missing_ok=True)
            except OSError as error:
                raise StationError(f"the plan cannot be removed: {error.strerror or error}") from None

    def _check(self, vehicle_id: str, condition: Condition) -> None:
        # A spoilt file is no reason to refuse what replaces it, where nobody asks what was there.
        if condition == ALWAYS:
            return
        before = self.find(vehicle_id)
        etag = None if before is None else etag_of(before)
        if not condition.holds(etag):
            raise PlanChangedError(vehicle_id, etag)

    def _path(self, vehicle_id: str) -> Path:
        return self._folder / f"vehicle-{vehicle_id}.plan"
