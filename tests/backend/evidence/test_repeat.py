"""``pilotage verify`` registers the picture again: on the map, on its piece, and of bundles that were altered."""

from __future__ import annotations

import hashlib
import json
import math
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest

from backend.evidence.bundle import Bundle, pack, unpack
from backend.evidence.piece import GROUND_FILE, MAP_FILE
from backend.evidence.schema import HASH_FIELD, content_sha256, read_document
from backend.evidence.verify import verify
from geodata.maps import MapLibrary
from tests.backend.evidence.laid import flight, registered_bundle
from tests.backend.evidence.test_service import run_verify

Change = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def station(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data folder with a map library; the bundle is beside it."""
    folder = tmp_path_factory.mktemp("station")
    (folder / "target.zip").write_bytes(registered_bundle(folder))
    return folder


@pytest.fixture
def read(station: Path) -> Bundle:
    return unpack((station / "target.zip").read_bytes(), "target.zip")


@pytest.fixture
def one_thread_plain_arithmetic() -> Iterator[None]:
    threads = cv2.getNumThreads()
    cv2.setNumThreads(1)
    cv2.setUseOptimized(False)
    yield
    cv2.setUseOptimized(True)
    cv2.setNumThreads(threads)


def changed(read: Bundle, change: Change, pieces: dict[Any, bytes] | None = None) -> bytes:
    """A bundle with another document, under hashes that fit it."""
    content = json.loads(read.document)
    change(content)
    content[HASH_FIELD] = content_sha256(content)
    return pack(json.dumps(content).encode(), read.picture, None, read.pieces if pieces is None else pieces)


def told(path: Path, *options: object) -> tuple[int, dict[str, Any]]:
    done = run_verify(path, "--json", *options)
    assert "Traceback" not in done.output
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, json.loads(done.stdout)


def verified(tmp_path: Path, data: bytes, *options: object) -> tuple[int, dict[str, Any]]:
    (tmp_path / "target.zip").write_bytes(data)
    return told(tmp_path / "target.zip", *options)


def sources() -> tuple[object, ...]:
    return "--map", flight().reference_path, "--elevation", flight().elevation_path


def test_a_registration_is_repeated_on_the_piece_of_the_map_in_the_bundle(station: Path, read: Bundle) -> None:
    status, said = told(station / "target.zip")
    again = said["registration"]

    assert (status, said["agrees"], again["outcome"]) == (0, True, "agrees")
    assert again["on"] == "the piece of it in the bundle"
    # the same machine, the same cells: what is found is the same to the last bit
    assert (again["distance_m"], again["cov_change"]) == (0.0, 0.0)
    assert read.evidence.placement is not None
    assert again["displacement_ne_m"] == list(read.evidence.placement.correction[:2])
    assert math.hypot(*again["displacement_ne_m"]) > 0.3
    assert len((station / "target.zip").read_bytes()) < 500_000


@pytest.mark.parametrize("corrected", [False, True])
def test_it_is_repeated_on_the_map_in_use_and_on_what_that_was_imported_from(tmp_path: Path, corrected: bool) -> None:
    """With ``corrected`` the search had set out from another state than the one of the coordinate."""
    (tmp_path / "target.zip").write_bytes(registered_bundle(tmp_path, corrected))
    library = MapLibrary(tmp_path / "maps")
    by_kind = {record.kind: library.raster_path(record.id) for record in library.list()}
    used = told(tmp_path / "target.zip", "--map", by_kind["imagery"], "--elevation", by_kind["elevation"])
    source = told(tmp_path / "target.zip", *sources())
    text = run_verify(tmp_path / "target.zip", *sources()).output

    for status, said in (used, source):
        assert (status, said["registration"]["outcome"]) == (0, "agrees"), said
        assert (said["registration"]["distance_m"], said["registration"]["cov_change"]) == (0.0, 0.0)
    assert f"registration repeated on '{flight().reference_path}': agrees; displacement N " in text
    assert "the file that the reference was imported from, 'reference.tif'" in text
    assert "the file that the elevation was imported from, 'elevation.tif'" in text
    assert text.endswith("  agrees\n")
    assert unpack((tmp_path / "target.zip").read_bytes(), "").evidence.state.corrected_by_later_fixes is corrected


@pytest.mark.usefixtures("one_thread_plain_arithmetic")
def test_other_arithmetic_than_the_stations_agrees_within_the_tolerance(station: Path) -> None:
    status, said = told(station / "target.zip")

    assert (status, said["registration"]["outcome"]) == (0, "agrees"), said


def test_what_is_not_there_to_repeat_it_with_is_said(tmp_path: Path, read: Bundle) -> None:
    def without_pieces(content: dict[str, Any]) -> None:
        for grid in ("map", "ground"):
            content["registration"][grid].update(files=[], problem="too large")

    (tmp_path / "target.json").write_bytes(read.document)
    alone, said = told(tmp_path / "target.json")
    assert (alone, said["registration"]["outcome"]) == (0, "not repeated")
    assert said["registration"]["reason"] == "the picture is in the .zip"
    assert run_verify(tmp_path / "target.json").output.endswith("  agrees, but its registration was not repeated\n")

    bare = changed(read, without_pieces, {})
    status, said = verified(tmp_path, bare)
    assert (status, said["registration"]["outcome"]) == (0, "not repeated")
    assert "no piece of the map (too large): give the map with --map" in said["registration"]["reason"]
    status, said = verified(tmp_path, bare, *sources()[:2])
    assert (status, said["registration"]["outcome"]) == (0, "not repeated")
    assert "no piece of the elevation (too large): give the elevation with" in said["registration"]["reason"]
    status, said = verified(tmp_path, bare, *sources())
    assert (status, said["registration"]["outcome"], said["registration"]["distance_m"]) == (0, "agrees", 0.0)


def test_another_map_is_no_map_to_repeat_it_on(station: Path) -> None:
    other = flight().path / "targets_truth.csv"
    status, said = told(station / "target.zip", "--map", other)

    assert (status, said["agrees"], said["registration"]["outcome"]) == (1, False, "not repeated")
    assert said["files"] == [{"file": str(other), "is": None}]


def test_a_picture_of_gigabytes_is_not_made(tmp_path: Path, read: Bundle) -> None:
    def enlarge(content: dict[str, Any]) -> None:
        camera, click = content["camera"], content["click"]
        for size, at, focal, centre in (
            ("width_px", "u_px", "fx_px", "cx_px"), ("height_px", "v_px", "fy_px", "cy_px"),
        ):  # fmt: skip
            camera[size] *= 1_000
            camera[focal] *= 1_000.0
            camera[centre] = (camera[centre] + 0.5) * 1_000 - 0.5
            click[f"camera_{at}"] = (click[at] + 0.5) * 1_000 - 0.5

    _, said = verified(tmp_path, changed(read, enlarge))

    assert said["registration"]["outcome"] == "not repeated"
    assert "larger than any in use" in said["registration"]["reason"]


@pytest.mark.parametrize("moved_m", [0.02, 3.0])
def test_a_placement_that_the_picture_does_not_give_is_found_though_its_arithmetic_is_right(
    tmp_path: Path, read: Bundle, moved_m: float
) -> None:
    """
    Fault: somebody moves the placement and states the coordinate that goes with it, under fitting hashes.
    Expected: the coordinate is recomputed to the millimetre; the registration repeated gives another.
    """
    content = json.loads(read.document)
    content["placement"]["correction"][0] += moved_m
    content[HASH_FIELD] = content_sha256(content)
    found = verify(read_document(json.dumps(content).encode(), "forged"), "forged").recomputed

    def forge(content: dict[str, Any]) -> None:
        content["placement"]["correction"][0] += moved_m
        content["result"].update(
            lat_deg=math.degrees(found.lat_rad), lon_deg=math.degrees(found.lon_rad), alt_amsl_m=found.alt_amsl_m,
            pos_ned_m=found.pos_ned_m.tolist(), cov_ned_m2=found.cov_ned_m2.tolist(),
        )  # fmt: skip

    status, said = verified(tmp_path, changed(read, forge))

    assert said["distance_m"] < 1e-3
    assert (status, said["agrees"], said["registration"]["outcome"]) == (1, False, "disagrees")
    assert said["registration"]["reason"] == "another coordinate"
    assert 0.5 * moved_m < said["registration"]["distance_m"] <= 1.01 * moved_m


@pytest.mark.parametrize(
    ("change", "said_of_it"),
    [
        (lambda c: c["placement"]["cov"][0].__setitem__(0, 4.0 * c["placement"]["cov"][0][0]), None),
        (lambda c: c["placement"].update(by="windows"), "matched by whole picture"),
        (lambda c: c["placement"].update(outlier_probability=0.29), "outlier probability"),
        (lambda c: c["registration"]["state"]["pos_ned_m"].__setitem__(0, 5.0), None),
        (
            lambda c: c["registration"]["settings"].update(max_outlier_probability=0.0),
            "no match: the match is too weak",
        ),
    ],
)
def test_other_statements_on_the_registration_disagree(
    tmp_path: Path, read: Bundle, change: Change, said_of_it: str | None
) -> None:
    status, said = verified(tmp_path, changed(read, change))

    assert (status, said["registration"]["outcome"]) == (1, "disagrees"), said
    assert said_of_it is None or said_of_it in said["registration"]["reason"]


@pytest.mark.parametrize(
    ("change", "said_of_it"),
    [
        (lambda s: s.update(speed=1.0), "missing or unknown"),
        (lambda s: s.pop("radius_m"), "missing or unknown"),
        (lambda s: s.update(radius_m="10"), "radius_m"),
        (lambda s: s.update(turn_rad=1e9), "larger than any that was made"),
        (lambda s: s["matcher"].update(heading_step_rad=1e-9), "larger than any that was made"),
        (lambda s: s.update(levels_px=[512] * 100), "larger than any that was made"),
        (lambda s: s["matcher"].update(channels="crystal ball"), "registration fails|fails"),
    ],
)
def test_settings_that_were_never_in_use_are_not_tried(
    tmp_path: Path, read: Bundle, change: Change, said_of_it: str
) -> None:
    status, said = verified(tmp_path, changed(read, lambda c: change(c["registration"]["settings"])))
    words = said["registration"]["reason"]

    assert said["registration"]["outcome"] in ("not repeated", "disagrees")
    assert any(word in words for word in said_of_it.split("|")), words
    assert status == (1 if said["registration"]["outcome"] == "disagrees" else 0)


def test_a_piece_that_is_not_of_the_map_is_found_with_the_map(tmp_path: Path, read: Bundle) -> None:
    """
    Fault: the piece of the map is exchanged for one that lies 2 m further north, under fitting hashes.
    Expected: on that piece the picture lies elsewhere; and with the map at hand it is seen not to be of it.
    """
    image = cv2.imdecode(np.frombuffer(read.pieces[MAP_FILE], np.uint8), cv2.IMREAD_GRAYSCALE)
    assert image is not None
    png = cv2.imencode(".png", np.roll(image, -4, axis=0))[1].tobytes()

    def exchange(content: dict[str, Any]) -> None:
        content["registration"]["map"]["files"][0]["sha256"] = hashlib.sha256(png).hexdigest()

    data = changed(read, exchange, {**read.pieces, MAP_FILE: png})
    status, said = verified(tmp_path, data)
    with_map, with_map_said = verified(tmp_path, data, *sources())

    assert (status, said["registration"]["outcome"]) == (1, "disagrees")
    assert (with_map, with_map_said["registration"]["outcome"]) == (1, "disagrees")
    assert "the piece in the bundle is not of this map" in with_map_said["registration"]["reason"]
    assert "pixels differ" in with_map_said["registration"]["reason"]


@pytest.mark.parametrize(
    ("file", "data", "said_of_it"),
    [
        (MAP_FILE, b"hello", "map.png is no PNG"),
        (MAP_FILE, cv2.imencode(".png", np.zeros((10, 10), np.uint8))[1].tobytes(), "map.png is no PNG of"),
        (GROUND_FILE, b"12345678", "ground.f64 has 8 bytes"),
    ],
)
def test_pieces_that_cannot_be_are_refused(
    tmp_path: Path, read: Bundle, file: str, data: bytes, said_of_it: str
) -> None:
    def exchange(content: dict[str, Any]) -> None:
        for grid in ("map", "ground"):
            for part in content["registration"][grid]["files"]:
                if part["file"] == file:
                    part["sha256"] = hashlib.sha256(data).hexdigest()

    status, said = verified(tmp_path, changed(read, exchange, {**read.pieces, file: data}))

    assert (status, said["agrees"]) == (1, False)
    assert said_of_it in said["error"]


@pytest.mark.parametrize(
    ("change", "said_of_it"),
    [
        (lambda c: c.update(registration=None), "go together"),
        (lambda c: c.update(schema="pilotage.evidence/3"), "the Pilotage that made it reads it"),
        (lambda c: c["registration"].update(ground_alt_amsl_m=0.0), "either a grid or at one altitude"),
        (lambda c: c["registration"]["map"].update(rows=10), "beyond its grid"),
        (lambda c: c["registration"]["map"].update(rows=10**9), "larger than any"),
        (lambda c: c["registration"]["map"]["files"].clear(), "map.png of which evidence.json knows nothing"),
        (lambda c: c["registration"]["map"]["files"][0].update(file="../evil.png"), "files"),
        (lambda c: c["registration"]["map"]["files"][0].update(sha256="0" * 64), "map.png was altered"),
        (lambda c: c["registration"]["state"].update(q_ned_from_camera=[1.0, 1.0, 0.0, 0.0]), "registration.state"),
    ],
)
def test_registrations_that_cannot_be_are_refused_in_words(
    tmp_path: Path, read: Bundle, change: Change, said_of_it: str
) -> None:
    status, said = verified(tmp_path, changed(read, change))

    assert (status, said["agrees"]) == (1, False)
    assert said_of_it in said["error"]
