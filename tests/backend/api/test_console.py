"""The console's files, and nothing beside them."""

from __future__ import annotations

from pathlib import Path

import pytest

from backend.api.console import default_console_dir
from tests.backend.station_runner import running_station


def test_the_build_is_looked_for_in_the_checkout() -> None:
    assert default_console_dir().parent.joinpath("package.json").exists()


@pytest.mark.parametrize("path", ["/../secret.txt", "/%2e%2e/secret.txt", "/assets/..%2f..%2fsecret.txt", "/link.txt"])
async def test_only_the_consoles_own_files_are_served(tmp_path: Path, path: str) -> None:
    console = tmp_path / "console"
    (console / "assets").mkdir(parents=True)
    (console / "index.html").write_text("<title>here</title>")
    (console / "assets" / "a.js").write_text("1")
    (tmp_path / "secret.txt").write_text("secret")
    (console / "link.txt").symlink_to(tmp_path / "secret.txt")
    async with running_station(tmp_path / "data", console_dir=console) as running:
        answer = await running.client.get(path)
        asset = await running.client.get("/assets/a.js")

    assert answer.status_code == 404
    assert "secret" not in answer.text.replace(path, "")
    assert asset.text == "1"
