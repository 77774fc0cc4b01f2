"""The time under everything: marks appear, a scrub holds map, picture, HUD and plots, and what is exported is true."""

from __future__ import annotations

import csv
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from playwright.sync_api import Locator, Page, expect

from tests.e2e.demo_console import Console, open_console

PATIENCE_S = 225.0
METRES_PER_DEG = 111_200.0
"""Of a degree of latitude anywhere, to half a percent: errors of metres are compared to centimetres."""
SEEN_S = 12.0

pytestmark = pytest.mark.timeout(240)


@pytest.fixture
def console(tmp_path: Path) -> Iterator[Console]:
    with open_console(tmp_path, (1920, 1080), PATIENCE_S, "time-end") as opened:
        yield opened


def test_timeline(console: Console) -> None:
    page = console.page
    expect.set_options(timeout=30_000)
    track = page.get_by_test_id("time-track")
    page.get_by_test_id("time-window").select_option("60000000")
    console.wait_until("d.trackLengths.vision >= 5 && d.framesDrawn >= 25")

    # Fixes, the mode and what the operator does are marks.
    page.get_by_test_id("deny-gps").click()
    marks = page.get_by_test_id("time-mark")
    expect(marks.and_(page.locator("[data-kind=gps_denied]"))).to_have_count(1)
    page.wait_for_function(
        "s => { const t = document.querySelector('[data-testid=time-track]').dataset;"
        " return Number(t.accepted) >= 3 && t.modes.includes('vision')"
        " && (document.querySelectorAll('[data-kind=gps_denied]')[0].dataset.tUs - t.atUs) / -1e6 > s; }",
        arg=SEEN_S, timeout=console.deadline.left_ms, polling=100,
    )  # fmt: skip
    console.photograph("time-1-live")

    check_scrub(console, track)
    check_target_of_the_past(console, marks)
    check_plots(console, track)

    # Back to now: everything moves again.
    page.keyboard.press("l")
    expect(page.get_by_test_id("time-badge")).to_have_text("LIVE")
    expect(page.get_by_test_id("map-paused")).to_have_count(0)
    drawn = console.debug("framesDrawn")
    console.wait_until("!d.paused && d.framesDrawn > n[0] + 10", drawn)

    # A page that comes late knows the hour before it.
    first_us = states(console)["t_unix_us"][0]
    page.reload()
    page.wait_for_function(
        "t => Number(document.querySelector('[data-testid=time-track]')?.dataset.accepted) >= 3",
        arg=0, timeout=console.deadline.left_ms, polling=100,
    )  # fmt: skip
    page.get_by_test_id("time-track").focus()
    page.get_by_test_id("time-window").select_option("300000000")
    page.get_by_test_id("time-track").focus()
    page.keyboard.press("Home")
    expect(page.get_by_test_id("time-track")).to_have_attribute("data-at-us", str(first_us))
    expect(page.get_by_test_id("video-message")).to_contain_text("no longer held")
    console.photograph("time-4-late")

    assert not console.errors
    assert not console.demo.ended, "".join(console.demo.said)


def check_scrub(console: Console, track: Locator) -> None:
    """A click on the track holds everything at that time; new data changes nothing of it."""
    page = console.page
    click_at(track, 0.9)
    badge = page.get_by_test_id("time-badge")
    expect(badge).to_contain_text("PAUSED")
    expect(page.get_by_test_id("map-paused")).to_be_visible()
    at_us = number(track, "data-at-us")
    from_us, to_us = number(track, "data-from-us"), number(track, "data-to-us")
    assert at_us == pytest.approx(from_us + 0.9 * (to_us - from_us), abs=0.6e6)
    console.wait_until("d.paused")
    held = page.get_by_test_id("hud").get_attribute("data-heading")
    at_that_time(console, at_us, float(held or "nan"))
    frame_id = console.debug("lastFrameId")
    console.photograph("time-2-held")

    newest = states(console)["t_unix_us"][-1]
    while states(console)["t_unix_us"][-1] < newest + 1_500_000:
        page.wait_for_timeout(100)
    assert page.get_by_test_id("hud").get_attribute("data-heading") == held
    assert (number(track, "data-from-us"), console.debug("lastFrameId")) == (from_us, frame_id)

    # Keys step by a picture, and with shift by a second.
    page.keyboard.press("ArrowLeft")
    console.wait_until("d.lastFrameId === n[0]", frame_id - 1)
    before_us = number(track, "data-at-us")
    page.keyboard.press("Shift+ArrowLeft")
    expect(track).not_to_have_attribute("data-at-us", str(round(before_us)))
    assert number(track, "data-at-us") == pytest.approx(before_us - 1e6, abs=0.1e6)


def check_target_of_the_past(console: Console, marks: Locator) -> None:
    """A click on the held picture is a target of its frame, and a mark at its time."""
    page = console.page
    console.wait_until("d.paused && d.lastFrameId !== null")
    page.wait_for_timeout(300)
    frame_id = console.debug("lastFrameId")
    box = page.get_by_test_id("video-stage").bounding_box()
    assert box is not None
    page.get_by_test_id("video-stage").click(position={"x": 0.5 * box["width"], "y": 0.5 * box["height"]})
    expect(page.get_by_test_id("target")).to_have_count(1)
    (target,) = console.get("targets")["features"]
    assert target["properties"]["frame_id"] == frame_id
    expect(marks.and_(page.locator("[data-kind=target]"))).to_have_attribute(
        "data-t-us", str(target["properties"]["t_unix_us"])
    )


def check_plots(console: Console, track: Locator) -> None:
    """Plots have their cursor at the held time, and their table agrees with what the station says."""
    page = console.page
    page.get_by_test_id("plots-toggle").click()
    plots = page.get_by_test_id("plots")
    expect(plots.locator("canvas").first).to_be_visible()
    expect(plots).to_have_attribute("data-at-us", track.get_attribute("data-at-us") or "")
    console.photograph("time-3-plots")
    page.set_viewport_size({"width": 1280, "height": 720})
    page.wait_for_timeout(300)
    console.photograph("time-3-plots-small")
    page.set_viewport_size({"width": 1920, "height": 1080})

    with page.expect_download() as download:
        page.get_by_test_id("plots-csv").click()
    rows = list(csv.DictReader(Path(download.value.path()).read_text().splitlines()))
    said = states(console)
    index = {t_us: i for i, t_us in enumerate(said["t_unix_us"])}
    both = [(row, index[int(row["t_unix_us"])]) for row in rows if int(row["t_unix_us"]) in index and row["std_n_m"]]
    assert len(both) > 20
    for row, i in both:
        for name in ("std_n_m", "std_e_m", "alt_amsl_m"):
            assert float(row[name]) == pytest.approx(said[name][i], rel=1e-4, abs=1e-3), name
    errors = [row for row in rows if row["error_north_m"]]
    assert len(errors) > 20
    own = [(float(row["error_north_m"]), gps_minus_estimate_north_m(console, int(row["t_unix_us"]))) for row in errors]
    off_m = np.abs([said_m - north_m for said_m, north_m in own if north_m is not None])
    # Between two states that the station kept a fix may have moved the estimate, by decimetres.
    assert len(off_m) > 20
    assert np.median(off_m) < 0.1
    assert off_m.max() < 2.0
    with page.expect_download() as picture:
        page.get_by_test_id("plots-png").click()
    assert Path(picture.value.path()).read_bytes()[:8] == b"\x89PNG\r\n\x1a\n"
    page.get_by_test_id("plots-toggle").click()
    expect(plots).to_have_count(0)


_history: dict[str, Any] = {}


def gps_minus_estimate_north_m(console: Console, t_us: int) -> float | None:
    """The same by the station's own numbers; None where the station keeps no reading of that time."""
    if not _history:
        _history.update(console.get("vehicles/1/history"))
    gps, said = _history["gps"], _history["states"]
    if t_us not in gps["t_unix_us"] or not said["t_unix_us"][0] <= t_us <= said["t_unix_us"][-1]:
        return None
    lat_deg = np.interp(t_us, said["t_unix_us"], said["lat_deg"])
    return float(METRES_PER_DEG * (gps["lat_deg"][gps["t_unix_us"].index(t_us)] - lat_deg))


def at_that_time(console: Console, t_us: float, heading_deg: float) -> None:
    """The HUD's heading is that of the station at a time, to what it turns in a fifth of a second."""
    said = states(console)
    nearest = min(range(len(said["t_unix_us"])), key=lambda i: abs(said["t_unix_us"][i] - t_us))
    off = (heading_deg - said["heading_deg"][nearest] + 180.0) % 360.0 - 180.0
    assert abs(off) < 12.0
    assert math.isfinite(off)


def states(console: Console) -> dict[str, Any]:
    return dict(console.get("vehicles/1/history")["states"])


def number(track: Locator, name: str) -> float:
    return float(track.get_attribute(name) or "nan")


def click_at(track: Locator, part: float) -> None:
    box = track.bounding_box()
    assert box is not None
    track.click(position={"x": part * box["width"], "y": box["height"] / 2})


__all__ = ["Page"]
