"""Planning and commanding as an operator does: the mouse on the map, held buttons, and what the aircraft answers."""

from __future__ import annotations

import json
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
import pytest
from playwright.sync_api import Page, Route, expect, sync_playwright

from backend.demo import free_udp_ports
from tests.backend.station_process import await_words, free_port, start
from tests.e2e.demo_console import CHROMIUM, reported
from tests.e2e.demo_process import OUTPUT, ROOT, Deadline
from tests.e2e.plan_aircraft import FlyingAircraft

PATIENCE_S = 225.0
HELD_MS = 1500
# Three corners of a right angle, as shares of the map.
CORNERS = ((0.30, 0.35), (0.70, 0.35), (0.70, 0.70))
# A centimetre: what a position of 1e-7 degrees is good for.
SAME_DEG = 1.1e-7
PLAN_ADDRESS = "**/api/v1/vehicles/1/plan"

pytestmark = pytest.mark.timeout(240)


@dataclass(slots=True)
class Bench:
    page: Page
    client: httpx.Client
    errors: list[str]

    def by(self, name: str) -> Any:
        return self.page.get_by_test_id(name)

    def place(self, x: float, y: float) -> tuple[float, float]:
        """Where a share of the map lies on the page."""
        box = self.by("map").bounding_box()
        assert box is not None
        return box["x"] + x * box["width"], box["y"] + y * box["height"]

    def stand_still(self) -> None:
        """Wait until nothing above the map comes or goes any more, such as what the station waits for."""
        before = None
        while before != (before := self.by("map").bounding_box()):
            self.page.wait_for_timeout(1200)

    def plan(self) -> Any:
        answer = self.client.get("/api/v1/vehicles/1/plan", params={"format": "plan"})
        assert answer.status_code == 200, answer.text
        return answer.json()

    def places(self) -> list[list[float]]:
        """Latitude, longitude and height of the items that are kept."""
        return [item["params"][4:7] for item in self.plan()["mission"]["items"]]

    def kept(self) -> None:
        expect(self.by("plan")).to_have_attribute("data-state", "saved")

    def hold(self, name: str, for_ms: float) -> None:
        button = self.by(name)
        button.scroll_into_view_if_needed()
        box = button.bounding_box()
        assert box is not None
        self.page.mouse.move(box["x"] + box["width"] / 2, box["y"] + box["height"] / 2)
        self.page.mouse.down()
        self.page.wait_for_timeout(for_ms)
        self.page.mouse.up()

    def photograph(self, name: str) -> None:
        for width, height in ((1280, 720), (1920, 1080)):
            self.page.set_viewport_size({"width": width, "height": height})
            self.page.wait_for_timeout(250)
            self.page.screenshot(path=OUTPUT / f"{name}-{height}.png")
        self.page.set_viewport_size({"width": 1440, "height": 900})


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    assert (ROOT / "frontend/dist/index.html").exists(), "the console is not built: run 'make setup'"
    assert CHROMIUM.exists(), f"no browser at {CHROMIUM}: run 'make chromium' or set CHROMIUM"
    OUTPUT.mkdir(exist_ok=True)
    deadline = Deadline.after(PATIENCE_S)
    port, (mavlink,) = free_port(), free_udp_ports(1)
    address = f"http://127.0.0.1:{port}"
    station = start(tmp_path / "data", port, "--video", "none", "--mavlink", f"udpin:127.0.0.1:{mavlink}")
    aircraft: FlyingAircraft | None = None
    try:
        await_words(station, f"127.0.0.1:{port}")
        aircraft = FlyingAircraft(mavlink, OUTPUT / "worlds")
        with sync_playwright() as playwright, httpx.Client(base_url=address, timeout=60.0) as client:
            browser = playwright.chromium.launch(
                executable_path=str(CHROMIUM), args=["--no-sandbox", "--disable-dev-shm-usage"]
            )
            page = browser.new_page(viewport={"width": 1440, "height": 900})
            page.set_default_timeout(30_000)
            errors: list[str] = []
            page.on("pageerror", lambda error: errors.append(str(error)))
            page.on("console", lambda said: errors.extend(reported(said)))
            page.goto(address, timeout=deadline.left_ms)
            try:
                yield Bench(page, client, errors)
            finally:
                page.screenshot(path=OUTPUT / "plan-end.png")
                browser.close()
    finally:
        if aircraft is not None:
            aircraft.close()
        station.terminate()
        station.communicate(timeout=30)


def test_plan_and_commands(bench: Bench) -> None:
    expect.set_options(timeout=30_000)
    page = bench.page
    expect(bench.by("mode")).to_have_attribute("data-mode", "gps")
    bench.by("tab-plan").click()
    expect(bench.by("plan-send")).to_be_disabled()
    bench.by("follow").click()
    # The last thing that the station waits for, which moves the map down when it comes.
    expect(bench.by("waiting")).to_contain_text("a reference map")
    bench.stand_still()

    draw_and_keep(bench)
    up_and_down(bench)
    fence_and_problems(bench)
    another_page(bench)
    commands(bench)
    assert bench.errors == ["Failed to load resource: the server responded with a status of 412 (Precondition Failed) "
                            f"{page.url}api/v1/vehicles/1/plan"]  # fmt: skip


def draw_and_keep(bench: Bench) -> None:
    """Three points by the mouse, one dragged, one put on a leg and taken back; a reload changes nothing."""
    page = bench.page
    bench.by("tool-points").click()
    for corner in CORNERS:
        page.mouse.click(*bench.place(*corner))
    expect(bench.by("plan-item")).to_have_count(3)
    # The map draws what the list has a moment later, and only what is drawn can be taken hold of.
    bench.kept()
    page.wait_for_timeout(500)
    x, y = bench.place(*CORNERS[2])
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x - 30, y + 20, steps=4)
    page.mouse.up()
    bench.kept()
    drawn = bench.places()
    # North is up and east is right.
    assert drawn[0][0] == pytest.approx(drawn[1][0], abs=SAME_DEG)
    assert drawn[1][1] > drawn[0][1]
    assert drawn[2][0] < drawn[1][0]
    assert drawn[2][1] < drawn[1][1]
    assert [place[2] for place in drawn] == [50, 50, 50]

    page.mouse.click(*bench.place(0.5, 0.35))
    expect(bench.by("plan-item")).to_have_count(4)
    page.keyboard.press("Delete")
    expect(bench.by("plan-item")).to_have_count(3)
    page.keyboard.press("Control+z")
    page.keyboard.press("Control+z")
    expect(bench.by("plan-item")).to_have_count(3)
    page.keyboard.press("Escape")
    expect(bench.by("plan-hint")).to_have_count(0)

    height = bench.by("item-height").nth(1)
    height.fill("60")
    height.press("Enter")
    hold = bench.by("item-hold").nth(1)
    hold.fill("5")
    hold.press("Enter")
    speed = bench.by("item-speed").nth(1)
    speed.fill("8")
    speed.press("Enter")
    bench.kept()
    items = bench.plan()["mission"]["items"]
    assert [item["command"] for item in items] == [16, 16, 178, 16]
    assert (items[1]["params"][0], items[1]["params"][6], items[2]["params"][1]) == (5, 60, 8)
    expect(bench.by("plan-length")).not_to_have_text("–")

    page.reload()
    bench.by("tab-plan").click()
    expect(bench.by("plan-item")).to_have_count(3)
    bench.by("follow").click()
    expect(bench.by("waiting")).to_contain_text("a reference map")
    bench.stand_still()


def up_and_down(bench: Bench) -> None:
    """The vehicle takes the mission, holds the same, and gives the same back."""
    before = bench.plan()["mission"]["items"]
    bench.by("plan-send").click()
    operation = bench.by("plan-operation")
    expect(operation).to_have_attribute("data-state", "accepted")
    expect(operation).to_contain_text("read back and compared: mission of 4 items")
    bench.by("plan-compare").click()
    expect(operation).to_have_attribute("data-same", "true")
    bench.by("plan-fetch").click()
    expect(operation).to_contain_text("kept: mission of 4 items")
    expect(bench.by("plan-undo")).to_be_enabled()  # what was drawn can be gone back to
    bench.kept()
    after = bench.plan()["mission"]["items"]
    assert [item["command"] for item in after] == [item["command"] for item in before]
    for sent, back in zip(before, after, strict=True):
        if sent["command"] == 16:
            assert back["params"][4:6] == pytest.approx(sent["params"][4:6], abs=SAME_DEG)
            assert (back["params"][0], back["params"][6]) == (sent["params"][0], sent["params"][6])


def fence_and_problems(bench: Bench) -> None:
    """A zone over a leg is a problem, sending asks first, and what the vehicle does not take it says."""
    bench.by("plan-item").first.get_by_role("button").first.click()
    bench.page.wait_for_timeout(500)  # the map goes to the item
    bench.by("tool-circle").click()
    bench.by("fence-out").click()
    bench.page.mouse.click(*bench.place(0.5, 0.42))
    bench.page.keyboard.press("Escape")
    problem = bench.by("plan-problem")
    expect(problem).to_have_count(1)
    expect(problem).to_have_attribute("data-kind", "exclusion")
    expect(problem).to_contain_text("the leg from item 1 to item 2 enters a zone to stay out of")
    bench.by("plan-send").click()
    bench.by("send-anyway").click()
    operation = bench.by("plan-operation")
    expect(operation).to_have_attribute("data-state", "rejected")
    expect(operation).to_contain_text("fence: the vehicle does not support it")
    bench.photograph("plan")


def another_page(bench: Bench) -> None:
    """A program changes the plan while the page saves: neither overwrites the other unasked."""
    theirs = bench.plan()
    del theirs["mission"]["items"][-1]

    def overtake(route: Route) -> None:
        if route.request.method == "PUT":
            bench.client.put("/api/v1/vehicles/1/plan", content=json.dumps(theirs)).raise_for_status()
        route.continue_()

    bench.page.route(PLAN_ADDRESS, overtake)
    height = bench.by("item-height").first
    height.fill("77")
    height.press("Enter")
    expect(bench.by("plan-conflict")).to_be_visible()
    bench.page.unroute(PLAN_ADDRESS)
    assert bench.plan() == theirs
    bench.by("take-theirs").click()
    bench.kept()
    expect(bench.by("plan-item")).to_have_count(2)
    expect(height.locator("visible=true")).to_have_value("50")
    # And what the page wanted can still be gone back to.
    bench.by("plan-undo").click()
    bench.kept()
    assert bench.places()[0][2] == 77


def commands(bench: Bench) -> None:
    """What moves the aircraft has to be held; a refusal comes with the aircraft's own words."""
    bench.hold("command-mission", HELD_MS)
    current = bench.page.locator("[data-testid=plan-item][data-current=true]")
    expect(current).to_have_count(1)

    bench.by("tab-fly").click()
    bench.hold("command-disarm", 300)
    expect(bench.page.locator("[data-testid=command]").filter(has_text="Disarm")).to_have_count(0)
    bench.hold("command-disarm", HELD_MS)
    disarm = bench.page.locator("[data-testid=command]").filter(has_text="Disarm")
    expect(disarm).to_have_attribute("data-state", "rejected")
    expect(disarm).to_contain_text("the autopilot denied it (“Disarm: not landed”)")

    go = bench.by("command-goto")
    expect(go).to_be_disabled()
    bench.by("goto-pick").click()
    bench.page.keyboard.press("Escape")
    expect(bench.by("goto-pick")).to_have_attribute("aria-pressed", "false")
    bench.by("goto-pick").click()
    bench.page.mouse.click(*bench.place(0.5, 0.5))
    expect(go).to_be_disabled()  # the height is not named yet
    bench.by("goto-height").fill("60")
    # By key, as a button that is held.
    bench.by("command-orbit").focus()
    bench.page.keyboard.down("Enter")
    bench.page.wait_for_timeout(HELD_MS)
    bench.page.keyboard.up("Enter")
    orbit = bench.page.locator("[data-testid=command]").filter(has_text="Orbit")
    expect(orbit).to_have_attribute("data-state", "accepted")
    expect(bench.by("fly-state")).to_have_text("Armed, CIRCLE")
    bench.photograph("fly")
    bench.by("command-hold").click()
    expect(bench.by("fly-state")).to_have_text("Armed, LOITER")
