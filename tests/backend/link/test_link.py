import random
from typing import Any

import pytest
from pymavlink.dialects.v20 import ardupilotmega as dialect

from backend.link.commands import CommandStep
from backend.link.events import (
    Autopilot,
    CommandResult,
    CommandStatus,
    LinkEvent,
    LinkStats,
    SampleEvent,
    StatusText,
    TelemetryHeartbeat,
    VehicleAppeared,
    VehicleLost,
    VehicleRebooted,
    VehicleReturned,
    VehicleType,
)
from backend.link.framing import RawPacket
from backend.link.link import UnknownVehicleError, VehicleLink
from estimator.types import AttitudeSample
from tests.backend.link.wire import FIXED_WING, GCS, INVALID, Sender, parsed

T_US = 1_760_000_000_000_000
SECOND_US = 1_000_000


def _sent(link: VehicleLink, kind: str) -> list[Any]:
    return [message for message in parsed(link.data_to_send()) if message.get_type() == kind]


def _of(events: list[LinkEvent], kind: type) -> list[Any]:
    return [event for event in events if isinstance(event, kind)]


def _link_with_vehicle(sender: Sender | None = None, **options: Any) -> VehicleLink:
    link = VehicleLink(**options)
    link.receive((sender or Sender()).heartbeat(), T_US)
    return link


def test_a_vehicle_appears_with_its_first_heartbeat() -> None:
    link = VehicleLink()
    sender = Sender(3)
    assert link.receive(sender.attitude(1000), T_US) == []

    appeared, heartbeat = link.receive(sender.heartbeat(), T_US)
    assert appeared == VehicleAppeared(T_US, 3, 1, Autopilot.ARDUPILOT, VehicleType.HELICOPTER)
    assert isinstance(heartbeat, TelemetryHeartbeat)
    assert (heartbeat.mode, heartbeat.armed) == ("GUIDED", True)
    assert not _of(link.receive(sender.heartbeat(), T_US + SECOND_US), VehicleAppeared)


@pytest.mark.parametrize("stranger", [(GCS, INVALID), (6, 3), (26, INVALID), (30, INVALID)])
def test_stations_cameras_and_gimbals_are_no_vehicles(stranger: tuple[int, int]) -> None:
    assert VehicleLink().receive(Sender(9).heartbeat(*stranger), T_US) == []


def test_packets_of_a_station_are_not_the_vehicle_s() -> None:
    """A log holds the station's packets too, and routers mirror them."""
    link = _link_with_vehicle()

    assert link.receive(Sender(255, 190).heartbeat(), T_US) == []
    assert link.receive(Sender(254, 190).attitude(100), T_US) == []


def test_samples_of_another_component_are_left_out_but_for_its_gimbal() -> None:
    link = _link_with_vehicle()
    companion = Sender(1, 191)
    gimbal = Sender(1, 154).pack(
        dialect.MAVLink_gimbal_device_attitude_status_message(0, 0, 5, 64, [1.0, 0.0, 0.0, 0.0], 0, 0, 0, 0)
    )

    assert link.receive(companion.attitude(100), T_US) == []
    assert len(_of(link.receive(gimbal, T_US), SampleEvent)) == 1


def test_a_gimbal_s_clock_does_not_disturb_the_autopilot_s() -> None:
    link = _link_with_vehicle()
    autopilot, gimbal = Sender(), Sender(1, 154)
    for i in range(20):
        t_us = T_US + i * 100_000
        link.receive(autopilot.attitude(500_000 + 100 * i), t_us)
        (event,) = link.receive(
            gimbal.pack(
                dialect.MAVLink_gimbal_device_attitude_status_message(
                    0, 0, 7 + 100 * i, 64, [1.0, 0.0, 0.0, 0.0], 0, 0, 0, 0
                )
            ),
            t_us,
        )
        assert isinstance(event, SampleEvent)
        assert event.sample.t_us == t_us
    assert link.vehicles[1].clock.reboots == link.vehicles[1].clock.steps == 0


def test_a_sample_has_the_time_it_was_made() -> None:
    link = _link_with_vehicle()
    sender = Sender()
    link.receive(sender.attitude(10_000), T_US)
    (event,) = _of(link.receive(sender.attitude(10_040), T_US + 190_000), SampleEvent)

    assert isinstance(event.sample, AttitudeSample)
    assert (event.t_us, event.sample.t_us) == (T_US + 190_000, T_US + 40_000)


def test_heartbeat_once_a_second_from_the_start() -> None:
    link = VehicleLink(system_id=250, component_id=191)
    times = []
    for i in range(50):
        link.tick(T_US + i * 100_000)
        for message in _sent(link, "HEARTBEAT"):
            assert (message.type, message.autopilot) == (GCS, INVALID)
            assert (message.get_srcSystem(), message.get_srcComponent()) == (250, 191)
            times.append(i)
    assert times == [0, 10, 20, 30, 40]


def test_a_silent_vehicle_is_lost_and_returns() -> None:
    link = _link_with_vehicle()
    assert not _of(link.tick(T_US + 5 * SECOND_US), VehicleLost)
    (lost,) = _of(link.tick(T_US + 5 * SECOND_US + 1), VehicleLost)
    assert lost.last_heartbeat_us == T_US
    assert not _of(link.tick(T_US + 9 * SECOND_US), VehicleLost)

    events = link.receive(Sender().heartbeat(), T_US + 10 * SECOND_US)
    assert _of(events, VehicleReturned) == [VehicleReturned(T_US + 10 * SECOND_US, 1, 10 * SECOND_US)]


def test_rates_are_asked_for_and_asked_again_after_a_return() -> None:
    link = _link_with_vehicle(rates_hz={30: 25.0, 105: 50.0})
    sender = Sender()
    asked = []
    for i in range(20):
        link.tick(T_US + i * 100_000)
        for message in _sent(link, "COMMAND_LONG"):
            assert message.command == 511
            asked.append((message.param1, message.param2))
            link.receive(sender.ack(511, 0), T_US + i * 100_000 + 20_000)
    assert asked == [(30.0, 40_000.0), (105.0, 20_000.0)]

    link.tick(T_US + 8 * SECOND_US)
    link.data_to_send()
    link.receive(sender.heartbeat(), T_US + 9 * SECOND_US)
    link.tick(T_US + 9 * SECOND_US)
    assert [m.param1 for m in _sent(link, "COMMAND_LONG")] == [30.0]


def test_rate_requests_make_no_command_results() -> None:
    link = _link_with_vehicle(rates_hz={30: 25.0})
    link.tick(T_US)

    assert link.receive(Sender().ack(511, 2), T_US) == []


def test_an_old_autopilot_is_asked_for_streams() -> None:
    link = _link_with_vehicle(rates_hz={30: 25.0})
    link.tick(T_US)
    link.receive(Sender().ack(511, 3), T_US)
    link.data_to_send()
    link.receive(Sender().heartbeat(), T_US + SECOND_US)
    sent = []
    for i in range(3):
        link.tick(T_US + i * SECOND_US)
        sent += _sent(link, "REQUEST_DATA_STREAM")

    assert {m.req_stream_id for m in sent} == {1, 2, 6, 10, 11, 12}


def test_a_command_through_a_lossy_link() -> None:
    """Fault: the command is lost twice, the first acknowledgement once. Expected: one result, accepted."""
    link = _link_with_vehicle(rates_hz={})
    sender = Sender()
    command_id = link.command(1, [CommandStep(400, (1.0,))])
    results, attempts = [], 0
    for i in range(100):
        t_us = T_US + i * 100_000
        if i % 10 == 0:
            link.receive(sender.heartbeat(), t_us)
        results += _of(link.tick(t_us), CommandResult)
        for _ in _sent(link, "COMMAND_LONG"):
            attempts += 1
            if attempts == 4:
                results += _of(link.receive(sender.ack(400, 0), t_us), CommandResult)

    assert [(r.command_id, r.status) for r in results] == [(command_id, CommandStatus.ACCEPTED)]


def test_a_command_to_nobody() -> None:
    with pytest.raises(UnknownVehicleError, match=r"system id 7 on this link \(heard: 1\)"):
        _link_with_vehicle().command(7, [CommandStep(400)])


def test_time_sync_is_asked_answered_and_measured() -> None:
    link = _link_with_vehicle(rates_hz={})
    sender = Sender()
    link.tick(T_US)
    (question,) = _sent(link, "TIMESYNC")
    assert (question.tc1, question.ts1) == (0, T_US * 1000)
    link.receive(sender.pack(dialect.MAVLink_timesync_message(123_456, question.ts1)), T_US + 30_000)
    (stats,) = _of(link.tick(T_US + SECOND_US), LinkStats)
    assert stats.round_trip_ms == 30.0

    link.receive(sender.pack(dialect.MAVLink_timesync_message(0, 777)), T_US + SECOND_US)
    answers = [m for m in _sent(link, "TIMESYNC") if m.tc1]
    assert [(m.tc1, m.ts1) for m in answers] == [((T_US + SECOND_US) * 1000, 777)]


def test_stats_count_rates_losses_noise_and_signatures() -> None:
    signed = Sender(key=b"k" * 32)
    link = _link_with_vehicle(signed, rates_hz={})
    for i in range(10):
        link.receive(signed.attitude(1000 + i) + b"\xfd\x00z", T_US + i)
    signed.skip(10)
    link.receive(signed.attitude(2000), T_US + 10)
    (stats,) = _of(link.tick(T_US + SECOND_US), LinkStats)

    assert (stats.packets, stats.lost_packets, stats.signed_packets, stats.noise_bytes) == (12, 10, 12, 30)
    assert dict(stats.rates_hz)["ATTITUDE"] == 11.0
    assert stats.loss_pct == pytest.approx(100 * 10 / 22)
    assert (stats.connected, stats.version) == (True, 2)


def test_a_reboot_is_told_and_rates_are_asked_again() -> None:
    link = _link_with_vehicle(rates_hz={30: 25.0})
    sender = Sender()
    link.tick(T_US)
    link.receive(sender.ack(511, 0), T_US)
    for i in range(10):
        link.receive(sender.attitude(60_000 + 40 * i), T_US + 40_000 * i)
    link.data_to_send()
    events = []
    for i in range(5):
        events += link.receive(sender.attitude(2_000 + 40 * i), T_US + 4 * SECOND_US + 40_000 * i)
    assert len(_of(events, VehicleRebooted)) == 1

    link.tick(T_US + 5 * SECOND_US)
    assert [m.param1 for m in _sent(link, "COMMAND_LONG")] == [30.0]


def test_a_clock_set_back_stops_nothing() -> None:
    link = _link_with_vehicle(rates_hz={})
    link.tick(T_US)
    link.data_to_send()
    back_us = T_US - 3600 * SECOND_US
    link.tick(back_us)
    assert len(_sent(link, "HEARTBEAT")) == 1

    assert len(_of(link.tick(back_us + 6 * SECOND_US), VehicleLost)) == 1


def test_two_vehicles_on_one_link_are_kept_apart() -> None:
    link = VehicleLink(rates_hz={})
    helicopter, plane = Sender(1), Sender(2)
    link.receive(helicopter.heartbeat() + plane.heartbeat(FIXED_WING), T_US)
    events = link.receive(helicopter.attitude(100) + plane.attitude(900_000), T_US)

    assert [e.system_id for e in _of(events, SampleEvent)] == [1, 2]
    assert {v.vehicle_type for v in link.vehicles.values()} == {VehicleType.HELICOPTER, VehicleType.FIXED_WING}
    link.receive(plane.heartbeat(FIXED_WING), T_US + 4 * SECOND_US)
    assert [e.system_id for e in _of(link.tick(T_US + 6 * SECOND_US), VehicleLost)] == [1]


def test_a_recorder_sees_every_packet_as_it_came() -> None:
    seen: list[tuple[RawPacket, int]] = []
    link = VehicleLink(on_packet=lambda packet, t_us: seen.append((packet, t_us)))
    packets = [Sender().heartbeat(), Sender(version=1).attitude(5), Sender(255, 190).heartbeat()]
    link.receive(b"noise" + b"".join(packets), T_US)

    assert [(packet.data, t_us) for packet, t_us in seen] == [(packet, T_US) for packet in packets]


def test_a_passive_link_sends_nothing() -> None:
    link = _link_with_vehicle(passive=True)
    for i in range(100):
        link.tick(T_US + i * 100_000)

    assert link.data_to_send() == []


def test_random_bytes_and_damaged_packets_never_raise_nor_stop_the_link() -> None:
    rng = random.Random(4)
    link = _link_with_vehicle(rates_hz={})
    sender = Sender()
    for i in range(300):
        packet = bytearray(sender.pack(dialect.MAVLink_statustext_message(1, rng.randbytes(50), i % 3, i % 5)))
        if i % 3 == 0:
            packet[rng.randrange(len(packet))] ^= rng.randrange(1, 256)
        link.receive(rng.randbytes(rng.randrange(50)) + packet[: rng.choice([60, 200])], T_US + i * 10_000)
        link.tick(T_US + i * 10_000)
    link.receive(sender.heartbeat(), T_US + 4 * SECOND_US)
    # One whole heartbeat more pushes out whatever a false header of a carrier still holds back.
    events = [e for i in range(20) for e in link.receive(sender.status_text("still here"), T_US + 5 * SECOND_US + i)]

    assert "still here" in {e.text for e in _of(events, StatusText)}
