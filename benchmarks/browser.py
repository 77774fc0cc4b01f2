"""What the operator sees, in a real Chromium on the loopback."""

from __future__ import annotations

import os
import time
from pathlib import Path
from typing import Any

from benchmarks.budget import Measurement, percentile, unmeasured
from benchmarks.flying import FlyingStation

DRAWN_MEDIAN_MS, DRAWN_P95_MS, CLICK_P95_MS = 50.0, 120.0, 250.0
PATIENCE_MS = 60_000.0
NAMES = ("wire to drawn, median", "wire to drawn, p95", "click to coordinate shown, p95")

# Notes when the pointer goes down and when the list of targets has grown and the frame with it is about to be painted.
_WATCH_CLICKS = """() => {
    const count = () => document.querySelectorAll('[data-testid=target]').length;
    const bench = window.pilotageBench = { times: [], down: null, had: count() };
    addEventListener('pointerdown', () => { bench.down = performance.now(); bench.had = count(); }, true);
    new MutationObserver(() => {
        if (bench.down === null || count() <= bench.had) return;
        const down = bench.down;
        bench.down = null;
        requestAnimationFrame(() => bench.times.push(performance.now() - down));
    }).observe(document.body, { childList: true, subtree: true });
}"""


def measure_browser(station: FlyingStation, short: bool) -> list[Measurement]:
    """Latency of the video and of clicks; not measured where there is no Chromium or no built console."""
    chromium = Path(os.environ.get("CHROMIUM", "/usr/bin/chromium"))
    if not chromium.exists():
        return unmeasured(NAMES, f"no browser at {chromium}: run 'make chromium' or set CHROMIUM")
    try:
        from playwright.sync_api import Error, sync_playwright  # noqa: PLC0415  a development dependency
    except ImportError:
        return unmeasured(NAMES, "playwright is not installed: run from a checkout (make bench)")
    with sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=str(chromium), args=["--no-sandbox", "--disable-dev-shm-usage"]
        )
        try:
            page = browser.new_page(viewport={"width": 1440, "height": 900})
            page.goto(station.address)
            page.wait_for_function("() => (window.pilotageDebug?.framesDrawn ?? 0) > 50", timeout=PATIENCE_MS)
            return [*_video(page, 8.0 if short else 60.0), _clicks(page, 10 if short else 60)]
        except Error as error:
            return unmeasured(NAMES, f"the page did not do as expected: {error.message.splitlines()[0]}")
        finally:
            browser.close()


def _video(page: Any, seconds: float) -> list[Measurement]:
    drawn = "window.pilotageDebug.framesDrawn"
    before, started_s = page.evaluate(drawn), time.monotonic()
    page.wait_for_timeout(seconds * 1e3)
    rate = (page.evaluate(drawn) - before) / (time.monotonic() - started_s)
    # The page keeps the last 500 values: 20 s at 25 frames/s.
    told = page.evaluate("() => ({...window.pilotageDebug.drawLatencyMs})")
    kind = page.evaluate("window.pilotageDebug.decoder")
    note = f"{rate:.1f} frames/s drawn, {kind}"
    return [
        Measurement(NAMES[0], told["median"], "ms", DRAWN_MEDIAN_MS, note=note),
        Measurement(NAMES[1], told["p95"], "ms", DRAWN_P95_MS),
    ]


def _clicks(page: Any, count: int) -> Measurement:
    page.evaluate(_WATCH_CLICKS)
    box = page.get_by_test_id("video-stage").bounding_box()
    for n in range(count):
        across, down = 0.3 + 0.4 * (n % 7) / 6.0, 0.3 + 0.4 * (n % 5) / 4.0
        page.mouse.click(box["x"] + across * box["width"], box["y"] + down * box["height"])
        page.wait_for_function("n => window.pilotageBench.times.length > n", arg=n, timeout=PATIENCE_MS)
    times_ms = [float(value) for value in page.evaluate("window.pilotageBench.times")]
    note = f"{count} clicks, median {percentile(times_ms, 0.5):.3g} ms"
    return Measurement(NAMES[2], percentile(times_ms, 0.95), "ms", CLICK_P95_MS, note=note)
