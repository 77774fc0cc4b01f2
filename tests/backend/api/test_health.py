"""Health, readiness, metrics, and the page when the console is not built."""

from pathlib import Path

from tests.backend.station_runner import running_station


async def test_alive_ready_and_measured(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        health = await running.client.get("/healthz")
        ready = await running.client.get("/readyz")
        metrics = await running.client.get("/metrics")

    assert health.json()["status"] == "ok"
    assert ready.json() == {"ready": True, "waiting_for": [], "cot": []}
    assert "pilotage_stage_seconds" in metrics.text
    assert "pilotage_disk_free_bytes" in metrics.text


async def test_a_missing_console_says_how_to_build_it(tmp_path: Path) -> None:
    async with running_station(tmp_path) as running:
        page = await running.client.get("/")

    assert page.status_code == 503
    assert "make setup" in page.text


async def test_a_built_console_is_served_beside_the_api(tmp_path: Path) -> None:
    console = tmp_path / "console"
    console.mkdir()
    (console / "index.html").write_text("<title>here</title>")
    async with running_station(tmp_path / "data", console_dir=console) as running:
        page = await running.client.get("/")
        api = await running.client.get("/api/v1/vehicles")

    assert page.text == "<title>here</title>"
    assert api.json() == []
