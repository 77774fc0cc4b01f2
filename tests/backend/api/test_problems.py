"""Whatever goes wrong is answered as a problem, and no insides are shown."""

from __future__ import annotations

from pathlib import Path

import pytest

from backend.store.targets import TargetStore
from tests.backend.station_runner import running_station


async def test_a_fault_of_ours_is_told_without_its_insides_and_the_next_request_is_served(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def broken(_: TargetStore) -> None:
        raise RuntimeError(f"secret of {tmp_path}")

    async with running_station(tmp_path) as running:
        with monkeypatch.context() as patched:
            patched.setattr(TargetStore, "all", broken)
            failed = await running.client.get("/api/v1/targets")
        healthy = await running.client.get("/api/v1/targets")

    assert failed.status_code == 500
    assert failed.headers["content-type"] == "application/problem+json"
    assert "secret" not in failed.text
    assert str(tmp_path) not in failed.text
    assert "log" in failed.json()["detail"]
    assert healthy.status_code == 200


@pytest.mark.parametrize(
    ("method", "path", "content", "status"),
    [
        ("GET", "/api/v1/nonsense", b"", 404),
        ("PUT", "/api/v1/targets", b"{}", 405),
        ("POST", "/api/v1/targets", b"{", 422),
        ("POST", "/api/v1/targets", b"\xff\xfe", 422),
        ("POST", "/api/v1/targets", b'{"lat_deg": NaN, "lon_deg": 8}', 422),
        ("POST", "/api/v1/targets", b'{"lat_deg": 1e999, "lon_deg": 8}', 422),
        ("POST", "/api/v1/targets", b"[" * 50_000, 400),
        ("POST", "/api/v1/maps", b"not a form", 422),
        ("GET", "/api/v1/maps/../../etc/passwd", b"", 404),
        ("GET", "/api/v1/flights/..%2f..%2fetc", b"", 404),
    ],
)
async def test_every_refusal_is_a_problem_with_a_reason(
    tmp_path: Path, method: str, path: str, content: bytes, status: int
) -> None:
    async with running_station(tmp_path) as running:
        headers = {"Content-Type": "application/json"}
        answer = await running.client.request(method, path, content=content, headers=headers)
        health = await running.client.get("/healthz")

    assert answer.status_code == status
    assert answer.headers["content-type"] == "application/problem+json"
    body = answer.json()
    assert body["status"] == status
    assert body["title"]
    assert body["detail"]
    assert health.status_code == 200
