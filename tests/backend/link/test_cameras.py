"""Cameras that track points themselves: found by their heartbeat, asked for what they can, told where to look."""

import pytest

from backend.link.commands import CommandStep
from backend.link.events import CommandResult, CommandStatus
from backend.link.link import NoTrackerError, VehicleLink
from tests.backend.link.wire import INVALID, Sender, dialect, parsed

T0_US = 1_700_000_000_000_000
CAMERA_TYPE, CAMERA_ID = 30, 100
TRACK = CommandStep(2004, (0.25, 0.75, 0.02))


def information(flags: int) -> object:
    return dialect.MAVLink_camera_information_message(
        1000, [0] * 32, [0] * 32, 1, 5.0, 6.0, 4.0, 640, 480, 0, flags, 0, b"", 0, 0
    )


def link_with(camera: Sender, flags: int | None) -> VehicleLink:
    """A link that has heard an autopilot and a camera; that says what it can when there are flags."""
    link = VehicleLink(rates_hz={})
    link.receive(Sender().heartbeat(), T0_US)
    link.receive(camera.heartbeat(CAMERA_TYPE, INVALID), T0_US)
    link.tick(T0_US)
    if flags is not None:
        link.receive(camera.pack(information(flags)), T0_US)
    return link


def to_camera(link: VehicleLink) -> list[object]:
    sent = parsed(link.data_to_send())
    return [m for m in sent if getattr(m, "target_component", None) == CAMERA_ID]


def test_a_camera_is_asked_what_it_can() -> None:
    (asked,) = to_camera(link_with(Sender(1, CAMERA_ID), None))

    assert (asked.command, asked.param1) == (512, 259)  # MAV_CMD_REQUEST_MESSAGE, CAMERA_INFORMATION


def test_a_camera_that_tracks_points_is_told_one_and_its_answer_is_heard() -> None:
    camera = Sender(1, CAMERA_ID)
    link = link_with(camera, dialect.CAMERA_CAP_FLAGS_HAS_TRACKING_POINT | dialect.CAMERA_CAP_FLAGS_CAPTURE_VIDEO)
    link.data_to_send()

    command_id = link.command_tracker(1, [TRACK])
    link.tick(T0_US + 1)
    (told,) = to_camera(link)
    events = link.receive(camera.ack(2004, 0), T0_US + 2)

    assert told.get_type() == "COMMAND_LONG"
    assert (told.command, told.param1, told.param2) == (2004, 0.25, 0.75)
    assert told.param3 == pytest.approx(0.02)
    (result,) = [event for event in events if isinstance(event, CommandResult)]
    assert (result.command_id, result.status) == (command_id, CommandStatus.ACCEPTED)


def test_an_autopilot_that_answers_for_its_camera_is_told_instead() -> None:
    autopilot = Sender()
    link = VehicleLink(rates_hz={})
    link.receive(autopilot.heartbeat(), T0_US)
    link.receive(autopilot.pack(information(dialect.CAMERA_CAP_FLAGS_HAS_TRACKING_POINT)), T0_US)

    command_id = link.command_tracker(1, [TRACK])
    link.tick(T0_US + 1)
    (told,) = [m for m in parsed(link.data_to_send()) if m.get_type() == "COMMAND_LONG"]
    events = link.receive(autopilot.ack(2004, 2), T0_US + 2)

    assert (told.target_component, told.command) == (1, 2004)
    assert [(e.command_id, e.status) for e in events] == [(command_id, CommandStatus.DENIED)]


def test_a_silent_camera_times_out() -> None:
    link = link_with(Sender(1, CAMERA_ID), dialect.CAMERA_CAP_FLAGS_HAS_TRACKING_POINT)
    command_id = link.command_tracker(1, [TRACK])
    results = []
    for step in range(20):
        link.receive(Sender().heartbeat(), T0_US + step * 1_000_000)
        results += [e for e in link.tick(T0_US + step * 1_000_000) if isinstance(e, CommandResult)]

    # Nobody hears of the station's own question.
    assert [(result.command_id, result.status) for result in results] == [(command_id, CommandStatus.TIMEOUT)]


@pytest.mark.parametrize("flags", [None, 0, dialect.CAMERA_CAP_FLAGS_HAS_TRACKING_RECTANGLE])
def test_a_camera_that_does_not_say_so_is_not_told(flags: int | None) -> None:
    with pytest.raises(NoTrackerError, match="CAMERA_INFORMATION"):
        link_with(Sender(1, CAMERA_ID), flags).command_tracker(1, [TRACK])
