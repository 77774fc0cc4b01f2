"""A replay over time, for faults that come and go: errors before, during and after, modes, and the alarms raised."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from backend.alarms import VIDEO_FROZEN, AlarmBoard, estimator_checks
from benchmarks.studies.figures import WRONG_SIGMAS
from estimator.types import Doubt, Float, Mode

NORMAL_M = 1.0
"""An error is normal again inside twice what it was before the fault, or inside twice this."""
SHOWN_MODES = (Mode.VISION, Mode.DEAD_RECKONING, Mode.LOST)


@dataclass(frozen=True, slots=True, eq=False)
class Series:
    """A replay's states: seconds since GPS was denied (n,), horizontal error in metres (n,) and in its sigmas (n,).

    ``modes`` and ``doubts`` are the states' own, ``frozen`` (n,) is whether the station would call the video frozen.
    """

    t_s: Float
    error_m: Float
    sigmas: Float
    modes: tuple[Mode, ...]
    doubts: tuple[tuple[Doubt, ...], ...]
    frozen: NDArray[np.bool_]


def alarms_raised(series: Series) -> list[str]:
    """Codes of the alarms that the station would raise over the whole flight, in order."""
    board = AlarmBoard()
    codes: dict[str, None] = {}
    for t_s, mode, doubts, frozen in zip(series.t_s, series.modes, series.doubts, series.frozen, strict=True):
        for kind, condition, text in (*estimator_checks("1", mode, doubts), (VIDEO_FROZEN, bool(frozen), "")):
            alarm = board.watch(kind, "1", condition, text, round(1e6 * t_s))
            if alarm is not None and alarm.active:
                codes[alarm.code] = None
    return list(codes)


def recovery_s(series: Series, start_s: float, end_s: float) -> float:
    """How long after a stretch the mode is vision and the error what it was before; infinite where it never is."""
    before = (series.t_s >= 0.0) & (series.t_s < start_s)
    normal_m = 2.0 * max(float(np.sqrt(np.mean(series.error_m[before] ** 2))) if before.any() else 0.0, NORMAL_M)
    vision = np.array([mode is Mode.VISION for mode in series.modes])
    well = (series.t_s >= end_s) & (series.error_m <= normal_m) & vision
    return float(series.t_s[well][0] - end_s) if well.any() else float("inf")


def series_figures(runs: Sequence[Series], stretch_s: tuple[float, float], denied_s: float) -> dict[str, Any]:
    """Figures of some replays with a fault in a stretch; one that lasts has neither after nor a recovery.

    States from ``denied_s`` on, when GPS is back, count for nothing. Errors are as rms and 95 % limit.
    ``sure_and_wrong`` is the share of states in mode vision beyond five sigma.
    """
    start_s, end_s = stretch_s
    runs = [_until(run, denied_s) for run in runs]
    lasts = end_s >= denied_s
    spans = {"before": (0.0, start_s), "during": (start_s, end_s), "after": (end_s, np.inf)}
    if lasts:
        del spans["after"]
    figures: dict[str, Any] = {}
    for name, (first, last) in spans.items():
        error = np.concatenate([run.error_m[(run.t_s >= first) & (run.t_s < last)] for run in runs])
        if len(error):
            rms_m, p95_m = float(np.sqrt((error**2).mean())), float(np.percentile(error, 95))
            figures |= {f"rms_{name}_m": rms_m, f"p95_{name}_m": p95_m, name: f"{rms_m:.1f} / {p95_m:.1f}"}
    denied = [run.t_s >= 0.0 for run in runs]
    sigmas = np.concatenate([run.sigmas[inside] for run, inside in zip(runs, denied, strict=True)])
    vision, modes = _modes(runs, denied), _modes(runs, [_inside(run.t_s, *spans["during"]) for run in runs])
    shares = [float(np.mean(modes == mode)) for mode in SHOWN_MODES]
    figures |= {f"share_{mode}": share for mode, share in zip(SHOWN_MODES, shares, strict=True)}
    figures["modes"] = " / ".join(f"{100.0 * share:.0f}" for share in shares)
    figures["largest_sigmas"] = float(sigmas.max())
    figures["sure_and_wrong"] = float(((sigmas > WRONG_SIGMAS) & (vision == Mode.VISION)).mean())
    counts = Counter(code for run in runs for code in alarms_raised(run))
    figures["alarms"] = ", ".join(f"{code} {count}" for code, count in counts.items()) or "none"
    if not lasts:
        waits = [recovery_s(run, start_s, end_s) for run in runs]
        back = [wait for wait in waits if np.isfinite(wait)]
        figures["recovered"] = f"{np.mean(back):.1f} s" if back else "never"
        if back and len(back) < len(waits):
            figures["recovered"] += f" ({len(back)} of {len(waits)})"
    return figures


def _until(run: Series, end_s: float) -> Series:
    count = int(np.searchsorted(run.t_s, end_s))
    return Series(
        run.t_s[:count], run.error_m[:count], run.sigmas[:count], run.modes[:count], run.doubts[:count],
        run.frozen[:count],
    )  # fmt: skip


def _inside(t_s: Float, first_s: float, last_s: float) -> NDArray[np.bool_]:
    return (t_s >= first_s) & (t_s < last_s)


def _modes(runs: Sequence[Series], inside: Sequence[NDArray[np.bool_]]) -> NDArray[np.str_]:
    kept = [mode for run, use in zip(runs, inside, strict=True) for mode, on in zip(run.modes, use, strict=True) if on]
    return np.array([str(mode) for mode in kept])
