from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import rasterio
import typer
from rasterio.transform import from_origin
from typer.testing import CliRunner, Result

from geodata.cli import library_folder, register
from geodata.maps import MapLibrary
from tests.geodata import rasters


def run(*arguments: str | Path) -> Result:
    app = typer.Typer()
    register(app)
    app.command("other")(lambda: None)  # one command alone would lose its name
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_import_list_info_delete(tmp_path: Path) -> None:
    path = rasters.write(tmp_path / "field.tif", np.full((1, 40, 40), 90, np.uint8))
    data = ("--data-dir", tmp_path / "data")

    imported = run("map", "import", path, "--json", *data)
    record = json.loads(imported.stdout)
    listed = json.loads(run("map", "list", "--json", *data).stdout)
    shown = run("map", "info", record["id"], *data)
    removed = run("map", "delete", record["id"], *data)

    assert imported.exit_code == shown.exit_code == removed.exit_code == 0
    assert [entry["id"] for entry in listed] == [record["id"]]
    assert record["name"] == "field"
    assert "EPSG:32632" in shown.stdout
    assert "no maps in" in run("map", "list", *data).stdout
    assert MapLibrary(tmp_path / "data" / "maps").list() == []


def test_info_of_a_file_needs_no_import(tmp_path: Path) -> None:
    path = rasters.write(tmp_path / "dem.tif", np.full((1, 40, 40), 512.5, np.float32), nodata=float("nan"))
    facts = json.loads(run("map", "info", path, "--json").stdout)
    assert (facts["kind"], facts["width_px"], facts["nodata"]) == ("elevation", 40, None)
    assert facts["gsd_m"] == pytest.approx(1.0, rel=1e-3)


def test_failures_exit_with_one_and_a_line_that_names_the_file(tmp_path: Path) -> None:
    data = ("--data-dir", tmp_path / "data")
    for arguments in (("map", "import", tmp_path / "none.tif", *data), ("map", "delete", "0123456789ab", *data)):
        result = run(*arguments)
        assert result.exit_code == 1
        assert result.stderr.count("\n") <= 2
        assert "error: " in result.stderr
        assert "Traceback" not in result.output
    assert run("map", "import").exit_code == 2


def _no_crs(path: Path) -> None:
    rasters.write(path, np.full((1, 40, 40), 7, np.uint8), crs=None)


def _cut(path: Path) -> None:
    rasters.write(path, np.random.default_rng(1).integers(0, 255, (3, 300, 300), dtype=np.uint8))
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 3])


def _huge(path: Path) -> None:
    profile = {"driver": "GTiff", "width": 300_000, "height": 300_000, "count": 1, "dtype": "uint8", "tiled": True}
    where = {"crs": "EPSG:32632", "transform": from_origin(5e5, 5.2e6, 0.1, 0.1)}
    with rasterio.open(path, "w", sparse_ok=True, BIGTIFF="YES", **profile, **where):
        pass


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda path: path.write_bytes(b""), "empty"), (lambda path: path.write_bytes(b"hello"), "cannot be read"),
        (_no_crs, "coordinate reference system"), (_cut, "truncated or damaged"), (_huge, "more than"),
    ],
    ids=["empty", "text", "no CRS", "cut", "huge"],
)  # fmt: skip
def test_a_raster_that_is_no_map_is_refused_in_a_line_and_leaves_nothing(
    tmp_path: Path, make: Callable[[Path], object], words: str
) -> None:
    make(tmp_path / "bad.tif")
    result = run("map", "import", tmp_path / "bad.tif", "--data-dir", tmp_path / "data")

    assert result.exit_code == 1
    assert "bad.tif" in result.stderr
    assert words in result.stderr.replace("\n", " ")
    assert "Traceback" not in result.output
    assert not list((tmp_path / "data").rglob("*.tif"))
    assert json.loads(run("map", "list", "--json", "--data-dir", tmp_path / "data").stdout) == []


def test_library_lies_in_the_data_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_DATA_HOME", str(tmp_path))
    assert library_folder(None) == tmp_path / "pilotage" / "maps"
    assert library_folder(Path("/srv/x")) == Path("/srv/x/maps")
