"""Targets as Cursor on Target events: XML, version 2.0 (MITRE, Event.xsd of 2003; Developer's Guide of 2005)."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree.ElementTree import Element, tostring

from backend.exports.text import add, decimal, in_words, iso_utc, one_line
from backend.schemas.geometry import TargetProperties, feature_of_target
from backend.store.targets import Target

UNKNOWN_GROUND = "a-u-G"  # an atom of unknown affiliation on the ground; what it is, people say
HUMAN_ESTIMATE = "h-g-i-g-o"
STALE_AFTER_US = 300_000_000
# One that moves is told anew every second or so while it is seen.
MOVING_STALE_AFTER_US = 30_000_000
UNKNOWN_M = 9_999_999.0
# Radius of the circle that holds 90 % of a circular normal distribution, in sigmas: 2.146.
_CE90_SIGMAS = math.sqrt(-2.0 * math.log(0.1))


def cot_of_targets(targets: Sequence[Target], now_us: int) -> bytes:
    """One event after the other, each on a line of its own, as TAK servers and clients read them from a stream.

    There is no element around them, because such readers take a piece from ``<event`` to ``</event>``: one target is an
    XML document, several are an external parsed entity (XML 1.0, 4.3.2), and none is nothing.
    """
    return b"".join(cot_event(target, now_us) for target in targets)


def cot_event(target: Target, now_us: int, *, deleted: bool = False, cot_type: str = UNKNOWN_GROUND) -> bytes:
    """One event as a line of XML; the same uid for the same target whenever it is written.

    ``ce`` and ``le`` are one sigma: CE90 / 2.146, and the sigma of the height. ``hae`` is always unknown: it is above
    the ellipsoid, the station's heights are above mean sea level, and there is no geoid to convert them with. The
    height is in the remarks. A deleted target is stale at once. One that moves has course and speed, and is stale soon
    after it was seen last.
    """
    about = feature_of_target(target).properties
    now = iso_utc(now_us)
    track = about.track
    event = Element(
        "event", version="2.0", uid=uid_of(target.id), type=cot_type, time=now, start=now,
        stale=now if deleted else iso_utc(_stale_us(about, now_us)), how=HUMAN_ESTIMATE,
    )  # fmt: skip
    add(
        event, "point", lat=decimal(about.lat_deg, 7), lon=decimal(about.lon_deg, 7), hae=_metres(None),
        ce=_metres(circular_sigma_m(about)), le=_metres(about.std_d_m),
    )  # fmt: skip
    detail = add(event, "detail")
    add(detail, "contact", callsign=one_line(about.name) or "unnamed")
    if track is not None and track.speed_m_s is not None and track.course_deg is not None:
        add(detail, "track", course=decimal(track.course_deg, 1), speed=decimal(track.speed_m_s, 2))
    add(detail, "remarks", f"{'Deleted. ' if deleted else ''}Pilotage: {one_line(in_words(about))}")
    return bytes(tostring(event, encoding="utf-8")) + b"\n"


def _stale_us(about: TargetProperties, now_us: int) -> int:
    track = about.track
    if track is None or track.seen_unix_us is None or not track.moving:
        return now_us + STALE_AFTER_US
    # never before the event itself, which Event.xsd does not allow
    return max(track.seen_unix_us + MOVING_STALE_AFTER_US, now_us)


def uid_of(target_id: str) -> str:
    """The uid of a target's events."""
    return f"pilotage.{one_line(target_id)}"


def circular_sigma_m(about: TargetProperties) -> float | None:
    """CE90 / 2.146, as in MISB ST 0805: the sigma of a circular distribution with the same CE90."""
    return None if about.ce90_m is None else about.ce90_m / _CE90_SIGMAS


def _metres(value: float | None) -> str:
    known = value is not None and math.isfinite(value) and value < UNKNOWN_M
    return decimal(value, 2) if known and value is not None else decimal(UNKNOWN_M, 1)
