"""The API keeps what its OpenAPI description promises: generated requests to every GET endpoint."""

import asyncio
import threading
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import pytest
import schemathesis
from hypothesis import HealthCheck, Phase, given, settings

from tests.backend.station_runner import running_station


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    data_dir: Path = tmp_path_factory.mktemp("station")
    found: list[str] = []
    up, loop, ended = threading.Event(), asyncio.new_event_loop(), asyncio.Event()

    async def run() -> None:
        async with running_station(data_dir) as running:
            await running.client.post("/api/v1/targets", json={"lat_deg": 47.0, "lon_deg": 8.0})
            found.append(running.address)
            up.set()
            await ended.wait()

    thread = threading.Thread(target=loop.run_until_complete, args=(run(),))
    thread.start()
    assert up.wait(20)
    yield found[0]
    loop.call_soon_threadsafe(ended.set)
    thread.join(20)
    loop.close()


EXCLUDED = [
    schemathesis.checks.unsupported_method,
    schemathesis.checks.positive_data_acceptance,
    schemathesis.checks.negative_data_rejection,
    schemathesis.checks.missing_required_header,
]


def test_every_get_answers_as_described(address: str) -> None:
    schema = schemathesis.openapi.from_url(f"{address}/openapi.json").include(method="GET")
    asked: set[str] = set()
    for found in schema.get_all_operations():
        operation = found.ok()

        @given(case=operation.as_strategy())
        @settings(
            max_examples=15, deadline=None, derandomize=True, phases=[Phase.explicit, Phase.generate],
            suppress_health_check=list(HealthCheck), database=None,
        )  # fmt: skip
        def ask(case: Any) -> None:
            case.call_and_validate(excluded_checks=EXCLUDED)

        ask()
        asked.add(operation.path)

    assert "/api/v1/vehicles/{vehicle_id}/tracks" in asked
    assert "/api/v1/targets" in asked
    assert len(asked) >= 14
