"""One vehicle on the link: its clocks, what it says, and what it is asked."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from typing import Any

from backend.link import telemetry
from backend.link.aiding import EXTERNAL_POSITION_ESTIMATE
from backend.link.cameras import Cameras
from backend.link.commands import RESULTS, CommandChannel, CommandStep
from backend.link.dialect import message_layouts
from backend.link.events import (
    Autopilot,
    CommandResult,
    CommandStatus,
    LinkEvent,
    LinkStats,
    PositionAnswer,
    SampleEvent,
    TelemetryHeartbeat,
    TelemetryLocalPosition,
    TransferAction,
    VehicleAppeared,
    VehicleLost,
    VehicleRebooted,
    VehicleReturned,
)
from backend.link.framing import RawPacket
from backend.link.gimbals import Gimbals
from backend.link.missions import MESSAGES as MISSION_MESSAGES
from backend.link.missions import MissionChannel
from backend.link.parameters import PARAM_VALUE, ParameterChannel
from backend.link.rates import RateRequests
from backend.link.samples import SMALLEST_UNIX_US, SampleMaker
from backend.link.stats import PacketStats
from backend.link.timebase import BootClock
from guidance.mission import MissionItem, MissionType

LOST_AFTER_US = 5_000_000
_STATS_PERIOD_US = 1_000_000
_SYSTEM_TIME = 2
_COMMAND_ACK = 77
_LOCAL_POSITION_NED = 32
_GIMBAL_MESSAGES = (265, 285)
# Messages stamped when they are sent: where in the payload the boot time lies, and its microseconds per count.
_BOOT_TIME_BYTES = {26: 4, 29: 4, 30: 4, 31: 4, 33: 4, 285: 4, 265: 4, 27: 8, 105: 8}


class Vehicle:
    """The link's side of one system id; made when its autopilot's first heartbeat comes.

    ``station`` is the system and component id that it is spoken to from.
    """

    def __init__(
        self, first: TelemetryHeartbeat, component_id: int, rates_hz: Mapping[int, float] | None,
        station: tuple[int, int] = (255, 190),
    ) -> None:  # fmt: skip
        self.system_id = first.system_id
        self.component_id = component_id
        self.autopilot = first.autopilot
        self.vehicle_type = first.vehicle_type
        self.connected = True
        self.last_heartbeat_us = first.t_us
        self.clock = BootClock()
        self.stats = PacketStats()
        self.round_trip_us: int | None = None
        self._samples = SampleMaker(raw_imu_is_scaled=first.autopilot is Autopilot.ARDUPILOT)
        self._gimbal_clocks: dict[int, BootClock] = {}
        self._texts = telemetry.StatusTexts(self.system_id)
        self._commands = CommandChannel(self.system_id, component_id)
        self._missions = MissionChannel(self.system_id, component_id, station)
        self.parameters = ParameterChannel(self.system_id, component_id, first.autopilot)
        self._cameras = Cameras(self.system_id, component_id)
        self.gimbals = Gimbals(component_id)
        self._rates = RateRequests(rates_hz or {})
        self._has_battery = False
        self._next_stats_us = first.t_us + _STATS_PERIOD_US

    def appeared(self, t_us: int) -> VehicleAppeared:
        """The event of its appearance."""
        return VehicleAppeared(t_us, self.system_id, self.component_id, self.autopilot, self.vehicle_type)

    # --- receiving ---

    def receive(self, packet: RawPacket, t_us: int) -> list[LinkEvent]:
        """Take one packet of this system id."""
        msg_id = packet.msg_id
        self.stats.count(
            packet.component_id,
            packet.seq,
            len(packet.data),
            msg_id,
            signed=packet.signed,
            version=packet.version,
        )
        of_camera = self._cameras.receive(packet, t_us)
        self.gimbals.receive(packet, t_us)
        from_autopilot = packet.component_id == self.component_id
        if not packet.known or not (from_autopilot or msg_id in _GIMBAL_MESSAGES or msg_id == telemetry.STATUSTEXT):
            return of_camera
        events: list[LinkEvent] = of_camera
        clock = self._clock_of(packet.component_id)
        if msg_id in _BOOT_TIME_BYTES:
            self._observe_boot_time(clock, packet, t_us, events)
        wanted = self._samples.wants(msg_id, t_us)
        if wanted or msg_id in telemetry.TELEMETRY or msg_id in _HANDLERS:
            message = packet.decode()
            if wanted:
                made = self._samples.samples(msg_id, message, clock, t_us)
                events += [SampleEvent(t_us, self.system_id, sample) for sample in made]
            shown = telemetry.TELEMETRY.get(msg_id)
            if shown is not None and not (msg_id == telemetry.BATTERY_STATUS and self._has_battery):
                event = shown(message, t_us, self.system_id)
                if event is not None:
                    self._has_battery |= msg_id == telemetry.SYS_STATUS
                    events.append(event)
            if msg_id in _HANDLERS:
                events += _HANDLERS[msg_id](self, message, packet.component_id, t_us)
        return events

    def _clock_of(self, component_id: int) -> BootClock:
        """A gimbal of its own has a boot clock of its own."""
        if component_id == self.component_id:
            return self.clock
        return self._gimbal_clocks.setdefault(component_id, BootClock())

    def _observe_boot_time(self, clock: BootClock, packet: RawPacket, t_us: int, events: list[LinkEvent]) -> None:
        size = _BOOT_TIME_BYTES[packet.msg_id]
        # Trailing zeros of a payload are not sent, so the slice may be short: that is the same number.
        stamp = int.from_bytes(packet.payload[:size], "little")
        if size == 8 and stamp >= SMALLEST_UNIX_US:
            return
        reboots = clock.reboots
        clock.observe(stamp * 1000 if size == 4 else stamp, t_us)
        if clock.reboots > reboots and clock is self.clock:
            self.stats.forget_sequence()
            events.append(VehicleRebooted(t_us, self.system_id))
            events += self._missions.restarted(t_us)
            events += self.parameters.restarted(t_us)

    def _on_heartbeat(self, m: Any, _component_id: int, t_us: int) -> Iterator[LinkEvent]:
        heartbeat = telemetry.heartbeat(m, t_us, self.system_id)
        if not self.connected:
            self.connected = True
            yield VehicleReturned(t_us, self.system_id, t_us - self.last_heartbeat_us)
        self.last_heartbeat_us = t_us
        self.vehicle_type = heartbeat.vehicle_type
        yield heartbeat

    def _on_system_time(self, m: Any, _component_id: int, t_us: int) -> Iterator[LinkEvent]:
        self.clock.observe(m.time_boot_ms * 1000, t_us)
        # Zero, or a date before 2001, is a vehicle that does not know the time yet.
        if m.time_unix_usec >= SMALLEST_UNIX_US:
            self.clock.observe_unix(m.time_unix_usec, m.time_boot_ms * 1000)
        return iter(())

    def _on_local_position(self, m: Any, _component_id: int, t_us: int) -> Iterator[LinkEvent]:
        place, velocity = (m.x, m.y, m.z), (m.vx, m.vy, m.vz)
        if all(map(math.isfinite, (*place, *velocity))):
            known_us = self.clock.unix_from_boot(m.time_boot_ms * 1000)
            yield TelemetryLocalPosition(t_us if known_us is None else known_us, self.system_id, place, velocity)

    def _on_status_text(self, m: Any, component_id: int, t_us: int) -> list[LinkEvent]:
        return self._texts.add(m, component_id, t_us)

    def _on_command_ack(self, m: Any, _component_id: int, t_us: int) -> list[LinkEvent]:
        if m.command == EXTERNAL_POSITION_ESTIMATE:
            # It is sent beside the commands: a repeat would bring an old position.
            status = RESULTS.get(m.result, CommandStatus.FAILED)
            return [PositionAnswer(t_us, self.system_id, status)]
        return self._report(self._commands.acknowledge(m, t_us))

    def _on_mission(self, m: Any, _component_id: int, t_us: int) -> list[LinkEvent]:
        return list(self._missions.receive(m, t_us))

    def _on_parameter(self, m: Any, _component_id: int, t_us: int) -> list[LinkEvent]:
        return list(self.parameters.receive(m, t_us))

    def answers(self) -> list[Any]:
        """Messages that answer what was received; each is given once."""
        return self._missions.take_messages() + self.parameters.take_messages()

    # --- asking ---

    def transfer(
        self, transfer_id: int, action: TransferAction, kind: MissionType, items: Sequence[MissionItem]
    ) -> None:
        """Queue a transfer of one of its lists of items; ValueError as ``MissionChannel.start``."""
        self._missions.start(transfer_id, action, kind, items)

    def command(self, command_id: int, steps: Sequence[CommandStep]) -> None:
        """Queue a command of the user."""
        self._commands.start(command_id, steps)

    def command_tracker(self, command_id: int, steps: Sequence[CommandStep]) -> bool:
        """Queue a command of the user to the camera that tracks points itself; False when none says that it does."""
        component_id = self._cameras.tracker()
        if component_id is None:
            return False
        if component_id == self.component_id:
            self._commands.start(command_id, steps)
        else:
            self._cameras.command(component_id, command_id, steps)
        return True

    def command_gimbals(self, command_id: int, steps: Sequence[CommandStep]) -> None:
        """Queue a command of the user to whoever manages the gimbals."""
        if self.gimbals.component_id == self.component_id:
            self._commands.start(command_id, steps)
        else:
            self._cameras.command(self.gimbals.component_id, command_id, steps)

    def request_rate(self, msg_id: int, rate_hz: float, command_id: int) -> None:
        """Ask for one more message, beside those asked for from the start."""
        self._request_rate(msg_id, rate_hz, command_id)

    def request_rates(self, new_id: Callable[[], int]) -> None:
        """Ask for every wanted message, from the start."""
        for msg_id, rate_hz in self._rates.begin():
            self._request_rate(msg_id, rate_hz, new_id())

    def _request_rate(self, msg_id: int, rate_hz: float, command_id: int) -> None:
        self._commands.start(command_id, [self._rates.step(command_id, msg_id, rate_hz)], quiet=True)

    def _report(self, results: list[tuple[CommandResult, bool]]) -> list[LinkEvent]:
        events: list[LinkEvent] = []
        for result, quiet in results:
            if not quiet:
                events.append(result)
                continue
            lower = self._rates.result(result)
            if lower is not None:
                self._request_rate(*lower, result.command_id)
        return events

    # --- time ---

    def tick(self, t_us: int) -> tuple[list[Any], list[LinkEvent]]:
        """Messages to send, and what has happened by the passing of time."""
        events: list[LinkEvent] = []
        if self.connected and t_us - self.last_heartbeat_us > LOST_AFTER_US:
            self.connected = False
            self.stats.forget_sequence()
            events.append(VehicleLost(t_us, self.system_id, self.last_heartbeat_us))
            events += self._report(self._commands.abandon(t_us))
            events += self._missions.abandon(t_us)
            events += self.parameters.abandon(t_us)
            events += self._cameras.abandon(t_us)
        messages, results = self._commands.tick(t_us)
        events += self._report(results)
        events += self._missions.tick(t_us)
        events += self.parameters.tick(t_us)
        messages += self.answers()
        to_cameras, of_cameras = self._cameras.tick(t_us)
        messages += to_cameras
        events += of_cameras
        messages += self._rates.fallback_messages(self.system_id, self.component_id)
        events += self._texts.expire(t_us)
        return messages, events

    def clock_set_back(self, t_us: int) -> None:
        """The station's clock was set back to ``t_us``: nothing may wait for the time it came from."""
        self.last_heartbeat_us = min(self.last_heartbeat_us, t_us)
        self._next_stats_us = t_us
        self._commands.clock_set_back(t_us)
        self._missions.clock_set_back(t_us)
        self.parameters.clock_set_back(t_us)
        self._cameras.clock_set_back(t_us)

    def due_stats(self, t_us: int, noise_bytes: int, unknown_packets: int) -> list[LinkEvent]:
        """The link's figures, once a second."""
        if t_us < self._next_stats_us:
            return []
        self._next_stats_us = t_us + _STATS_PERIOD_US
        self.stats.close_second()
        layouts = message_layouts()
        rates = {layouts[i].name if i in layouts else f"MESSAGE {i}": hz for i, hz in self.stats.rates_hz().items()}
        return [
            LinkStats(
                t_us=t_us,
                system_id=self.system_id,
                connected=self.connected,
                heartbeat_age_s=(t_us - self.last_heartbeat_us) * 1e-6,
                messages_per_s=self.stats.messages_per_s(),
                bytes_per_s=self.stats.bytes_per_s(),
                loss_pct=self.stats.loss_pct(),
                packets=self.stats.packets,
                lost_packets=self.stats.lost,
                signed_packets=self.stats.signed,
                noise_bytes=noise_bytes,
                unknown_packets=unknown_packets,
                version=self.stats.version,
                round_trip_ms=None if self.round_trip_us is None else self.round_trip_us * 1e-3,
                rates_hz=tuple(sorted(rates.items())),
                rejected=tuple(sorted(self._samples.rejected.items())),
            )
        ]


_HANDLERS: dict[int, Callable[[Vehicle, Any, int, int], Any]] = {
    telemetry.HEARTBEAT: Vehicle._on_heartbeat,
    _SYSTEM_TIME: Vehicle._on_system_time,
    _COMMAND_ACK: Vehicle._on_command_ack,
    _LOCAL_POSITION_NED: Vehicle._on_local_position,
    telemetry.STATUSTEXT: Vehicle._on_status_text,
    PARAM_VALUE: Vehicle._on_parameter,
    **dict.fromkeys(MISSION_MESSAGES, Vehicle._on_mission),
}
