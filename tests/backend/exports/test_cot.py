"""CoT events against the published schema's facts."""

from __future__ import annotations

import math

import pytest
from lxml import etree

from backend.exports.cot import cot_event, cot_of_targets
from tests.backend.exports.samples import NASTY_NAMES, T_US, followed, target, typed, valid_event


def test_an_event_of_a_clicked_target() -> None:
    event = valid_event(cot_event(target(), T_US))
    point, detail = event.find("point"), event.find("detail")

    assert dict(event.attrib) == {
        "version": "2.0", "uid": "pilotage.6b0f0d3e-0b1c-4a53-9d3f-1d6f3a1f8a11", "type": "a-u-G", "how": "h-g-i-g-o",
        "time": "2026-05-01T09:30:00.250Z", "start": "2026-05-01T09:30:00.250Z", "stale": "2026-05-01T09:35:00.250Z",
    }  # fmt: skip
    assert (point.get("lat"), point.get("lon"), point.get("hae")) == ("47.3769000", "8.5417000", "9999999.0")
    assert point.get("le") == "2.00"
    assert detail.find("contact").get("callsign") == "Bridge"
    assert "height 408.2 m above mean sea level (1 sigma 2.0 m)" in detail.findtext("remarks")


def test_a_moving_target_has_course_and_speed_and_is_stale_soon() -> None:
    now_us = T_US + 3_000_000
    event = valid_event(cot_event(followed(), now_us))
    standing = valid_event(cot_event(followed(moving=False), now_us))
    long_lost = valid_event(cot_event(followed(track_status="lost"), now_us + 600_000_000))

    assert dict(event.find("detail/track").attrib) == {"course": "90.0", "speed": "5.00"}
    assert event.get("stale") == "2026-05-01T09:30:32.250Z"  # half a minute after the sighting
    assert "moving 5.0 m/s, course 90 degrees, seen 2026-05-01T09:30:02.250Z" in event.findtext("detail/remarks")
    assert standing.find("detail/track") is None
    assert standing.get("stale") == "2026-05-01T09:35:03.250Z"
    assert long_lost.get("stale") == long_lost.get("time")


def test_ce_is_one_sigma() -> None:
    """Of a circular distribution of 3 m it is 3 m, where CE90 is 6.4 m."""
    event = valid_event(cot_event(target(var_n_m2=9.0, var_e_m2=9.0, cov_ne_m2=0.0), T_US))

    assert float(event.find("point").get("ce")) == pytest.approx(3.0, abs=0.011)
    assert "CE90 6.4 m" in event.findtext("detail/remarks")
    assert 3.0 * math.sqrt(-2 * math.log(0.1)) == pytest.approx(6.44, abs=0.005)


@pytest.mark.parametrize("changes", [{}, {"var_n_m2": 1.0, "var_e_m2": 1.0}, {"lat_deg": -90.0, "lon_deg": -180.0}])
def test_what_nobody_knows_is_nines(changes: dict[str, float]) -> None:
    point = valid_event(cot_event(typed(**changes), T_US)).find("point")

    assert [point.get(name) for name in ("hae", "ce", "le")] == ["9999999.0"] * 3


def test_an_error_larger_than_unknown_is_unknown() -> None:
    point = valid_event(cot_event(target(var_n_m2=1e15, var_e_m2=1e15, var_d_m2=1e15), T_US)).find("point")

    assert (point.get("ce"), point.get("le")) == ("9999999.0", "9999999.0")


def test_tiny_coordinates_have_no_exponent() -> None:
    point = valid_event(cot_event(target(lat_deg=1e-7, lon_deg=-1e-9), T_US)).find("point")

    assert (point.get("lat"), point.get("lon")) == ("0.0000001", "0.0000000")


def test_a_deleted_target_is_stale_at_once_under_the_same_uid() -> None:
    event = valid_event(cot_event(target(), T_US, deleted=True))

    assert event.get("stale") == event.get("start") == "2026-05-01T09:30:00.250Z"
    assert event.get("uid") == valid_event(cot_event(target(name="Other", version=9), T_US)).get("uid")
    assert event.findtext("detail/remarks").startswith("Deleted.")


@pytest.mark.parametrize("name", NASTY_NAMES)
def test_any_name_makes_one_valid_line(name: str) -> None:
    data = cot_event(target(name=name), T_US)

    assert data.count(b"\n") == 1
    assert data.endswith(b"</event>\n")
    callsign = valid_event(data).find("detail/contact").get("callsign")
    assert callsign == (" ".join(name.translate({0: 0xFFFD, 7: 0xFFFD, 0xFFFE: 0xFFFD}).split()) or "unnamed")


def test_several_targets_are_read_one_event_after_the_other() -> None:
    """As a stream's reader does: a piece ends with ``</event>``."""
    data = cot_of_targets([target(name="</event> & <event>"), typed()], T_US)
    pieces = [piece + b"</event>" for piece in data.split(b"</event>")[:-1]]

    assert [valid_event(piece).find("detail/contact").get("callsign") for piece in pieces] == [
        "</event> & <event>", "Typed",
    ]  # fmt: skip
    # And as a program does that puts an element around it.
    assert len(etree.fromstring(b"<events>" + data + b"</events>")) == 2


@pytest.mark.parametrize(
    "wrong",
    [
        b'<event version="2.0"/>',
        cot_event(target(), T_US).replace(b'ce="', b'ce="-'),
        cot_event(target(), T_US).replace(b'lat="47', b'lat="97'),
        cot_event(target(), T_US).replace(b'type="a-u-G"', b'type="a--G"'),
        cot_event(target(), T_US).replace(b'hae="9999999.0"', b'hae="1e7"'),
        cot_event(target(), T_US).replace(b"250Z", b"250"),
    ],
)
def test_the_schema_refuses_what_is_wrong(wrong: bytes) -> None:
    with pytest.raises(etree.DocumentInvalid):
        valid_event(wrong)
