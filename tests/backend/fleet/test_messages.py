"""What the stream says of a state: degrees, null where nothing is known, the footprint on the ground."""

from __future__ import annotations

import json
import math
from dataclasses import replace

import numpy as np
import orjson
from numpy.testing import assert_allclose

from backend.fleet.messages import camera_fields, fix_fields, footprint, state_fields
from backend.navigation.setup import CameraProfile, MapFiles, NavigationSetup, Place, build_setup
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import q_from_euler
from estimator.types import FixReport, OffsetSource, VideoOffset
from geodata.flight_meta import MapMeta
from tests.backend.flight_maker import CAMERA, GROUND_M, HEIGHT_M, LAT_DEG, LON_DEG, SIZE, T0_US, state


def setup() -> NavigationSetup:
    profile = CameraProfile(CAMERA, MapMeta(ground_alt_amsl_m=GROUND_M), None)
    here = Place(math.radians(LAT_DEG), math.radians(LON_DEG), GROUND_M)
    return build_setup(profile, MapFiles(None, None, None, None), here)


def test_the_footprint_is_what_the_camera_sees() -> None:
    """Straight down from 100 m with 300 px of focal length: 320 x 240 px are 106.7 m across and 80 m along."""
    corners = footprint(state(T0_US), setup())
    frame = LocalFrame(math.radians(LAT_DEG), math.radians(LON_DEG), GROUND_M)

    assert corners is not None
    ne = frame.ne_from_geodetic(*np.radians(np.array(corners)).T)
    half_e, half_n = 0.5 * SIZE[0] / 3.0, 0.5 * SIZE[1] / 3.0
    # flight_maker's camera looks down with the top of its picture to the east
    size = sorted([np.ptp(ne[:, 0]), np.ptp(ne[:, 1])])
    assert_allclose(size, [2 * half_n, 2 * half_e], atol=0.01)
    assert_allclose(ne.mean(axis=0), [0.0, 0.0], atol=0.01)
    assert HEIGHT_M == 100.0


def test_a_camera_that_sees_the_sky_or_has_no_ground_has_no_footprint() -> None:
    level = replace(state(T0_US), q_ned_from_camera=q_from_euler(0.0, math.pi / 2, 0.0))

    assert footprint(level, setup()) is None
    assert footprint(replace(state(T0_US), alt_agl_m=math.nan), setup()) is None
    assert footprint(replace(state(T0_US), alt_agl_m=-1.0), setup()) is None


def test_numbers_that_are_none_become_null() -> None:
    """JSON has neither NaN nor infinity; a browser would refuse the whole message."""
    unknown = replace(
        state(T0_US), alt_agl_m=math.nan, last_fix_age_s=math.inf, cov_pos_ned_m2=np.full((3, 3), np.nan),
        vel_ned_m_s=np.array([math.nan, 0.0, 0.0]),
    )  # fmt: skip
    fields = json.loads(orjson.dumps(state_fields(unknown, 1, False, setup())))

    nothing = ("alt_agl_m", "last_fix_age_s", "std_n_m", "cov_ne_m2", "ellipse95", "vn_m_s", "ground_speed_m_s")
    assert {name for name in nothing if fields[name] is not None} == set()
    assert (fields["footprint"], fields["ve_m_s"]) == (None, 0.0)


def test_a_heading_is_never_negative() -> None:
    assert state_fields(state(T0_US, yaw_rad=-0.1), 1, False, None)["heading_deg"] == 360.0 - math.degrees(0.1)


def test_a_refused_fix_has_no_place() -> None:
    frame = LocalFrame(math.radians(LAT_DEG), math.radians(LON_DEG), GROUND_M)
    refused = FixReport(
        t_us=T0_US, kind="registration", accepted=False, reason="flat", north_m=math.nan, east_m=math.nan,
        cov_ne_m2=np.full((2, 2), np.nan), score=math.nan, outlier_probability=1.0, heading_correction_rad=0.0,
        scale_correction=1.0, frame_id=3, elapsed_ms=4.0,
    )  # fmt: skip
    fields = fix_fields(refused, frame)
    accepted = fix_fields(replace(refused, accepted=True, north_m=0.0, east_m=0.0, cov_ne_m2=np.eye(2)), frame)

    assert (fields["lat_deg"], fields["lon_deg"], fields["cov_ne_m2"], fields["score"]) == (None, None, None, None)
    assert_allclose([accepted["lat_deg"], accepted["lon_deg"]], [LAT_DEG, LON_DEG], atol=1e-9)


def test_what_is_known_of_the_camera_is_told_in_degrees_and_seconds() -> None:
    found = VideoOffset(OffsetSource.FOUND, -0.1213, 0.004)
    with_camera = replace(
        state(T0_US), video_offset=found, boresight_rad=np.radians([0.3, -0.2, 0.1]),
        cov_boresight_rad2=np.diag(np.radians([0.1, 0.2, 0.4]) ** 2),
    )  # fmt: skip
    fields = camera_fields(with_camera, setup())

    assert fields["video_clock"] == {"source": "found", "time_offset_s": -0.1213, "std_s": 0.004, "reason": ""}
    assert_allclose(fields["boresight_deg"], [0.3, -0.2, 0.1])
    assert_allclose(fields["boresight_std_deg"], [0.1, 0.2, 0.4])
    assert json.loads(orjson.dumps(state_fields(with_camera, 1, False, setup())))["boresight_deg"] is not None


def test_what_nobody_knows_of_the_camera_is_null() -> None:
    searching = replace(state(T0_US), video_offset=VideoOffset(OffsetSource.SEARCHING, reason="too few pairs"))
    configured = replace(setup(), time_offset_s=0.25)
    given = camera_fields(replace(state(T0_US), video_offset=VideoOffset(OffsetSource.GIVEN)), configured)

    assert camera_fields(searching, setup())["video_clock"] == {
        "source": "searching", "time_offset_s": None, "std_s": None, "reason": "too few pairs",
    }  # fmt: skip
    assert given["video_clock"] == {"source": "given", "time_offset_s": 0.25, "std_s": None, "reason": ""}
    # no camera file: nothing is said of a camera that is a stand-in
    no_camera = camera_fields(searching, replace(setup(), has_camera=False))
    assert set(no_camera.values()) == {None}
    # a replayed estimate says nothing of either
    assert set(camera_fields(state(T0_US), setup()).values()) == {None}
