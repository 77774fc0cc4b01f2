"""Answers as JSON lines, CSV and GeoJSON."""

from __future__ import annotations

import csv
import io
import json
from dataclasses import asdict, fields
from pathlib import Path
from typing import Any

from backend.photos.session import PhotoAnswer
from geodata.flight_write import write_atomically

_DIGITS = {"lat_deg": 8, "lon_deg": 8, "outlier_probability": 5}
COLUMNS = tuple(f.name for f in fields(PhotoAnswer) if f.name != "failed")


def as_object(answer: PhotoAnswer) -> dict[str, Any]:
    """One answer for JSON."""
    values = {k: v for k, v in asdict(answer).items() if k != "failed"}
    return {k: round(v, _DIGITS.get(k, 3)) if isinstance(v, float) else v for k, v in values.items()}


def write_answers(path: Path, answers: list[PhotoAnswer]) -> None:
    """Write CSV or GeoJSON, by the ending of the file's name; whole or not at all.

    A refused place is in the CSV with its reason; a map shows accepted ones only.
    """
    if path.suffix.lower() == ".csv":
        text = io.StringIO()
        table = csv.DictWriter(text, COLUMNS, lineterminator="\n")
        table.writeheader()
        table.writerows({k: "" if v is None else v for k, v in as_object(a).items()} for a in answers)
        content = text.getvalue()
    else:
        content = json.dumps(as_geojson(answers), indent=1) + "\n"
    write_atomically(path, content.encode())


def as_geojson(answers: list[PhotoAnswer]) -> dict[str, Any]:
    """A FeatureCollection of the accepted answers (RFC 7946: longitude first)."""
    features = []
    for answer in answers:
        if not answer.accepted or answer.lat_deg is None or answer.lon_deg is None:
            continue
        properties = as_object(answer)
        coordinates = [properties.pop("lon_deg"), properties.pop("lat_deg")]
        if properties["alt_amsl_m"] is not None:
            coordinates.append(properties["alt_amsl_m"])
        features.append(
            {
                "type": "Feature",
                "geometry": {"type": "Point", "coordinates": coordinates},
                "properties": properties,
            }
        )
    return {"type": "FeatureCollection", "features": features}
