"""The autopilot's side of the link: answers commands, keeps its own idea of the position. No I/O, no clock."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.local import LocalFrame
from estimator.types import Float
from simulator.believed import BelievedPosition
from simulator.gimbal_manager import CONFIGURE, PITCH_YAW, GimbalManager
from simulator.mavlink_input import messages_in
from simulator.mission_store import KINDS, MissionStore
from simulator.navigation_input import EXTERNAL_POSITION, SET_SOURCES, NavigationInput
from simulator.parameters import KINDS as PARAMETER_KINDS
from simulator.parameters import ParameterStore
from simulator.sensors.gnss import GnssReceiver
from simulator.set_points import target_of, velocity_of
from simulator.telemetry import Snapshot, Telemetry
from simulator.vehicles.kinds import VEHICLES, VehicleKind
from simulator.vehicles.mission_flight import MissionFlight, stops_of
from simulator.vehicles.pilot import FlightMode, Pilot
from simulator.vehicles.state import VehicleState

_FORCE = 21196.0
_GPS_UNIT = 4.0
_FAILURE_OK, _FAILURE_OFF = 0.0, 1.0
_AIRBORNE_M = 1.0
_FARTHEST_M = 5_000.0
_SMALLEST_ORBIT_M, _LARGEST_ORBIT_M = 5.0, 1_000.0

_ACCEPTED = mavlink.MAV_RESULT_ACCEPTED
_DENIED = mavlink.MAV_RESULT_DENIED
_UNSUPPORTED = mavlink.MAV_RESULT_UNSUPPORTED


_MODE_COMMANDS = {
    mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH: FlightMode.RTL,
    mavlink.MAV_CMD_NAV_LAND: FlightMode.LAND,
    mavlink.MAV_CMD_NAV_LOITER_UNLIM: FlightMode.LOITER,
}


class Autopilot:
    """Bytes in, bytes out, and orders to the pilot and the receiver in between."""

    def __init__(
        self, telemetry: Telemetry, pilot: Pilot, receiver: GnssReceiver, frame: LocalFrame, system_id: int,
        believed: BelievedPosition, gimbal: GimbalManager | None = None,
        kind: VehicleKind = VEHICLES["helicopter"],
    ) -> None:  # fmt: skip
        self._telemetry, self._pilot, self._receiver, self._frame = telemetry, pilot, receiver, frame
        self._system_id, self._gimbal, self._kind = system_id, gimbal, kind
        self.on_ground = False
        self._outbox: list[bytes] = []
        self._missions = MissionStore(lambda message: self._outbox.append(telemetry.pack(message)))
        self._parameters = ParameterStore(lambda message: self._outbox.append(telemetry.pack(message)))
        self.navigation = NavigationInput(believed, self._parameters, frame, pilot.home_ned_m)
        self.armed = True
        self.say(mavlink.MAV_SEVERITY_INFO, f"Simulated {kind.said} ready")

    def say(self, severity: int, text: str) -> None:
        """Queue a line for the operator."""
        message = mavlink.MAVLink_statustext_message(severity, text.encode()[:50])
        self._outbox.append(self._telemetry.pack(message))

    def take_outbox(self, t_boot_us: int) -> list[bytes]:
        """What waits to be sent at a time since boot: answers, and requests that were not answered."""
        self._missions.step(t_boot_us)
        waiting, self._outbox = self._outbox, []
        return waiting

    def receive(self, data: bytes, state: VehicleState, now: Snapshot, truth: VehicleState) -> None:
        """Act on one datagram from a ground station.

        ``state`` is where the autopilot takes itself to be, ``truth`` what it is told of its place is held against.
        """
        for message in messages_in(data):
            kind = message.get_type()
            if kind in ("COMMAND_LONG", "COMMAND_INT"):
                if message.target_system in (0, self._system_id):
                    self._command(message, state, now, truth)
            elif kind == "TIMESYNC" and message.tc1 == 0:
                answer = mavlink.MAVLink_timesync_message(now.t_boot_us * 1000, message.ts1)
                self._outbox.append(self._telemetry.pack(answer))
            elif kind == "SET_MODE" and message.target_system in (0, self._system_id):
                self._set_mode(float(message.custom_mode), state)
            elif kind == "REQUEST_DATA_STREAM" and message.start_stop == 0:
                continue
            elif kind in KINDS:
                if message.target_system == self._system_id:
                    self._missions.receive(message, now.t_boot_us)
            elif kind in PARAMETER_KINDS:
                if message.target_system == self._system_id:
                    self._parameters.receive(message)
            else:
                self._stream(kind, message, state, now, truth)

    def _stream(self, kind: str, message: Any, state: VehicleState, now: Snapshot, truth: VehicleState) -> None:
        """What comes many times a second and is not answered."""
        if kind == "ODOMETRY":
            self.navigation.odometry(message, truth)
        elif kind == "GPS_INPUT":
            self.navigation.gps_input(message, truth.t_us)
        elif kind == "LANDING_TARGET":
            target = target_of(message, now.q_believed)
            if target is not None:
                self._pilot.aim(state.pos_ned_m + target)
        elif getattr(message, "target_system", None) not in (0, self._system_id):
            return
        elif kind == "SET_POSITION_TARGET_LOCAL_NED":
            velocity = velocity_of(message, now.q_believed)
            if velocity is not None and self.armed:
                self._pilot.follow(velocity)
        elif self._gimbal is not None:
            self._gimbal.receive(message)

    def _command(self, message: Any, state: VehicleState, now: Snapshot, truth: VehicleState) -> None:
        if message.command == EXTERNAL_POSITION:
            result = self.navigation.position(message, truth, now.fix)
        else:
            result = self._execute(message, state, now)
        answer = mavlink.MAVLink_command_ack_message(
            message.command, result, 255, 0, message.get_srcSystem(), message.get_srcComponent()
        )
        # The acknowledgement comes before what was asked for, as with ArduPilot.
        self._outbox.insert(0, self._telemetry.pack(answer))

    def _execute(self, message: Any, state: VehicleState, now: Snapshot) -> int:
        command = message.command
        if command in _MODE_COMMANDS:
            return self._fly(_MODE_COMMANDS[command], state)
        if command == mavlink.MAV_CMD_REQUEST_MESSAGE:
            return self._request(message, now)
        if command in (CONFIGURE, PITCH_YAW) and self._gimbal is not None:
            return self._gimbal.command(message)
        actions: dict[int, Callable[[Any, VehicleState], int]] = {
            mavlink.MAV_CMD_SET_MESSAGE_INTERVAL: self._set_interval,
            mavlink.MAV_CMD_INJECT_FAILURE: self._inject_failure,
            mavlink.MAV_CMD_COMPONENT_ARM_DISARM: self._arm,
            mavlink.MAV_CMD_DO_SET_MODE: lambda order, at: self._set_mode(order.param2, at),
            mavlink.MAV_CMD_DO_REPOSITION: self._reposition,
            mavlink.MAV_CMD_DO_ORBIT: self._orbit,
            mavlink.MAV_CMD_MISSION_START: self._start_mission,
            mavlink.MAV_CMD_NAV_TAKEOFF: self._take_off,
            SET_SOURCES: lambda order, _: self.navigation.use_sources(order.param1),
        }
        act = actions.get(command)
        return int(_UNSUPPORTED) if act is None else act(message, state)

    def _set_interval(self, message: Any, _: VehicleState) -> int:
        known = self._telemetry.set_interval(_index(message.param1), message.param2)
        return int(_ACCEPTED if known else _DENIED)

    def _request(self, message: Any, now: Snapshot) -> int:
        packet = self._telemetry.one(_index(message.param1), now)
        if packet is None:
            return int(_DENIED)
        self._outbox.append(packet)
        return int(_ACCEPTED)

    def _inject_failure(self, message: Any, state: VehicleState) -> int:
        if message.param1 != _GPS_UNIT:
            return int(_UNSUPPORTED)
        if message.param2 not in (_FAILURE_OK, _FAILURE_OFF):
            return int(_UNSUPPORTED)
        off = message.param2 == _FAILURE_OFF
        self.cut_gps(off, state.t_us)
        return int(_ACCEPTED)

    def cut_gps(self, off: bool, t_us: int) -> None:
        """Cut or restore the receiver and say so."""
        if off != self._receiver.is_off:
            self._receiver.cut(off, t_us)
            text = "GPS 1: signal lost" if off else "GPS 1: signal restored"
            self.say(mavlink.MAV_SEVERITY_CRITICAL if off else mavlink.MAV_SEVERITY_INFO, text)

    def disarm_on_ground(self) -> None:
        """The motors stop by themselves after a landing."""
        if self.armed:
            self.armed = False
            self.say(mavlink.MAV_SEVERITY_INFO, "Landed: motors off")

    def _arm(self, message: Any, state: VehicleState) -> int:
        if message.param1 >= 0.5:
            self.armed = True
            return int(_ACCEPTED)
        if self._flies(state) and message.param2 != _FORCE:
            self.say(mavlink.MAV_SEVERITY_WARNING, "Disarm: not landed")
            return int(_DENIED)
        if self._flies(state):
            # The world has no crash model.
            return int(_DENIED)
        self.armed = False
        return int(_ACCEPTED)

    def _set_mode(self, custom_mode: float, state: VehicleState) -> int:
        mode = self._kind.mode(custom_mode)
        return int(_DENIED) if mode is None else self._fly(mode, state)

    def _fly(self, mode: FlightMode, state: VehicleState) -> int:
        if mode not in self._kind.modes:
            return int(_UNSUPPORTED)
        if not self.armed:
            self.say(mavlink.MAV_SEVERITY_WARNING, "Arm first")
            return int(_DENIED)
        self._pilot.fly(mode, state.pos_ned_m)
        self.say(mavlink.MAV_SEVERITY_INFO, f"Mode {mode.name}")
        return int(_ACCEPTED)

    def _start_mission(self, _: Any, state: VehicleState) -> int:
        """The mission that was sent; without one, the route that this aircraft has of its own."""
        if not self.armed or not self._missions.items or not self._kind.hovers:
            return self._fly(FlightMode.AUTO, state)
        stops = stops_of(self._missions.items, self._frame, self._pilot.home_ned_m)
        if not stops:
            self.say(mavlink.MAV_SEVERITY_WARNING, "Mission: no place in it to fly to")
            return int(_DENIED)
        far_m = max(float(np.nanmax(np.abs(stop.goal_ned_m), initial=0.0)) for stop in stops)
        if far_m > _FARTHEST_M:
            self.say(mavlink.MAV_SEVERITY_WARNING, "Mission: an item is too far away")
            return int(_DENIED)
        self._pilot.fly_mission(MissionFlight(stops, state.pos_ned_m), state.pos_ned_m)
        self.say(mavlink.MAV_SEVERITY_INFO, f"Mission: {len(stops)} places")
        return int(_ACCEPTED)

    @property
    def mission_total(self) -> int:
        """How many items the mission has that is held, home included."""
        return len(self._missions.items)

    def _take_off(self, message: Any, state: VehicleState) -> int:
        rise_m = float(message.z if message.get_type() == "COMMAND_INT" else message.param7)
        if not self.armed or not 1.0 <= rise_m <= 400.0:
            return int(_DENIED)
        if self._flies(state):
            self.say(mavlink.MAV_SEVERITY_WARNING, "Takeoff: already flying")
            return int(_DENIED)
        goal = state.pos_ned_m - (0.0, 0.0, rise_m)
        self._pilot.fly(FlightMode.GUIDED, state.pos_ned_m, goal)
        return int(_ACCEPTED)

    def _reposition(self, message: Any, state: VehicleState) -> int:
        goal = self._goal(message, state, "Goto")
        if goal is None:
            return int(_DENIED)
        self._pilot.fly(FlightMode.GUIDED, state.pos_ned_m, goal)
        return int(_ACCEPTED)

    def _orbit(self, message: Any, state: VehicleState) -> int:
        if not self._kind.hovers:
            return int(_UNSUPPORTED)
        if not self._flies(state):
            self.say(mavlink.MAV_SEVERITY_WARNING, "Orbit: take off first")
            return int(_DENIED)
        if not _SMALLEST_ORBIT_M <= abs(message.param1) <= _LARGEST_ORBIT_M:
            self.say(mavlink.MAV_SEVERITY_WARNING, f"Orbit: radius {_SMALLEST_ORBIT_M:g} to {_LARGEST_ORBIT_M:g} m")
            return int(_DENIED)
        centre = self._goal(message, state, "Orbit")
        if centre is None:
            return int(_DENIED)
        self._pilot.orbit(centre, message.param1, state.pos_ned_m)
        return int(_ACCEPTED)

    def _goal(self, message: Any, state: VehicleState, what: str) -> Float | None:
        """The place of a command (3,), None where it will not be flown to; the operator is told why."""
        if message.get_type() == "COMMAND_INT":
            lat_deg, lon_deg, alt_m, datum = message.x / 1e7, message.y / 1e7, message.z, message.frame
        else:
            lat_deg, lon_deg, alt_m = message.param5, message.param6, message.param7
            datum = mavlink.MAV_FRAME_GLOBAL
        if not self.armed:
            self.say(mavlink.MAV_SEVERITY_WARNING, "Arm first")
            return None
        if not (abs(lat_deg) <= 90 and abs(lon_deg) <= 180):
            return None
        goal = self._frame.ned_from_geodetic(np.radians(lat_deg), np.radians(lon_deg), self._frame.alt_m)
        relative = (mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT, mavlink.MAV_FRAME_GLOBAL_RELATIVE_ALT_INT)
        if not np.isfinite(alt_m):
            goal[2] = state.pos_ned_m[2]
        elif datum in relative:
            goal[2] = self._pilot.home_ned_m[2] - alt_m
        else:
            goal[2] = self._frame.alt_m - alt_m
        if np.abs(goal[:2]).max() > _FARTHEST_M or -goal[2] - self._frame.alt_m > 2_000.0:
            self.say(mavlink.MAV_SEVERITY_WARNING, f"{what}: too far")
            return None
        return goal

    def _flies(self, state: VehicleState) -> bool:
        return not self.on_ground and float(self._pilot.home_ned_m[2] - state.pos_ned_m[2]) > _AIRBORNE_M


def _index(value: float) -> int:
    """A message's number sent as a float; -1 for nonsense."""
    return int(value) if np.isfinite(value) and abs(value) < 2**24 else -1
