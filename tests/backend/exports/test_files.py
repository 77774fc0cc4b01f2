"""KML, GPX and GeoJSON read back by OGR, CSV by Python's reader; numbers, names and what nobody knows."""

from __future__ import annotations

import csv
import io
import json
from collections.abc import Sequence
from typing import Any

import numpy as np
import pyogrio
import pyproj
import pytest
from lxml import etree

from backend.exports.csv_table import COLUMNS, csv_of_targets
from backend.exports.formats import FORMATS, file_name
from backend.exports.gpx import gpx_of_targets
from backend.exports.kml import ellipse_ring_deg, kml_of_targets
from backend.exports.text import clean, decimal, iso_utc
from backend.schemas.geometry import EllipseBody, feature_of_target
from backend.store.targets import Target
from tests.backend.exports.samples import NASTY_NAMES, T_US, followed, target, typed

KML = {"k": "http://www.opengis.net/kml/2.2"}


def read_ogr(data: bytes, layer: str | None = None) -> tuple[dict[str, np.ndarray[Any, Any]], list[dict[str, Any]]]:
    """Columns and geometries (as GeoJSON objects) that OGR finds in a file."""
    meta, _, wkb, columns = pyogrio.raw.read(data, layer=layer)
    return dict(zip(meta["fields"], columns, strict=True)), [_geometry(one) for one in wkb]


def _geometry(wkb: bytes) -> dict[str, Any]:
    """Points and polygons of ISO or extended WKB, little-endian."""
    kind = int.from_bytes(wkb[1:5], "little")
    has_z = bool(kind & 0x80000000) or kind // 1000 % 10 == 1
    width, base = 3 if has_z else 2, (kind & 0xFFFF) % 1000
    if base == 1:
        return {"type": "Point", "coordinates": np.frombuffer(wkb[5:], "<f8").tolist()}
    assert base == 3
    assert int.from_bytes(wkb[5:9], "little") == 1
    return {"type": "Polygon", "coordinates": np.frombuffer(wkb[13:], "<f8").reshape(-1, width)}


def csv_rows(targets: Sequence[Target]) -> list[dict[str, str]]:
    return list(csv.DictReader(io.StringIO(csv_of_targets(targets).decode(), newline="")))


def test_ogr_reads_kml_points_with_their_data() -> None:
    fields, shapes = read_ogr(kml_of_targets([target(), typed()]), "Targets")

    assert shapes[0]["coordinates"] == [8.5417, 47.3769, 408.25]
    assert shapes[1]["coordinates"][:2] == [8.5417, 47.3769]
    assert fields["Name"].tolist() == ["Bridge", "Typed"]


def test_kml_says_method_error_time_and_what_its_height_means() -> None:
    root = etree.fromstring(kml_of_targets([target(), typed()]))
    clicked, bare = root.xpath("//k:Folder[k:name='Targets']/k:Placemark", namespaces=KML)
    data = {one.get("name"): one.findtext("k:value", namespaces=KML) for one in clicked.iter("{*}Data")}

    assert data["method"] == "ray_terrain"
    assert data["time"] == clicked.findtext("k:TimeStamp/k:when", namespaces=KML) == "2026-05-01T09:30:00.250Z"
    ce90_m = feature_of_target(target()).properties.ce90_m
    assert ce90_m is not None
    assert float(data["ce90_m"]) == pytest.approx(ce90_m, abs=5e-4)
    assert [p.findtext("k:Point/k:altitudeMode", namespaces=KML) for p in (clicked, bare)] == [
        "absolute", "clampToGround",
    ]  # fmt: skip
    assert bare.findtext("k:Point/k:coordinates", namespaces=KML) == "8.5417000,47.3769000"
    assert "ce90_m" not in {one.get("name") for one in bare.iter("{*}Data")}


def test_the_kml_ellipse_holds_what_the_covariance_says() -> None:
    """95 % of 20 000 draws of the covariance lie inside the polygon that OGR reads; none is drawn for the typed one."""
    fields, shapes = read_ogr(kml_of_targets([target(), typed()]), "Error ellipses 95 %")
    assert fields["Name"].tolist() == ["Bridge"]
    ring = shapes[0]["coordinates"][:, :2]
    assert (ring[0] == ring[-1]).all()

    away_deg, _, away_m = pyproj.Geod(ellps="WGS84").inv(
        np.full(len(ring), 8.5417), np.full(len(ring), 47.3769), ring[:, 0], ring[:, 1]
    )
    corners = np.column_stack([away_m * np.cos(np.radians(away_deg)), away_m * np.sin(np.radians(away_deg))])
    draws = np.random.default_rng(5).multivariate_normal([0, 0], [[5.0, 4.0], [4.0, 5.0]], 20_000)
    area = np.sum(corners[:-1, 1] * corners[1:, 0] - corners[1:, 1] * corners[:-1, 0])
    assert area > 0  # counter-clockwise seen from above: east to the right, north up
    # A convex ring turned counter-clockwise has what is inside to the left of every edge.
    edge = np.diff(corners, axis=0)
    offset = draws[:, None, :] - corners[None, :-1, :]
    inside = np.all(edge[:, 1] * offset[:, :, 0] - edge[:, 0] * offset[:, :, 1] >= 0, axis=1)
    assert inside.mean() == pytest.approx(
        0.95, abs=0.006
    )  # 72 corners cut off 0.1 %; three sigmas of the draws are 0.5


def test_an_ellipse_reaches_over_the_date_line_without_leaving_the_range() -> None:
    ring = np.array(ellipse_ring_deg(10.0, 179.99999, EllipseBody(semi_major_m=50, semi_minor_m=5, azimuth_deg=90)))

    assert np.abs(ring[:, 0]).max() <= 180.0
    assert (ring[:, 0] < 0).any()


def test_ogr_reads_gpx_waypoints() -> None:
    fields, shapes = read_ogr(gpx_of_targets([target(), typed(lon_deg=180.0)]), "waypoints")

    assert [shape["coordinates"][:2] for shape in shapes] == [[8.5417, 47.3769], [-180.0, 47.3769]]
    assert fields["name"].tolist() == ["Bridge", "Typed"]
    assert fields["ele"][0] == 408.25
    assert np.isnan(fields["ele"][1])
    assert str(fields["time"][0]) == "2026-05-01T09:30:00.250"
    assert "CE90" in fields["desc"][0]
    assert "error unknown" in fields["desc"][1]


def test_ogr_reads_geojson_with_three_coordinates() -> None:
    fields, shapes = read_ogr(FORMATS["geojson"].write([target(), typed()], T_US))

    assert shapes[0]["coordinates"] == [8.5417, 47.3769, 408.25]
    assert fields["name"].tolist() == ["Bridge", "Typed"]
    assert fields["utm"].tolist() == ["32T 465403 5247151"] * 2


@pytest.mark.parametrize("name", NASTY_NAMES)
def test_any_name_is_read_back_from_every_file(name: str) -> None:
    targets = [target(name=name)]
    expected = clean(name)

    kml = etree.fromstring(kml_of_targets(targets))
    assert (kml.findtext(".//k:Placemark/k:name", namespaces=KML) or "") == expected
    gpx = etree.fromstring(gpx_of_targets(targets))
    assert (gpx.findtext(".//{*}wpt/{*}name") or "") == expected
    assert csv_rows(targets)[0]["name"].removeprefix("'") == expected
    assert json.loads(FORMATS["geojson"].write(targets, T_US))["features"][0]["properties"]["name"] == name
    for data, layer in ((kml_of_targets(targets), "Targets"), (gpx_of_targets(targets), "waypoints")):
        assert len(read_ogr(data, layer)[1]) == 1


@pytest.mark.parametrize("name", ["=1+1", "+1", "-1", "@SUM(A1)", "\t=1", " =1", "\n=1", "\u00a0=1", "＝1"])
def test_a_spreadsheet_is_given_no_formula(name: str) -> None:
    assert csv_rows([target(name=name, vehicle_id=name)])[0]["name"] == f"'{name}"
    assert csv_rows([target(name=name, vehicle_id=name)])[0]["vehicle_id"] == f"'{name}"


def test_csv_has_units_times_grids_and_no_digits_that_are_not_known() -> None:
    clicked, bare = csv_rows([target(), typed(lon_deg=-8.5417)])

    assert tuple(clicked) == COLUMNS
    assert (clicked["lat_deg"], clicked["lon_deg"], bare["lon_deg"]) == ("47.3769000", "8.5417000", "-8.5417000")
    assert (clicked["alt_amsl_m"], clicked["time_utc"]) == ("408.25", "2026-05-01T09:30:00.250Z")
    assert clicked["dms"] == "47°22′36.84″N 008°32′30.12″E"
    assert clicked["utm"] == "32T 465403 5247151"
    assert clicked["mgrs"] == "32TMT65404715"  # 3 m along the major axis, though north and east are 2.2 m each
    assert len(bare["mgrs"]) == len("29TNN1234512345")
    assert (clicked["std_n_m"], clicked["std_d_m"], clicked["ellipse95_azimuth_deg"]) == ("2.236", "2.000", "45.0")
    assert (bare["alt_amsl_m"], bare["ce90_m"], bare["std_n_m"], bare["frame_id"]) == ("", "", "", "")
    assert csv_of_targets([]).decode() == ",".join(COLUMNS) + "\r\n"


def test_velocities_are_in_every_file_that_has_a_place_for_them() -> None:
    (row, other) = csv_rows([followed(), target()])
    root = etree.fromstring(kml_of_targets([followed()]))
    data = {item.get("name"): item.findtext("k:value", None, KML) for item in root.iterfind(".//k:Data", KML)}
    (feature,) = json.loads(FORMATS["geojson"].write([followed()], T_US))["features"]

    assert (row["track"], row["moving"], row["speed_m_s"], row["course_deg"]) == ("seen", "true", "5.00", "90.0")
    assert (row["vel_e_m_s"], row["std_vel_n_m_s"], row["time_utc"]) == ("5.00", "0.20", "2026-05-01T09:30:02.250Z")
    assert (other["track"], other["moving"], other["speed_m_s"]) == ("", "", "")
    assert (data["track"], data["speed_m_s"], data["course_deg"]) == ("seen", "5.000", "90.000")
    assert feature["properties"]["track"]["std_vel_e_m_s"] == pytest.approx(0.3)


def test_files_without_targets_are_still_files() -> None:
    assert pyogrio.raw.read(FORMATS["geojson"].write([], T_US))[2].size == 0
    assert etree.fromstring(kml_of_targets([])).tag == "{http://www.opengis.net/kml/2.2}kml"
    assert len(etree.fromstring(gpx_of_targets([]))) == 0
    assert FORMATS["cot"].write([], T_US) == b""


def test_numbers_and_times() -> None:
    assert [decimal(v, 2) for v in (-0.001, 0.0, 1e-9, -1.005e3, 1e21)] == [
        "0.00", "0.00", "0.00", "-1005.00", "1000000000000000000000.00",
    ]  # fmt: skip
    assert iso_utc(0) == "1970-01-01T00:00:00.000Z"
    assert iso_utc(2**62) == "9999-12-31T23:59:59.999Z"
    assert file_name("kml", T_US) == "targets-20260501T093000Z.kml"
