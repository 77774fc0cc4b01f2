"""Targets as GPX 1.1 waypoints."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element, tostring

from backend.exports.text import add, decimal, in_words, iso_utc, position_unix_us
from backend.schemas.geometry import TargetFeature, feature_of_target
from backend.store.targets import Target

NAMESPACE = "http://www.topografix.com/GPX/1/1"
_XML = b'<?xml version="1.0" encoding="UTF-8"?>\n'


def gpx_of_targets(targets: Sequence[Target]) -> bytes:
    """A GPX document; ``ele`` is above mean sea level, and absent where the height is not known.

    GPX has no place for a covariance: errors are told in words, in ``desc``.
    """
    root = Element("gpx", xmlns=NAMESPACE, version="1.1", creator="Pilotage")
    for target in targets:
        _add_waypoint(root, feature_of_target(target))
    return _XML + bytes(tostring(root, encoding="utf-8")) + b"\n"


def _add_waypoint(root: Element, feature: TargetFeature) -> None:
    about = feature.properties
    lon = decimal(about.lon_deg, 7)
    if lon == decimal(180.0, 7):
        lon = f"-{lon}"  # the schema's longitude excludes +180
    # The order of the elements is the schema's.
    point = add(root, "wpt", lat=decimal(about.lat_deg, 7), lon=lon)
    if about.alt_amsl_m is not None:
        add(point, "ele", decimal(about.alt_amsl_m, 2))
    add(point, "time", iso_utc(position_unix_us(about)))
    add(point, "name", about.name)
    add(point, "desc", in_words(about))
    add(point, "src", "Pilotage")
