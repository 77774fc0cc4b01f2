"""The layer's place on the Earth, its files, and the command."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np
import rasterio
import typer
from rasterio.warp import transform
from typer.testing import CliRunner, Result

from geodata.cli import register
from geodata.maps import MapLibrary
from geodata.matchability import add_to_library, matchability_of, of_library
from geodata.tiles import MapTiles
from tests.estimator.registration.textured_map import MAP
from tests.geodata import rasters


def _half_bare(path: Path) -> Path:
    """400 m square: blocks in the west, bare grain in the east."""
    image = MAP.image.copy()
    image[:, 200:] = np.clip(np.random.default_rng(1).normal(100.0, 3.0, (401, 201)), 0, 255)
    return rasters.write(path, image[None].astype(np.uint8))


def _run(*arguments: str | Path) -> Result:
    app = typer.Typer()
    register(app)
    app.command("other")(lambda: None)  # one command alone would lose its name
    return CliRunner().invoke(app, [str(argument) for argument in arguments])


def test_the_layer_lies_where_the_map_does(tmp_path: Path) -> None:
    source, out = _half_bare(tmp_path / "half.tif"), tmp_path / "layer.tif"

    result = _run("map", "matchability", source, "--out", out, "--footprint", "80", "--json")

    assert result.exit_code == 0, result.output
    with rasterio.open(source) as there, rasterio.open(out) as layer:
        rows, cols = (there.height / 2, there.height / 2), (0.3 * there.width, 0.8 * there.width)
        xs, ys = rasterio.transform.xy(there.transform, rows, cols)
        points = list(zip(*transform(there.crs, layer.crs, xs, ys), strict=True))
        west, east = layer.sample(points)
        assert layer.count == 4
        # kind: good in the west, too little texture in the east; sigma says the same
        assert (west[3], east[3]) == (0.0, 2.0)
        assert east[0] > 3.0 * west[0]
    summary = json.loads(result.stdout)
    assert 0.2 < summary["share_weak"] < 0.7
    assert math.isclose(summary["share_good"] + summary["share_ambiguous"] + summary["share_weak"], 1.0)


def test_a_map_of_the_library_keeps_its_layer(tmp_path: Path) -> None:
    library = MapLibrary(tmp_path / "maps")
    record = library.import_file(_half_bare(tmp_path / "half.tif"))
    assert of_library(library, record.id) is None

    summary = add_to_library(library, record.id, matchability_of(library.raster_path(record.id), 80.0))

    found = of_library(library, record.id)
    assert found is not None
    assert found[1] == summary
    tiles = MapTiles(found[0])
    box = record.bounds
    lat, lon = math.radians(0.5 * (box.south_deg + box.north_deg)), 0.5 * (box.west_deg + box.east_deg)
    x = int((lon / 360.0 + 0.5) * 2**15)
    y = int((1.0 - math.asinh(math.tan(lat)) / math.pi) / 2.0 * 2**15)
    assert tiles.tile(15, x, y) != tiles.empty
    tiles.close()
    # a summary that cannot be read is no layer
    (library.folder / record.id / "matchability.json").write_text("{")
    assert of_library(library, record.id) is None


def test_misuse_is_told(tmp_path: Path) -> None:
    source = _half_bare(tmp_path / "half.tif")

    no_out = _run("map", "matchability", source)
    onto_itself = _run("map", "matchability", source, "--out", source)
    too_big = _run("map", "matchability", source, "--out", tmp_path / "x.tif", "--footprint", "900")
    unknown = _run("map", "matchability", "0123456789ab", "--data-dir", tmp_path)

    assert (no_out.exit_code, onto_itself.exit_code) == (2, 2)
    assert (too_big.exit_code, unknown.exit_code) == (1, 1)
    assert "footprint 900 m" in too_big.output
    assert "no map" in unknown.output
    assert source.stat().st_size > 0
