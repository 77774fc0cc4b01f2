import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from estimator.geometry.earth import (
    ecef_from_geodetic,
    ecef_from_ned_matrix,
    geodetic_from_ecef,
    gravity_m_s2,
    isa_pressure_alt_m,
    isa_pressure_pa,
    meridian_radius_m,
    transverse_radius_m,
)
from tests.authorities.stored import stored

latitudes = st.floats(-math.pi / 2, math.pi / 2)
longitudes = st.floats(-math.pi, math.pi)
heights = st.floats(-5000.0, 1e6)


def _places() -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    rows = stored("earth_pyproj")["ecef"]
    lat, lon = (np.radians([row[key] for row in rows]) for key in ("lat_deg", "lon_deg"))
    return lat, lon, np.array([row["alt_hae_m"] for row in rows]), np.array([row["ecef_m"] for row in rows])


def test_ecef_agrees_with_proj() -> None:
    lat, lon, alt, ecef = _places()

    assert_allclose(ecef_from_geodetic(lat, lon, alt), ecef, rtol=0.0, atol=1e-8)


def test_geodetic_agrees_with_proj() -> None:
    lat, lon, alt, ecef = _places()

    lat_found, lon_found, alt_found = geodetic_from_ecef(ecef)

    # 1e-15 rad is 6 nm; heights are differences of numbers of 6e6.
    assert_allclose(lat_found, lat, rtol=0.0, atol=1e-15)
    assert_allclose(alt_found, alt, rtol=0.0, atol=1e-8)
    off_axis = np.hypot(ecef[:, 0], ecef[:, 1]) > 1e-3
    turn = np.angle(np.exp(1j * (lon_found - lon)))
    assert_allclose(turn[off_axis], 0.0, atol=1e-14)


@given(latitudes, longitudes, heights)
def test_geodetic_there_and_back(lat: float, lon: float, alt: float) -> None:
    pos = ecef_from_geodetic(lat, lon, alt)

    assert_allclose(ecef_from_geodetic(*geodetic_from_ecef(pos)), pos, rtol=0.0, atol=1e-8)


def test_radii_agree_with_arcs_of_proj() -> None:
    for row in stored("earth_pyproj")["arcs"]:
        lat = math.radians(row["lat_deg"])

        assert meridian_radius_m(lat) * math.radians(row["span_deg"]) == pytest.approx(row["meridian_arc_m"], rel=3e-8)
        assert transverse_radius_m(lat) * math.cos(lat) == pytest.approx(row["parallel_radius_m"], rel=1e-14)


@given(latitudes, longitudes)
def test_ned_axes_are_a_rotation(lat: float, lon: float) -> None:
    ecef_from_ned = ecef_from_ned_matrix(lat, lon)

    assert_allclose(ecef_from_ned @ ecef_from_ned.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(ecef_from_ned) == pytest.approx(1.0)


@given(st.floats(-1.5, 1.5), longitudes)
def test_ned_axes_point_where_coordinates_grow(lat: float, lon: float) -> None:
    """Columns are the directions of growing latitude, growing longitude and falling height."""
    step = 1e-6
    here = ecef_from_geodetic(lat, lon, 0.0)
    north = (ecef_from_geodetic(lat + step, lon, 0.0) - here) / (step * meridian_radius_m(lat))
    east = (ecef_from_geodetic(lat, lon + step, 0.0) - here) / (step * transverse_radius_m(lat) * math.cos(lat))
    down = ecef_from_geodetic(lat, lon, -1.0) - here

    # The arcs curve by step / 2, more in the parallel of a high latitude.
    assert_allclose(ecef_from_ned_matrix(lat, lon), np.column_stack((north, east, down)), atol=2e-5)


def test_gravity_agrees_with_the_standard() -> None:
    for row in stored("earth_tables")["gravity_surface"]:
        # The printed constants carry ten decimals.
        assert gravity_m_s2(math.radians(row["lat_deg"]), 0.0) == pytest.approx(row["gravity_m_s2"], abs=2e-10)


def test_gravity_at_height_is_the_gradient_of_the_potential() -> None:
    for row in stored("earth_tables")["gravity_at_height"]:
        found = gravity_m_s2(math.radians(row["lat_deg"]), row["alt_m"])

        # The series leaves out f^2 in the slope with height, 1.2e-10 m/s2 per metre, and the third order, 4 g (h/R)^3.
        left_out = 1.2e-10 * abs(row["alt_m"]) + 1.2 * 4.0 * 9.8 * (abs(row["alt_m"]) / 6.37e6) ** 3
        assert found == pytest.approx(row["gravity_m_s2"], abs=left_out + 1e-9)


def test_pressure_agrees_with_the_printed_table() -> None:
    for row in stored("earth_tables")["pressure"]:
        # Six digits are printed.
        assert isa_pressure_pa(row["alt_m"]) == pytest.approx(row["pressure_pa"], rel=4e-6)
        # 4e-6 of the pressure is 3 cm of a scale height of 8 km.
        assert isa_pressure_alt_m(row["pressure_pa"]) == pytest.approx(row["alt_m"], abs=0.04)


@given(st.floats(-5000.0, 20000.0))
def test_pressure_altitude_there_and_back(alt: float) -> None:
    assert isa_pressure_alt_m(isa_pressure_pa(alt)) == pytest.approx(alt, abs=1e-7)


@pytest.mark.parametrize("pressure_pa", [0.0, -5.0, math.nan, math.inf, 1.0])
def test_no_altitude_for_pressures_outside_the_atmosphere(pressure_pa: float) -> None:
    assert math.isnan(isa_pressure_alt_m(pressure_pa))


def test_floats_give_floats_and_arrays_give_the_same_numbers() -> None:
    lat, alt = np.array((0.1, -0.9)), np.array((100.0, 3000.0))

    for function in (meridian_radius_m, transverse_radius_m):
        assert isinstance(function(0.1), float)
        assert_allclose(function(lat), [function(float(x)) for x in lat], rtol=1e-15)
    for function in (isa_pressure_pa, isa_pressure_alt_m):
        assert isinstance(function(30000.0 if function is isa_pressure_alt_m else 100.0), float)
    assert_allclose(gravity_m_s2(lat, alt), [gravity_m_s2(0.1, 100.0), gravity_m_s2(-0.9, 3000.0)], rtol=1e-15)


def test_shapes_broadcast_and_nan_stays_with_its_point() -> None:
    lat = np.array([[0.5], [np.nan]])
    pos = ecef_from_geodetic(lat, np.zeros(3), 10.0)

    assert pos.shape == (2, 3, 3)
    assert np.all(np.isfinite(pos[0]))
    assert np.all(np.isnan(pos[1]))
    lat_found, lon_found, alt_found = geodetic_from_ecef(pos)
    assert np.all(np.isfinite(lat_found[0]))
    assert np.all(np.isnan((lat_found[1], lon_found[1], alt_found[1])))
