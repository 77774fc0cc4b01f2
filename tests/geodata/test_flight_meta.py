from __future__ import annotations

import json
import math
from typing import Any

import pytest
from pydantic import ValidationError

from geodata.flight_meta import FlightMeta
from tests.shared_data import shared_data

CAMERA: dict[str, Any] = {"width_px": 640, "height_px": 480, "fx_px": 500.0}


def meta(**sections: Any) -> FlightMeta:
    return FlightMeta.model_validate({"schema": "pilotage.flight/1", **sections})


@pytest.mark.parametrize("name", ["copter_120m", "plane_80m", "ariel_b"])
def test_real_descriptions_are_read_to_the_last_number(name: str) -> None:
    text = json.loads(shared_data(f"flights/{name}/flight.json").read_text())

    flight = FlightMeta.model_validate(text)

    assert flight.camera is not None
    assert flight.camera.fx_px == text["camera"]["fx_px"]
    assert list(flight.camera.distortion) == text["camera"]["distortion"]
    assert flight.camera.mount.pitch_deg == text["camera"]["mount"]["pitch_deg"]
    assert flight.video.start_time_us == text["video"]["start_time_us"]
    assert flight.video.time_offset_s == text["video"]["time_offset_s"]
    assert [list(pair) for pair in flight.gps_denied] == text["gps_denied"]
    assert list(flight.map.offset_ne_m) == text["map"].get("offset_ne_m", [0.0, 0.0])
    assert flight.home is not None
    assert flight.home.lat_deg == text["home"]["lat_deg"]


def test_the_least_there_can_be() -> None:
    flight = meta()
    assert flight.camera is None
    assert flight.video.time_offset_s == 0.0
    assert flight.gps_denied == ()


def test_null_is_absent_but_for_an_unknown_delay() -> None:
    flight = meta(
        camera={**CAMERA, "distortion": None, "mount": None, "gimbal": None, "cx_px": None},
        video={"file": None, "start_time_us": None, "time_offset_s": None},
        map={"reference": None, "offset_ne_m": None, "elevation": None, "ground_alt_amsl_m": None},
        gps_denied=None, home=None, pad=None, vehicle=None,
    )  # fmt: skip
    assert flight.camera is not None
    assert flight.camera.distortion == (0.0,) * 5
    assert flight.camera.mount.pitch_deg == -90.0
    assert (flight.camera.cx_px, flight.camera.cy_px, flight.camera.fy_px) == (319.5, 239.5, 500.0)
    assert flight.video.time_offset_s is None
    assert flight.map.offset_ne_m == (0.0, 0.0)


def test_unknown_keys_are_kept() -> None:
    flight = meta(weather="fog", camera={**CAMERA, "serial": "A17"})
    dumped = flight.model_dump(mode="json", by_alias=True)
    assert dumped["weather"] == "fog"
    assert dumped["camera"]["serial"] == "A17"
    assert dumped["schema"] == "pilotage.flight/1"
    assert FlightMeta.model_validate(dumped) == flight


@pytest.mark.parametrize(
    ("sections", "field"),
    [
        ({"camera": {**CAMERA, "fx_px": -1.0}}, "camera.fx_px"),
        ({"camera": {**CAMERA, "fx_px": math.nan}}, "camera.fx_px"),
        ({"camera": {**CAMERA, "width_px": 10**9}}, "camera.width_px"),
        ({"camera": {**CAMERA, "distortion": [0.1] * 9}}, "camera.distortion"),
        ({"camera": {**CAMERA, "gimbal": "wobbly"}}, "camera.gimbal"),
        ({"camera": {**CAMERA, "cx_px": 5000.0}}, "camera"),
        ({"camera": {"width_px": 640, "height_px": 480}}, "camera.fx_px"),
        ({"vehicle": {"type": "submarine"}}, "vehicle.type"),
        ({"vehicle": {"system_id": 0}}, "vehicle.system_id"),
        ({"gps_denied": [[5, 3]]}, "gps_denied"),
        ({"home": {"lat_deg": 91, "lon_deg": 0, "alt_amsl_m": 0}}, "home.lat_deg"),
        ({"video": {"time_offset_s": math.inf}}, "video.time_offset_s"),
        ({"schema": "pilotage.flight/9"}, "schema"),
    ],
)
def test_impossible_values_are_refused_by_name(sections: dict[str, Any], field: str) -> None:
    with pytest.raises(ValidationError) as caught:
        meta(**sections)
    assert ".".join(map(str, caught.value.errors()[0]["loc"])).startswith(field)


def test_description_without_schema_is_refused() -> None:
    with pytest.raises(ValidationError, match="schema"):
        FlightMeta.model_validate({"name": "x"})
