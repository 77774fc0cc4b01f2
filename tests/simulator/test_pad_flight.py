"""A flight to a pad: set-points, landing by a target, touchdown, and the gimbal that is told where to look."""

from __future__ import annotations

import json
import math
import threading
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.rotation import matrix_from_q
from estimator.types import Float
from geodata.flight import FlightFolder
from geodata.pad_file import pad_from
from simulator.offline import record_offline
from simulator.scenario import SCENARIOS, CameraSection, Scenario
from simulator.world.world import World
from tests.simulator.test_simulation import Run

GUIDED, LOITER, LAND = 4.0, 5.0, 9.0
VELOCITY_ONLY = 0x0DC7


@pytest.fixture(scope="module")
def pad_scenario(scenario: Scenario) -> Scenario:
    """The scenario of the pad over the small world, GPS cut after three seconds."""
    return SCENARIOS["pad"].model_copy(
        update={"world": scenario.world, "gps_cut_s": ((3.0, 1e6),), "gps_denied_s": ((3.0, 1e6),)}
    )


@pytest.fixture
def run(pad_scenario: Scenario, world: World) -> Run:
    return Run(pad_scenario, world)


def rel(run: Run) -> Float:
    state, pad = run.simulation.state, run.simulation.pad
    assert state is not None
    assert pad is not None
    return state.pos_ned_m - pad.pos_ned_m


def velocity(north: float, east: float, down: float, frame: int = 1, mask: int = VELOCITY_ONLY) -> object:
    return mavlink.MAVLink_set_position_target_local_ned_message(
        *(0, 1, 1, frame, mask, 0.0, 0.0, 0.0, north, east, down, 0.0, 0.0, 0.0, 0.0, 0.0)
    )


def test_it_comes_to_the_pad_and_waits_beside_it(run: Run) -> None:
    run.fly(32.0)
    first = rel(run)
    run.fly(4.0)

    assert np.hypot(*first[:2]) == pytest.approx(4.0, abs=1.0)
    assert first[2] == pytest.approx(-20.0, abs=0.7)
    assert np.linalg.norm(rel(run) - first) < 1.0


def flown(run: Run, wanted: tuple[float, float, float] | None, seconds: float) -> Float:
    """Mean velocity by the autopilot's own belief over the last half; turbulence moves it by decimetres a second."""
    believed = []
    for _ in range(round(seconds * 10)):
        if wanted is not None:
            run.send(velocity(*wanted))
        run.fly(0.1)
        state = run.simulation.state
        assert state is not None
        believed.append(state.vel_ned_m_s + run.simulation.believed_vel_error_ned_m_s)
    mean: Float = np.mean(believed[len(believed) // 2 :], axis=0)
    return mean


def test_velocities_are_flown_by_the_autopilots_own_and_stop_when_none_comes(run: Run) -> None:
    run.fly(2.0)
    assert run.command(176, 1.0, GUIDED) == 0
    assert_allclose(flown(run, (1.0, -0.5, 0.0), 10.0), [1.0, -0.5, 0.0], atol=0.15)
    # GPS has been off for nine seconds.
    assert np.linalg.norm(run.simulation.believed_vel_error_ned_m_s) > 0.03
    assert_allclose(flown(run, None, 14.0), np.zeros(3), atol=0.15)


def test_set_points_of_other_kinds_modes_and_vehicles_are_not_flown(run: Run) -> None:
    run.fly(2.0)
    run.send(velocity(1.0, 0.0, 0.0))
    assert not run.simulation.pilot.follows_set_points
    assert run.command(176, 1.0, GUIDED) == 0
    for message in (
        velocity(1.0, 0.0, 0.0, mask=0x0DF8), velocity(math.nan, 0.0, 0.0), velocity(900.0, 0.0, 0.0),
        velocity(1.0, 0.0, 0.0, frame=0),
    ):  # fmt: skip
        run.send(message)
        assert not run.simulation.pilot.follows_set_points
    run.send(velocity(1.0, 0.0, 0.0, frame=8))
    assert run.simulation.pilot.follows_set_points
    assert run.command(176, 1.0, LOITER) == 0
    assert not run.simulation.pilot.follows_set_points


def landed_with(run: Run, *, targets: bool) -> float:
    """Metres beside the pad after LAND, with LANDING_TARGET or without."""
    run.fly(16.0)
    assert run.command(21) == 0
    for _ in range(1600):
        state = run.simulation.state
        assert state is not None
        if targets:
            x, y, z = (-matrix_from_q(state.q_ned_from_body).T @ rel(run)).tolist()
            run.send(
                mavlink.MAVLink_landing_target_message(
                    *(0, 0, 12, 0.0, 0.0, math.hypot(x, y, z), 0.0, 0.0, x, y, z, [1.0, 0.0, 0.0, 0.0], 2, 1)
                )
            )
        run.fly(0.05)
        if not run.simulation.autopilot.armed:
            break
    return float(np.hypot(*rel(run)[:2]))


def test_landing_targets_bring_it_onto_the_pad(pad_scenario: Scenario, world: World) -> None:
    """With targets it comes down within what its own drift of velocity leaves; without, metres beside."""
    with_targets = landed_with(Run(pad_scenario, world, 5), targets=True)
    without = landed_with(Run(pad_scenario, world, 5), targets=False)

    assert with_targets < 2.0
    assert without > with_targets + 1.5


def test_it_stands_on_the_ground_and_takes_off_again(run: Run, world: World) -> None:
    run.fly(2.0)
    assert run.command(176, 1.0, GUIDED) == 0
    for _ in range(1200):
        run.send(velocity(0.0, 0.0, 0.8 if rel(run)[2] > -6.0 else 4.0))
        run.fly(0.05)
        if run.simulation.touchdown is not None:
            break
    touched = run.simulation.touchdown
    assert touched is not None
    assert touched.vel_ned_m_s[2] == pytest.approx(0.8, abs=0.2)
    run.fly(2.0)
    state = run.simulation.state
    assert state is not None
    ground = -float(world.terrain.at(*state.pos_ned_m[:2]))
    assert state.pos_ned_m[2] == pytest.approx(ground - 0.3, abs=1e-6)
    assert np.linalg.norm(state.vel_ned_m_s) < 1e-3
    assert abs(state.roll_rad) + abs(state.pitch_rad) < 1e-3
    # It feels its weight and nothing else.
    assert state.specific_force_body_m_s2[2] == pytest.approx(-9.82, abs=0.02)
    for _ in range(80):
        run.send(velocity(0.0, 0.0, -1.0))
        run.fly(0.05)
    state = run.simulation.state
    assert state is not None
    assert state.pos_ned_m[2] < ground - 2.0


def test_a_gimbal_obeys_who_took_control_and_says_where_it_looks(run: Run) -> None:
    run.fly(1.0)
    point = mavlink.MAVLink_gimbal_manager_set_pitchyaw_message(1, 1, 32, 0, -0.9, 0.4, math.nan, math.nan)
    run.send(point)
    run.fly(2.0)
    assert run.of("GIMBAL_MANAGER_STATUS")[-1].primary_control_sysid == 0
    assert _axis_pitch(run) == pytest.approx(-math.pi / 2, abs=0.03)
    assert run.command(1001, 255, 190, -1, -1) == 0
    run.send(point)
    run.fly(3.0)

    status = run.of("GIMBAL_MANAGER_STATUS")[-1]
    assert (status.primary_control_sysid, status.primary_control_compid) == (255, 190)
    # The lens sits up to a degree askew in it, and its own horizon is off by tenths.
    assert _axis_pitch(run) == pytest.approx(-0.9, abs=0.04)
    report = run.of("GIMBAL_DEVICE_ATTITUDE_STATUS")[-1]
    assert report.flags & 32
    axis = matrix_from_q(np.array(report.q))[:, 0]
    assert math.asin(-axis[2]) == pytest.approx(-0.9, abs=0.02)
    assert math.atan2(axis[1], axis[0]) == pytest.approx(0.4, abs=0.02)
    assert run.command(1001, -3, -3) == 0
    run.fly(1.2)
    assert run.of("GIMBAL_MANAGER_STATUS")[-1].primary_control_sysid == 0


def _axis_pitch(run: Run) -> float:
    return math.asin(-float(run.exposures[-1].ned_from_camera[2, 2]))


def test_a_vehicle_without_a_gimbal_knows_none_of_it(scenario: Scenario, world: World) -> None:
    run = Run(scenario, world).fly(1.5)
    assert run.command(1001, 255, 190) == mavlink.MAV_RESULT_UNSUPPORTED
    assert run.command(511, 285, 100_000) == mavlink.MAV_RESULT_DENIED
    assert run.of("GIMBAL_MANAGER_STATUS") == []


def test_a_recording_describes_the_pad(pad_scenario: Scenario, world: World, tmp_path: Path) -> None:
    small = CameraSection(width_px=160, height_px=120, hfov_deg=43.6, gimbal="pan_tilt")
    scenario = pad_scenario.model_copy(update={"duration_s": 1.0, "camera": small})
    record_offline(scenario, world, 5, tmp_path / "flight", threading.Event())

    data = json.loads((tmp_path / "flight" / "flight.json").read_text())
    assert scenario.pad is not None
    assert pad_from(data["pad"], tmp_path) == scenario.pad.pad()
    assert data["camera"]["gimbal"] == "pan_tilt"
    assert FlightFolder.open(tmp_path / "flight").meta.pad is not None
    assert "\npad," in (tmp_path / "flight" / "targets_truth.csv").read_text()
