"""The demonstration's page in a browser, with the station's own answers beside it."""

from __future__ import annotations

import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import httpx
from playwright.sync_api import ConsoleMessage, Page, sync_playwright

from tests.e2e.demo_process import OUTPUT, ROOT, Deadline, RunningDemo, running_demo

SEED = 5
CHROMIUM = Path(os.environ.get("CHROMIUM", "/usr/bin/chromium"))
WORLDS = OUTPUT / "worlds"


@dataclass(slots=True)
class Console:
    """The open page beside the station's own answers."""

    page: Page
    client: httpx.Client
    demo: RunningDemo
    deadline: Deadline
    errors: list[str]

    def debug(self, expression: str) -> Any:
        return self.page.evaluate(f"() => window.pilotageDebug.{expression}")

    def wait_until(self, condition: str, *numbers: float) -> None:
        """Wait for a condition on ``d`` (pilotageDebug) and ``n`` (the numbers)."""
        self.page.wait_for_function(
            f"(n) => {{ const d = window.pilotageDebug; return d !== undefined && ({condition}); }}",
            arg=list(numbers), timeout=self.deadline.left_ms, polling=100,
        )  # fmt: skip

    def get(self, path: str, **parameters: str) -> Any:
        answer = self.client.get(f"/api/v1/{path}", params=parameters)
        assert answer.status_code == 200, answer.text
        return answer.json()

    def photograph(self, name: str) -> None:
        self.page.screenshot(path=OUTPUT / f"{name}.png")


@contextmanager
def open_console(folder: Path, size: tuple[int, int], patience_s: float, last: str) -> Iterator[Console]:
    """The page of a fresh demonstration; ``last`` names the picture of how it looked in the end."""
    assert (ROOT / "frontend/dist/index.html").exists(), "the console is not built: run 'make setup'"
    assert CHROMIUM.exists(), f"no browser at {CHROMIUM}: run 'make chromium' or set CHROMIUM"
    OUTPUT.mkdir(exist_ok=True)
    deadline = Deadline.after(patience_s)
    with running_demo(folder / "data", WORLDS, SEED, deadline) as demo, sync_playwright() as playwright:
        browser = playwright.chromium.launch(
            executable_path=str(CHROMIUM), args=["--no-sandbox", "--disable-dev-shm-usage"], timeout=deadline.left_ms
        )
        page = browser.new_page(viewport={"width": size[0], "height": size[1]})
        errors: list[str] = []
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.on("console", lambda said: errors.extend(reported(said)))
        with httpx.Client(base_url=demo.address, timeout=60.0) as client:
            page.goto(demo.address, timeout=deadline.left_ms)
            try:
                yield Console(page, client, demo, deadline, errors)
            finally:
                page.screenshot(path=OUTPUT / f"{last}.png")
                browser.close()


def reported(said: ConsoleMessage) -> list[str]:
    """What the browser itself reports as an error, such as an answer of 404; a map without the layer has one."""
    url = str(said.location.get("url"))
    return [f"{said.text} {url}"] if said.type == "error" and not url.endswith("/matchability") else []
