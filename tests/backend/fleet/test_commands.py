"""Operator's commands in MAVLink's words."""

import math

import pytest
from pydantic import ValidationError

from backend.errors import CommandRefusedError, InvalidRequestError
from backend.fleet.commands import steps_of, tracking_steps
from backend.fleet.feed import FrameIdentity
from backend.link.events import Autopilot, VehicleType
from backend.schemas.vehicles import CommandBody

HELI = (Autopilot.ARDUPILOT, VehicleType.HELICOPTER)


@pytest.mark.parametrize(
    ("command", "numbers"),
    [
        ("arm", [400]),
        ("disarm", [400]),
        ("takeoff", [176, 22]),
        ("hold", [176]),
        ("return", [20]),
        ("land", [21]),
        ("start_mission", [300]),
    ],
)
def test_commands_of_an_ardupilot_helicopter(command: str, numbers: list[int]) -> None:
    steps = steps_of(CommandBody.model_validate({"command": command}), *HELI)

    assert [step.command for step in steps] == numbers


def test_arming_and_disarming_differ() -> None:
    arm, disarm = (steps_of(CommandBody.model_validate({"command": c}), *HELI)[0] for c in ("arm", "disarm"))

    assert (arm.params[0], disarm.params[0]) == (1.0, 0.0)


def test_goto_is_an_integer_command_relative_to_home() -> None:
    body = CommandBody(command="goto", lat_deg=47.1234567, lon_deg=-8.5, alt_rel_m=60.0)
    (step,) = steps_of(body, *HELI)

    assert (step.command, step.frame) == (192, 6)
    assert [round(value) for value in step.params[4:6]] == [471234567, -85000000]
    assert step.params[6] == 60.0
    assert math.isnan(step.params[3])


def test_hold_of_px4_and_of_ardupilot_are_their_own_modes() -> None:
    body = CommandBody(command="hold")
    (ardupilot,) = steps_of(body, *HELI)
    (px4,) = steps_of(body, Autopilot.PX4, VehicleType.MULTIROTOR)

    assert ardupilot.params[:2] == (1.0, 5.0)  # COPTER_MODE_LOITER
    assert px4.params[:3] == (1.0, 4.0, 3.0)  # main mode AUTO, sub mode LOITER


def test_an_orbit_has_its_side_in_the_sign_and_its_height_as_the_autopilot_takes_it() -> None:
    body = CommandBody(command="orbit", lat_deg=47.5, lon_deg=8.5, alt_rel_m=60.0, radius_m=40.0, clockwise=False)
    (ardupilot,) = steps_of(body, *HELI)
    (px4,) = steps_of(body, Autopilot.PX4, VehicleType.MULTIROTOR, home_alt_amsl_m=450.0)

    assert (ardupilot.command, ardupilot.frame, ardupilot.params[0], ardupilot.params[6]) == (34, 6, -40.0, 60.0)
    assert (px4.command, px4.frame, px4.params[0], px4.params[6]) == (34, 5, -40.0, 510.0)
    assert [round(value) for value in px4.params[4:6]] == [475000000, 85000000]
    with pytest.raises(CommandRefusedError, match="how high its home lies"):
        steps_of(body, Autopilot.PX4, VehicleType.MULTIROTOR)


@pytest.mark.parametrize("radius_m", [4.9, 2000.1, math.nan, math.inf])
def test_orbits_that_nobody_flies_are_refused(radius_m: float) -> None:
    with pytest.raises(ValidationError):
        CommandBody(command="orbit", lat_deg=47.5, lon_deg=8.5, alt_rel_m=60.0, radius_m=radius_m)


@pytest.mark.parametrize(
    "body",
    [
        {"command": "orbit", "lat_deg": 1, "lon_deg": 2, "alt_rel_m": 50},
        {"command": "goto", "lat_deg": 1, "lon_deg": 2},
        {"command": "inject_failure", "unit": "gps"},
    ],
)
def test_incomplete_commands_are_refused(body: dict[str, object]) -> None:
    with pytest.raises(InvalidRequestError):
        steps_of(CommandBody.model_validate(body), *HELI)


def test_a_point_to_track_is_a_share_of_the_picture_from_its_top_left() -> None:
    frame = FrameIdentity(3, 0, 640, 480)
    (step,) = tracking_steps(CommandBody(command="track_point", frame_id=3, u_px=159.5, v_px=359.5), frame)
    (stop,) = tracking_steps(CommandBody(command="track_stop"), None)

    assert (step.command, step.params[:2], step.frame) == (2004, (0.25, 0.75), None)
    assert stop.command == 2010


@pytest.mark.parametrize(("u_px", "v_px"), [(640.0, 5.0), (5.0, -0.6), (None, 5.0)])
def test_a_point_outside_the_picture_is_refused(u_px: float | None, v_px: float) -> None:
    body = CommandBody(command="track_point", frame_id=3, u_px=u_px, v_px=v_px)
    with pytest.raises(InvalidRequestError):
        tracking_steps(body, FrameIdentity(3, 0, 640, 480))
    with pytest.raises(InvalidRequestError, match="needs frame_id"):
        tracking_steps(body, None)
