"""The map's displacement from surveyed targets, on the ellipsoid of pyproj."""

from pathlib import Path

import numpy as np
import pyproj
import pytest
import typer
from typer.testing import CliRunner

from backend.replay.cli import register

GEOD = pyproj.Geod(ellps="WGS84")


def run(*arguments: str) -> tuple[int, str]:
    app = typer.Typer()
    register(app)
    done = CliRunner().invoke(app, ["map-offset", *arguments])
    return done.exit_code, done.output


def tables(folder: Path, north_m: float, east_m: float, count: int = 9) -> tuple[str, str]:
    rng = np.random.default_rng(1)
    there, here = ["target,lat_deg,lon_deg"], ["target,lat_deg,lon_deg,alt_amsl_m,ce90_m,method,observations"]
    for n in range(count):
        lat, lon = 47.0 + 0.001 * n, 8.0 - 0.0015 * n
        there.append(f"t{n},{lat:.9f},{lon:.9f}")
        # where the map has it: the surveyed place less the offset
        d_north, d_east = rng.normal(0.0, 0.3, 2) - (north_m, east_m)
        x, y, _ = GEOD.fwd(lon, lat, np.degrees(np.arctan2(d_east, d_north)), np.hypot(d_east, d_north))
        here.append(f"t{n},{y:.9f},{x:.9f},400,0.6,fused,3")
    here.append("unsurveyed,47,8,400,1,fused,1")
    for name, rows in (("survey.csv", there), ("targets.csv", here)):
        (folder / name).write_text("\n".join(rows) + "\n")
    return str(folder / "survey.csv"), str(folder / "targets.csv")


def test_the_offset_is_what_the_map_was_moved_by(tmp_path: Path) -> None:
    status, said = run(*tables(tmp_path, -2.0, 5.8), "--std-m", "0.3")

    assert status == 0
    north, east = (float(v) for v in said.split("[")[1].split("]")[0].split(","))
    assert (north, east) == pytest.approx((-2.0, 5.8), abs=0.35)
    assert "9 points" in said


@pytest.mark.parametrize(
    ("survey", "reason"),
    [
        ("target,lat_deg,lon_deg\nother,47,8\n", "0 targets are in both files"),
        ("target,lat_deg\nt1,47\n", "no column 'lon_deg'"),
        ("target,lat_deg,lon_deg\nt1,47,x\n", "line 2"),
        ("target,lat_deg,lon_deg\nt1,97,8\n", "no coordinate"),
    ],
)
def test_what_gives_no_offset_is_refused_in_words(tmp_path: Path, survey: str, reason: str) -> None:
    _, found = tables(tmp_path, 0.0, 0.0)
    (tmp_path / "bad.csv").write_text(survey)

    status, said = run(str(tmp_path / "bad.csv"), found)

    assert status == 1
    assert reason in said
