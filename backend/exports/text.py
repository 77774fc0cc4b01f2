"""Names, times and numbers as they may stand in XML and CSV."""

from __future__ import annotations

import re
from datetime import UTC, datetime, timedelta
from xml.etree.ElementTree import Element, SubElement

from backend.schemas.geometry import TargetProperties, TrackBody

# XML 1.0, production 2: no other control characters, no surrogates, no U+FFFE and U+FFFF, not even escaped.
_NOT_XML = re.compile("[^\t\n\r\u0020-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_LATEST_US = 253_402_300_799_999_999  # the end of the year 9999


def clean(text: str) -> str:
    """A text with what XML cannot hold replaced by U+FFFD."""
    return _NOT_XML.sub("\ufffd", text)


def one_line(text: str) -> str:
    """A cleaned text with every run of white space as one space."""
    return " ".join(clean(text).split())


def iso_utc(t_unix_us: int) -> str:
    """ISO 8601 to the millisecond, ``2026-05-01T09:30:00.250Z``."""
    moment = _EPOCH + timedelta(microseconds=min(max(t_unix_us, 0), _LATEST_US))
    return f"{moment:%Y-%m-%dT%H:%M:%S}.{moment.microsecond // 1000:03d}Z"


def decimal(value: float, digits: int) -> str:
    """A number without an exponent, which xs:decimal does not allow, and without a minus before zero."""
    text = f"{value:.{digits}f}"
    return text.removeprefix("-") if not text.strip("-0.") else text


def add(parent: Element, tag: str, text: str | None = None, **attributes: str) -> Element:
    """A child element, with a cleaned text."""
    child = SubElement(parent, tag, attributes)
    if text is not None:
        child.text = clean(text)
    return child


def position_unix_us(about: TargetProperties) -> int:
    """The time a position is of: the exposure of the clicked frame, or of the last sighting of one that was followed;
    by hand, when the target was last touched."""
    if about.track is not None and about.track.seen_unix_us is not None:
        return about.track.seen_unix_us
    if about.t_unix_us is not None and about.method != "manual":
        return about.t_unix_us
    return about.updated_unix_us


def motion_in_words(track: TrackBody) -> str:
    """Whether a followed target stands, or how it moves."""
    if track.speed_m_s is None or track.course_deg is None:
        return "standing"
    return f"moving {decimal(track.speed_m_s, 1)} m/s, course {decimal(track.course_deg, 0)} degrees"


def in_words(about: TargetProperties) -> str:
    """Method, errors and time of a position in one line for people."""
    parts = [about.method]
    if about.ce90_m is not None:
        parts.append(f"CE90 {decimal(about.ce90_m, 1)} m")
    else:
        parts.append("horizontal error unknown")
    if about.alt_amsl_m is not None:
        height = f"height {decimal(about.alt_amsl_m, 1)} m above mean sea level"
        if about.std_d_m is not None:
            height += f" (1 sigma {decimal(about.std_d_m, 1)} m)"
        parts.append(height)
    if about.track is not None and about.track.moving is not None:
        parts.append(motion_in_words(about.track))
    verb = "entered" if about.method == "manual" else "seen"
    parts.append(f"{verb} {iso_utc(position_unix_us(about))}")
    return ", ".join(parts)
