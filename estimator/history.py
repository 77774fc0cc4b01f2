"""Samples in time order, states by time, and attitudes between their reports."""

from __future__ import annotations

import bisect
import heapq
from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from estimator.geometry.rotation import matrix_from_q, q_conjugate, q_multiply, q_slerp, rotvec_from_q
from estimator.types import Float, InertialSample, NavigationState, PadRelative, Sample

MOST_CORRECTED_US = 600_000_000
"""Of a whole flight's history the states of so long are kept with their predictions."""


class SampleQueue:
    """Samples sorted by time; one that is older than what has been taken out is refused and counted."""

    def __init__(self) -> None:
        self._heap: list[tuple[int, int, Sample]] = []
        self._count = 0
        self.taken_until_us: int | None = None
        self.late = 0

    def push(self, sample: Sample) -> bool:
        """Add a sample; False if it came too late."""
        if self.taken_until_us is not None and sample.t_us < self.taken_until_us:
            self.late += 1
            return False
        self._count += 1
        heapq.heappush(self._heap, (sample.t_us, self._count, sample))
        return True

    def take_until(self, t_us: int) -> Iterator[Sample]:
        """Take out, in order, all samples up to and including ``t_us``, each when it is its turn."""
        if self.taken_until_us is None or t_us > self.taken_until_us:
            self.taken_until_us = t_us
        while self._heap and self._heap[0][0] <= t_us:
            yield heapq.heappop(self._heap)[2]

    def pending(self) -> list[Sample]:
        """What waits, in order of time."""
        return [entry[2] for entry in sorted(self._heap)]


class AttitudeTrack:
    """Reported quaternions over time, interpolated; keeps the last ``keep_s`` seconds."""

    def __init__(self, keep_s: float = 10.0) -> None:
        self._t_us: list[int] = []
        self._q: list[Float] = []
        self._keep_us = int(keep_s * 1e6)

    def add(self, t_us: int, q: Float) -> None:
        """Add a quaternion (4,), in any order; one for a time already held is ignored."""
        index = bisect.bisect_left(self._t_us, t_us)
        if index < len(self._t_us) and self._t_us[index] == t_us:
            return
        self._t_us.insert(index, t_us)
        self._q.insert(index, q)
        newest = self._t_us[-1]
        if self._t_us[0] < newest - 2 * self._keep_us:
            keep = bisect.bisect_left(self._t_us, newest - self._keep_us)
            del self._t_us[:keep], self._q[:keep]

    @property
    def newest_t_us(self) -> int | None:
        """Time of the last report."""
        return self._t_us[-1] if self._t_us else None

    def at(self, t_us: int, max_extrapolation_us: int = 300_000) -> Float | None:
        """Quaternion at a time: interpolated, or turned on at the last rate past the newest; None where too far."""
        if not self._t_us:
            return None
        index = bisect.bisect_left(self._t_us, t_us)
        if index == len(self._t_us):
            return self._beyond_newest(t_us, max_extrapolation_us)
        if index == 0:
            return self._q[0] if self._t_us[0] - t_us <= max_extrapolation_us else None
        before, after = self._t_us[index - 1], self._t_us[index]
        if after - before > 4 * max_extrapolation_us:
            return None
        return q_slerp(self._q[index - 1], self._q[index], (t_us - before) / (after - before))

    def turning_rad_s(self, t_us: int) -> Float:
        """Fastest rate (3,), about the axes that the reports turn, between those around a time; 0 where it is unknown.

        Of three intervals: a rate that has changed between reports is in the one beside.
        """
        index = bisect.bisect_left(self._t_us, t_us)
        fastest: Float = np.zeros(3)
        for after in range(max(index - 1, 1), min(index + 2, len(self._t_us))):
            turn = rotvec_from_q(q_multiply(q_conjugate(self._q[after - 1]), self._q[after]))
            rate = turn / (1e-6 * (self._t_us[after] - self._t_us[after - 1]))
            if rate @ rate > fastest @ fastest:
                fastest = rate
        return fastest

    def _beyond_newest(self, t_us: int, max_extrapolation_us: int) -> Float | None:
        beyond = t_us - self._t_us[-1]
        if beyond > max_extrapolation_us:
            return None
        span = self._t_us[-1] - self._t_us[-2] if len(self._t_us) > 1 else 0
        if beyond == 0 or not 0 < span <= max_extrapolation_us:
            return self._q[-1]
        return q_slerp(self._q[-2], self._q[-1], 1.0 + beyond / span)


class InertialTrack:
    """Gyroscope and accelerometer readings over time, interpolated; keeps the last ``keep_s`` seconds.

    A reading tells of a moment ``delay_s`` before its stamp: it is the mean since the last one, or has passed a filter.
    """

    def __init__(self, delay_s: float, keep_s: float = 4.0) -> None:
        self._t_us: list[int] = []
        self._readings: list[Float] = []
        self._delay_us = round(delay_s * 1e6)
        self._keep_us = int(keep_s * 1e6)

    def add(self, sample: InertialSample) -> None:
        """Add a reading, in any order; one for a time already held is ignored."""
        t_us = sample.t_us - self._delay_us
        index = bisect.bisect_left(self._t_us, t_us)
        if index < len(self._t_us) and self._t_us[index] == t_us:
            return
        self._t_us.insert(index, t_us)
        self._readings.insert(index, np.concatenate((sample.rate_body_rad_s, sample.specific_force_body_m_s2)))
        if self._t_us[0] < self._t_us[-1] - 2 * self._keep_us:
            keep = bisect.bisect_left(self._t_us, self._t_us[-1] - self._keep_us)
            del self._t_us[:keep], self._readings[:keep]

    def at(self, t_us: int) -> tuple[Float, Float] | None:
        """Rates (3,) and specific force (3,) at a time, those at the ends held beyond them; None before the first."""
        if not self._t_us:
            return None
        index = bisect.bisect_left(self._t_us, t_us)
        if index in (0, len(self._t_us)):
            reading = self._readings[min(index, len(self._t_us) - 1)]
        else:
            before, after = self._t_us[index - 1], self._t_us[index]
            share = (t_us - before) / (after - before)
            reading = (1.0 - share) * self._readings[index - 1] + share * self._readings[index]
        return reading[:3], reading[3:]


class SampleRate:
    """How often samples of one kind have come lately."""

    def __init__(self) -> None:
        self._t_us: list[int] = []

    def note(self, t_us: int) -> None:
        """One has come."""
        self._t_us.append(t_us)
        del self._t_us[:-20]

    def hz(self, t_us: int, timeout_s: float) -> float:
        """Their rate at a time; zero before the tenth, and when the last one is older than ``timeout_s``."""
        times = self._t_us
        if len(times) < 10 or t_us - times[-1] > timeout_s * 1e6:
            return 0.0
        return (len(times) - 1) / max((times[-1] - times[0]) / 1e6, 1e-6)


@dataclass(frozen=True, slots=True, eq=False)
class Corrected:
    """A state as predicted, and as it was after what was measured at its time."""

    before: NavigationState
    after: NavigationState


class StateHistory:
    """States over time, interpolated; keeps the last ``keep_s`` seconds."""

    def __init__(self, keep_s: float = 120.0) -> None:
        self._t_us: list[int] = []
        self._states: list[NavigationState] = []
        self._keep_us = int(keep_s * 1e6)
        self._predicted: NavigationState | None = None
        self._corrected: list[Corrected] = []

    def add(self, state: NavigationState) -> None:
        """Add the newest state; of several at one time the last one counts."""
        while self._t_us and self._t_us[-1] >= state.t_us:
            self._t_us.pop()
            self._states.pop()
        self._t_us.append(state.t_us)
        self._states.append(state)
        self._note_correction(state)
        if self._t_us[0] < state.t_us - self._keep_us - 5_000_000:
            keep = bisect.bisect_left(self._t_us, state.t_us - self._keep_us)
            del self._t_us[:keep], self._states[:keep]

    def expect(self, predicted: NavigationState) -> None:
        """What the state was before what is measured at its time; `add` follows with the state after that."""
        self._predicted = predicted

    def _note_correction(self, state: NavigationState) -> None:
        predicted, self._predicted = self._predicted, None
        if predicted is None or predicted.t_us != state.t_us:
            return
        self._corrected.append(Corrected(predicted, state))
        first_us = state.t_us - min(self._keep_us, MOST_CORRECTED_US)
        if self._corrected[0].after.t_us < first_us - 5_000_000:
            self._corrected = [each for each in self._corrected if first_us <= each.after.t_us <= state.t_us]

    def corrected(self) -> list[Corrected]:
        """The states of pictures and fixes, before and after those. May be asked by any thread."""
        return self._corrected.copy()

    def at(self, t_us: int) -> NavigationState | None:
        """The state at a time inside the kept span, None outside it."""
        if not self._t_us or not self._t_us[0] <= t_us <= self._t_us[-1]:
            return None
        index = bisect.bisect_left(self._t_us, t_us)
        if self._t_us[index] == t_us:
            return self._states[index]
        return between(self._states[index - 1], self._states[index], t_us)


def between(before: NavigationState, after: NavigationState, t_us: int) -> NavigationState:
    """The state between two: position and velocity linear, attitudes by slerp, the rest from the nearer."""
    share = (t_us - before.t_us) / (after.t_us - before.t_us)
    nearer = before if share < 0.5 else after
    return replace(
        nearer,
        t_us=t_us,
        lat_rad=before.lat_rad + share * (after.lat_rad - before.lat_rad),
        lon_rad=before.lon_rad + share * (after.lon_rad - before.lon_rad),
        alt_amsl_m=before.alt_amsl_m + share * (after.alt_amsl_m - before.alt_amsl_m),
        alt_agl_m=before.alt_agl_m + share * (after.alt_agl_m - before.alt_agl_m),
        pos_ned_m=before.pos_ned_m + share * (after.pos_ned_m - before.pos_ned_m),
        vel_ned_m_s=before.vel_ned_m_s + share * (after.vel_ned_m_s - before.vel_ned_m_s),
        q_ned_from_body=q_slerp(before.q_ned_from_body, after.q_ned_from_body, share),
        q_ned_from_camera=q_slerp(before.q_ned_from_camera, after.q_ned_from_camera, share),
        lever_ned_m=before.lever_ned_m + share * (after.lever_ned_m - before.lever_ned_m),
        pad=_between_pads(before.pad, after.pad, share),
    )


def _between_pads(before: PadRelative | None, after: PadRelative | None, share: float) -> PadRelative | None:
    """A place between two: position and velocity linear, the rest from the nearer."""
    nearer = before if share < 0.5 else after
    if before is None or after is None or nearer is None:
        return nearer
    return replace(
        nearer,
        pos_ned_m=before.pos_ned_m + share * (after.pos_ned_m - before.pos_ned_m),
        vel_ned_m_s=before.vel_ned_m_s + share * (after.vel_ned_m_s - before.vel_ned_m_s),
    )


def rotation_between(q_from: Float, q_to: Float) -> Float:
    """Small rotation (3,) about the NED axes that takes one attitude to another."""
    conjugate = q_from * np.array([1.0, -1.0, -1.0, -1.0])
    return rotvec_from_q(q_multiply(q_to, conjugate))


def level_yaw_matrix(q_ned_from_body: Float) -> Float:
    """Rotation (3, 3) about the vertical by the yaw of an attitude."""
    ned_from_body = matrix_from_q(q_ned_from_body)
    yaw = np.arctan2(ned_from_body[1, 0], ned_from_body[0, 0])
    cos, sin = np.cos(yaw), np.sin(yaw)
    return np.array([[cos, -sin, 0.0], [sin, cos, 0.0], [0.0, 0.0, 1.0]])
