"""Targets: points on the ground somebody wants to know about, with how well they are known."""

from __future__ import annotations

from dataclasses import asdict, dataclass, replace

from sqlalchemy import delete, select

from backend.errors import TargetChangedError, UnknownTargetError
from backend.store.database import Database
from backend.store.models import TargetRow

SEEN, LOST, STOPPED = "seen", "lost", "stopped"
TRACK_STATES = (SEEN, LOST, STOPPED)
FOLLOWED = "followed"


@dataclass(frozen=True, slots=True)
class Target:
    """One target. Variances and the north-east covariance are None where nobody knows them (typed-in coordinates).

    ``vehicle_id``, ``frame_id``, ``t_unix_us`` (exposure) and the pixel say where it was clicked, and
    ``height_above_ground_m`` with ``ground`` ("terrain" or "flat") at which height above what. ``registration`` says
    how its picture fits the map, and ``refined`` how often its coordinate has become better since the first answer.

    Of one that was followed, ``track_status`` is one of `TRACK_STATES`, ``track_reason`` why it is not seen, and
    ``seen_unix_us`` the exposure of the last sighting, of which the place is. ``moving`` and the velocity are None
    before they are known.
    """

    id: str
    name: str
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float | None
    method: str
    created_unix_us: int
    updated_unix_us: int
    version: int = 1
    vehicle_id: str | None = None
    frame_id: int | None = None
    t_unix_us: int | None = None
    u_px: float | None = None
    v_px: float | None = None
    var_n_m2: float | None = None
    var_e_m2: float | None = None
    var_d_m2: float | None = None
    cov_ne_m2: float | None = None
    height_above_ground_m: float | None = None
    ground: str | None = None
    registration: str | None = None
    refined: int | None = None
    track_status: str | None = None
    track_reason: str | None = None
    seen_unix_us: int | None = None
    moving: bool | None = None
    vel_n_m_s: float | None = None
    vel_e_m_s: float | None = None
    var_vel_n_m2_s2: float | None = None
    var_vel_e_m2_s2: float | None = None
    cov_vel_ne_m2_s2: float | None = None

    @property
    def followed(self) -> bool:
        """Whether it is being followed now."""
        return self.track_status in (SEEN, LOST)


@dataclass(frozen=True, slots=True)
class TrackUpdate:
    """What following found: where a target was at ``seen_unix_us``, how it moved then, and whether it is seen now."""

    status: str
    reason: str | None
    seen_unix_us: int
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    var_n_m2: float
    var_e_m2: float
    cov_ne_m2: float
    var_d_m2: float
    moving: bool | None
    vel_n_m_s: float | None
    vel_e_m_s: float | None
    var_vel_n_m2_s2: float | None
    var_vel_e_m2_s2: float | None
    cov_vel_ne_m2_s2: float | None


@dataclass(frozen=True, slots=True)
class TargetChange:
    """What to change of a target; None leaves as it is. A new position has no covariance from the old click."""

    name: str | None = None
    position_deg: tuple[float, float] | None = None
    alt_amsl_m: float | None = None


class TargetStore:
    """Keeps targets. A method that returns has its change on the disk.

    Reads come from memory: the station is the only writer of its database, and a hundred viewers that connect at once
    must not queue for it.
    """

    def __init__(self, database: Database, targets: list[Target]) -> None:
        self._database = database
        self._targets = {target.id: target for target in targets}

    @classmethod
    async def load(cls, database: Database) -> TargetStore:
        """The store of a database, with what it holds."""
        async with database.session() as session:
            rows = await session.scalars(select(TargetRow))
            return cls(database, [_target(row) for row in rows])

    async def add(self, target: Target) -> None:
        """Keep a new target."""
        async with self._database.writing:
            async with self._database.session.begin() as session:
                session.add(TargetRow(**asdict(target)))
            self._targets[target.id] = target

    def all(self) -> list[Target]:
        """All targets, the oldest first."""
        return sorted(self._targets.values(), key=lambda target: (target.created_unix_us, target.id))

    def get(self, target_id: str) -> Target:
        """One target, or UnknownTargetError."""
        return self._expected(target_id, None)

    def expected(self, target_id: str, version: int | None) -> Target:
        """One target, if it has the expected version (None: whichever it has); else TargetChangedError."""
        return self._expected(target_id, version)

    async def change(self, target_id: str, change: TargetChange, version: int | None, now_us: int) -> Target:
        """Change a target, if it still has the expected version (None: whichever it has)."""
        async with self._database.writing:
            return await self._replace(_changed(self._expected(target_id, version), change, now_us))

    async def track(self, target_id: str, update: TrackUpdate, now_us: int) -> Target:
        """Keep where a target was seen; its coordinate is then that of sightings, no longer that of the click."""
        async with self._database.writing:
            target = self._expected(target_id, None)
            found = asdict(update)
            found["track_status"], found["track_reason"] = found.pop("status"), found.pop("reason")
            return await self._replace(
                replace(target, version=target.version + 1, updated_unix_us=now_us, method=FOLLOWED, **found)
            )

    async def set_track(self, target_id: str, status: str, reason: str | None, now_us: int) -> Target:
        """Say whether a target is followed; its coordinate stays as it is."""
        async with self._database.writing:
            target = self._expected(target_id, None)
            changed = replace(target, version=target.version + 1, updated_unix_us=now_us)
            return await self._replace(replace(changed, track_status=status, track_reason=reason))

    async def _replace(self, changed: Target) -> Target:
        async with self._database.session.begin() as session:
            await session.merge(TargetRow(**asdict(changed)))
        self._targets[changed.id] = changed
        return changed

    async def put(self, target: Target) -> None:
        """Keep what a target has become; it must be the next version of the one that is kept."""
        async with self._database.writing:
            self._expected(target.id, target.version - 1)
            async with self._database.session.begin() as session:
                await session.merge(TargetRow(**asdict(target)))
            self._targets[target.id] = target

    async def delete(self, target_id: str, version: int | None) -> Target:
        """Remove and return a target, if it still has the expected version (None: whichever it has)."""
        async with self._database.writing:
            target = self._expected(target_id, version)
            async with self._database.session.begin() as session:
                await session.execute(delete(TargetRow).where(TargetRow.id == target_id))
            del self._targets[target_id]
        return target

    def _expected(self, target_id: str, version: int | None) -> Target:
        target = self._targets.get(target_id)
        if target is None:
            raise UnknownTargetError(target_id)
        if version is not None and target.version != version:
            raise TargetChangedError(target_id, target.version)
        return target


def _changed(target: Target, change: TargetChange, now_us: int) -> Target:
    changed = replace(target, version=target.version + 1, updated_unix_us=now_us)
    if change.name is not None:
        changed = replace(changed, name=change.name)
    if change.alt_amsl_m is not None:
        changed = replace(changed, alt_amsl_m=change.alt_amsl_m)
    if change.position_deg is not None:
        lat_deg, lon_deg = change.position_deg
        changed = replace(
            changed, lat_deg=lat_deg, lon_deg=lon_deg, method="manual",
            var_n_m2=None, var_e_m2=None, var_d_m2=None, cov_ne_m2=None, height_above_ground_m=None, ground=None,
            seen_unix_us=None, moving=None, vel_n_m_s=None, vel_e_m_s=None, var_vel_n_m2_s2=None,
            var_vel_e_m2_s2=None, cov_vel_ne_m2_s2=None,
            registration=None, refined=None,
        )  # fmt: skip
    return changed


def _target(row: TargetRow) -> Target:
    return Target(**{name: getattr(row, name) for name in Target.__dataclass_fields__})
