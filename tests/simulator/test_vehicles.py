"""Each kind of vehicle in a simulation: its route, its modes, and what it is called on the wire and in the folder."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pydantic import ValidationError
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from estimator.geometry.rotation import matrix_from_q, q_from_euler
from simulator.errors import SimulatorError
from simulator.recording import flight_meta
from simulator.scenario import CameraSection, FlightSection, PadSection, Scenario, VehicleSection, WorldSection
from simulator.simulation import Simulation
from simulator.vehicles.airframes import PING_WING
from simulator.vehicles.kinds import VEHICLES
from simulator.vehicles.pilot import FlightMode
from simulator.vehicles.wing_aircraft import turn_radius_m
from simulator.world.world import World, world_for
from tests.simulator.test_simulation import Run

RADIUS_M = turn_radius_m(PING_WING)


@pytest.fixture(scope="module")
def wide(world_cache: Path) -> tuple[Scenario, World]:
    """A coarse world in which a small aeroplane can turn."""
    scenario = Scenario(
        name="wide", world=WorldSection(half_size_m=400.0, gsd_m=1.0),
        camera=CameraSection(width_px=320, height_px=240, gimbal="stabilised"),
        flight=FlightSection(height_agl_m=(70.0, 80.0), waypoints=6, hover_stops=1),
        vehicle=VehicleSection(type="fixed_wing", airframe="ping_wing"),
    )  # fmt: skip
    return scenario, world_for(scenario.world.spec(7), world_cache)


def of_kind(scenario: Scenario, kind: str) -> Scenario:
    return scenario.model_copy(update={"vehicle": VehicleSection.model_validate({"type": kind})})


def test_every_kind_that_a_scenario_can_name_is_known() -> None:
    named = VehicleSection.model_json_schema()["properties"]["type"]["enum"]
    assert set(named) == set(VEHICLES)


@pytest.mark.parametrize(
    ("kind", "mav_type", "flight_type"),
    [
        ("helicopter", mavlink.MAV_TYPE_HELICOPTER, "helicopter"),
        ("multirotor", mavlink.MAV_TYPE_QUADROTOR, "multirotor"),
        ("rmax", mavlink.MAV_TYPE_HELICOPTER, "helicopter"),
    ],
)
def test_hovering_kinds_fly_the_route_and_obey(
    scenario: Scenario, world: World, kind: str, mav_type: int, flight_type: str
) -> None:
    run = Run(of_kind(scenario, kind), world).fly(8.0)
    simulation = run.simulation
    beat = run.of("HEARTBEAT")[-1]
    assert (beat.type, beat.custom_mode) == (mav_type, FlightMode.AUTO)
    meta = flight_meta(simulation.scenario, world, simulation.home_ned_m, None)
    assert meta.vehicle.type == flight_type
    state = simulation.state
    assert state is not None
    start = simulation.pilot.goal_ned_m
    assert np.linalg.norm(state.pos_ned_m - start) > 5.0
    assert run.command(mavlink.MAV_CMD_DO_SET_MODE, 1, FlightMode.LOITER) == mavlink.MAV_RESULT_ACCEPTED
    place = state.pos_ned_m.copy()
    run.fly(10.0)
    assert simulation.state is not None
    assert np.linalg.norm(simulation.state.vel_ned_m_s) < 0.6
    # Stopped from the speed of the route.
    assert np.linalg.norm(simulation.state.pos_ned_m - place) < 15.0
    assert run.of("HEARTBEAT")[-1].custom_mode == FlightMode.LOITER


def test_a_multirotor_lands_and_disarms(scenario: Scenario, world: World) -> None:
    pad = of_kind(scenario, "multirotor").model_copy(
        update={
            "pad": PadSection(height_m=6.0),
            "flight": FlightSection(
                speed_m_s=3.0, height_agl_m=(20.0, 26.0), hover_stops=1, hover_s=100.0, wind_m_s=2.0
            ),
        }
    )
    run = Run(pad, world).fly(2.0)
    assert run.command(mavlink.MAV_CMD_NAV_LAND) == mavlink.MAV_RESULT_ACCEPTED
    for _ in range(60):
        run.fly(1.0)
        if not run.simulation.autopilot.armed:
            break
    assert not run.simulation.autopilot.armed
    assert run.simulation.touchdown is not None
    assert run.simulation.touchdown.vel_ned_m_s[2] < 1.2


def test_an_aeroplane_flies_its_route_and_circles_where_others_hover(wide: tuple[Scenario, World]) -> None:
    """Within 15 m of the route, but for a circle to its right of the radius that it can turn with."""
    run = Run(*wide)
    pilot = run.simulation.pilot
    route = pilot._route.pos_ned_m
    assert pilot._route.curvature_per_m.max() <= 1.0 / RADIUS_M
    positions = []
    for _ in range(80):
        run.fly(1.0)
        state = run.simulation.state
        assert state is not None
        positions.append(state.pos_ned_m.copy())
        assert math.hypot(*state.pos_ned_m[:2]) < 400.0
    off = np.array([np.linalg.norm(route[:, :2] - one[:2], axis=1).min() for one in positions])
    stop = route[pilot._route.hover_at[0]]
    tangent = pilot._route.tangent_ne[pilot._route.hover_at[0]]
    centre = stop[:2] + RADIUS_M * np.array((-tangent[1], tangent[0]))
    on_circle = np.abs([np.linalg.norm(one[:2] - centre) - RADIUS_M for one in positions]) < 25.0
    assert np.all((off < 15.0) | on_circle)
    assert np.count_nonzero(on_circle & (off > 15.0)) > 8
    heights = np.array(
        [one[2] - route[np.linalg.norm(route[:, :2] - one[:2], axis=1).argmin(), 2] for one in positions]
    )
    assert np.abs(heights[off < 15.0]).max() < 8.0


def test_an_aeroplane_is_one_on_the_wire(wide: tuple[Scenario, World]) -> None:
    scenario, world = wide
    run = Run(scenario, world).fly(2.0)
    beat = run.of("HEARTBEAT")[-1]
    assert (beat.type, beat.custom_mode) == (mavlink.MAV_TYPE_FIXED_WING, mavlink.PLANE_MODE_AUTO)
    meta = flight_meta(scenario, world, run.simulation.home_ned_m, None)
    assert (meta.vehicle.type, meta.camera.gimbal) == ("fixed_wing", "stabilised")
    # A copter's numbers are others: 5 is a plane's FBWA, 6 its FBWB, which this autopilot has not.
    assert run.command(mavlink.MAV_CMD_DO_SET_MODE, 1, 5) == mavlink.MAV_RESULT_DENIED
    assert run.command(mavlink.MAV_CMD_DO_SET_MODE, 1, mavlink.PLANE_MODE_LOITER) == mavlink.MAV_RESULT_ACCEPTED
    assert run.command(mavlink.MAV_CMD_NAV_LAND) == mavlink.MAV_RESULT_UNSUPPORTED
    run.fly(1.0)
    assert run.of("HEARTBEAT")[-1].custom_mode == mavlink.PLANE_MODE_LOITER


def test_an_aeroplane_circles_its_goal_and_its_home(wide: tuple[Scenario, World]) -> None:
    """Within a fifth of the radius, in wind of 3.5 m/s with gusts."""
    run = Run(*wide).fly(1.0)
    pilot = run.simulation.pilot
    goal = np.add(run.simulation.home_ned_m, (40.0, -60.0, -80.0))
    state = run.simulation.state
    assert state is not None
    pilot.fly(FlightMode.GUIDED, state.pos_ned_m, goal)
    pilot.follow(np.array((1.0, 0.0, 0.0)))
    assert not pilot.follows_set_points
    run.fly(30.0)
    for _ in range(10):
        run.fly(1.0)
        assert run.simulation.state is not None
        offset = run.simulation.state.pos_ned_m - goal
        assert math.hypot(*offset[:2]) == pytest.approx(RADIUS_M, rel=0.2)
        assert abs(offset[2]) < 4.0
    assert run.command(mavlink.MAV_CMD_NAV_RETURN_TO_LAUNCH) == mavlink.MAV_RESULT_ACCEPTED
    run.fly(40.0)
    offset = run.simulation.state.pos_ned_m - run.simulation.home_ned_m
    assert math.hypot(*offset[:2]) == pytest.approx(RADIUS_M, rel=0.2)
    assert offset[2] < -60.0


def test_a_stabilised_camera_looks_down_in_a_turn(wide: tuple[Scenario, World]) -> None:
    run = Run(*wide).fly(6.0)
    exposure = max(run.exposures, key=lambda one: abs(one.state.roll_rad))
    assert abs(exposure.state.roll_rad) > math.radians(15.0)
    assert_allclose(exposure.ned_from_camera[:, 2], (0.0, 0.0, 1.0), atol=1e-9)
    # The top of the picture leads where the nose does.
    ahead = matrix_from_q(q_from_euler(0.0, 0.0, exposure.state.yaw_rad))[:, 0]
    assert_allclose(-exposure.ned_from_camera[:, 1], ahead, atol=1e-9)


def test_what_cannot_be_flown_is_refused(scenario: Scenario, world: World) -> None:
    with pytest.raises(ValidationError, match="cannot stand on a pad"):
        Scenario(vehicle=VehicleSection(type="fixed_wing"), pad=PadSection())
    with pytest.raises(SimulatorError, match="no route in this world has bends of 114 m"):
        Simulation(of_kind(scenario, "fixed_wing"), world, 7, 0)
