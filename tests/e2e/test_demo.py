"""The demonstration as an operator meets it: the command, the page in a browser, the switch, a click, the numbers."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pytest
from playwright.sync_api import expect

from tests.e2e.demo_console import SEED, WORLDS, Console, open_console
from tests.e2e.demo_process import OUTPUT
from tests.e2e.flown_truth import FlownTruth, flown_s

PATIENCE_S = 225.0
VIDEO_PX = (640, 480)
# A pixel of the page is 1.2 of the video; the browser may round where the pointer is.
POINTER_PX = 1.5
LEAST_LIKENESS = 0.9
# A right estimate is farther away than this one time in 3000.
MOST_SIGMAS = 4.0
# An ellipse that says nothing would hold any truth.
WIDEST_CE90_M = 15.0
ESTIMATED_MODES = ("vision", "dead_reckoning")

pytestmark = pytest.mark.timeout(240)


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Console]:
    with open_console(tmp_path, (1440, 900), PATIENCE_S, "end") as opened:
        yield opened


def test_demo(console: Console) -> None:
    page, deadline = console.page, console.deadline
    expect.set_options(timeout=60_000)

    # Tracks grow and the picture moves.
    console.wait_until("d.trackLengths.gps >= 5 && d.trackLengths.vision >= 5 && d.framesDrawn >= 25")
    before = console.debug("trackLengths")
    drawn = console.debug("framesDrawn")
    console.wait_until(
        "d.trackLengths.gps > n[0] && d.trackLengths.vision > n[1] && d.framesDrawn >= n[2] + 25",
        before["gps"], before["vision"], drawn,
    )  # fmt: skip
    mode = page.get_by_test_id("mode")
    expect(mode).to_have_attribute("data-mode", "gps", timeout=deadline.left_ms)
    console.photograph("1-gps")

    # Without GPS the estimator's track goes on.
    deny = page.get_by_test_id("deny-gps")
    expect(deny).to_have_attribute("aria-checked", "false")
    deny.click(timeout=deadline.left_ms)
    expect(deny).to_have_attribute("aria-checked", "true", timeout=deadline.left_ms)
    expect(mode).to_have_attribute("data-gps-denied", "true", timeout=deadline.left_ms)
    page.wait_for_function(
        "(modes) => modes.includes(document.querySelector('[data-testid=mode]').dataset.mode)",
        arg=list(ESTIMATED_MODES), timeout=deadline.left_ms, polling=100,
    )  # fmt: skip
    length = console.debug("trackLengths.vision")
    console.wait_until("d.trackLengths.vision >= n[0] + 10", length)
    (vehicle,) = console.get("vehicles")
    assert console.get(f"vehicles/{vehicle['id']}/state")["mode"] in ESTIMATED_MODES
    console.photograph("2-gps-denied")

    # A click in the paused picture is a target, on the page as in the interface.
    page.get_by_test_id("video-pause").click(timeout=deadline.left_ms)
    console.wait_until("d.paused && d.lastFrameId !== null")
    frame_id = console.debug("lastFrameId")
    box = page.get_by_test_id("video-stage").bounding_box()
    assert box is not None
    check_crosshair(console, box)
    click = {"x": 0.5 * box["width"], "y": 0.4 * box["height"]}
    page.get_by_test_id("video-stage").click(position=click, timeout=deadline.left_ms)
    entry = page.get_by_test_id("target")
    expect(entry).to_have_count(1, timeout=deadline.left_ms)
    (target,) = console.get("targets")["features"]
    about = target["properties"]
    assert entry.get_attribute("data-target-id") == target["id"]
    assert float(entry.get_attribute("data-lat") or "nan") == pytest.approx(about["lat_deg"], abs=1e-9)
    assert float(entry.get_attribute("data-lon") or "nan") == pytest.approx(about["lon_deg"], abs=1e-9)
    assert target["geometry"]["coordinates"][:2] == pytest.approx([about["lon_deg"], about["lat_deg"]], abs=1e-9)
    assert about["frame_id"] == frame_id
    assert (about["u_px"], about["v_px"]) == pytest.approx(clicked_pixel(click, box), abs=POINTER_PX)
    console.photograph("3-target")
    # While the station still holds the picture.
    check_list_and_overlay(console, target["id"], frame_id)
    check_against_truth(console, about)

    # The pictures' clock is named, and a map says where it can be matched.
    expect(page.get_by_text("the vehicle's own")).to_be_visible(timeout=deadline.left_ms)
    page.get_by_role("tab", name="Maps").click(timeout=deadline.left_ms)
    page.get_by_role("button", name="Matchability").click(timeout=deadline.left_ms)
    expect(page.get_by_text("median sigma")).to_be_visible(timeout=deadline.left_ms)
    console.photograph("4-matchability")
    check_home(console, vehicle["id"])

    assert not console.errors
    assert not console.demo.ended, "".join(console.demo.said)


def check_home(console: Console, vehicle_id: str) -> None:
    """Without GPS it is flown towards home by vision; one press has it stand, another ends that."""
    page, left_ms = console.page, console.deadline.left_ms
    page.get_by_test_id("tab-fly").click(timeout=left_ms)
    page.get_by_test_id("show-way").click(timeout=left_ms)
    expect(page.get_by_test_id("way-words")).to_contain_text("above the highest ground", timeout=left_ms)
    assert console.get(f"vehicles/{vehicle_id}/homing")["active"] is False
    console.photograph("5-way-home")
    # A press is not a hold.
    page.get_by_test_id("fly-home").click(timeout=left_ms)
    assert console.get(f"vehicles/{vehicle_id}/homing")["active"] is False
    page.get_by_test_id("fly-home").hover(timeout=left_ms)
    page.mouse.down()
    bar = page.get_by_test_id("homing-bar")
    expect(bar).to_be_visible(timeout=left_ms)
    page.mouse.up()
    expect(bar).to_have_attribute("data-phase", "follow", timeout=left_ms)
    farther = console.get(f"vehicles/{vehicle_id}/homing")["remaining_m"]
    while (told := console.get(f"vehicles/{vehicle_id}/homing"))["remaining_m"] > farther - 30.0:
        assert told["active"] and console.deadline.left_s > 1.0, told
        page.wait_for_timeout(200)
    console.photograph("6-flying-home")
    page.get_by_test_id("abort-homing").click(timeout=left_ms)
    expect(bar).to_have_attribute("data-phase", "hold", timeout=left_ms)
    page.get_by_test_id("abort-homing").click(timeout=left_ms)
    expect(bar).to_have_count(0, timeout=left_ms)


def check_crosshair(console: Console, box: Any) -> None:
    """The crosshair tells a coordinate and keeps none; another height moves it."""
    page, left_ms = console.page, console.deadline.left_ms
    page.mouse.move(box["x"] + 0.7 * box["width"], box["y"] + 0.7 * box["height"])
    position, height = page.get_by_test_id("aim-position"), page.get_by_test_id("aim-height")
    expect(position).to_have_attribute("data-frame-id", str(console.debug("lastFrameId")), timeout=left_ms)
    at_ground = position.get_attribute("data-lat")
    height.fill("30")
    expect(position).not_to_have_attribute("data-lat", at_ground or "", timeout=left_ms)
    height.fill("0")
    assert console.get("targets")["features"] == []


def check_list_and_overlay(console: Console, target_id: str, frame_id: int) -> None:
    """The target has its picture; a deletion is taken back; the paused frame lies on the map."""
    page, left_ms = console.page, console.deadline.left_ms
    picture = page.get_by_test_id("target-picture")
    expect(picture).to_have_js_property("naturalWidth", 64, timeout=left_ms)
    page.get_by_test_id("target-delete").click(timeout=left_ms)
    expect(page.get_by_test_id("target")).to_have_count(0, timeout=left_ms)
    page.keyboard.press("Control+z")
    expect(page.get_by_test_id("target")).to_have_attribute("data-target-id", target_id, timeout=left_ms)
    page.keyboard.press("o")
    said = page.get_by_test_id("overlay-said")
    expect(said).to_have_attribute("data-frame-id", str(frame_id), timeout=left_ms)
    console.photograph("3-overlay")
    page.keyboard.press("o")
    assert [feature["id"] for feature in console.get("targets")["features"]] == [target_id]


def clicked_pixel(click: dict[str, float], box: Any) -> tuple[float, float]:
    """The pixel of the video below a point of the stage: the picture is fitted in, pixel 0 is centred at 0."""
    width, height = VIDEO_PX
    scale = min(box["width"] / width, box["height"] / height)
    left, top = (box["width"] - scale * width) / 2, (box["height"] - scale * height) / 2
    return (click["x"] - left) / scale - 0.5, (click["y"] - top) / scale - 0.5


def check_against_truth(console: Console, about: dict[str, Any]) -> None:
    """The target lies inside its scaled ellipse about the point that the simulator's camera truly saw there."""
    vehicle = about["vehicle_id"]
    answer = console.client.get(f"/api/v1/video/cam-{vehicle}/frames/{about['frame_id']}.jpg")
    assert answer.status_code == 200, answer.text
    picture = cv2.imdecode(np.frombuffer(answer.content, np.uint8), cv2.IMREAD_COLOR)
    assert picture is not None
    cv2.imwrite(str(OUTPUT / "clicked.jpg"), picture)
    pieces = console.get(f"vehicles/{vehicle}/tracks", source="gps")["features"]
    times = [t for piece in pieces for t in piece["properties"]["times_unix_us"]]
    places = [place for piece in pieces for place in piece["geometry"]["coordinates"]]

    truth = FlownTruth.of_demo(SEED, WORLDS / "pilotage/worlds", flown_s(times))
    take_off_us = truth.take_off_us(times, [p[1] for p in places], [p[0] for p in places])
    exposure, likeness = truth.exposure_of(picture, about["t_unix_us"] - take_off_us)
    assert likeness > LEAST_LIKENESS, "no exposure of the true flight gives the clicked picture"

    lat_rad, lon_rad = np.radians(about["lat_deg"]), np.radians(about["lon_deg"])
    error_ne_m = truth.world.frame.ne_from_geodetic(lat_rad, lon_rad) - truth.ground_ne_m(
        exposure, about["u_px"], about["v_px"]
    )
    cov = np.array([[about["std_n_m"] ** 2, about["cov_ne_m2"]], [about["cov_ne_m2"], about["std_e_m"] ** 2]])
    sigmas = float(np.sqrt(error_ne_m @ np.linalg.solve(cov, error_ne_m)))
    found = (
        f"{np.hypot(*error_ne_m):.2f} m or {sigmas:.2f} sigma off, CE90 {about['ce90_m']:.2f} m, alike {likeness:.3f}"
    )
    (OUTPUT / "target.txt").write_text(found + "\n")
    assert sigmas < MOST_SIGMAS, found
    assert about["ce90_m"] < WIDEST_CE90_M, found
