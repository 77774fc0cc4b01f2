"""A study's results as Markdown, JSON and plot."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from benchmarks.studies.plot import bars_svg
from benchmarks.studies.run import Result
from benchmarks.studies.study import Study


def table(study: Study, results: Sequence[Result]) -> str:
    """The Markdown table alone."""
    heads = ["row", "what changes", *(column.title for column in study.columns)]
    lines = ["| " + " | ".join(heads) + " |", "|" + "---|" * len(heads)]
    for result in results:
        cells = [column.cell(result.figures) for column in study.columns]
        failed = f" ({len(result.failures)} failed)" if result.failures else ""
        lines.append("| " + " | ".join([result.name + failed, result.change, *cells]) + " |")
    return "\n".join(lines) + "\n"


def write_results(study: Study, results: Sequence[Result], command: str, seeds: Sequence[int], folder: Path) -> Path:
    """Write ``<study>.md``, ``.json`` and ``.svg`` into a folder; returns the page's path."""
    folder.mkdir(parents=True, exist_ok=True)
    rows = [(result.name, result.figures.get(study.plotted)) for result in results]
    (folder / f"{study.name}.svg").write_text(bars_svg(study.title, study.plot_label, rows))
    about = {
        "study": study.name,
        "command": command,
        "seeds": list(seeds),
        "rows": [_finite(asdict(result)) for result in results],
    }
    (folder / f"{study.name}.json").write_text(json.dumps(about, indent=1, allow_nan=False) + "\n")
    failures = [
        f"* {result.name}, seed {seed}: {reason}" for result in results for seed, reason in result.failures.items()
    ]
    page = (
        f"# {study.title}\n\n{study.about}\n\n"
        f"Run: `{command}`, {len(seeds)} seed{'s' if len(seeds) != 1 else ''} ({_span(seeds)}).\n\n"
        f"{table(study, results)}\n![{study.title}]({study.name}.svg)\n"
    )
    if failures:
        page += "\nFailed, and in no figure:\n\n" + "\n".join(failures) + "\n"
    path = folder / f"{study.name}.md"
    path.write_text(page)
    return path


def _span(seeds: Sequence[int]) -> str:
    run = list(seeds) == list(range(seeds[0], seeds[0] + len(seeds)))
    return f"{seeds[0]} to {seeds[-1]}" if run and len(seeds) > 1 else ", ".join(map(str, seeds))


def _finite(value: Any) -> Any:
    """The same without infinities, which JSON has not."""
    if isinstance(value, dict):
        return {str(key): _finite(inner) for key, inner in value.items()}
    if isinstance(value, float) and not math.isfinite(value):
        return None
    return value
