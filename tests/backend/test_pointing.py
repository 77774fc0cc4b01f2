"""Heights above the ground and the choice of the ground, on rays whose answers plane geometry gives."""

import math
from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from backend.navigation.setup import NavigationSetup
from backend.pointing import Pointing, cut, ground_for, reaches_m
from estimator.errors import GeometryError
from estimator.geometry.camera import Camera, Mount
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import q_from_matrix
from estimator.ports import GroundModel
from estimator.types import NavigationState
from geodata.elevation import ElevationGrid, FlatGround
from tests.backend.flight_maker import state

CAMERA = Camera.from_hfov(640, 480, 1.0)
SETUP = NavigationSetup(
    CAMERA, Mount(0.0, -math.pi / 2, 0.0, np.zeros(3)), "fixed", True,
    LocalFrame(0.8, 0.1, 400.0), None, FlatGround(400.0), 2.0, None,
)  # fmt: skip
# 100 m above a plateau of 400 m that ends 150 m from its middle.
PLATEAU = ElevationGrid(np.full((61, 61), 400.0), 150.0, -150.0, 5.0)
CENTRE = (319.5, 239.5)


def looking_north(down_deg: float) -> NavigationState:
    """100 m above the frame's origin; the optical axis points north, so many degrees below the horizon."""
    down = math.radians(down_deg)
    axis = np.array([math.cos(down), 0.0, math.sin(down)])
    right = np.array([0.0, 1.0, 0.0])
    q = q_from_matrix(np.stack((right, np.cross(axis, right), axis), axis=-1))
    return replace(
        state(0), pos_ned_m=np.array([0.0, 0.0, -100.0]), alt_agl_m=100.0, q_ned_from_camera=q,
        cov_camera_pose=np.diag([1.0, 1.0, 1.0, 1e-4, 1e-4, 1e-4]),
    )  # fmt: skip


@pytest.mark.parametrize("ground", ["terrain", "flat"])
@pytest.mark.parametrize("height_m", [-10.0, 0.0, 25.0])
def test_what_stands_higher_lies_nearer(ground: str, height_m: float) -> None:
    pointing = Pointing(height_m, "flat" if ground == "flat" else "terrain")
    setup = replace(SETUP, ground=PLATEAU)

    seen = cut(looking_north(45.0), setup, CENTRE, pointing, ground_for(setup, pointing, looking_north(45.0)))

    assert_allclose(seen.found.pos_ned_m, [100.0 - height_m, 0.0, -height_m], atol=1e-3)
    assert seen.method == f"ray_{ground}"


def test_a_stated_height_and_level_ground_widen_the_ellipse() -> None:
    """One metre of the ground's height is one metre along the ray's ground track at 45 degrees."""
    setup, seen = replace(SETUP, ground=PLATEAU), looking_north(45.0)

    def north_var_m2(pointing: Pointing) -> float:
        return float(
            cut(seen, setup, CENTRE, pointing, ground_for(setup, pointing, looking_north(45.0))).found.cov_ned_m2[0, 0]
        )

    at_ground, flat = north_var_m2(Pointing()), north_var_m2(Pointing(ground="flat"))
    low, high = Pointing(20.0), Pointing(-20.0)

    assert_allclose(flat - at_ground, (0.03 * 100.0) ** 2, rtol=1e-3)
    # Nearer by 20 m the pose counts less; as much below, more: what is left is the stated height's own error, twice.
    raised = [cut(seen, setup, CENTRE, p, ground_for(setup, p, seen)) for p in (low, high)]
    assert_allclose([c.ground_std_m for c in raised], math.hypot(2.0, 2.0))


def test_beyond_the_elevation_model_only_chosen_flat_ground_gives_a_place() -> None:
    setup, seen = replace(SETUP, ground=PLATEAU), looking_north(20.0)  # the axis meets level ground after 275 m

    with pytest.raises(GeometryError, match="beyond the elevation model"):
        cut(seen, setup, CENTRE, Pointing(), ground_for(setup, Pointing(), seen))
    flat = Pointing(ground="flat")
    found = cut(seen, setup, CENTRE, flat, ground_for(setup, flat, seen))

    assert_allclose(found.found.pos_ned_m[0], 100.0 / math.tan(math.radians(20.0)), atol=1e-3)
    assert (found.ground_std_m, found.slope_std) == (2.0, 0.03)
    by_height_m = np.linalg.norm(found.found.height_way_m[:2]) * math.tan(math.radians(20.0))
    assert_allclose(by_height_m, math.hypot(2.0, 0.03 * 274.75), rtol=1e-3)


def test_level_ground_needs_a_height() -> None:
    """Beside the elevation model the vehicle's own height above ground serves; without that there is none."""
    flat, setup = Pointing(ground="flat"), replace(SETUP, ground=PLATEAU)
    away = replace(looking_north(45.0), pos_ned_m=np.array([900.0, 0.0, -100.0]), alt_agl_m=80.0)

    found = cut(away, setup, CENTRE, flat, ground_for(setup, flat, away)).found

    assert_allclose(found.pos_ned_m, [980.0, 0.0, -20.0], atol=1e-3)
    with pytest.raises(GeometryError, match="not known"):
        ground_for(setup, flat, replace(away, alt_agl_m=math.nan))


@pytest.mark.parametrize("ground", [PLATEAU, FlatGround(400.0)])
@pytest.mark.parametrize("pointing", [Pointing(), Pointing(5.0, "flat")])
def test_the_sky_stays_the_sky(ground: GroundModel, pointing: Pointing) -> None:
    setup, seen = replace(SETUP, ground=ground), looking_north(-10.0)

    with pytest.raises(GeometryError, match="horizon"):
        cut(seen, setup, CENTRE, pointing, ground_for(setup, pointing, seen))


def test_a_ray_is_not_followed_beneath_all_ground() -> None:
    setup, seen = replace(SETUP, ground=PLATEAU), looking_north(45.0)
    rays = np.array([[0.8, 0.0, 0.6], [1.0, 0.0, 0.0], [0.8, 0.0, -0.6], [0.9999, 0.0, 0.0141]])

    assert_allclose(reaches_m(seen, setup, rays, Pointing()), [250.0, 0.0, 0.0, 3000.0])
    # From below the highest ground a ray may meet it on its way up.
    valley = replace(seen, pos_ned_m=np.array([0.0, 0.0, 10.0]))
    assert_allclose(reaches_m(valley, setup, rays[2:3], Pointing()), [3000.0])
