"""A landing as an operator flies it: give the pad, see it found without GPS, hold to land, and stand on it."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Page, TimeoutError, expect, sync_playwright

from simulator.recording import PAD_TARGET
from tests.e2e.demo_console import CHROMIUM, reported
from tests.e2e.demo_process import OUTPUT, ROOT, Deadline
from tests.e2e.landing_process import Flown, landing_scene

PATIENCE_S = 280.0
HOLD_MS, HOLDS = 10_000, 3
LANDINGS = 3
ON_THE_PAD_M = 1.0
"""Half the board's side: how near it lands where nothing else keeps the machine busy is in docs/results/landing.md."""
GIVEN_UP = "HOLDING BY VISION|LANDING ENDED"
METRES_PER_DEG = 111_320.0

pytestmark = pytest.mark.timeout(300)


@dataclass(slots=True)
class Landing:
    page: Page
    client: httpx.Client
    flown: Flown
    deadline: Deadline
    errors: list[str]

    def told(self) -> dict[str, Any]:
        answer = self.client.get("/api/v1/vehicles/1/landing")
        assert answer.status_code == 200, answer.text
        return dict(answer.json())

    def photograph(self, name: str) -> None:
        self.page.screenshot(path=OUTPUT / f"landing-{name}.png")


@pytest.fixture
def landing(tmp_path: Path) -> Iterator[Landing]:
    assert (ROOT / "frontend/dist/index.html").exists(), "the console is not built: run 'make setup'"
    assert CHROMIUM.exists(), f"no browser at {CHROMIUM}: run 'make chromium' or set CHROMIUM"
    OUTPUT.mkdir(exist_ok=True)
    deadline = Deadline.after(PATIENCE_S)
    with landing_scene(tmp_path, deadline) as flown, sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=str(CHROMIUM), args=["--no-sandbox", "--disable-dev-shm-usage"], timeout=deadline.left_ms
        )
        page = browser.new_page(viewport={"width": 1280, "height": 900})
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda said: errors.extend(word for word in reported(said) if not word.endswith("/pad")))
        with httpx.Client(base_url=flown.address, timeout=60.0) as client:
            page.goto(flown.address, timeout=deadline.left_ms)
            try:
                yield Landing(page, client, flown, deadline, errors)
            finally:
                page.screenshot(path=OUTPUT / "landing-end.png")
                browser.close()


def test_landing(landing: Landing) -> None:
    page, deadline = landing.page, landing.deadline
    page.get_by_test_id("tab-landing").click()
    expect(page.get_by_test_id("pad-mode")).to_have_text("NO PAD")
    page.get_by_test_id("pad-file").set_input_files(landing.flown.pad_file)
    expect(page.get_by_test_id("pad-name")).to_have_text("pad", timeout=deadline.left_ms)

    # Without GPS the pad comes into the picture, and is shown from above with the place over it.
    expect(page.get_by_test_id("gps-status")).to_have_text("no fix", timeout=deadline.left_ms)
    expect(page.get_by_test_id("landing")).to_have_attribute("data-mode", "tracking", timeout=deadline.left_ms)
    page.wait_for_function(
        "() => document.querySelector('[data-testid=pad-view] img')?.naturalWidth > 0", timeout=deadline.left_ms
    )
    expect(page.get_by_test_id("pad-cross")).to_be_visible(timeout=deadline.left_ms)
    expect(page.get_by_test_id("pad-outlines")).to_be_attached(timeout=deadline.left_ms)
    landing.photograph("1-tracking")

    # A press is not a hold.
    land = page.get_by_test_id("land")
    land.click(timeout=deadline.left_ms)
    assert landing.told()["descent"] is None
    begin(landing)
    expect(page.get_by_test_id("gaze")).to_have_attribute("aria-checked", "true", timeout=deadline.left_ms)

    # One press ends it where it is, another has the vehicle hold by itself, and it can be begun again from both.
    bar, abort, descent = (page.get_by_test_id(name) for name in ("landing-bar", "abort-landing", "descent"))
    expect(bar).not_to_contain_text("aiting for the vehicle", timeout=deadline.left_ms)
    abort.click(timeout=deadline.left_ms)
    expect(bar).to_have_attribute("data-phase", "hold", timeout=deadline.left_ms)
    expect(abort).to_have_text("END")
    landing.photograph("2-standing")
    abort.click(timeout=deadline.left_ms)
    expect(bar).to_have_count(0, timeout=deadline.left_ms)
    expect(descent).to_have_text("LANDING ENDED", timeout=deadline.left_ms)
    land_on_it(landing)
    landing.photograph("4-landed")
    assert miss_m(landing.flown) < ON_THE_PAD_M
    assert landing.errors == []


def land_on_it(landing: Landing) -> None:
    """Land, and again where a station that was kept from looking for seconds has rightly given it up."""
    page, given_up = landing.page, []
    for _ in range(LANDINGS):
        begin(landing)
        descent = page.get_by_test_id("descent")
        expect(descent).to_have_text(re.compile(f"DESCENDING|{GIVEN_UP}"), timeout=landing.deadline.left_ms)
        landing.photograph("3-descending")
        expect(descent).to_have_text(re.compile(f"LANDED|{GIVEN_UP}"), timeout=landing.deadline.left_ms)
        told = landing.told()["descent"]
        if told["phase"] == "landed":
            return
        given_up.append(told["reason"])
    raise AssertionError(f"given up {LANDINGS} times: {given_up}")


def begin(landing: Landing) -> None:
    """Hold the button until the landing has begun; anew where the pad went out of sight, which takes the hold back."""
    page = landing.page
    for _ in range(HOLDS):
        expect(page.get_by_test_id("land")).to_be_enabled(timeout=landing.deadline.left_ms)
        if held(page):
            return
    raise AssertionError(f"{HOLDS} holds of the button began no landing: {landing.told()}")


def held(page: Page) -> bool:
    """Whether holding the button for a while began a landing, though a line comes above it and moves it meanwhile."""
    box = page.get_by_test_id("land").bounding_box()
    assert box is not None
    page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
    page.mouse.down()
    panel = page.get_by_test_id("landing")
    panel.evaluate("panel => { panel.style.paddingTop = '60px'; }")
    try:
        page.locator("[data-testid=landing-bar]:not([data-phase=hold])").wait_for(timeout=HOLD_MS)
    except TimeoutError:
        return False
    finally:
        page.mouse.up()
        panel.evaluate("panel => { panel.style.paddingTop = ''; }")
    return True


def miss_m(flown: Flown) -> float:
    """How far the vehicle truly stands from the pad's centre, by the simulator's own record; ends the flight."""
    flown.aircraft.close()
    with (flown.truth / "truth.csv").open() as file:
        stands = list(csv.DictReader(file))[-1]
    with (flown.truth / "targets_truth.csv").open() as file:
        pad = next(row for row in csv.DictReader(file) if row["target"] == PAD_TARGET)
    lat_deg = float(pad["lat_deg"])
    north_m = (float(stands["lat_deg"]) - lat_deg) * METRES_PER_DEG
    east_m = (float(stands["lon_deg"]) - float(pad["lon_deg"])) * METRES_PER_DEG * math.cos(math.radians(lat_deg))
    return math.hypot(north_m, east_m)
