"""The operator's commands in MAVLink's words."""

from __future__ import annotations

import math

from backend.errors import CommandRefusedError, InvalidRequestError
from backend.fleet.feed import FrameIdentity
from backend.fleet.vehicle import LiveVehicle
from backend.link.commands import CommandStep
from backend.link.events import Autopilot, VehicleType
from backend.link.link import VehicleLink
from backend.link.modes import mode_numbers
from backend.schemas.vehicles import CommandBody

NAV_RETURN_TO_LAUNCH = 20
NAV_LAND = 21
NAV_TAKEOFF = 22
DO_ORBIT = 34
DO_SET_MODE = 176
DO_REPOSITION = 192
MISSION_START = 300
COMPONENT_ARM_DISARM = 400
INJECT_FAILURE = 420
CAMERA_TRACK_POINT = 2004
CAMERA_STOP_TRACKING = 2010

CUSTOM_MODE_ENABLED = 1
FRAME_GLOBAL_INT = 5
FRAME_GLOBAL_RELATIVE_ALT = 6
REPOSITION_CHANGES_MODE = 1
FAILURE_UNIT_GPS = 4
FAILURE_OF_WORD = {"ok": 0, "off": 1}
DEFAULT_TAKEOFF_M = 30.0
# Of the picture's width: what a person means by a point.
TRACK_RADIUS = 0.02

NAN = math.nan


def send_command(link: VehicleLink, vehicle: LiveVehicle, body: CommandBody, frame: FrameIdentity | None = None) -> int:
    """Queue a command on a link; returns the link's id of it. ``frame`` is the one that the body names.

    Raises
    ------
    CommandRefusedError
        The vehicle cannot be given this command.
    InvalidRequestError
        The command lacks what it needs.
    """
    try:
        if body.command in ("track_point", "track_stop"):
            return link.command_tracker(vehicle.system_id, tracking_steps(body, frame))
        home_amsl_m = None if vehicle.home is None else vehicle.home.alt_amsl_m
        return link.command(vehicle.system_id, steps_of(body, vehicle.autopilot, vehicle.vehicle_type, home_amsl_m))
    except LookupError as error:
        raise CommandRefusedError(str(error)) from None


def tracking_steps(body: CommandBody, frame: FrameIdentity | None) -> list[CommandStep]:
    """What a camera is told that tracks points itself: places in its picture from 0 to 1, from the top left.

    Raises
    ------
    InvalidRequestError
        The point or its frame is missing, or the point lies outside the frame.
    """
    if body.command == "track_stop":
        return [CommandStep(CAMERA_STOP_TRACKING)]
    if frame is None or body.u_px is None or body.v_px is None:
        raise InvalidRequestError("track_point needs frame_id, u_px and v_px")
    frame.check_shows(body.u_px, body.v_px)
    x, y = (body.u_px + 0.5) / frame.width_px, (body.v_px + 0.5) / frame.height_px
    return [CommandStep(CAMERA_TRACK_POINT, (x, y, TRACK_RADIUS))]


def steps_of(  # noqa: PLR0911, PLR0912  one case for each command reads best
    body: CommandBody, autopilot: Autopilot, kind: VehicleType, home_alt_amsl_m: float | None = None
) -> list[CommandStep]:
    """The MAVLink commands of one operator's command, in order.

    Raises
    ------
    CommandRefusedError
        This kind of vehicle has no such mode, or its home's height (``home_alt_amsl_m``) has to be known and is not.
    InvalidRequestError
        The command lacks what it needs.
    """
    match body.command:
        case "track_point" | "track_stop":
            raise InvalidRequestError(f"{body.command} is for a camera, not for the vehicle")
        case "arm":
            return [CommandStep(COMPONENT_ARM_DISARM, (1.0,))]
        case "disarm":
            return [CommandStep(COMPONENT_ARM_DISARM, (0.0,))]
        case "takeoff":
            height_m = DEFAULT_TAKEOFF_M if body.alt_rel_m is None else body.alt_rel_m
            takeoff = CommandStep(NAV_TAKEOFF, (0.0, 0.0, 0.0, NAN, 0.0, 0.0, height_m))
            return [_mode("GUIDED", autopilot, kind), takeoff] if autopilot is Autopilot.ARDUPILOT else [takeoff]
        case "hold":
            return [_mode("AUTO LOITER" if autopilot is Autopilot.PX4 else "LOITER", autopilot, kind)]
        case "return":
            return [CommandStep(NAV_RETURN_TO_LAUNCH)]
        case "land":
            return [CommandStep(NAV_LAND, (0.0, 0.0, 0.0, NAN, 0.0, 0.0, 0.0))]
        case "goto":
            if body.lat_deg is None or body.lon_deg is None or body.alt_rel_m is None:
                raise InvalidRequestError("goto needs lat_deg, lon_deg and alt_rel_m")
            place = (body.lat_deg * 1e7, body.lon_deg * 1e7, body.alt_rel_m)
            params = (-1.0, float(REPOSITION_CHANGES_MODE), 0.0, NAN, *place)
            return [CommandStep(DO_REPOSITION, params, FRAME_GLOBAL_RELATIVE_ALT)]
        case "orbit":
            return [_orbit(body, autopilot, home_alt_amsl_m)]
        case "start_mission":
            return [CommandStep(MISSION_START)]
        case "inject_failure":
            if body.unit != "gps" or body.failure is None:
                raise InvalidRequestError("inject_failure needs unit 'gps' and failure 'off' or 'ok'")
            return [CommandStep(INJECT_FAILURE, (float(FAILURE_UNIT_GPS), float(FAILURE_OF_WORD[body.failure])))]


def _orbit(body: CommandBody, autopilot: Autopilot, home_alt_amsl_m: float | None) -> CommandStep:
    """DO_ORBIT with the vehicle's own speed, its nose towards the centre, round and round."""
    if body.lat_deg is None or body.lon_deg is None or body.alt_rel_m is None or body.radius_m is None:
        raise InvalidRequestError("orbit needs lat_deg, lon_deg, alt_rel_m and radius_m")
    radius_m = -body.radius_m if body.clockwise is False else body.radius_m
    alt_m, frame = body.alt_rel_m, FRAME_GLOBAL_RELATIVE_ALT
    if autopilot is Autopilot.PX4:
        # PX4 takes the height of an orbit as above mean sea level, whatever the frame says.
        if home_alt_amsl_m is None:
            raise CommandRefusedError("the vehicle has not said how high its home lies, so that no height can be given")
        alt_m, frame = home_alt_amsl_m + body.alt_rel_m, FRAME_GLOBAL_INT
    return CommandStep(DO_ORBIT, (radius_m, NAN, 0.0, 0.0, body.lat_deg * 1e7, body.lon_deg * 1e7, alt_m), frame)


def take_over(link: VehicleLink, vehicle: LiveVehicle, mode: str) -> None:
    """Ask a vehicle for the mode in which it takes velocities; CommandRefusedError as ``send_command``."""
    try:
        link.command(vehicle.system_id, [_mode(mode, vehicle.autopilot, vehicle.vehicle_type)])
    except LookupError as error:
        raise CommandRefusedError(str(error)) from None


def _mode(name: str, autopilot: Autopilot, kind: VehicleType) -> CommandStep:
    try:
        numbers = mode_numbers(autopilot, kind, name)
    except ValueError as error:
        raise CommandRefusedError(str(error)) from None
    return CommandStep(DO_SET_MODE, (float(CUSTOM_MODE_ENABLED), float(numbers.main), float(numbers.sub)))
