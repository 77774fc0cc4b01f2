"""LANDING_TARGET against two landings of an ArduPilot copter on it, recorded with what it was told and where it was."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
import pytest
from numpy.testing import assert_allclose
from pymavlink import mavutil

from backend.link.events import Autopilot, TelemetryLocalPosition
from backend.link.landing_target import TargetForm, form_for, target_in_body, target_in_local, velocity_set_point
from estimator.geometry.rotation import matrix_from_q, q_from_euler
from estimator.types import Float
from tests.backend.link.wire import dialect
from tests.shared_data import shared_data

T_US = 1_760_000_000_000_000
# Where the recording placed the target, metres north, east and down of home: the mean over both logs of SIM_STATE plus
# the recorded target turned by SIM_STATE's attitude, computed once with nothing of this project; it scatters by 8 um.
PAD_NED_M = np.array((4.044548, -2.962339, 0.080000))
# MAVLink's degrees times 1e7 on a sphere of the recorder's: metres per degree.
METRES_PER_DEG = 111_319.5
# Half a unit of lat_int or of the home's latitude is 6 mm, and the float altitude at 500 m is good to 30 um; what
# made the log worked in the same units, so that less than a millimetre is left.
PLACE_TOLERANCE_M = 0.001
NO_TURN = np.array((1.0, 0.0, 0.0, 0.0))


@dataclass(frozen=True)
class Told:
    """One recorded LANDING_TARGET, its bytes, and the true attitude and place as last heard before it."""

    message: Any
    packet: bytes
    q_ned_from_body: Float
    vehicle_from_pad_ned_m: Float


@cache
def recorded(name: str) -> tuple[Told, ...]:
    return tuple(_read(name))


def _read(name: str) -> Iterator[Told]:
    log = mavutil.mavlink_connection(str(shared_data(f"telemetry/{name}.tlog")), dialect="ardupilotmega")
    home = state = None
    while (message := log.recv_match(type=["HOME_POSITION", "SIM_STATE", "LANDING_TARGET"])) is not None:
        if message.get_type() == "HOME_POSITION":
            home = message
        elif message.get_type() == "SIM_STATE":
            state = message
        else:
            assert home is not None
            assert state is not None
            lat_deg = home.latitude * 1e-7
            own = np.array((
                (state.lat_int * 1e-7 - lat_deg) * METRES_PER_DEG,
                (state.lon_int - home.longitude) * 1e-7 * METRES_PER_DEG * np.cos(np.radians(lat_deg)),
                home.altitude * 1e-3 - state.alt,
            ))  # fmt: skip
            q = q_from_euler(state.roll, state.pitch, state.yaw)
            yield Told(message, bytes(message.get_msgbuf()), q, own - PAD_NED_M)


def packed(message: Any, like: Any) -> bytes:
    """The message as the recorded one's sender would have put it on the wire."""
    sender = dialect.MAVLink(None, srcSystem=like.get_srcSystem(), srcComponent=like.get_srcComponent())
    sender.seq = like.get_seq()
    return bytes(message.pack(sender))


def test_from_the_recorded_place_the_same_bytes_come() -> None:
    """The place is given to 32 bits in the log, so a distance from it may round to the neighbouring number."""
    log = recorded("precland_pos")
    for told in log:
        sent = told.message
        ours = target_in_body(sent.time_usec, NO_TURN, -np.array((sent.x, sent.y, sent.z)))
        assert ours.distance == pytest.approx(sent.distance, rel=2.0**-23)
        ours.distance = sent.distance
        assert packed(ours, sent) == told.packet

    assert len(log) == 446


def test_from_attitude_and_place_the_recorded_target_comes() -> None:
    log = recorded("precland_pos")
    ours = [target_in_body(T_US, told.q_ned_from_body, told.vehicle_from_pad_ned_m) for told in log]

    assert_allclose(
        [(m.x, m.y, m.z) for m in ours], [(t.message.x, t.message.y, t.message.z) for t in log], atol=PLACE_TOLERANCE_M
    )
    # It stood forward, right and below at some time, so that no sign and no exchange of axes passes.
    assert np.ptp([(t.message.x, t.message.y) for t in log], axis=0).min() > 2.0


def test_the_angles_of_the_other_recording_are_those_of_our_place() -> None:
    """Said as angles: ``angle_x`` to the right of straight down and ``angle_y`` backwards."""
    log = recorded("precland_angle")
    assert {told.message.position_valid for told in log} == {0}
    high = [told for told in log if told.message.distance > 2.0]
    assert len(high) > 300
    for told in high:
        ours = target_in_body(T_US, told.q_ned_from_body, told.vehicle_from_pad_ned_m)
        tolerance_rad = PLACE_TOLERANCE_M / told.message.distance
        assert np.arctan2(ours.y, ours.z) == pytest.approx(told.message.angle_x, abs=tolerance_rad)
        assert -np.arctan2(ours.x, ours.z) == pytest.approx(told.message.angle_y, abs=tolerance_rad)
        assert ours.distance == pytest.approx(told.message.distance, abs=PLACE_TOLERANCE_M)


def test_px4_is_told_a_place_in_its_own_frame() -> None:
    """Its own position may be far off: what counts is where the pad lies from it, carried on to the estimate's time."""
    own = TelemetryLocalPosition(T_US - 100_000, 1, (250.0, -40.0, -12.0), (1.0, -2.0, 0.5))
    q_ned_from_pad = q_from_euler(0.0, 0.0, np.radians(30.0))

    message = target_in_local(T_US, q_ned_from_pad, np.array((3.0, 4.0, -12.0)), own)

    assert (message.frame, message.type, message.position_valid) == (1, 2, 1)
    assert_allclose((message.x, message.y, message.z), (250.1 - 3.0, -40.2 - 4.0, -11.95 + 12.0), atol=1e-9)
    assert message.distance == pytest.approx(13.0)
    assert_allclose(matrix_from_q(np.array(message.q)), matrix_from_q(q_ned_from_pad), atol=1e-9)
    assert message.time_usec == T_US


def test_each_autopilot_has_its_form() -> None:
    assert form_for(Autopilot.ARDUPILOT) is TargetForm.BODY
    assert form_for(Autopilot.PX4) is TargetForm.LOCAL
    with pytest.raises(ValueError, match="takes no LANDING_TARGET"):
        form_for(Autopilot.OTHER)


def test_a_velocity_set_point_leaves_everything_else_alone() -> None:
    message = velocity_set_point(7, 1, np.array((0.5, -0.25, 1.0)))

    ignored = {
        name: bool(message.type_mask & getattr(dialect, f"POSITION_TARGET_TYPEMASK_{name}_IGNORE"))
        for name in ("X", "Y", "Z", "VX", "VY", "VZ", "AX", "AY", "AZ", "YAW", "YAW_RATE")
    }
    assert {name for name, so in ignored.items() if not so} == {"VX", "VY", "VZ"}
    assert not message.type_mask & dialect.POSITION_TARGET_TYPEMASK_FORCE_SET
    assert (message.target_system, message.target_component, message.coordinate_frame) == (7, 1, 1)
    assert (message.vx, message.vy, message.vz) == (0.5, -0.25, 1.0)
