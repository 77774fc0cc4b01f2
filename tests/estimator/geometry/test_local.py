import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from estimator.geometry.local import LocalFrame
from tests.authorities.stored import stored

FRAME = LocalFrame(math.radians(58.4108), math.radians(15.6214), 152.0)

frames = st.builds(LocalFrame, st.floats(-1.55, 1.55), st.floats(-math.pi, math.pi), st.floats(-400.0, 9000.0))
metres = st.floats(-20000.0, 20000.0)


def test_ned_agrees_with_proj() -> None:
    for row in stored("earth_pyproj")["topocentric"]:
        origin = row["origin"]
        frame = LocalFrame(math.radians(origin["lat_deg"]), math.radians(origin["lon_deg"]), origin["alt_hae_m"])
        lat, lon = math.radians(row["lat_deg"]), math.radians(row["lon_deg"])

        assert_allclose(frame.ned_from_geodetic(lat, lon, row["alt_hae_m"]), row["ned_m"], rtol=0.0, atol=1e-8)
        lat_found, lon_found, alt_found = frame.geodetic_from_ned(np.array(row["ned_m"]))
        assert_allclose((lat_found, lon_found), (lat, lon), rtol=0.0, atol=1e-12)
        assert_allclose(alt_found, row["alt_hae_m"], rtol=0.0, atol=1e-8)


@given(frames, metres, metres, st.floats(-5000.0, 5000.0))
def test_ned_there_and_back(frame: LocalFrame, north: float, east: float, down: float) -> None:
    ned = np.array((north, east, down))

    assert_allclose(frame.ned_from_geodetic(*frame.geodetic_from_ned(ned)), ned, rtol=0.0, atol=1e-8)


@given(frames, metres, metres)
def test_ne_there_and_back_at_the_height_of_the_origin(frame: LocalFrame, north: float, east: float) -> None:
    ne = np.array((north, east))

    assert_allclose(frame.ne_from_geodetic(*frame.geodetic_from_ne(ne)), ne, rtol=0.0, atol=1e-5)


def test_ne_is_the_horizontal_part_of_ned() -> None:
    lat, lon = FRAME.lat_rad + 0.001, FRAME.lon_rad - 0.002

    assert_allclose(FRAME.ne_from_geodetic(lat, lon), FRAME.ned_from_geodetic(lat, lon, 152.0)[:2], atol=0.0)


def test_ne_of_far_places() -> None:
    """The plane is not the Earth: at 2000 km the iteration still finds the place."""
    ne = np.array([[2.0e6, 0.0], [-1.0e6, 1.0e6]])

    assert_allclose(FRAME.ne_from_geodetic(*FRAME.geodetic_from_ne(ne)), ne, rtol=0.0, atol=1e-4)


def test_grids_keep_their_shape_and_nan_its_place() -> None:
    ne = np.zeros((4, 5, 2))
    ne[2, 3, 0] = np.nan

    lat, lon = FRAME.geodetic_from_ne(ne)

    assert lat.shape == lon.shape == (4, 5)
    assert np.isnan(lat).sum() == 1
    assert np.isnan(lat[2, 3])


def test_mean_sea_level_as_ellipsoid_changes_distances_less_than_said() -> None:
    """The same two places with heights 107 m apart in datum: the largest height of the geoid."""
    ellipsoid, sea = FRAME, LocalFrame(FRAME.lat_rad, FRAME.lon_rad, FRAME.alt_m - 107.0)
    lat, lon = FRAME.lat_rad + 0.002, FRAME.lon_rad + 0.002

    there, shifted = ellipsoid.ne_from_geodetic(lat, lon), sea.ne_from_geodetic(lat, lon)

    assert np.linalg.norm(there - shifted) < 2e-5 * np.linalg.norm(there)


@pytest.mark.parametrize(
    ("lat", "lon", "alt"), [(58.0, 15.0, 0.0), (math.nan, 0.0, 0.0), (0.0, math.inf, 0.0), (0.0, 0.0, math.nan)]
)
def test_refuses_an_impossible_origin(lat: float, lon: float, alt: float) -> None:
    with pytest.raises(ValueError, match="local frame"):
        LocalFrame(lat, lon, alt)


def test_frames_compare_by_origin() -> None:
    assert LocalFrame(0.1, 0.2, 3.0) == LocalFrame(0.1, 0.2, 3.0)
    assert LocalFrame(0.1, 0.2, 3.0) != LocalFrame(0.1, 0.2, 4.0)
    assert hash(LocalFrame(0.1, 0.2, 3.0)) == hash(LocalFrame(0.1, 0.2, 3.0))
