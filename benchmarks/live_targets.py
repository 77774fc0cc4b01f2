"""``python -m benchmarks.live_targets``: how good clicks on a live video are, at once and when they have been refined.

A flight with ``clicks.csv`` and ``targets_truth.csv`` is played into a station of its own in real time, as an aircraft
would send it. Each recorded click is made on its picture as soon as that has been shown and the estimator is where it
was taken. Its first answer, and what the target has become when its picture was registered, are compared with the
truth.
"""

from __future__ import annotations

import asyncio
import json
import math
import struct
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Annotated, Any

import httpx
import typer
import websockets
from rich.console import Console
from rich.table import Table

from backend.demo import free_udp_ports
from backend.replay.live import moments
from benchmarks.budget import percentile
from benchmarks.flying import ADDRESS, command, started, wait_for
from benchmarks.targets import Miss, miss_of, summary
from geodata.flight import FlightFolder
from geodata.flight_tables import Click, TargetTruth

SAME_PICTURE_US = 30_000
PATIENCE_S = 30.0
BEHIND_S = 1.0  # the estimator's horizon is a quarter of a second behind the video
AT_ONCE, LATER = "1 click, at once", "1 click, refined"


def run_flight(flight: Path, denied: bool, limit_s: float) -> dict[str, Any]:
    """Play one flight and compare."""
    folder = FlightFolder.open(flight)
    known = folder.targets_truth()
    with tempfile.TemporaryDirectory(prefix="pilotage-live-") as scratch:
        mavlink_port, video_port = free_udp_ports(2)
        serve = [
            "serve", "--port", "0", "--data-dir", f"{scratch}/data", "--map", str(flight / "reference.tif"),
            "--camera", str(flight / "flight.json"), "--mavlink", f"udpin:127.0.0.1:{mavlink_port}",
            "--video", f"udp://127.0.0.1:{video_port}",
        ]  # fmt: skip
        with started(serve, Path(scratch) / "station.log") as (station, said):
            address = wait_for(lambda: ADDRESS.search(said.read_text()), station, said)[0]
            play = [
                "replay", str(flight), "--live", "--mavlink", f"udpout:127.0.0.1:{mavlink_port}",
                "--video", f"udp://127.0.0.1:{video_port}", "--station", address if denied else "none",
            ]  # fmt: skip
            return asyncio.run(_click_along(address, folder, known, play, limit_s, Path(scratch) / "player.log"))


async def _click_along(
    address: str, folder: FlightFolder, known: dict[str, TargetTruth], play: list[str], limit_s: float, log: Path
) -> dict[str, Any]:
    clicks = [click for click in folder.clicks() if click.target in known]
    first = next(moment.frame.frame_id for moment in moments(folder) if moment.frame is not None)
    made: list[tuple[Click, dict[str, Any]]] = []
    times_ms: list[float] = []
    refused: list[str] = []
    jobs: set[asyncio.Task[None]] = set()

    async with (
        httpx.AsyncClient(base_url=address, timeout=30.0) as client,
        websockets.connect(f"{address.replace('http', 'ws')}/api/v1/video/cam-1", max_size=None, max_queue=None) as ws,
    ):

        async def click_on(click: Click, frame_id: int) -> None:
            await asyncio.sleep(BEHIND_S)
            body = {"vehicle_id": "1", "frame_id": frame_id, "u_px": click.u_px, "v_px": click.v_px}
            began_s = time.perf_counter()
            answer = await client.post("/api/v1/targets", json={**body, "name": click.target})
            times_ms.append((time.perf_counter() - began_s) * 1e3)
            if answer.status_code == 201:
                made.append((click, answer.json()))
            else:
                refused.append(answer.json().get("detail", ""))

        with log.open("wb") as out, subprocess.Popen(command(play), stdout=out, stderr=out) as player:
            try:
                began_id: int | None = None
                waiting = sorted(clicks, key=lambda click: click.t_video_us)
                end_s = time.monotonic() + limit_s
                while waiting and time.monotonic() < end_s:
                    packet = bytes(await asyncio.wait_for(ws.recv(), PATIENCE_S))  # type: ignore[arg-type]
                    (length,) = struct.unpack_from(">I", packet)
                    header = json.loads(packet[4 : 4 + length])
                    began_id = header["frame_id"] if began_id is None else began_id
                    at_us = folder.frame_time_us(first + header["frame_id"] - began_id)
                    if at_us is None:
                        continue
                    while waiting and waiting[0].t_video_us < at_us - SAME_PICTURE_US:
                        refused.append(f"no picture of {waiting.pop(0).t_video_us}")
                    while waiting and abs(waiting[0].t_video_us - at_us) <= SAME_PICTURE_US:
                        job = asyncio.create_task(click_on(waiting.pop(0), header["frame_id"]))
                        jobs.add(job)
                await asyncio.gather(*jobs)
            finally:
                player.terminate()
        final = await _settled(client)
        metrics = (await client.get("/metrics")).text
    return _compared(folder, known, made, final, times_ms, refused, metrics)


async def _settled(client: httpx.AsyncClient) -> dict[str, dict[str, Any]]:
    """All targets once none waits for its registration."""
    for _ in range(600):
        features = (await client.get("/api/v1/targets")).json()["features"]
        if all(feature["properties"]["registration"] != "waiting" for feature in features):
            break
        await asyncio.sleep(0.2)
    return {feature["id"]: feature for feature in features}


def _compared(
    folder: FlightFolder, known: dict[str, TargetTruth], made: list[tuple[Click, dict[str, Any]]],
    final: dict[str, dict[str, Any]], times_ms: list[float], refused: list[str], metrics: str,
) -> dict[str, Any]:  # fmt: skip
    misses: list[Miss] = []
    words: dict[str, int] = {}
    for click, answer in made:
        for what, feature in ((AT_ONCE, answer), (LATER, final[answer["id"]])):
            at = feature["properties"]
            misses.append(miss_of(what, known[click.target], at["lat_deg"], at["lon_deg"], at["ce90_m"]))
        told = final[answer["id"]]["properties"]["registration"] or ""
        words[told] = words.get(told, 0) + 1
    return {
        "flight": folder.name, "found": summary(misses), "registration": words, "refused": refused,
        "click_p50_ms": percentile(times_ms, 0.5) if times_ms else math.nan,
        "click_p95_ms": percentile(times_ms, 0.95) if times_ms else math.nan,
        "registration_ms": _mean_ms(metrics, "click_registration"), "refined_ms": _mean_ms(metrics, "click_to_refined"),
    }  # fmt: skip


def _mean_ms(metrics: str, stage: str) -> float:
    found = {
        kind: float(line.rsplit(" ", 1)[1])
        for line in metrics.splitlines()
        for kind in ("sum", "count")
        if f"_{kind}{{" in line and f'stage="{stage}"' in line
    }
    return 1e3 * found["sum"] / found["count"] if found.get("count") else math.nan


def main(
    flights: Annotated[list[Path] | None, typer.Argument(help="Flight folders.")] = None,
    data: Annotated[Path, typer.Option(help="The evaluation data.")] = Path("../shared/data"),
    denied: Annotated[bool, typer.Option(help="Keep GPS from the estimator when the flight says so.")] = True,
    limit_s: Annotated[float, typer.Option(help="End after so long.")] = 600.0,
    as_json: Annotated[bool, typer.Option("--json", help="Print JSON.")] = False,
) -> None:
    """Play flights into a station, click along, and print how far the targets are from the truth."""
    rows = [
        run_flight(flight, denied, limit_s)
        for flight in flights or [data / "flights" / name for name in ("plane_80m", "copter_120m")]
    ]
    if as_json:
        typer.echo(json.dumps(rows, indent=1))
        return
    titles = ("CE50 m", "CE90 m", "worst m", "stated CE90 m", "inside CE90")
    table = Table("flight", "by", "count", *titles, box=None)
    console = Console(width=140)
    for row in rows:
        for what, of in row["found"].items():
            keys = ("ce50_m", "ce90_m", "worst_m", "stated_ce90_m", "inside_ce90")
            table.add_row(row["flight"], what, f"{of['count']:.0f}", *(f"{of[k]:.2f}" for k in keys))
    console.print(table)
    for row in rows:
        console.print({key: value for key, value in row.items() if key != "found"})


if __name__ == "__main__":
    typer.run(main)
