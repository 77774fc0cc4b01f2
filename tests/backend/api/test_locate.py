"""Where pixels lie, over REST: what a click may be told of heights, crosshair, footprint, cut-out."""

import hashlib
import json
from pathlib import Path

import cv2
import numpy as np
import pyproj
import pytest

from backend.evidence.bundle import pack, unpack
from backend.evidence.schema import HASH_FIELD, content_sha256
from tests.backend.evidence.flown import STRIDE, VEHICLE, click, click_body, evidence_zip, hilly_station
from tests.backend.evidence.test_service import run_verify
from tests.backend.station_runner import RunningStation


async def test_the_chosen_height_is_kept_and_proven(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        plain = (await click(running))["properties"]
        target = await click(running, height_above_ground_m=12.0, ground="flat")
        answer = await evidence_zip(running, target["id"])
        again = (await running.client.get(f"/api/v1/targets/{target['id']}")).json()
        moved = await running.client.patch(f"/api/v1/targets/{target['id']}", json={"lat_deg": 47.0, "lon_deg": 8.0})
    (tmp_path / "flat.zip").write_bytes(answer.content)

    assert (plain["height_above_ground_m"], plain["ground"], plain["method"]) == (0.0, "terrain", "ray_terrain")
    kept = again["properties"]
    assert (kept["height_above_ground_m"], kept["ground"], kept["method"]) == (12.0, "flat", "ray_flat")
    assert kept["ce90_m"] > 1.05 * plain["ce90_m"]
    evidence = unpack(answer.content, "answer").evidence
    assert (evidence.ground.target_height_m, evidence.ground.model.kind) == (12.0, "flat")
    verified = run_verify(tmp_path / "flat.zip")
    assert verified.exit_code == 0, verified.output
    assert moved.json()["properties"]["ground"] is None


async def test_heights_that_make_no_sense_are_refused(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        post = running.client.post
        answers = [
            await post("/api/v1/targets", json=click_body(height_above_ground_m=5000.0)),
            await post("/api/v1/targets", json=click_body(ground="water")),
            await post("/api/v1/targets", json={"lat_deg": 47.0, "lon_deg": 8.0, "height_above_ground_m": 3.0}),
            await post("/api/v1/targets", json=click_body(u_px=8.0, v_px=16.0)),
        ]
        listed = (await running.client.get("/api/v1/targets")).json()

    assert [answer.status_code for answer in answers] == [422, 422, 400, 422]
    assert "beyond the elevation model" in answers[3].json()["detail"]
    assert listed["features"] == []


def locate_body(**changes: object) -> dict[str, object]:
    return {"frame_id": STRIDE + 30, "u_px": 100.25, "v_px": 190.75, **changes}


LOCATE = f"/api/v1/vehicles/{VEHICLE}/locate"


async def test_the_crosshair_tells_what_a_click_would_and_keeps_nothing(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        choice = {"height_above_ground_m": 3.0, "ground": "terrain"}
        seen = (await running.client.post(LOCATE, json=locate_body(**choice))).json()
        nothing = (await running.client.get("/api/v1/targets")).json()
        target = (await click(running, **choice))["properties"]

    assert nothing["features"] == []
    ring = np.array(seen.pop("ellipse95_px"))
    assert {name: target[name] for name in seen} == seen
    assert np.all(ring[0] == ring[-1])
    # Perspective shifts the middle of a ring, but not by a tenth of it.
    assert np.hypot(*(ring[:-1].mean(axis=0) - [100.25, 190.75])) < 0.1 * np.ptp(ring, axis=0).max()


async def test_the_ring_in_the_frame_holds_the_ellipse_on_the_ground(tmp_path: Path) -> None:
    """Each of its pixels, located on level ground at the place's own height, lies on the ellipse's edge."""
    async with hilly_station(tmp_path) as running:
        flat = {"ground": "flat"}
        seen = (await running.client.post(LOCATE, json=locate_body(**flat))).json()
        on_ring = []
        for u_px, v_px in seen["ellipse95_px"][:-1:4]:
            place = await running.client.post(LOCATE, json=locate_body(u_px=u_px, v_px=v_px, **flat))
            on_ring.append((place.json()["lat_deg"], place.json()["lon_deg"]))

    cov = np.array([[seen["std_n_m"] ** 2, seen["cov_ne_m2"]], [seen["cov_ne_m2"], seen["std_e_m"] ** 2]])
    for lat_deg, lon_deg in on_ring:
        azimuth, _, away_m = pyproj.Geod(ellps="WGS84").inv(seen["lon_deg"], seen["lat_deg"], lon_deg, lat_deg)
        ne_m = away_m * np.array([np.cos(np.radians(azimuth)), np.sin(np.radians(azimuth))])
        assert ne_m @ np.linalg.solve(cov, ne_m) == pytest.approx(5.991, rel=0.02)  # chi-square, 2 degrees of freedom


async def test_every_refusal_of_the_crosshair_says_why(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:

        async def refused(body: dict[str, object], address: str = LOCATE) -> tuple[int, str]:
            answer = await running.client.post(address, json=body)
            assert answer.headers["content-type"] == "application/problem+json"
            return answer.status_code, answer.json()["detail"]

        outside = await refused(locate_body(u_px=900.0))
        beyond = await refused(locate_body(u_px=8.0, v_px=16.0))
        expired = await refused(locate_body(frame_id=10**9))
        stranger = await refused(locate_body(), "/api/v1/vehicles/9/locate")
        unknown = await refused(locate_body(colour="red"))

    assert (outside[0], beyond[0], expired[0], stranger[0], unknown[0]) == (400, 422, 404, 404, 422)
    assert "outside the frame of 320 x 240" in outside[1]
    assert "beyond the elevation model" in beyond[1]
    assert "not held" in expired[1]
    assert "no vehicle '9'" in stranger[1]


async def test_a_footprint_is_the_grid_of_its_pixels_places(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        address = f"/api/v1/vehicles/{VEHICLE}/frames/{STRIDE + 30}/footprint"
        found = (await running.client.get(f"{address}?columns=5&rows=4")).json()
        flat = (await running.client.get(f"{address}?columns=5&rows=4&ground=flat&height_above_ground_m=2")).json()
        places = []
        for i in range(20):
            at = {"u_px": found["u_px"][i % 5], "v_px": found["v_px"][i // 5]}
            places.append(await running.client.post(LOCATE, json=locate_body(**at)))
        gone = await running.client.get(f"/api/v1/vehicles/{VEHICLE}/frames/1000000/footprint")
        coarse = await running.client.get(f"{address}?columns=1")

    assert (found["u_px"][0], found["u_px"][-1], found["v_px"][-1]) == pytest.approx((-0.5, 319.5, 239.5), abs=0.02)
    for point, place in zip(found["points"], places, strict=True):
        if point is None:
            assert place.status_code == 422
        else:
            assert point == [place.json()["lat_deg"], place.json()["lon_deg"]]
    # Three pixels at the top look past the elevation model; level ground goes on.
    assert [i for i, point in enumerate(found["points"]) if point is None] == [0, 1, 4]
    assert None not in flat["points"]
    assert found["centre"] == found["points"][12]  # of row 2, column 2
    assert found["ce90_m"] == places[12].json()["ce90_m"]
    assert (gone.status_code, coarse.status_code) == (404, 422)


def decoded(data: bytes) -> np.ndarray:
    picture = cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    return picture


async def chip(running: RunningStation, target_id: str, query: str = "") -> tuple[int, bytes, str]:
    answer = await running.client.get(f"/api/v1/targets/{target_id}/picture{query}")
    return answer.status_code, answer.content, answer.headers["content-type"]


@pytest.mark.parametrize(("u_px", "v_px"), [(160.4, 120.0), (4.0, 200.0)])
async def test_the_picture_of_a_target_is_the_video_about_the_pixel(tmp_path: Path, u_px: float, v_px: float) -> None:
    async with hilly_station(tmp_path) as running:
        target = await click(running, 30, u_px, v_px, ground="flat")
        status, data, kind = await chip(running, target["id"], "?size_px=64")
        whole = await running.client.get(f"/api/v1/video/cam-{VEHICLE}/frames/{STRIDE + 30}.jpg")
        too_large = await chip(running, target["id"], "?size_px=4000")
    cut, frame = decoded(data), decoded(whole.content)
    framed = cv2.copyMakeBorder(frame, 32, 32, 32, 32, cv2.BORDER_CONSTANT, value=(0, 0, 0))
    row, column = round(v_px), round(u_px)

    assert (status, kind, cut.shape) == (200, "image/jpeg", (64, 64, 3))
    difference = cut.astype(float) - framed[row : row + 64, column : column + 64]
    assert np.abs(difference).mean() < 4.0  # of coding it twice
    assert too_large[0] == 422


async def test_a_target_without_a_picture_has_none_and_says_why(tmp_path: Path) -> None:
    async with hilly_station(tmp_path) as running:
        client = running.client
        typed = (await client.post("/api/v1/targets", json={"lat_deg": 47.0, "lon_deg": 8.0})).json()
        moved, blind, spoilt = [await click(running) for _ in range(3)]
        await client.patch(f"/api/v1/targets/{moved['id']}", json={"lat_deg": 47.0, "lon_deg": 8.0})
        for target, picture in ((blind, None), (spoilt, b"no picture")):
            path = tmp_path / "evidence" / f"{target['id']}.zip"
            path.write_bytes(without_picture((await evidence_zip(running, target["id"])).content, picture))
        answers = [
            await client.get(f"/api/v1/targets/{t['id']}/picture") for t in (typed, moved, blind, spoilt, {"id": "x"})
        ]

    assert [answer.status_code for answer in answers] == [404] * 5
    details = [answer.json()["detail"] for answer in answers]
    assert "typed in" in details[0]
    assert "moved by hand" in details[1]
    assert "no picture was kept: it was gone" in details[2]
    assert "cannot be read" in details[3]


def without_picture(bundle: bytes, picture: bytes | None) -> bytes:
    """A whole bundle with another picture, or none."""
    content = json.loads(unpack(bundle, "bundle").document)
    content["picture"] = {"file": None, "sha256": None, "problem": "it was gone"}
    if picture is not None:
        content["picture"] = {"file": "frame.jpg", "sha256": hashlib.sha256(picture).hexdigest(), "problem": None}
    content[HASH_FIELD] = content_sha256(content)
    return pack(json.dumps(content).encode(), picture)
