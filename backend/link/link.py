"""The link to the vehicles behind one transport: bytes and time in, events and bytes out, no I/O."""

from __future__ import annotations

import itertools
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from pymavlink.dialects.v20 import ardupilotmega as _dialect

from backend.link import telemetry
from backend.link.commands import CommandStep
from backend.link.events import LinkEvent, TransferAction, VehicleRebooted, VehicleReturned
from backend.link.framing import MavlinkFramer, Noise, RawPacket
from backend.link.gimbals import pitch_yaw, release_control, take_control
from backend.link.rates import DEFAULT_RATES_HZ
from backend.link.vehicle import Vehicle
from guidance.mission import MissionItem, MissionType

_HEARTBEAT_PERIOD_US = 1_000_000
_TIMESYNC_PERIOD_US = 1_000_000
_AUTOPILOT_INVALID = 8
_TYPE_GCS = 6
_STATE_ACTIVE = 4
_TIMESYNC = 111
_LONGEST_ROUND_TRIP_US = 10_000_000


class UnknownVehicleError(LookupError):
    """A command names a vehicle that this link has not heard."""

    def __init__(self, system_id: int, known: tuple[int, ...]) -> None:
        self.system_id = system_id
        self.known = known
        heard = ", ".join(map(str, known)) or "none"
        super().__init__(f"no vehicle with system id {system_id} on this link (heard: {heard})")


class NoTrackerError(LookupError):
    """A command to a camera that tracks points itself, and the vehicle has none that says so."""

    def __init__(self, system_id: int) -> None:
        self.system_id = system_id
        super().__init__(
            f"no camera of vehicle {system_id} tracks points itself: none has said so in its CAMERA_INFORMATION"
        )


class VehicleLink:
    """Speaks MAVLink with every vehicle on one transport.

    ``passive`` sends nothing, for replay. ``rates_hz`` maps message ids to the rates asked of each vehicle.
    ``on_packet(packet, t_unix_us)`` sees every packet as it came, for a recorder.
    Times are Unix microseconds of the station's clock.
    """

    def __init__(
        self,
        system_id: int = 255,
        component_id: int = 190,
        *,
        rates_hz: Mapping[int, float] = DEFAULT_RATES_HZ,
        passive: bool = False,
        on_packet: Callable[[RawPacket, int], None] | None = None,
    ) -> None:
        self.system_id = system_id
        self.component_id = component_id
        self.noise_bytes = 0
        self.unknown_packets = 0
        self._passive = passive
        self._rates_hz = {} if passive else rates_hz
        self._on_packet = on_packet
        self._framer = MavlinkFramer()
        self._vehicles: dict[int, Vehicle] = {}
        self._encoder = _dialect.MAVLink(None, srcSystem=system_id, srcComponent=component_id)
        self._outgoing: list[bytes] = []
        self._command_ids = itertools.count(1)
        self._next_heartbeat_us: int | None = None
        self._next_timesync_us: int | None = None
        self._newest_us: int | None = None

    @property
    def vehicles(self) -> Mapping[int, Vehicle]:
        """The vehicles heard so far, by system id."""
        return self._vehicles

    def receive(self, data: bytes, t_unix_us: int) -> list[LinkEvent]:
        """Take bytes that came at ``t_unix_us``; never raises on what they hold."""
        events: list[LinkEvent] = []
        for item in self._framer.feed(data):
            if isinstance(item, Noise):
                self.noise_bytes += item.length
                continue
            if self._on_packet is not None:
                self._on_packet(item, t_unix_us)
            if not item.known:
                self.unknown_packets += 1
            # Our own packets come back from a log or a mirroring router.
            if item.system_id != self.system_id:
                events += self._receive_packet(item, t_unix_us)
        return events

    def tick(self, t_unix_us: int) -> list[LinkEvent]:
        """Let time pass: heartbeats, repeats, time-outs, figures. Call it some ten times a second."""
        if self._newest_us is not None and t_unix_us < self._newest_us:
            self._restart_schedule(t_unix_us)
        self._newest_us = t_unix_us
        events: list[LinkEvent] = []
        self._send_heartbeat(t_unix_us)
        self._send_timesync(t_unix_us)
        for vehicle in self._vehicles.values():
            messages, happened = vehicle.tick(t_unix_us)
            events += happened
            events += vehicle.due_stats(t_unix_us, self.noise_bytes, self.unknown_packets)
            for message in messages:
                self._send(message)
        return events

    def data_to_send(self) -> list[bytes]:
        """Packets to write to the transport; each is given once."""
        out, self._outgoing = self._outgoing, []
        return out

    def command(self, system_id: int, steps: Sequence[CommandStep]) -> int:
        """Send a command of one or more steps; its ``CommandResult`` events carry the id given here.

        Raises UnknownVehicleError for a vehicle that was never heard, ValueError for no steps.
        """
        vehicle = self._known(system_id)
        command_id = next(self._command_ids)
        vehicle.command(command_id, steps)
        return command_id

    def command_tracker(self, system_id: int, steps: Sequence[CommandStep]) -> int:
        """As ``command``, to the vehicle's camera that tracks points itself.

        Raises UnknownVehicleError as there, NoTrackerError when no camera says that it can.
        """
        vehicle = self._known(system_id)
        command_id = next(self._command_ids)
        if not vehicle.command_tracker(command_id, steps):
            raise NoTrackerError(system_id)
        return command_id

    def transfer(
        self, system_id: int, action: TransferAction, kind: MissionType, items: Sequence[MissionItem] = ()
    ) -> int:
        """Begin to move one of a vehicle's lists of items; its ``TransferNews`` events carry the id given here.

        ``items`` are an upload's, as the vehicle counts them. Raises UnknownVehicleError for a vehicle that was never
        heard, ValueError for an upload of nothing.
        """
        vehicle = self._known(system_id)
        transfer_id = next(self._command_ids)
        vehicle.transfer(transfer_id, action, kind, items)
        return transfer_id

    def read_parameters(self, system_id: int, names: Sequence[str]) -> int:
        """Ask for parameters; a ``ParameterNews`` for each name carries the id given here.

        Raises UnknownVehicleError as ``command`` does, ValueError for what can be no name.
        """
        vehicle = self._known(system_id)
        request_id = next(self._command_ids)
        vehicle.parameters.read(request_id, names)
        return request_id

    def write_parameter(self, system_id: int, name: str, value: float) -> int:
        """Change a parameter; its ``ParameterNews`` carries the id given here. Raises as ``read_parameters``."""
        vehicle = self._known(system_id)
        request_id = next(self._command_ids)
        vehicle.parameters.write(request_id, name, value)
        return request_id

    def request_rate(self, system_id: int, msg_id: int, rate_hz: float) -> None:
        """Ask a vehicle for one more message. Raises UnknownVehicleError as ``command`` does."""
        self._known(system_id).request_rate(msg_id, rate_hz, next(self._command_ids))

    def take_gimbal(self, system_id: int) -> int:
        """Ask for control of a vehicle's gimbals; ``vehicles[…].gimbals.manager`` says whether it was given."""
        command_id = next(self._command_ids)
        self._known(system_id).command_gimbals(command_id, take_control(self.system_id, self.component_id))
        return command_id

    def release_gimbal(self, system_id: int) -> int:
        """Hand control of a vehicle's gimbals back."""
        command_id = next(self._command_ids)
        self._known(system_id).command_gimbals(command_id, release_control())
        return command_id

    def point_gimbal(self, system_id: int, pitch_rad: float, yaw_rad: float, *, earth: bool = False) -> None:
        """Point a vehicle's gimbals, see ``backend.link.gimbals.pitch_yaw``."""
        component_id = self._known(system_id).gimbals.component_id
        self._send(pitch_yaw(system_id, component_id, pitch_rad, yaw_rad, earth=earth))

    def _known(self, system_id: int) -> Vehicle:
        vehicle = self._vehicles.get(system_id)
        if vehicle is None:
            raise UnknownVehicleError(system_id, tuple(sorted(self._vehicles)))
        return vehicle

    def send_message(self, message: Any) -> None:
        """Queue one of pymavlink's message objects as it is, for what needs no acknowledgement."""
        self._send(message)

    def station_time_of(self, system_id: int, t_vehicle_unix_us: int) -> int | None:
        """Station time of a stamp on the vehicle's own Unix clock; None while that clock is not known."""
        vehicle = self._vehicles.get(system_id)
        return None if vehicle is None else vehicle.clock.unix_from_vehicle_unix(t_vehicle_unix_us)

    def _receive_packet(self, packet: RawPacket, t_us: int) -> list[LinkEvent]:
        vehicle = self._vehicles.get(packet.system_id)
        events: list[LinkEvent] = []
        if packet.msg_id == telemetry.HEARTBEAT and vehicle is None:
            vehicle = self._discover(packet, t_us, events)
        if packet.msg_id == _TIMESYNC:
            self._answer_timesync(packet, vehicle, t_us)
        if vehicle is None:
            return events
        made = vehicle.receive(packet, t_us)
        for message in vehicle.answers():
            self._send(message)
        if any(isinstance(event, VehicleReturned | VehicleRebooted) for event in made) and self._rates_hz:
            vehicle.request_rates(self._next_command_id)
        return events + made

    def _discover(self, packet: RawPacket, t_us: int, events: list[LinkEvent]) -> Vehicle | None:
        """An autopilot is told by its heartbeat; stations, cameras and gimbals have no autopilot."""
        message = packet.decode()
        if message.autopilot == _AUTOPILOT_INVALID or message.type == _TYPE_GCS or packet.system_id == 0:
            return None
        first = telemetry.heartbeat(message, t_us, packet.system_id)
        vehicle = Vehicle(first, packet.component_id, self._rates_hz, (self.system_id, self.component_id))
        self._vehicles[packet.system_id] = vehicle
        events.append(vehicle.appeared(t_us))
        if self._rates_hz:
            vehicle.request_rates(self._next_command_id)
        return vehicle

    def _next_command_id(self) -> int:
        return next(self._command_ids)

    def _answer_timesync(self, packet: RawPacket, vehicle: Vehicle | None, t_us: int) -> None:
        message = packet.decode()
        if message.tc1 == 0:
            self._send(_dialect.MAVLink_timesync_message(t_us * 1000, message.ts1))
            return
        # Version 1 has no target fields: an answer is ours when it mirrors a time we could have sent.
        round_trip_us = t_us - message.ts1 // 1000
        if vehicle is not None and 0 <= round_trip_us < _LONGEST_ROUND_TRIP_US:
            # The smallest is the path's own; it may rise again slowly, as when a radio changes its rate.
            known = vehicle.round_trip_us
            vehicle.round_trip_us = (
                round_trip_us if known is None else min(round_trip_us, (7 * known + round_trip_us) // 8)
            )

    def _send_heartbeat(self, t_us: int) -> None:
        if self._next_heartbeat_us is None or t_us >= self._next_heartbeat_us:
            self._next_heartbeat_us = t_us + _HEARTBEAT_PERIOD_US
            self._send(_dialect.MAVLink_heartbeat_message(_TYPE_GCS, _AUTOPILOT_INVALID, 0, 0, _STATE_ACTIVE, 3))

    def _send_timesync(self, t_us: int) -> None:
        if self._vehicles and (self._next_timesync_us is None or t_us >= self._next_timesync_us):
            self._next_timesync_us = t_us + _TIMESYNC_PERIOD_US
            self._send(_dialect.MAVLink_timesync_message(0, t_us * 1000))

    def _restart_schedule(self, t_us: int) -> None:
        """The clock was set back: nothing may wait for the time it came from."""
        self._next_heartbeat_us = None
        self._next_timesync_us = None
        for vehicle in self._vehicles.values():
            vehicle.clock_set_back(t_us)

    def _send(self, message: Any) -> None:
        if not self._passive:
            self._outgoing.append(bytes(message.pack(self._encoder)))
            self._encoder.seq = (self._encoder.seq + 1) % 256
