"""What is told of a place over the pad: signs, headings, and that nothing is told of nothing."""

import math
from dataclasses import replace

import numpy as np
import pytest

from backend.landing.messages import coast_left_s, pad_body, place_fields, worst_std
from backend.navigation.setup import CameraProfile, MapFiles, NavigationSetup, Place, build_setup
from backend.schemas.landing import LandingBody
from estimator.geometry.rotation import matrix_from_q, q_from_matrix
from estimator.landing.pad import tag_pad
from estimator.types import PadMode
from geodata.flight_meta import MapMeta
from tests.backend.flight_maker import CAMERA, GROUND_M, LAT_DEG, LON_DEG, state
from tests.backend.landing.relative import PAD, over_pad

T_US = 1_760_000_000_000_000
REST = {"aiding": {"on": False, "form": None, "sending": False, "sent": 0, "reason": ""}, "descent": None, "gaze": None}


def setup(*, pad: bool = True) -> NavigationSetup:
    profile = CameraProfile(CAMERA, MapMeta(ground_alt_amsl_m=GROUND_M), None)
    place = Place(math.radians(LAT_DEG), math.radians(LON_DEG), GROUND_M)
    return replace(build_setup(profile, MapFiles(None, None, None, None), place), pad=PAD if pad else None)


def test_the_pad_lies_where_the_vehicle_is_not() -> None:
    """8 m above, 0.6 m north and 0.4 m west of the pad, heading east: the pad is 0.4 m ahead and 0.6 m to the right."""
    fields = place_fields(over_pad(T_US, heading_deg=90.0, pad_heading_deg=30.0), setup())

    assert (fields["pad"], fields["mode"], fields["height_m"], fields["sink_m_s"]) == ("test pad", "tracking", 8.0, 0.5)
    assert (fields["north_m"], fields["east_m"], fields["speed_m_s"]) == (0.6, -0.4, 0.3)
    assert (fields["ahead_m"], fields["right_m"]) == pytest.approx((0.4, 0.6))
    assert fields["heading_on_pad_deg"] == pytest.approx(60.0)
    # The pad's x points to 30 degrees.
    sin, cos = math.sin(math.radians(30.0)), math.cos(math.radians(30.0))
    assert (fields["x_m"], fields["y_m"]) == pytest.approx((0.6 * cos - 0.4 * sin, -0.6 * sin - 0.4 * cos))
    assert (fields["std_horizontal_m"], fields["std_height_m"]) == pytest.approx((0.05, 0.02))
    assert fields["std_velocity_m_s"] == pytest.approx(0.04)


def test_the_outlines_are_where_the_camera_sees_them() -> None:
    """Camera of 300 pixels focal length, 8 m up, heading north: the first ring is 0.866 m north of the centre."""
    fields = place_fields(over_pad(T_US, frame_id=77), setup())
    seen = fields["seen"]

    assert (seen["frame_id"], seen["width_px"], seen["height_px"]) == (77, 320, 240)
    middle = np.mean(seen["outlines_px"][0], axis=0)
    ahead_m, right_m = math.sqrt(3.0) / 2.0 - 0.6, 0.4
    assert middle == pytest.approx((159.5 + 300 * right_m / 8.0, 119.5 - 300 * ahead_m / 8.0), abs=0.1)
    LandingBody(vehicle_id="1", **fields, **REST)


def test_the_outlines_by_the_estimate_are_those_of_a_picture_taken_now() -> None:
    """The camera that looks down with its top ahead, lever arm included, sees what was seen in the picture of then."""
    flown = over_pad(T_US, frame_id=77, heading_deg=25.0, pad_heading_deg=70.0)
    level = flown.q_ned_from_body
    down = q_from_matrix(matrix_from_q(level) @ np.array(((0.0, -1.0, 0.0), (1.0, 0.0, 0.0), (0.0, 0.0, 1.0))))
    fields = place_fields(replace(flown, q_ned_from_camera=down, lever_ned_m=np.zeros(3)), setup())
    shifted = place_fields(replace(flown, q_ned_from_camera=down, lever_ned_m=np.array((0.0, 0.0, 2.0))), setup())

    assert np.array(fields["outlines_px"]) == pytest.approx(np.array(fields["seen"]["outlines_px"]), abs=0.11)
    # A lens two metres lower is six metres up instead of eight: larger by a third.
    width = [np.ptp(np.array(told["outlines_px"])[0, :, 0]) for told in (fields, shifted)]
    assert width[1] / width[0] == pytest.approx(8.0 / 6.0, rel=0.02)


def test_nothing_is_told_of_nothing() -> None:
    for state_now, setup_now, reason in (
        (None, None, "no pad is described"), (state(T_US), setup(pad=False), "no pad is described"),
        (None, setup(), ""), (state(T_US), setup(), ""),
    ):  # fmt: skip
        fields = place_fields(state_now, setup_now)
        assert (fields["reason"], fields["mode"], fields["height_m"], fields["seen"]) == (reason, None, None, None)
        LandingBody(vehicle_id="1", **fields, **REST)


def test_a_pad_that_was_never_seen_has_no_place() -> None:
    unknown = (math.nan, math.nan, math.nan)
    flown = over_pad(T_US, unknown, mode=PadMode.SEARCHING, age_s=math.inf, reason="nothing", std_m=unknown)
    fields = place_fields(flown, setup())

    assert (fields["mode"], fields["reason"], fields["age_s"]) == ("searching", "nothing", None)
    assert all(fields[name] is None for name in ("north_m", "height_m", "ahead_m", "x_m", "std_horizontal_m"))


def test_a_sigma_is_along_the_worst_direction() -> None:
    turn = np.array(((0.6, -0.8), (0.8, 0.6)))

    assert worst_std(turn @ np.diag((0.04, 0.0025)) @ turn.T) == pytest.approx(0.2)


def test_the_page_is_told_what_to_draw() -> None:
    circles, tags = pad_body(PAD), pad_body(tag_pad("board", 0.9))

    assert (circles.kind, len(circles.rings), circles.tags) == ("circles", 12, [])
    assert circles.rings[0].x_m == pytest.approx(math.sqrt(3.0) / 2.0)
    assert (tags.kind, tags.rings, len(tags.tags)) == ("tags", [], 7)
    assert tags.description["schema"] == "pilotage.pad/1"


def coasting(age_s: float, std_m: float, **changes: PadMode) -> float:
    state_now = over_pad(T_US, std_m=(std_m, 0.01, 0.01), age_s=age_s, mode=changes.get("mode", PadMode.DEAD_RECKONING))
    assert state_now.pad is not None
    return coast_left_s(state_now.pad, landing_std_m=0.3)


def test_the_time_left_of_dead_reckoning_runs_down_as_the_error_grows() -> None:
    """Velocity known to 4 cm/s and place to 5 cm when the pad went out of sight: sigma reaches 0.3 m after 7.4 s."""
    whole_s = math.sqrt(0.3**2 - 0.05**2) / 0.04
    for age_s in (0.0, 2.0, 5.0, whole_s):
        assert coasting(age_s, math.hypot(0.05, 0.04 * age_s)) == pytest.approx(whole_s - age_s, abs=1e-6)
    assert whole_s == pytest.approx(7.4, abs=0.05)


def test_no_time_is_left_of_what_is_lost_and_none_runs_while_the_pad_is_seen() -> None:
    assert coasting(9.0, 0.4) == 0.0
    assert coasting(1.0, 0.1, mode=PadMode.LOST) == 0.0
    assert math.isnan(coasting(0.1, 0.05, mode=PadMode.TRACKING))
