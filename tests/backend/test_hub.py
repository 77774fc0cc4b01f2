"""The hub: order, coalescing, slow readers."""

import asyncio
import math
from collections.abc import Mapping
from typing import Any

import orjson

from backend.hub import Hub, Mailbox, Message


async def read(mailbox: Mailbox) -> list[dict]:
    return [orjson.loads(text) for text in await asyncio.wait_for(mailbox.take(), 5)]


async def test_every_listener_gets_every_message_in_order() -> None:
    hub = Hub()
    boxes = [hub.open(), hub.open()]
    hub.publish("target", action="created")
    hub.publish("alarm", code="x")

    for box in boxes:
        messages = await read(box)
        assert [message["type"] for message in messages] == ["target", "alarm"]
        assert messages[0]["seq"] < messages[1]["seq"]


async def test_states_of_a_slow_reader_are_coalesced_and_targets_are_not() -> None:
    hub = Hub()
    box = hub.open()
    for n in range(500):
        hub.publish("state", vehicle_id="1", n=n)
        hub.publish("state", vehicle_id="2", n=n)
        if n % 100 == 0:
            hub.publish("target", action="created", n=n)

    messages = await read(box)

    assert [m["n"] for m in messages if m["type"] == "target"] == [0, 100, 200, 300, 400]
    assert [(m["vehicle_id"], m["n"]) for m in messages if m["type"] == "state"] == [("1", 499), ("2", 499)]
    assert [m["seq"] for m in messages] == sorted(m["seq"] for m in messages)


async def test_an_operators_fix_is_not_replaced_by_the_next_match() -> None:
    hub = Hub()
    box = hub.open()
    for kind in ("registration", "operator", "registration", "registration"):
        hub.publish("fix", vehicle_id="1", kind=kind, accepted=True)

    assert [message["kind"] for message in await read(box)] == ["operator", "registration"]


async def test_a_reader_that_stops_is_given_up_and_others_go_on() -> None:
    hub = Hub()
    stuck, reading = hub.open(), hub.open()
    for n in range(3000):
        hub.publish("target", n=n)
        if n % 100 == 0:
            await read(reading)

    assert stuck.overflowed
    assert not reading.overflowed


async def test_bytes_bound_a_mailbox_too() -> None:
    box = Mailbox(max_messages=100, max_bytes=1000)
    box.put(Message("x" * 600, None))
    assert not box.overflowed
    box.put(Message("x" * 600, None))
    assert box.overflowed


async def test_not_a_number_becomes_null() -> None:
    hub = Hub()
    box = hub.open()
    hub.publish("state", vehicle_id="1", value=math.nan, other=math.inf)

    (message,) = await read(box)

    assert message["value"] is None
    assert message["other"] is None


async def test_a_closed_mailbox_gets_nothing_more() -> None:
    hub = Hub()
    box = hub.open()
    hub.close(box)
    hub.publish("alarm", code="x")

    assert hub.listeners == 0
    box.put(hub.message("pong"))
    assert [m["type"] for m in await read(box)] == ["pong"]


async def test_a_field_may_be_called_kind() -> None:
    hub = Hub()
    box = hub.open()
    hub.publish("fix", vehicle_id="1", kind="map", accepted=True)

    (message,) = await read(box)

    assert (message["type"], message["kind"]) == ("fix", "map")


async def test_a_part_that_cannot_read_a_message_keeps_nobody_from_it() -> None:
    hub, heard = Hub(), []

    def broken(kind: str, fields: Mapping[str, Any]) -> None:
        raise KeyError(kind)

    hub.tap(broken)
    hub.tap(lambda kind, fields: heard.append((kind, dict(fields))))
    hub.publish("state", vehicle_id="1")

    assert heard == [("state", {"vehicle_id": "1"})]
