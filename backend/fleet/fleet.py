"""All vehicles heard on all links: folds link events into them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from backend.fleet.telemetry import told
from backend.fleet.vehicle import LiveVehicle, gps_reading, place_of_gnss
from backend.link.events import (
    CommandResult,
    LinkEvent,
    LinkStats,
    ParameterNews,
    PositionAnswer,
    SampleEvent,
    StatusText,
    TelemetryGps,
    TelemetryHeartbeat,
    TelemetryLocalPosition,
    TelemetryMission,
    TelemetryOrigin,
    TelemetryPosition,
    TransferNews,
    VehicleAppeared,
    VehicleLost,
    VehicleRebooted,
    VehicleReturned,
)
from backend.link.mission_items import number_of
from backend.navigation.setup import Place
from backend.navigation.worker import StateUpdate
from estimator.types import FixReport, GnssSample

MAV_SEVERITY_WARNING = 4
MAV_SEVERITY_ERROR = 3
NO_PLACE_US = 10_000_000  # a receiver that works and a home that is set have told by then


class Fleet:
    """Vehicles by id. Each belongs to the endpoint that it was last alive on.

    What has to be told to others goes to ``say(kind, **fields)``, a new vehicle to ``on_heard``, and a vehicle whose
    estimator can be set up, now that it is known where it is or has long not been, to ``on_place``. News of mission
    transfers go to ``on_transfer`` and of parameters to ``on_parameter`` with the endpoint that they ran on, whichever
    the vehicle belongs to by then.
    """

    def __init__(
        self, delay_us: int, say: Callable[..., None],
        on_heard: Callable[[LiveVehicle], None],
        on_place: Callable[[LiveVehicle, Place | None], None],
        on_state: Callable[[LiveVehicle, StateUpdate], None],
        on_reports: Callable[[LiveVehicle, list[FixReport]], None],
        on_transfer: Callable[[str, TransferNews], None] = lambda *_: None,
        on_parameter: Callable[[str, ParameterNews], None] = lambda *_: None,
    ) -> None:  # fmt: skip
        self.vehicles: dict[str, LiveVehicle] = {}
        self.link_stats: dict[str, dict[str, Any]] = {}
        self._delay_us = delay_us
        self._say = say
        self._on_heard = on_heard
        self._on_place = on_place
        self._on_state = on_state
        self._on_reports = on_reports
        self._on_transfer = on_transfer
        self._on_parameter = on_parameter
        self._commands: dict[tuple[str, int], tuple[str, str]] = {}

    def take(self, endpoint: str, event: LinkEvent) -> None:
        """Fold one event of a link."""
        if isinstance(event, VehicleAppeared):
            self._appeared(endpoint, event)
            return
        if isinstance(event, TransferNews):
            self._on_transfer(endpoint, event)
            return
        if isinstance(event, ParameterNews):
            self._on_parameter(endpoint, event)
            return
        vehicle = self.vehicles.get(str(event.system_id))
        if vehicle is None:
            return
        if isinstance(event, CommandResult):
            # It answers what was asked on its own link, whichever the vehicle is on by now.
            self._acknowledge(vehicle, endpoint, event)
            return
        if vehicle.endpoint != endpoint:
            # The same vehicle on two links: the second one is a spare, and takes over when the first falls silent.
            if vehicle.connected or not isinstance(event, TelemetryHeartbeat | VehicleReturned):
                return
            vehicle.endpoint = endpoint
            vehicle.connected = True
        self._fold(vehicle, endpoint, event)

    def note_command(self, endpoint: str, link_command_id: int, command_id: str, command: str) -> None:
        """Remember under which id the answer to a command is to be told."""
        self._commands[(endpoint, link_command_id)] = (command_id, command)

    def close(self) -> None:
        """End all estimators."""
        for vehicle in self.vehicles.values():
            vehicle.stop_navigation()

    def _appeared(self, endpoint: str, event: VehicleAppeared) -> None:
        key = str(event.system_id)
        known = self.vehicles.get(key)
        if known is not None:
            if not known.connected:
                known.endpoint, known.connected = endpoint, True
            return
        vehicle = LiveVehicle(event.system_id, endpoint, self._delay_us, self._on_state, self._on_reports)
        vehicle.telemetry = replace(vehicle.telemetry, vehicle_type=str(event.vehicle_type))
        vehicle.autopilot, vehicle.vehicle_type = event.autopilot, event.vehicle_type
        vehicle.last_heartbeat_us = event.t_us
        self.vehicles[key] = vehicle
        self._on_heard(vehicle)

    def _fold(self, vehicle: LiveVehicle, endpoint: str, event: LinkEvent) -> None:  # noqa: PLR0912  one case an event
        vehicle.telemetry = told(vehicle.telemetry, event, event.t_us)
        match event:
            case SampleEvent(sample=sample):
                vehicle.offer(sample)
                setup = vehicle.setup
                # a frame laid for want of a position gives way to one, unless the search has found the vehicle
                if setup is None or (not setup.place_known and vehicle.latest is None):
                    self._place(vehicle, event)
            case TelemetryHeartbeat():
                vehicle.last_heartbeat_us = event.t_us
                vehicle.autopilot, vehicle.vehicle_type = event.autopilot, event.vehicle_type
            case TelemetryMission():
                vehicle.telemetry = replace(vehicle.telemetry, mission_item=number_of(event.seq, vehicle.autopilot))
            case TelemetryGps():
                vehicle.take_gps(gps_reading(event))
                fields = vehicle.gps_message()
                if fields is not None:
                    self._say("gps", **fields)
            case TelemetryLocalPosition():
                vehicle.local_position = event
            case TelemetryPosition():
                vehicle.relative_alt_m = event.alt_rel_m
                vehicle.own_position = event
            case TelemetryOrigin():
                vehicle.origin = event
            case PositionAnswer():
                vehicle.position_answers[event.status] += 1
                vehicle.last_position_answer = event
            case VehicleLost():
                vehicle.connected = False
                self._say("vehicle", action="updated", vehicle=vehicle.summary())
            case VehicleReturned():
                vehicle.connected = True
                self._say("vehicle", action="updated", vehicle=vehicle.summary())
            case VehicleRebooted():
                vehicle.origin = None
                # The estimate of the time before the reboot means nothing to the samples after it.
                if vehicle.setup is not None:
                    vehicle.navigate(vehicle.setup)
            case LinkStats():
                self.link_stats[vehicle.id] = _stats(vehicle, endpoint, event)
                self._say("link", **self.link_stats[vehicle.id])
            case StatusText():
                self._say("alarm", **_text_alarm(vehicle, event))
            case _:
                pass

    def _place(self, vehicle: LiveVehicle, event: SampleEvent) -> None:
        here = vehicle.here()
        if here is None and isinstance(event.sample, GnssSample) and vehicle.relative_alt_m is not None:
            here = place_of_gnss(event.sample, vehicle.relative_alt_m)
        if here is not None:
            self._on_place(vehicle, here)
        elif vehicle.setup is None and event.t_us - vehicle.heard_first_us(event.t_us) > NO_PLACE_US:
            self._on_place(vehicle, None)

    def _acknowledge(self, vehicle: LiveVehicle, endpoint: str, event: CommandResult) -> None:
        known = self._commands.get((endpoint, event.command_id))
        if known is None:
            return
        if event.final:
            del self._commands[(endpoint, event.command_id)]
        command_id, command = known
        self._say(
            "ack", command_id=command_id, vehicle_id=vehicle.id, command=command, status=str(event.status),
            text=event.text,
        )  # fmt: skip


def _stats(vehicle: LiveVehicle, endpoint: str, event: LinkStats) -> dict[str, Any]:
    return {
        "vehicle_id": vehicle.id, "connected": event.connected, "heartbeat_age_s": event.heartbeat_age_s,
        "messages_per_s": event.messages_per_s, "bytes_per_s": event.bytes_per_s, "loss_pct": event.loss_pct,
        "noise_bytes": event.noise_bytes, "signed": event.signed_packets > 0, "endpoint": endpoint,
        "version": event.version, "round_trip_ms": event.round_trip_ms, "rates_hz": dict(event.rates_hz),
        "rejected": dict(event.rejected),
    }  # fmt: skip


def _text_alarm(vehicle: LiveVehicle, event: StatusText) -> dict[str, Any]:
    """A vehicle's own words as a passing alarm: it is told, and does not stand."""
    severity = "info"
    if event.severity <= MAV_SEVERITY_ERROR:
        severity = "warning"
    elif event.severity <= MAV_SEVERITY_WARNING:
        severity = "caution"
    return {
        "id": f"text:{vehicle.id}:{event.t_us}", "vehicle_id": vehicle.id, "severity": severity,
        "code": "vehicle_text", "text": event.text, "active": False, "since_unix_us": event.t_us,
    }  # fmt: skip
