"""Targets as KML 2.2 (OGC 07-147r2): a folder of points, and a folder of their 95 % error ellipses."""

from __future__ import annotations

from collections.abc import Sequence
from xml.etree.ElementTree import Element, tostring

import numpy as np
import pyproj

from backend.exports.text import add, decimal, in_words, iso_utc, position_unix_us
from backend.schemas.geometry import EllipseBody, TargetFeature, TargetProperties, feature_of_target
from backend.store.targets import Target

NAMESPACE = "http://www.opengis.net/kml/2.2"
_CORNERS = 72
_WGS84 = pyproj.Geod(ellps="WGS84")
_XML = b'<?xml version="1.0" encoding="UTF-8"?>\n'


def kml_of_targets(targets: Sequence[Target]) -> bytes:
    """A KML document.

    A point with a height is ``absolute``: KML means metres above mean sea level by it, as the station does. One without
    is ``clampToGround``, as all ellipses are. Nothing is drawn about a target whose covariance nobody knows.
    """
    root = Element("kml", xmlns=NAMESPACE)
    document = add(root, "Document")
    add(document, "name", "Pilotage targets")
    style = add(document, "Style", id="ellipse95")
    add(add(style, "LineStyle"), "color", "ff00a5ff")  # aabbggrr
    add(add(style, "PolyStyle"), "color", "4000a5ff")
    features = [feature_of_target(target) for target in targets]
    folder = add(document, "Folder")
    add(folder, "name", "Targets")
    for feature in features:
        _add_point(folder, feature)
    folder = add(document, "Folder")
    add(folder, "name", "Error ellipses 95 %")
    for feature in features:
        if feature.properties.ellipse95 is not None:
            _add_ellipse(folder, feature, feature.properties.ellipse95)
    return _XML + bytes(tostring(root, encoding="utf-8")) + b"\n"


def ellipse_ring_deg(lat_deg: float, lon_deg: float, ellipse: EllipseBody) -> list[tuple[float, float]]:
    """A closed ring of (lon, lat) about a place, counter-clockwise, by geodesics on WGS-84; lon within +-180."""
    angle = np.linspace(0.0, 2.0 * np.pi, _CORNERS, endpoint=False)
    along, across = ellipse.semi_major_m * np.cos(angle), ellipse.semi_minor_m * np.sin(angle)
    # Across is to the left of the major axis, so that a growing angle turns counter-clockwise.
    azimuth_deg = ellipse.azimuth_deg - np.degrees(np.arctan2(across, along))
    lon, lat, _ = _WGS84.fwd(
        np.full(_CORNERS, lon_deg), np.full(_CORNERS, lat_deg), azimuth_deg, np.hypot(along, across)
    )
    ring = [(float(x), float(y)) for x, y in zip(lon, lat, strict=True)]
    return [*ring, ring[0]]


def _add_point(folder: Element, feature: TargetFeature) -> None:
    about = feature.properties
    # The order of a feature's elements is the schema's: name, description, time, style, data, geometry.
    place = add(folder, "Placemark", id=f"target-{feature.id}")
    add(place, "name", about.name)
    add(place, "description", in_words(about))
    add(add(place, "TimeStamp"), "when", iso_utc(position_unix_us(about)))
    _add_data(place, feature.id, about)
    point = add(place, "Point")
    add(point, "altitudeMode", "clampToGround" if about.alt_amsl_m is None else "absolute")
    add(point, "coordinates", _position(about.lon_deg, about.lat_deg, about.alt_amsl_m))


def _add_ellipse(folder: Element, feature: TargetFeature, ellipse: EllipseBody) -> None:
    about = feature.properties
    place = add(folder, "Placemark", id=f"ellipse-{feature.id}")
    add(place, "name", about.name)
    add(place, "styleUrl", "#ellipse95")
    data = add(place, "ExtendedData")
    for name, value in (
        ("target_id", feature.id), ("semi_major_m", decimal(ellipse.semi_major_m, 3)),
        ("semi_minor_m", decimal(ellipse.semi_minor_m, 3)), ("azimuth_deg", decimal(ellipse.azimuth_deg, 1)),
    ):  # fmt: skip
        add(add(data, "Data", name=name), "value", value)
    polygon = add(place, "Polygon")
    add(polygon, "tessellate", "1")
    add(polygon, "altitudeMode", "clampToGround")
    ring = add(add(polygon, "outerBoundaryIs"), "LinearRing")
    corners = ellipse_ring_deg(about.lat_deg, about.lon_deg, ellipse)
    add(ring, "coordinates", " ".join(_position(lon, lat, None) for lon, lat in corners))


def _add_data(place: Element, target_id: str, about: TargetProperties) -> None:
    data = add(place, "ExtendedData")
    values: dict[str, str | None] = {
        "target_id": target_id,
        "method": about.method,
        "ce90_m": _number(about.ce90_m),
        "time": iso_utc(position_unix_us(about)),
        "std_n_m": _number(about.std_n_m),
        "std_e_m": _number(about.std_e_m),
        "std_d_m": _number(about.std_d_m),
        "alt_amsl_m": _number(about.alt_amsl_m),
        "mgrs": about.mgrs,
        "vehicle_id": about.vehicle_id,
    }
    if about.track is not None:
        values["track"] = about.track.status
        values["speed_m_s"] = _number(about.track.speed_m_s)
        values["course_deg"] = _number(about.track.course_deg)
    for name, value in values.items():
        if value is not None:
            add(add(data, "Data", name=name), "value", value)


def _position(lon_deg: float, lat_deg: float, alt_amsl_m: float | None) -> str:
    place = f"{decimal(lon_deg, 7)},{decimal(lat_deg, 7)}"
    return place if alt_amsl_m is None else f"{place},{decimal(alt_amsl_m, 2)}"


def _number(value: float | None) -> str | None:
    return None if value is None else decimal(value, 3)
