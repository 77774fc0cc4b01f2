"""Counts of what one vehicle sends: rates by message, losses by sequence number."""

from __future__ import annotations

from collections import Counter, deque
from dataclasses import dataclass, field

# Further ahead than this is a packet that was overtaken, not 200 lost ones.
_LARGEST_GAP = 200
_WINDOW_S = 5


@dataclass(slots=True)
class _Second:
    packets: int = 0
    lost: int = 0
    size: int = 0
    by_id: Counter[int] = field(default_factory=Counter)


@dataclass(slots=True)
class PacketStats:
    """Totals, and figures over the last five full seconds (``close_second`` is called once a second)."""

    packets: int = 0
    lost: int = 0
    signed: int = 0
    version: int = 0
    _seq: dict[int, int] = field(default_factory=dict)
    _open: _Second = field(default_factory=_Second)
    _closed: deque[_Second] = field(default_factory=lambda: deque(maxlen=_WINDOW_S))

    def count(self, component_id: int, seq: int, size: int, msg_id: int, *, signed: bool, version: int) -> None:
        """Take one packet."""
        newest = self._seq.get(component_id)
        gap = 0 if newest is None else (seq - newest - 1) & 0xFF
        if gap < _LARGEST_GAP:
            self._seq[component_id] = seq
            self.lost += gap
            self._open.lost += gap
        self.packets += 1
        self.signed += signed
        self.version = version
        self._open.packets += 1
        self._open.size += size
        self._open.by_id[msg_id] += 1

    def forget_sequence(self) -> None:
        """After a silence or a reboot the numbers start anywhere."""
        self._seq.clear()

    def close_second(self) -> None:
        """A second has passed."""
        self._closed.append(self._open)
        self._open = _Second()

    def rates_hz(self) -> dict[int, float]:
        """Messages per second by id."""
        total: Counter[int] = Counter()
        for second in self._closed:
            total.update(second.by_id)
        return {msg_id: n / len(self._closed) for msg_id, n in total.items()}

    def messages_per_s(self) -> float:
        """All packets per second."""
        return sum(second.packets for second in self._closed) / max(len(self._closed), 1)

    def bytes_per_s(self) -> float:
        """All bytes per second."""
        return sum(second.size for second in self._closed) / max(len(self._closed), 1)

    def loss_pct(self) -> float:
        """Share of packets that never came."""
        lost = sum(second.lost for second in self._closed)
        came = sum(second.packets for second in self._closed)
        return 100.0 * lost / max(lost + came, 1)
