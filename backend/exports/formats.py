"""The files that targets are given out as, by the name of their format."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

from backend.exports.cot import cot_of_targets
from backend.exports.csv_table import csv_of_targets
from backend.exports.gpx import gpx_of_targets
from backend.exports.kml import kml_of_targets
from backend.exports.text import iso_utc
from backend.schemas.geometry import collection_of_targets
from backend.store.targets import Target


@dataclass(frozen=True, slots=True)
class ExportFormat:
    """``write(targets, now_us)`` makes the file's bytes."""

    media_type: str
    ending: str
    write: Callable[[Sequence[Target], int], bytes]


def _geojson(targets: Sequence[Target], _now_us: int) -> bytes:
    return collection_of_targets(list(targets)).model_dump_json().encode()


FORMATS: dict[str, ExportFormat] = {
    "geojson": ExportFormat("application/geo+json", "geojson", _geojson),
    "kml": ExportFormat("application/vnd.google-earth.kml+xml", "kml", lambda targets, _: kml_of_targets(targets)),
    "gpx": ExportFormat("application/gpx+xml", "gpx", lambda targets, _: gpx_of_targets(targets)),
    "csv": ExportFormat("text/csv; charset=utf-8", "csv", lambda targets, _: csv_of_targets(targets)),
    # Events without an element around them: RFC 7303, section 9.3.
    "cot": ExportFormat("application/xml-external-parsed-entity", "cot", cot_of_targets),
}


def file_name(ending: str, now_us: int) -> str:
    """A name that sorts by time and overwrites no earlier download: ``targets-20260501T093000Z.kml``."""
    moment = iso_utc(now_us).replace("-", "").replace(":", "")
    return f"targets-{moment.partition('.')[0]}Z.{ending}"
