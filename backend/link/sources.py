"""Chooses one of several messages that carry the same measurement, so that none is counted twice."""

from __future__ import annotations

from dataclasses import dataclass, field

_SILENT_US = 1_000_000
_SMOOTHING = 0.1
_COUNT_TO_TRUST = 5
# A source must be this much faster to be preferred for its rate, so that the choice does not flap.
_FASTER = 2.0


@dataclass(slots=True)
class _Source:
    newest_us: int
    interval_us: float = float(_SILENT_US)
    count: int = 0


@dataclass(slots=True)
class SourceSelector:
    """``preferred`` lists message ids, best first; a slow one is good enough up to ``enough_interval_us``.

    The best source that is frequent enough wins; when none is, the most frequent. A source silent for a second is
    given up.
    """

    preferred: tuple[int, ...]
    enough_interval_us: int
    _current: int | None = None
    _sources: dict[int, _Source] = field(default_factory=dict)

    def accept(self, msg_id: int, t_us: int) -> bool:
        """Whether to use this message, which came at ``t_us``."""
        source = self._sources.get(msg_id)
        if source is None or t_us - source.newest_us > _SILENT_US:
            source = self._sources[msg_id] = _Source(t_us)
        else:
            source.interval_us += _SMOOTHING * (max(t_us - source.newest_us, 0) - source.interval_us)
            source.newest_us = t_us
        source.count += 1
        if self._current != msg_id and self._better(msg_id, source, t_us):
            self._current = msg_id
        return self._current == msg_id

    def _better(self, msg_id: int, source: _Source, t_us: int) -> bool:
        current = self._sources.get(self._current) if self._current is not None else None
        if current is None or self._current is None or abs(t_us - current.newest_us) > _SILENT_US:
            return True
        if source.count < _COUNT_TO_TRUST:
            return False
        if self.preferred.index(msg_id) < self.preferred.index(self._current):
            return source.interval_us < self.enough_interval_us or source.interval_us < current.interval_us
        return (
            current.count >= 2 * _COUNT_TO_TRUST
            and current.interval_us > _FASTER * self.enough_interval_us
            and source.interval_us * _FASTER < current.interval_us
        )
