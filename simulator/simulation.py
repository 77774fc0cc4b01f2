"""One simulated aircraft in its world, advanced in fixed steps; the same seed gives the same flight."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from estimator.geometry.earth import isa_pressure_alt_m
from estimator.geometry.rotation import matrix_from_q, q_from_euler
from estimator.types import Float
from simulator.autopilot import Autopilot
from simulator.believed import BelievedPosition
from simulator.gimbal_manager import GimbalManager
from simulator.scenario import Scenario
from simulator.sensors.attitude_filter import AttitudeFilter
from simulator.sensors.barometer import Barometer
from simulator.sensors.gnss import GnssReceiver
from simulator.sensors.inertial import InertialUnit
from simulator.sensors.magnetometer import Magnetometer
from simulator.telemetry import Snapshot, Telemetry
from simulator.vehicles.gimbal import PanTiltGimbal
from simulator.vehicles.kinds import AIRFRAMES, VEHICLES, make_aircraft
from simulator.vehicles.pilot import SKID_M, FlightMode, Pilot
from simulator.vehicles.route import Route, make_route, pad_route, widened
from simulator.vehicles.state import VehicleState
from simulator.vehicles.wing_aircraft import LOOK_AHEAD_S, turn_radius_m
from simulator.vehicles.wing_pilot import WingPilot
from simulator.world.pad_place import PadPlace, place_pad
from simulator.world.world import World

STEP_US = 5_000
_IMU_STEPS = 4
_BARO_STEPS = 20
_GNSS_STEPS = 40
_ATTITUDE_STEPS = 8
_BOOTED_BEFORE_US = 42_000_000
_DISARM_US = 2_000_000


@dataclass(frozen=True, slots=True, eq=False)
class Exposure:
    """A picture to be taken: when by the vehicle's clock, from where, looking where."""

    t_unix_us: int
    camera_pos_ned_m: Float
    ned_from_camera: Float
    state: VehicleState


@dataclass(frozen=True, slots=True, eq=False)
class StepOutput:
    """What one step sends out: packets, and at most one picture to take. ``t_unix_us`` is the station's time."""

    t_unix_us: int
    packets: list[bytes]
    exposure: Exposure | None


class Simulation:
    """Wires world, vehicle, sensors and autopilot together."""

    def __init__(self, scenario: Scenario, world: World, seed: int, start_unix_us: int) -> None:
        self.scenario, self.world, self._start_unix_us = scenario, world, start_unix_us
        flight = scenario.flight
        self.pad: PadPlace | None = None if scenario.pad is None else place_pad(world, scenario.pad.pad(), seed)
        route = self._route(seed)
        self.home_ned_m = np.array([*route.start_ned_m[:2], -float(world.terrain.at(*route.start_ned_m[:2]))])
        heading = float(np.arctan2(route.tangent_ne[0, 1], route.tangent_ne[0, 0]))
        kind = VEHICLES[scenario.vehicle.type]
        self._aircraft = make_aircraft(
            scenario.vehicle, world.frame, route.start_ned_m, heading, seed, flight.wind_m_s, flight.gust_std_m_s
        )
        self.pilot = self._pilot_of(route)
        sensors = scenario.sensors
        self._inertial = InertialUnit(seed, sensors)
        self._barometer = Barometer(seed, sensors)
        self._magnetometer = Magnetometer(seed)
        self._receiver = GnssReceiver(seed, sensors)
        self._attitude = AttitudeFilter(seed, sensors)
        self._believed = BelievedPosition(seed)
        mount = scenario.camera.mount()
        self._gimbal: PanTiltGimbal | None = None
        if scenario.camera.gimbal == "pan_tilt":
            self._gimbal = PanTiltGimbal(seed, mount.pitch_rad, mount.yaw_rad)
        manager = None if self._gimbal is None else GimbalManager(self._gimbal)
        self._telemetry = Telemetry(scenario.system_id, world.frame, manager, kind)
        self.autopilot = Autopilot(
            self._telemetry, self.pilot, self._receiver, world.frame, scenario.system_id, self._believed, manager, kind
        )
        self._body_from_camera, self._lever_arm = mount.body_from_camera, mount.lever_arm_frd_m
        self._clock_offset_us = round(scenario.vehicle_clock_offset_s * 1e6)
        self._frame_interval_us = 1e6 / scenario.camera.frames_per_s
        self._frames = 0
        self._steps = 0
        self._stands_us = 0
        self._snapshot: Snapshot | None = None
        self.state: VehicleState | None = None
        self.touchdown: VehicleState | None = None
        """The last step before the skids first touched the ground."""

    def _route(self, seed: int) -> Route:
        flight, section, world = self.scenario.flight, self.scenario.pad, self.world
        if section is not None and self.pad is not None:
            return pad_route(seed, self.pad.pos_ned_m, section.height_m, section.away_m, section.circle_m)
        route = make_route(
            seed, world.terrain, world.spec.half_size_m, flight.waypoints, flight.height_agl_m, flight.hover_stops
        )
        vehicle = self.scenario.vehicle
        return widened(route, turn_radius_m(AIRFRAMES[vehicle.airframe])) if vehicle.type == "fixed_wing" else route

    def _pilot_of(self, route: Route) -> Pilot:
        flight, vehicle, terrain = self.scenario.flight, self.scenario.vehicle, self.world.terrain
        if vehicle.type != "fixed_wing":
            # By a belief that drifts nobody knows where the ground is.
            until_it_stands = self.pad is not None or flight.by_belief
            return Pilot(route, self.home_ned_m, terrain, flight.speed_m_s, flight.hover_s, until_it_stands)
        airframe = AIRFRAMES[vehicle.airframe]
        return WingPilot(
            *(route, self.home_ned_m, terrain, airframe.airspeed_m_s, flight.hover_s),
            turn_radius_m(airframe), LOOK_AHEAD_S,
        )  # fmt: skip

    def begin(self, start_unix_us: int) -> None:
        """Set the clock again, before the first step only."""
        if self._steps:
            message = "the flight has begun"
            raise ValueError(message)
        self._start_unix_us = start_unix_us

    @property
    def elapsed_us(self) -> int:
        """Time since the start."""
        return self._steps * STEP_US

    @property
    def believed_vel_error_ned_m_s(self) -> Float:
        """How far off the velocity (3,) is that the autopilot flies by."""
        return self._believed.vel_error_ned_m_s

    @property
    def believed_error_ned_m(self) -> Float:
        """How far off (3,) the autopilot has itself."""
        return self._believed.error_ned_m

    def receive(self, data: bytes) -> None:
        """A datagram from a ground station; nothing before the first step."""
        if self.state is not None and self._snapshot is not None:
            state = self.state
            if self.scenario.flight.by_belief:
                state = replace(state, pos_ned_m=state.pos_ned_m + self._believed.error_ned_m)
            self.autopilot.receive(data, state, self._snapshot, self.state)

    def step(self) -> StepOutput:
        """Advance by one step of 5 ms."""
        self._steps += 1
        t_us = self._steps * STEP_US
        dt_s = STEP_US / 1e6
        state = self._fly(t_us, dt_s)
        self._inertial.sample(state.rate_body_rad_s, state.specific_force_body_m_s2, dt_s)
        for start_s, end_s in self.scenario.gps_cut_s:
            for moment_s, off in ((start_s, True), (end_s, False)):
                if t_us - STEP_US < moment_s * 1e6 <= t_us:
                    self.autopilot.cut_gps(off, t_us)
        packets: list[bytes] = []
        if self._steps % _IMU_STEPS == 0:
            now = self._sense(state)
            packets = self._telemetry.due(now)
        packets += self.autopilot.take_outbox(t_us + _BOOTED_BEFORE_US)
        return StepOutput(self._start_unix_us + t_us, packets, self._exposure(state))

    def _fly(self, t_us: int, dt_s: float) -> VehicleState:
        """One step of pilot, vehicle and gimbal."""
        before = self.state
        position = self.pilot.goal_ned_m if before is None else before.pos_ned_m
        # The route is flown by eye; what else is flown by belief is off by what the belief is off.
        by_belief = self.scenario.flight.by_belief and self.pilot.mode is not FlightMode.AUTO
        if by_belief:
            position = position + self._believed.error_ned_m
        velocity, yaw = self.pilot.command(position, dt_s)
        if by_belief or self.pilot.follows_set_points:
            velocity = velocity - self._believed.vel_error_ned_m_s
        if VEHICLES[self.scenario.vehicle.type].stands:
            state = self._above_ground(t_us, dt_s, velocity, yaw, before)
        else:
            state = self._aircraft.step(t_us, dt_s, velocity, yaw)
        if self._gimbal is not None:
            self._gimbal.step(dt_s, state.yaw_rad)
        self.state = state
        return state

    def _above_ground(
        self, t_us: int, dt_s: float, velocity: Float, yaw: float, before: VehicleState | None
    ) -> VehicleState:
        """A step over ground that one can stand on; in LAND the motors stop some time after that."""
        if not self.autopilot.armed:
            velocity = np.zeros(3)
        north, east = self.home_ned_m[:2] if before is None else before.pos_ned_m[:2]
        floor_down_m = -float(self.world.terrain.at(north, east)) - SKID_M
        state = self._aircraft.step(t_us, dt_s, velocity, yaw, floor_down_m)
        self.autopilot.on_ground = self._aircraft.on_ground
        if not self._aircraft.on_ground:
            self._stands_us = 0
            return state
        if self.touchdown is None:
            self.touchdown = before
        self._stands_us += STEP_US
        if self.pilot.mode is FlightMode.LAND and self._stands_us == _DISARM_US:
            self.autopilot.disarm_on_ground()
        return state

    def _sense(self, state: VehicleState) -> Snapshot:
        """Read every sensor whose turn it is."""
        before = self._snapshot
        ned_from_body = matrix_from_q(state.q_ned_from_body)
        rate, force = self._inertial.report()
        believed = before.q_believed if before is not None else state.q_ned_from_body
        pressure, baro_is_new, fix = 101325.0, False, None
        if before is not None:
            pressure, baro_is_new, fix = before.pressure_pa, before.baro_is_new, before.fix
        if before is None or self._steps % _BARO_STEPS == 0:
            alt_amsl_m = float(self.world.frame.geodetic_from_ned(state.pos_ned_m)[2])
            pressure = self._barometer.pressure_pa(alt_amsl_m, _BARO_STEPS * STEP_US / 1e6)
            baro_is_new = True
        if before is None or self._steps % _GNSS_STEPS == 0:
            own = self._receiver.measure(state, _GNSS_STEPS * STEP_US / 1e6)
            fix = self.autopilot.navigation.fix_in_use(own, state.t_us)
            self._believed.step(state, fix, _GNSS_STEPS * STEP_US / 1e6)
        if before is None or self._steps % _ATTITUDE_STEPS == 0:
            believed = self._attitude.step(state.q_ned_from_body, _ATTITUDE_STEPS * STEP_US / 1e6)
        drift = self._believed.error_ned_m
        snapshot = Snapshot(
            t_boot_us=state.t_us + _BOOTED_BEFORE_US,
            t_unix_us=self._start_unix_us + state.t_us + self._clock_offset_us,
            mode=self.pilot.mode,
            armed=self.autopilot.armed,
            rate_body_rad_s=rate,
            specific_force_body_m_s2=force,
            field_body_gauss=self._magnetometer.field_body_gauss(ned_from_body),
            pressure_pa=pressure,
            pressure_alt_m=float(isa_pressure_alt_m(pressure)),
            baro_is_new=baro_is_new,
            q_believed=believed,
            pos_believed_ned_m=state.pos_ned_m + drift,
            vel_believed_ned_m_s=state.vel_ned_m_s + self._believed.vel_error_ned_m_s,
            fix=fix,
            airspeed_m_s=float(np.linalg.norm(state.vel_ned_m_s - state.wind_ned_m_s)),
            home_ned_m=self.home_ned_m,
            gimbal=None if self._gimbal is None else self._gimbal.report(),
            mission_seq=self.pilot.mission_seq,
            mission_total=self.autopilot.mission_total,
        )
        self._snapshot = snapshot
        return snapshot

    def _exposure(self, state: VehicleState) -> Exposure | None:
        if state.t_us < (self._frames + 1) * self._frame_interval_us:
            return None
        self._frames += 1
        ned_from_body = matrix_from_q(state.q_ned_from_body)
        return Exposure(
            t_unix_us=self._start_unix_us + state.t_us + self._clock_offset_us,
            camera_pos_ned_m=state.pos_ned_m + ned_from_body @ self._lever_arm,
            ned_from_camera=self._ned_from_camera(state, ned_from_body),
            state=state,
        )

    def _ned_from_camera(self, state: VehicleState, ned_from_body: Float) -> Float:
        if self._gimbal is not None:
            return self._gimbal.ned_from_camera(state.yaw_rad)
        if self.scenario.camera.gimbal == "stabilised":
            ned_from_body = matrix_from_q(q_from_euler(0.0, 0.0, state.yaw_rad))
        return ned_from_body @ self._body_from_camera
