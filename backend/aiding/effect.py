"""Whether an autopilot uses what it is told: by what it answers, and by where it has itself. No I/O, no clock."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

# An autopilot that takes positions at once has come by then; one that weighs them takes a while.
SETTLED_US = 10_000_000
_UNANSWERED = 3
# 95 % of a normal error in two dimensions, and what an autopilot's own noise and delay make.
_SIGMAS, _SLACK_M = 2.4477, 2.0


class Effect(StrEnum):
    """What can be said of the effect."""

    USED = "used"
    NOT_USED = "not_used"
    CANNOT_TELL = "cannot_tell"


@dataclass(frozen=True, slots=True)
class Evidence:
    """What is known of it.

    ``sending_us`` is for how long it has been sent without a pause. ``answers`` is what came to a form that is
    answered, None for one that is not: accepted, refused, and the words of the last refusal where it stands.
    ``gap_began_m``, ``gap_now_m`` are from the estimate to where the autopilot has itself, None where it does not say;
    ``std_m`` is how well the estimate is known.
    """

    sending: bool
    sending_us: int
    sent: int
    answers: tuple[int, int, str] | None
    gap_began_m: float | None
    gap_now_m: float | None
    std_m: float


def judge(seen: Evidence) -> tuple[Effect, str]:
    """Whether it is used, and why that is said."""
    if not seen.sending:
        return Effect.CANNOT_TELL, "nothing is sent now"
    accepts = False
    if seen.answers is not None:
        accepted, refused, words = seen.answers
        if words:
            return Effect.NOT_USED, f"the autopilot refuses it ({words})"
        if accepted + refused == 0:
            if seen.sent > _UNANSWERED:
                return Effect.NOT_USED, "the autopilot does not answer to it: it may not know the command"
            return Effect.CANNOT_TELL, "the autopilot has not answered yet"
        accepts = True
    return _by_place(seen, accepts=accepts)


def _by_place(seen: Evidence, *, accepts: bool) -> tuple[Effect, str]:
    near_m = _SLACK_M + _SIGMAS * seen.std_m
    now_m, began_m = seen.gap_now_m, seen.gap_began_m
    if now_m is None:
        return Effect.CANNOT_TELL, "the autopilot does not say where it has itself"
    if now_m <= near_m:
        if began_m is not None and began_m > near_m:
            return Effect.USED, f"where it has itself was {began_m:.0f} m from the estimate, and is {now_m:.0f} m"
        if accepts:
            return Effect.USED, f"the autopilot accepts it, and has itself {now_m:.0f} m from the estimate"
        return Effect.CANNOT_TELL, f"the autopilot had itself as near before: {now_m:.0f} m from the estimate"
    if seen.sending_us < SETTLED_US:
        return Effect.CANNOT_TELL, f"the autopilot has itself {now_m:.0f} m from the estimate: wait some seconds"
    return Effect.NOT_USED, f"the autopilot has itself {now_m:.0f} m from the estimate"
