"""What is told of a place over the pad: signs, headings, and that nothing is told of nothing."""

import math
from dataclasses import replace

import numpy as np
import pytest

from backend.landing.messages import pad_body, place_fields, worst_std
from backend.navigation.setup import CameraProfile, MapFiles, NavigationSetup, Place, build_setup
from backend.schemas.landing import LandingBody
from estimator.landing.pad import tag_pad
from estimator.types import PadMode
from geodata.flight_meta import MapMeta
from tests.backend.flight_maker import CAMERA, GROUND_M, LAT_DEG, LON_DEG, state
from tests.backend.landing.relative import PAD, over_pad

T_US = 1_760_000_000_000_000
NO_AIDING = {"on": False, "form": None, "sending": False, "sent": 0, "reason": ""}


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
    LandingBody(vehicle_id="1", **fields, aiding=NO_AIDING)


def test_nothing_is_told_of_nothing() -> None:
    for state_now, setup_now, reason in (
        (None, None, "no pad is described"), (state(T_US), setup(pad=False), "no pad is described"),
        (None, setup(), ""), (state(T_US), setup(), ""),
    ):  # fmt: skip
        fields = place_fields(state_now, setup_now)
        assert (fields["reason"], fields["mode"], fields["height_m"], fields["seen"]) == (reason, None, None, None)
        LandingBody(vehicle_id="1", **fields, aiding=NO_AIDING)


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
