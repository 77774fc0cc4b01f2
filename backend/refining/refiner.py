"""Clicks that were answered become better: by their pictures' registration to the map, and by later fixes."""

from __future__ import annotations

import asyncio
import contextlib
import os
import threading
from collections.abc import Callable, Coroutine
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import Any, TypeVar

import structlog
from sqlalchemy.exc import SQLAlchemyError

from backend.clock import mono_us, unix_us
from backend.errors import TargetChangedError, TargetNotKeptError, UnknownTargetError
from backend.evidence.collect import Sighting
from backend.evidence.keeper import EvidenceKeeper
from backend.evidence.registering import Registered
from backend.metrics import Metrics
from backend.refining.later import LaterFixes
from backend.refining.places import Refined, corrected_state, refine, registered
from backend.store.targets import Target, TargetStore
from estimator.registration.placement import Placement

MOST_WAITING = 32
MOST_LOOKED_BACK_AT = 200
LOOK_BACK_S = 3.0
QUIET_US, LONGEST_UNQUIET_US = 2_000_000, 15_000_000
NICENESS = 10  # of the thread: the estimator and the links go first
WAITING = "waiting"
NO_MAP = "no match: there is no map"
TOO_MANY = "not tried: too many clicks at once"
CUT_OFF = "not tried: the station was ended before"
_LONGEST_WORDS = 300
_ATTEMPTS = 5  # somebody may rename the target meanwhile

_log = structlog.get_logger(__name__)
_Found = TypeVar("_Found")


@dataclass(slots=True, eq=False)
class LocatedClick:
    """A click as it was located last; ``search`` is None until its picture was registered.

    ``later`` is where later fixes of its state come from, None where none can.
    """

    sighting: Sighting
    source: str
    picture: bytes | None
    taken_us: int
    later: LaterFixes | None = None
    search: Registered | None = None


class Refiner:
    """Registers the pictures of clicks, and looks back at them, in one thread of its own. Lives on the event loop.

    ``changed`` is called with a target that has a new version; ``targets`` gives the store once there is one.
    """

    def __init__(
        self, targets: Callable[[], TargetStore], evidence: EvidenceKeeper, metrics: Metrics,
        changed: Callable[[Target], None],
    ) -> None:  # fmt: skip
        self._targets = targets
        self._evidence = evidence
        self._metrics = metrics
        self._changed = changed
        self._waiting: asyncio.Queue[LocatedClick] = asyncio.Queue(MOST_WAITING)
        self._thread = ThreadPoolExecutor(1, "refining", initializer=_be_nice)
        self._tasks: list[asyncio.Task[None]] = []
        self._lately: list[LocatedClick] = []
        self._keeping: set[asyncio.Future[None]] = set()

    async def start(self) -> None:
        """Begin to work; what an earlier end cut off is marked as such."""
        for target in self._targets().all():
            if target.registration == WAITING:
                await self._targets().put(_next(target, CUT_OFF))
        self._tasks = [asyncio.create_task(self._run()), asyncio.create_task(self._look_back())]

    async def close(self) -> None:
        """End; what waits is left, what is being registered ends by itself."""
        for task in self._tasks:
            task.cancel()
        await asyncio.gather(*self._tasks, return_exceptions=True)
        # The database must not be closed under a row that is being written.
        await asyncio.gather(*self._keeping, return_exceptions=True)
        self._thread.shutdown(wait=False, cancel_futures=True)

    def prospect(self, sighting: Sighting) -> str:
        """What a new click's ``registration`` says before it is tried."""
        if sighting.setup.reference is None:
            return NO_MAP
        return TOO_MANY if self._waiting.full() else WAITING

    def take(self, sighting: Sighting, source: str, picture: bytes | None, later: LaterFixes | None = None) -> None:
        """A click was located and kept, of a frame whose JPEG is ``picture``; ``later`` will know more of its state."""
        click = LocatedClick(sighting, source, picture, mono_us(), later)
        if sighting.target.registration == WAITING:
            try:
                self._waiting.put_nowait(click)
            except asyncio.QueueFull:
                self._in_background(self._kept(click, Refined(None, TOO_MANY)))
        if later is not None:
            self._lately.append(click)
            del self._lately[:-MOST_LOOKED_BACK_AT]

    def _in_background(self, work: Coroutine[Any, Any, None]) -> None:
        task = asyncio.create_task(work)
        self._tasks.append(task)
        task.add_done_callback(self._tasks.remove)

    async def _run(self) -> None:
        while True:
            click = await self._waiting.get()
            try:
                await self._register(click)
            except TargetNotKeptError as error:
                _log.warning("better coordinate not kept", target=click.sighting.target.id, error=str(error))
            except Exception:
                _log.exception("click not registered", target=click.sighting.target.id)
                await self._kept(click, Refined(None, "not tried: it failed"))

    async def _register(self, click: LocatedClick) -> None:
        started_us = mono_us()
        click.search = await self._in_thread(registered, click.sighting, click.picture)
        found = await self._in_thread(refine, click.sighting, click.search, click.sighting.state)
        await self._kept(click, found)
        self._metrics.stage.labels("click_registration").observe((mono_us() - started_us) / 1e6)
        self._metrics.stage.labels("click_to_refined").observe((mono_us() - click.taken_us) / 1e6)

    async def _look_back(self) -> None:
        """Every few seconds: have later fixes moved the states that clicks of the last minute were located with?"""
        looked_us = mono_us()
        while True:
            await asyncio.sleep(LOOK_BACK_S)
            newest_us = max((click.taken_us for click in self._lately), default=0)
            if mono_us() - newest_us < QUIET_US and mono_us() - looked_us < LONGEST_UNQUIET_US:
                continue  # somebody is clicking: answers go first
            looked_us = mono_us()
            # Asked before they are looked at: what comes to be known in between is for the next time.
            over = [
                click
                for click in self._lately
                if click.later is None or not click.later.expects_more(looked_us - click.taken_us)
            ]
            over = [click for click in over if self._is_settled(click)]
            for later in {click.later for click in self._lately if click.later is not None}:
                clicks = [click for click in self._lately if click.later == later and self._is_settled(click)]
                try:
                    await self._correct(later, clicks)
                except TargetNotKeptError as error:
                    _log.warning("better coordinates not kept", error=str(error))
                except Exception:
                    _log.exception("clicks not corrected by later fixes")
            self._lately = [click for click in self._lately if click not in over]

    def _is_settled(self, click: LocatedClick) -> bool:
        return click.search is not None or click.sighting.target.registration != WAITING

    async def _correct(self, later: LaterFixes, clicks: list[LocatedClick]) -> None:
        if not clicks:
            return
        setup = clicks[0].sighting.setup
        first_us = min(click.sighting.state.t_us for click in clicks)
        known = await self._in_thread(later.hindsight, first_us, setup)
        if known is None:
            return
        for click in clicks:
            if known.is_final(click.sighting.state.t_us):
                self._lately.remove(click)  # nothing that comes will move it any more
            state = corrected_state(click.sighting, known)
            if state is None:
                continue
            if click.search is None or not isinstance(click.search.placed, Placement):
                # From where the vehicle was in truth the picture may match.
                again = replace(click.sighting, state=state, corrected=True)
                click.search = await self._in_thread(registered, again, click.picture)
            await self._kept(click, await self._in_thread(refine, click.sighting, click.search, state))

    async def _in_thread(self, work: Callable[..., _Found], *arguments: object) -> _Found:
        return await asyncio.get_running_loop().run_in_executor(self._thread, work, *arguments)

    async def _kept(self, click: LocatedClick, found: Refined) -> None:
        """`_keep`, which goes on to its end where this is cancelled."""
        keeping = asyncio.ensure_future(self._keep(click, found))
        self._keeping.add(keeping)
        keeping.add_done_callback(self._keeping.discard)
        await asyncio.shield(keeping)

    async def _keep(self, click: LocatedClick, found: Refined) -> None:
        """Make the outcome the target's next version, unless it is gone or somebody has moved it.

        Raises
        ------
        TargetNotKeptError
            Its evidence or its row cannot be written; the target stays as it was.
        """
        async with self._evidence.changing:
            for _ in range(_ATTEMPTS):
                try:
                    target = self._targets().get(click.sighting.target.id)
                except UnknownTargetError:
                    return
                if _place(target) != _place(click.sighting.target):
                    return
                with contextlib.suppress(TargetChangedError, UnknownTargetError):
                    await self._put(click, found, target)
                    return

    async def _put(self, click: LocatedClick, found: Refined, target: Target) -> None:
        new = _next(target, found.registration)
        if found.sighting is None:
            await self._put_row(new)
        else:
            at = found.sighting.target
            new = replace(
                new, lat_deg=at.lat_deg, lon_deg=at.lon_deg, alt_amsl_m=at.alt_amsl_m, method=at.method,
                var_n_m2=at.var_n_m2, var_e_m2=at.var_e_m2, var_d_m2=at.var_d_m2, cov_ne_m2=at.cov_ne_m2,
                refined=(target.refined or 0) + 1,
            )  # fmt: skip
            sighting = replace(found.sighting, target=new)
            await self._evidence.keep_again(sighting, click.source, click.picture)
            try:
                await self._put_row(new)
            except BaseException:
                await self._evidence.discard(new.id, new.version)
                raise
            await self._evidence.confirm(new.id, new.version)
            click.sighting = sighting
        self._changed(new)

    async def _put_row(self, target: Target) -> None:
        try:
            await self._targets().put(target)
        except SQLAlchemyError as error:
            raise TargetNotKeptError(f"database: {getattr(error, 'orig', None) or error}") from None


def _next(target: Target, registration: str) -> Target:
    words = registration[:_LONGEST_WORDS]
    return replace(target, version=target.version + 1, updated_unix_us=unix_us(), registration=words)


def _place(target: Target) -> tuple[float, float, float | None, str]:
    return target.lat_deg, target.lon_deg, target.alt_amsl_m, target.method


def _be_nice() -> None:
    if hasattr(os, "setpriority") and hasattr(os, "PRIO_PROCESS"):
        with contextlib.suppress(OSError):
            os.setpriority(os.PRIO_PROCESS, threading.get_native_id(), NICENESS)
