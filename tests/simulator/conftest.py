"""A small world and a small scenario, made once for all tests of the simulator."""

from __future__ import annotations

from pathlib import Path

import pytest

from simulator.scenario import CameraSection, FlightSection, Scenario, WorldSection
from simulator.world.world import World, world_for


@pytest.fixture(scope="session")
def scenario() -> Scenario:
    """Low and slow over a small world, with a small picture."""
    return Scenario(
        name="small",
        duration_s=6.0,
        gps_denied_s=((2.0, 5.0),),
        world=WorldSection(half_size_m=180.0, gsd_m=0.25),
        camera=CameraSection(width_px=320, height_px=240),
        flight=FlightSection(height_agl_m=(70.0, 80.0), waypoints=6, hover_stops=1),
    )


@pytest.fixture(scope="session")
def world_cache(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("worlds")


@pytest.fixture(scope="session")
def world(scenario: Scenario, world_cache: Path) -> World:
    return world_for(scenario.world.spec(7), world_cache)
