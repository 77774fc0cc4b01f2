"""The scripts of the built console stay small enough for a slow link: all of them together, compressed."""

from __future__ import annotations

import gzip

from tests.e2e.demo_process import ROOT

MOST_BYTES = 400_000


def test_all_scripts_together_are_small() -> None:
    scripts = sorted((ROOT / "frontend/dist/assets").glob("*.js"))
    assert scripts, "the console is not built: run 'make setup'"

    sizes = {path.name: len(gzip.compress(path.read_bytes())) for path in scripts}

    assert sum(sizes.values()) < MOST_BYTES, sizes


def test_plots_are_loaded_only_when_they_are_opened() -> None:
    page = (ROOT / "frontend/dist/index.html").read_text()

    assert list((ROOT / "frontend/dist/assets").glob("Plots-*.js"))
    assert "Plots-" not in page
