"""What one aircraft tells, against its truth; and how it obeys."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.rotation import matrix_from_q
from simulator.mavlink_input import messages_in
from simulator.scenario import Scenario
from simulator.simulation import Exposure, Simulation
from simulator.world.world import World

START_US = 1_760_000_000_000_000


class Run:
    """A simulation and everything that it has sent."""

    def __init__(self, scenario: Scenario, world: World, seed: int = 7) -> None:
        self.simulation = Simulation(scenario, world, seed, START_US)
        self.messages: list[Any] = []
        self.packets: list[bytes] = []
        self.exposures: list[Exposure] = []
        self._station = mavlink.MAVLink(None, srcSystem=255, srcComponent=190)

    def fly(self, seconds: float) -> Run:
        for _ in range(round(seconds * 200)):
            output = self.simulation.step()
            self.packets += output.packets
            self.messages += [m for packet in output.packets for m in messages_in(packet)]
            if output.exposure is not None:
                self.exposures.append(output.exposure)
        return self

    def send(self, message: Any) -> None:
        self.simulation.receive(bytes(message.pack(self._station)))

    def command(self, number: int, *params: float) -> int | None:
        """Result of the acknowledgement that follows."""
        before = len(self.messages)
        padded = [*params, *([0.0] * (7 - len(params)))]
        self.send(mavlink.MAVLink_command_long_message(1, 1, number, 0, *padded))
        self.fly(0.05)
        acks = [m for m in self.messages[before:] if m.get_type() == "COMMAND_ACK" and m.command == number]
        return int(acks[0].result) if acks else None

    def of(self, kind: str) -> list[Any]:
        return [message for message in self.messages if message.get_type() == kind]


@pytest.fixture
def run(scenario: Scenario, world: World) -> Run:
    return Run(scenario, world)


def test_rates_are_those_of_an_autopilot(run: Run) -> None:
    run.fly(10.0)
    expected = {"HIGHRES_IMU": 50, "ATTITUDE": 25, "GLOBAL_POSITION_INT": 10, "GPS_RAW_INT": 5, "SCALED_PRESSURE": 10}
    expected |= {"HEARTBEAT": 1, "SYSTEM_TIME": 1, "SYS_STATUS": 1, "VFR_HUD": 4}
    for kind, rate_hz in expected.items():
        assert len(run.of(kind)) == pytest.approx(10 * rate_hz, abs=1), kind
    assert len(run.exposures) == pytest.approx(250, abs=1)
    assert set(np.diff([e.t_unix_us for e in run.exposures])) == {40_000}


def test_heartbeat_is_a_simulated_helicopter(run: Run) -> None:
    beat = run.fly(1.2).of("HEARTBEAT")[-1]
    assert (beat.type, beat.autopilot) == (4, 3)
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_HIL_ENABLED
    assert beat.base_mode & mavlink.MAV_MODE_FLAG_SAFETY_ARMED
    assert beat.custom_mode == 3


def test_telemetry_is_near_the_truth(run: Run, world: World) -> None:
    run.fly(8.0)
    state = run.simulation.state
    assert state is not None
    fix, attitude = run.of("GPS_RAW_INT")[-1], run.of("ATTITUDE")[-1]
    pos = world.frame.ned_from_geodetic(np.radians(fix.lat / 1e7), np.radians(fix.lon / 1e7), fix.alt / 1e3)
    # Half a second of flight at most, and four sigma of the receiver.
    assert np.linalg.norm(pos[:2] - state.pos_ned_m[:2]) < 11.0 * 0.25 + 5.0
    assert abs(pos[2] - state.pos_ned_m[2]) < 7.0
    assert attitude.roll == pytest.approx(state.roll_rad, abs=0.06)
    assert attitude.pitch == pytest.approx(state.pitch_rad, abs=0.06)
    yaw_error = (attitude.yaw - state.yaw_rad + np.pi) % (2 * np.pi) - np.pi
    assert abs(yaw_error) < np.radians(7)
    imu = run.of("HIGHRES_IMU")[-1]
    assert imu.zacc == pytest.approx(-9.8, abs=1.5)
    assert imu.time_usec == state.t_us + 42_000_000
    home = run.of("HOME_POSITION")[-1]
    assert home.altitude / 1e3 == pytest.approx(84.0 - run.simulation.home_ned_m[2], abs=0.01)


def test_clocks_agree_with_each_other(run: Run) -> None:
    run.fly(3.0)
    clock = run.of("SYSTEM_TIME")[-1]
    assert clock.time_unix_usec - START_US == clock.time_boot_ms * 1000 - 42_000_000
    fields = [m.fields_updated & 0x200 for m in run.of("HIGHRES_IMU")]
    assert 25 <= sum(map(bool, fields)) <= 31


def test_camera_follows_the_body(run: Run, scenario: Scenario) -> None:
    run.fly(4.0)
    exposure = run.exposures[-1]
    ned_from_body = matrix_from_q(exposure.state.q_ned_from_body)
    # The optical axis is the body's down, the top of the picture its front.
    assert_allclose(exposure.ned_from_camera[:, 2], ned_from_body[:, 2], atol=1e-9)
    assert_allclose(-exposure.ned_from_camera[:, 1], ned_from_body[:, 0], atol=1e-9)
    arm = ned_from_body.T @ (exposure.camera_pos_ned_m - exposure.state.pos_ned_m)
    assert_allclose(arm, scenario.camera.lever_arm_frd_m, atol=1e-9)


def test_same_seed_same_packets(scenario: Scenario, world: World) -> None:
    first, second = (Run(scenario, world, 5).fly(2.0) for _ in range(2))
    assert first.packets == second.packets
    assert first.packets != Run(scenario, world, 6).fly(2.0).packets


def test_gps_failure_cuts_and_restores(run: Run) -> None:
    run.fly(1.0)
    assert run.command(420, 4, 1, 0) == mavlink.MAV_RESULT_ACCEPTED
    run.fly(1.0)
    assert run.of("GPS_RAW_INT")[-1].fix_type == 1
    assert run.of("GPS_RAW_INT")[-1].satellites_visible == 0
    assert not run.of("SYS_STATUS")[-1].onboard_control_sensors_health & mavlink.MAV_SYS_STATUS_SENSOR_GPS
    assert any("GPS" in m.text for m in run.of("STATUSTEXT"))
    assert run.command(420, 4, 0, 0) == mavlink.MAV_RESULT_ACCEPTED
    run.fly(7.0)
    assert run.of("GPS_RAW_INT")[-1].fix_type == 3
    assert run.command(420, 7, 1) == mavlink.MAV_RESULT_UNSUPPORTED


def test_autopilots_own_position_drifts_without_gps(scenario: Scenario, world: World) -> None:
    run = Run(scenario.model_copy(update={"gps_cut_s": ((1.0, 500.0),)}), world).fly(60.0)
    told, state = run.of("GLOBAL_POSITION_INT")[-1], run.simulation.state
    assert state is not None
    pos = world.frame.ned_from_geodetic(np.radians(told.lat / 1e7), np.radians(told.lon / 1e7), told.alt / 1e3)
    assert 3.0 < np.linalg.norm(pos[:2] - state.pos_ned_m[:2]) < 300.0


def test_message_rates_on_request(run: Run) -> None:
    run.fly(1.0)
    assert run.command(511, mavlink.MAVLINK_MSG_ID_ATTITUDE_QUATERNION, 40_000) == 0
    assert run.command(511, mavlink.MAVLINK_MSG_ID_HIGHRES_IMU, -1) == 0
    assert run.command(511, 99999, 1000) == mavlink.MAV_RESULT_DENIED
    assert run.command(511, float("nan"), 1000) == mavlink.MAV_RESULT_DENIED
    run.messages.clear()
    run.fly(2.0)
    assert len(run.of("ATTITUDE_QUATERNION")) == pytest.approx(50, abs=1)
    assert run.of("HIGHRES_IMU") == []
    assert run.command(512, mavlink.MAVLINK_MSG_ID_HOME_POSITION) == 0
    assert run.of("HOME_POSITION")


def test_time_synchronisation_mirrors_the_question(run: Run) -> None:
    run.fly(0.5)
    run.send(mavlink.MAVLink_timesync_message(0, 123456789))
    run.fly(0.05)
    answer = run.of("TIMESYNC")[-1]
    assert answer.ts1 == 123456789
    assert answer.tc1 == pytest.approx((42.5 + 0.02) * 1e9, abs=3e7)


def test_goto_return_and_refusals(run: Run, world: World) -> None:
    run.fly(1.0)
    lat, lon, _ = world.frame.geodetic_from_ned(np.array([40.0, -30.0, 0.0]))
    x, y = round(np.degrees(float(lat)) * 1e7), round(np.degrees(float(lon)) * 1e7)
    order = mavlink.MAVLink_command_int_message(1, 1, 0, 192, 0, 0, -1, 1, 0, 0, x, y, 84.0 + 70.0)
    run.send(order)
    run.fly(40.0)
    assert run.of("COMMAND_ACK")[-1].result == 0
    state = run.simulation.state
    assert state is not None
    assert_allclose(state.pos_ned_m, [40.0, -30.0, -70.0], atol=2.5)
    assert run.of("HEARTBEAT")[-1].custom_mode == 4
    assert run.command(400, 0) == mavlink.MAV_RESULT_DENIED
    assert run.command(20) == mavlink.MAV_RESULT_ACCEPTED
    run.fly(1.2)
    assert run.of("HEARTBEAT")[-1].custom_mode == 6
    assert run.command(31000) == mavlink.MAV_RESULT_UNSUPPORTED
    assert run.command(192, -1, 0, 0, 0, float("nan"), float("nan"), 100) == mavlink.MAV_RESULT_DENIED


def test_orbits_a_place_either_way_and_says_why_it_does_not(run: Run, world: World) -> None:
    lat, lon, _ = world.frame.geodetic_from_ned(np.array([40.0, -30.0, 0.0]))
    place = (round(np.degrees(float(lat)) * 1e7), round(np.degrees(float(lon)) * 1e7))

    def orbit(radius_m: float) -> int:
        run.send(mavlink.MAVLink_command_int_message(1, 1, 6, 34, 0, 0, radius_m, float("nan"), 0, 0, *place, 60.0))
        run.fly(0.05)
        return int(run.of("COMMAND_ACK")[-1].result)

    run.fly(1.0)
    assert orbit(3.0) == mavlink.MAV_RESULT_DENIED
    assert run.of("STATUSTEXT")[-1].text == "Orbit: radius 5 to 1000 m"
    for radius_m in (30.0, -20.0):
        assert orbit(radius_m) == mavlink.MAV_RESULT_ACCEPTED
        run.fly(45.0)
        out, velocity = [], []
        for _ in range(20):
            run.fly(0.5)
            state = run.simulation.state
            assert state is not None
            out.append(state.pos_ned_m[:2] - (40.0, -30.0))
            velocity.append(np.array(state.vel_ned_m_s[:2]))
        # Wind and the receiver's own error move it off the circle.
        assert_allclose(np.linalg.norm(out, axis=1), abs(radius_m), atol=3.0)
        # The turn from north to east, clockwise from above, is positive.
        around = np.array([n * ve - e * vn for (n, e), (vn, ve) in zip(out, velocity, strict=True)])
        assert np.all(around * radius_m > 0.0)
        assert run.of("HEARTBEAT")[-1].custom_mode == 7  # CIRCLE
    assert run.command(176, 1, 7) == mavlink.MAV_RESULT_DENIED  # a circle about nothing


def test_orders_for_others_and_garbage_are_ignored(run: Run) -> None:
    run.fly(0.5)
    run.send(mavlink.MAVLink_command_long_message(9, 1, 20, 0, 0, 0, 0, 0, 0, 0, 0))
    run.simulation.receive(bytes(range(256)) * 4)
    run.simulation.receive(b"\xfd" * 300)
    run.fly(1.0)
    assert run.of("COMMAND_ACK") == []
    assert run.of("HEARTBEAT")[-1].custom_mode == 3
