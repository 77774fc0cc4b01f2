"""What tells the simulated autopilot where it is: taken where ArduPilot takes it, refused where it refuses it."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.rotation import matrix_from_q
from simulator.scenario import Scenario
from simulator.world.world import World
from tests.simulator.test_simulation import Run

EXTERNAL, SOURCES = 43003, 42007


@pytest.fixture
def run(scenario: Scenario, world: World) -> Run:
    return Run(scenario, world).fly(3.0)


def cut(run: Run, seconds: float = 30.0) -> Run:
    assert run.command(mavlink.MAV_CMD_INJECT_FAILURE, 4, 1) == 0
    return run.fly(seconds)


def off_m(run: Run) -> float:
    """How far the autopilot says that it is from where it is."""
    assert run.simulation.state is not None
    told = run.of("GLOBAL_POSITION_INT")[-1]
    frame = run.simulation.world.frame
    at = frame.ne_from_geodetic(np.radians(told.lat * 1e-7), np.radians(told.lon * 1e-7))
    return float(np.linalg.norm(at - run.simulation.state.pos_ned_m[:2]))


def place(run: Run, **change: Any) -> int | None:
    """Tell it its true place; the result that it answers with."""
    assert run.simulation.state is not None
    lat, lon, _ = run.simulation.world.frame.geodetic_from_ned(run.simulation.state.pos_ned_m)
    usual = {
        "frame": 0, "x": round(np.degrees(float(lat)) * 1e7), "y": round(np.degrees(float(lon)) * 1e7), "z": np.nan,
    }  # fmt: skip
    at = {**usual, **change}
    before = len(run.messages)
    run.send(mavlink.MAVLink_command_int_message(
        1, 1, at["frame"], EXTERNAL, 0, 0, 100.0, 0.0, 2.0, 0.0, at["x"], at["y"], at["z"]
    ))  # fmt: skip
    run.fly(0.2)
    acks = [m for m in run.messages[before:] if m.get_type() == "COMMAND_ACK" and m.command == EXTERNAL]
    return int(acks[0].result) if acks else None


def odometry(run: Run, frame_id: int = 20, child_frame_id: int = 12) -> None:
    state, home = run.simulation.state, run.simulation.home_ned_m
    assert state is not None
    velocity = matrix_from_q(state.q_ned_from_body).T @ state.vel_ned_m_s
    run.send(mavlink.MAVLink_odometry_message(
        1, frame_id, child_frame_id, *(state.pos_ned_m - home).tolist(), state.q_ned_from_body.tolist(),
        *velocity.tolist(), np.nan, np.nan, np.nan, [np.nan] * 21, [np.nan] * 21, 0, 2, 90,
    ))  # fmt: skip


def gps_input(run: Run, away_m: float = 0.0) -> None:
    state = run.simulation.state
    assert state is not None
    lat, lon, alt = run.simulation.world.frame.geodetic_from_ned(state.pos_ned_m + np.array((away_m, 0.0, 0.0)))
    run.send(mavlink.MAVLink_gps_input_message(
        1, 0, 0, 1000, 2387, 3, round(np.degrees(float(lat)) * 1e7), round(np.degrees(float(lon)) * 1e7), float(alt),
        1.0, 1.0, *state.vel_ned_m_s.tolist(), 0.3, 1.0, 1.5, 10, 0,
    ))  # fmt: skip


def told_while(run: Run, tell: Any, seconds: float) -> None:
    for _ in range(round(seconds * 10)):
        tell(run)
        run.fly(0.1)


def set_parameter(run: Run, name: str, value: float) -> Any:
    run.send(mavlink.MAVLink_param_set_message(1, 1, name.encode(), value, 2))
    run.fly(0.05)
    return run.of("PARAM_VALUE")[-1]


def test_a_position_moves_an_autopilot_that_has_drifted(run: Run) -> None:
    cut(run)
    assert off_m(run) > 5.0
    assert place(run) == 0
    assert off_m(run) < 1.0


def test_a_position_is_denied_while_the_receiver_has_a_fix(run: Run) -> None:
    assert place(run, x=0) == mavlink.MAV_RESULT_DENIED
    assert off_m(run) < 5.0


@pytest.mark.parametrize("change", [{"z": 100.0}, {"frame": 3}, {"x": 910_000_000}])
def test_a_position_in_another_form_is_denied(run: Run, change: dict[str, Any]) -> None:
    cut(run, 10.0)
    before = run.simulation.believed_error_ned_m
    assert place(run, **change) == mavlink.MAV_RESULT_DENIED
    assert np.linalg.norm(run.simulation.believed_error_ned_m - before) < 1.0


def test_a_position_as_command_long_is_denied(run: Run) -> None:
    cut(run, 1.0)
    assert run.command(EXTERNAL, 100.0, 0.0, 2.0, 0.0, 47.0, 8.0, np.nan) == mavlink.MAV_RESULT_DENIED


def test_odometry_holds_it_where_it_is_once_the_sources_are_switched(run: Run) -> None:
    cut(run)
    drifted = off_m(run)
    told_while(run, odometry, 3.0)
    assert off_m(run) > 0.8 * drifted
    assert run.command(SOURCES, 2) == 0
    told_while(run, odometry, 5.0)
    assert off_m(run) < 1.0
    assert np.linalg.norm(run.simulation.believed_vel_error_ned_m_s) < 0.1
    run.fly(30.0)
    assert off_m(run) > 2.0


@pytest.mark.parametrize("frames", [(1, 12), (20, 8), (20, 1)])
def test_odometry_in_other_frames_is_dropped(run: Run, frames: tuple[int, int]) -> None:
    cut(run)
    drifted = off_m(run)
    run.command(SOURCES, 2)
    told_while(run, lambda at: odometry(at, *frames), 3.0)
    assert off_m(run) > 0.8 * drifted


def test_there_are_three_sets_of_sources(run: Run) -> None:
    assert run.command(SOURCES, 4) == mavlink.MAV_RESULT_DENIED


def test_gps_input_is_the_receiver_only_where_the_parameter_says_so(run: Run) -> None:
    cut(run)
    drifted = off_m(run)
    told_while(run, gps_input, 3.0)
    assert off_m(run) > 0.8 * drifted
    assert run.of("GPS_RAW_INT")[-1].fix_type < 2
    assert set_parameter(run, "GPS1_TYPE", 14).param_value == 14.0
    told_while(run, gps_input, 6.0)
    assert run.of("GPS_RAW_INT")[-1].fix_type == 3
    assert off_m(run) < 2.5  # it follows a receiver with a delay of a second or so, at 4 m/s and on a curve


def test_what_it_says_of_gps_is_then_what_it_was_sent_and_ends_with_it(run: Run) -> None:
    """The circle that a station must not close: a wrong place comes back as a fix."""
    set_parameter(run, "GPS1_TYPE", 14)
    told_while(run, lambda at: gps_input(at, 200.0), 8.0)
    assert off_m(run) == pytest.approx(200.0, abs=10.0)
    told = run.of("GPS_RAW_INT")[-1]
    assert (told.fix_type, told.satellites_visible) == (3, 10)
    run.fly(5.0)
    assert run.of("GPS_RAW_INT")[-1].fix_type < 2


def test_the_origin_is_told_on_request(run: Run) -> None:
    assert run.command(mavlink.MAV_CMD_REQUEST_MESSAGE, 49) == 0
    home, origin = run.of("HOME_POSITION")[-1], run.of("GPS_GLOBAL_ORIGIN")[-1]
    assert (origin.latitude, origin.longitude, origin.altitude) == (home.latitude, home.longitude, home.altitude)


def test_parameters_are_read_listed_and_written(run: Run) -> None:
    run.send(mavlink.MAVLink_param_request_read_message(1, 1, b"EK3_SRC2_POSXY", -1))
    run.send(mavlink.MAVLink_param_request_read_message(1, 1, b"NO_SUCH", -1))
    run.send(mavlink.MAVLink_param_request_read_message(2, 1, b"GPS1_TYPE", -1))
    run.fly(0.05)
    assert [(m.param_id, m.param_value) for m in run.of("PARAM_VALUE")] == [("EK3_SRC2_POSXY", 6.0)]
    assert set_parameter(run, "GPS1_TYPE", 200.0).param_value == 127.0
    assert set_parameter(run, "GPS1_TYPE", np.nan).param_value == 127.0
    before = len(run.of("PARAM_VALUE"))
    run.send(mavlink.MAVLink_param_request_list_message(1, 1))
    run.fly(0.05)
    listed = run.of("PARAM_VALUE")[before:]
    assert len({m.param_id for m in listed}) == len(listed) == listed[0].param_count
    run.send(mavlink.MAVLink_param_request_read_message(1, 1, b"", 3))
    run.fly(0.05)
    assert run.of("PARAM_VALUE")[-1].param_id == listed[3].param_id


def test_a_flight_that_is_told_nothing_is_the_same_beside_one_that_is(scenario: Scenario, world: World) -> None:
    """What is told moves the belief, and neither the aircraft nor its sensors; by eye it flies the same route."""
    alone, told = Run(scenario, world), Run(scenario, world)
    cut(alone.fly(3.0), 5.0)
    cut(told.fly(3.0), 1.0)
    told_while(told, gps_input, 2.0)
    place(told, x=0)
    told.fly(5.0 - 1.0 - 2.0 - 0.2)
    for kind in ("HIGHRES_IMU", "SCALED_PRESSURE", "ATTITUDE"):
        ours = [m.to_dict() for m in alone.of(kind)]
        assert [m.to_dict() for m in told.of(kind)] == ours
        assert len(ours) > 50
    assert off_m(told) > 1000.0
