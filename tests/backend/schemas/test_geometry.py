"""Targets as GeoJSON: order of coordinates, uncertainty, and numbers that are none."""

from __future__ import annotations

import math

import pytest
from numpy.testing import assert_allclose
from pydantic import ValidationError

from backend.schemas.geometry import NewTarget, TargetPatch, collection_of_targets, feature_of_target
from backend.store.targets import Target


def target(**changes: object) -> Target:
    facts: dict[str, object] = {
        "id": "a", "name": "Bridge", "lat_deg": 47.0, "lon_deg": 8.0, "alt_amsl_m": 400.0, "method": "ray_terrain",
        "created_unix_us": 1, "updated_unix_us": 2,
    }  # fmt: skip
    return Target(**{**facts, **changes})  # type: ignore[arg-type]


def test_longitude_comes_first_in_geometry_and_height_last() -> None:
    assert feature_of_target(target()).geometry.coordinates == [8.0, 47.0, 400.0]
    assert feature_of_target(target(alt_amsl_m=None)).geometry.coordinates == [8.0, 47.0]


def test_the_ellipse_lies_along_the_larger_error() -> None:
    """3 m to the north-east and 1 m across: azimuth 45 degrees, semi-axes of 2.4477 sigma."""
    major, minor = 3.0**2, 1.0**2
    mean, half = 0.5 * (major + minor), 0.5 * (major - minor)
    about = feature_of_target(target(var_n_m2=mean, var_e_m2=mean, cov_ne_m2=half, var_d_m2=4.0)).properties

    assert about.ellipse95 is not None
    assert_allclose(about.ellipse95.azimuth_deg, 45.0, atol=1e-6)
    assert_allclose([about.ellipse95.semi_major_m, about.ellipse95.semi_minor_m], [7.343, 2.4477], atol=1e-3)
    assert about.std_d_m == 2.0
    assert about.std_n_m == about.std_e_m == pytest.approx(math.sqrt(mean))
    assert about.ce90_m is not None
    assert 1.645 * 3.0 < about.ce90_m < 2.146 * 3.0


def test_what_nobody_knows_is_null() -> None:
    about = feature_of_target(target(var_n_m2=1.0, var_e_m2=1.0)).properties  # without their covariance

    assert (about.ellipse95, about.ce90_m, about.std_d_m) == (None, None, None)
    assert collection_of_targets([]).model_dump() == {"type": "FeatureCollection", "features": []}


def test_a_place_comes_in_the_words_of_map_readers() -> None:
    about = feature_of_target(target(lat_deg=47.3769, lon_deg=8.5417)).properties

    assert (about.mgrs, about.utm, about.dms) == (
        "32TMT6540347150", "32T 465403 5247151", "47°22′36.84″N 008°32′30.12″E",
    )  # fmt: skip
    assert feature_of_target(target(lat_deg=89.0)).properties.utm is None


@pytest.mark.parametrize(
    "body",
    [
        {"lat_deg": 90.1, "lon_deg": 0}, {"lat_deg": 0, "lon_deg": -180.1}, {"lat_deg": float("nan"), "lon_deg": 0},
        {"u_px": float("inf"), "v_px": 1}, {"frame_id": -1}, {"name": "x" * 201}, {"alt_amsl_m": 30_000},
    ],
)  # fmt: skip
def test_numbers_off_the_earth_are_refused(body: dict[str, object]) -> None:
    with pytest.raises(ValidationError):
        NewTarget(**body)  # type: ignore[arg-type]


def test_a_patch_may_not_take_the_name_away() -> None:
    with pytest.raises(ValidationError):
        TargetPatch(name="")
