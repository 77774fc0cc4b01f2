from __future__ import annotations

import hashlib
import multiprocessing
from pathlib import Path

import numpy as np
import pytest
import rasterio
from numpy.testing import assert_allclose, assert_array_equal

from geodata.elevation import ElevationGrid
from geodata.errors import (
    CorruptRasterError,
    EmptyRasterError,
    MapLibraryError,
    MapNotFoundError,
    NoCrsError,
)
from geodata.imagery import NeBounds, ReferenceImagery
from geodata.maps import MapLibrary, guess_kind
from geodata.raster import open_raster
from tests.geodata import rasters
from tests.shared_data import shared_data


def test_imported_map_is_the_same_map(tmp_path: Path) -> None:
    """A real map in Web Mercator: the library's copy gives the matcher the same grid as the file."""
    source = shared_data("flights/ariel_b/reference.tif")
    library = MapLibrary(tmp_path / "maps")
    done: list[float] = []

    record = library.import_file(source, name="Campus", progress=done.append)

    frame = rasters.frame().__class__(*np.radians([32.1025, 35.2097]).tolist(), 710.0)
    bounds = NeBounds(-200.0, -200.0, 200.0, 200.0)
    copy = ReferenceImagery.open(library.raster_path(record.id)).grid(frame, 0.7, bounds)
    original = ReferenceImagery.open(source).grid(frame, 0.7, bounds)
    # Levels are rounded once more in the copy; nothing moves.
    assert_allclose(copy.image.astype(int), original.image, atol=1)
    assert (record.name, record.kind, record.crs, record.bands) == ("Campus", "imagery", "EPSG:3857", 3)
    assert record.sha256 == hashlib.sha256(source.read_bytes()).hexdigest()
    assert record.source_file == "reference.tif"
    assert record.gsd_m == pytest.approx(0.505, abs=0.001)
    assert 32.09 < record.bounds.south_deg < record.bounds.north_deg < 32.12
    assert done == sorted(done)
    assert done[-1] == 1.0
    with rasterio.open(library.raster_path(record.id)) as dataset:
        assert dataset.overviews(1) == [2, 4, 8, 16]
        assert dataset.block_shapes[0] == (256, 256)


def test_imported_elevation_keeps_heights_and_holes(tmp_path: Path) -> None:
    source = shared_data("flights/ariel_b/elevation.tif")
    library = MapLibrary(tmp_path / "maps")
    record = library.import_file(source)
    frame = rasters.frame().__class__(*np.radians([32.1025, 35.2097]).tolist(), 710.0)

    copy = ElevationGrid.open(library.raster_path(record.id), frame)

    assert record.kind == "elevation"
    assert_array_equal(copy.alt_amsl_grid_m, ElevationGrid.open(source, frame).alt_amsl_grid_m)


def test_palette_and_sixteen_bits_arrive_as_eight(tmp_path: Path) -> None:
    library = MapLibrary(tmp_path / "maps")
    index = np.array([[[0, 1], [2, 1]]], np.uint8).repeat(20, 1).repeat(20, 2)
    colours = {0: (10, 20, 30, 255), 1: (200, 0, 0, 255), 2: (0, 0, 90, 255)}
    deep = rasters.texture(50, 50, 1000, 3000).astype(np.uint16)
    for name, path in {
        "palette": rasters.write(tmp_path / "p.tif", index, colormap=colours),
        "deep": rasters.write(tmp_path / "d.tif", np.stack([deep] * 4)),
    }.items():
        record = library.import_file(path, name)
        with rasterio.open(library.raster_path(record.id)) as dataset:
            assert dataset.dtypes[0] == "uint8"
            assert record.bands == 3
            stored = dataset.read()
        if name == "palette":
            assert stored[:, 0, 39].tolist() == [200, 0, 0]
        else:
            assert stored.min() < 10
            assert stored.max() > 245


@pytest.mark.parametrize(
    ("low", "high", "dtype", "kind"),
    [(400, 900, np.float32, "elevation"), (0.0, 0.6, np.float32, "imagery"), (100, 900, np.int16, "elevation"),
     (100, 3000, np.uint16, "imagery"), (0, 255, np.uint8, "imagery")],
)  # fmt: skip
def test_kind_is_guessed_from_type_and_values(tmp_path: Path, low: float, high: float, dtype: type, kind: str) -> None:
    path = rasters.write(tmp_path / "a.tif", rasters.texture(40, 40, low, high).astype(dtype)[np.newaxis])
    with open_raster(path) as raster:
        assert guess_kind(raster) == kind


def test_same_file_again_is_the_same_map(tmp_path: Path) -> None:
    library = MapLibrary(tmp_path / "maps")
    path = rasters.write(tmp_path / "a.tif", np.full((1, 40, 40), 90, np.uint8))
    first = library.import_file(path)

    again = library.import_file(path, name="Renamed")

    assert again.id == first.id
    assert [record.name for record in MapLibrary(tmp_path / "maps").list()] == ["Renamed"]


def test_deleted_map_is_gone_and_others_stay(tmp_path: Path) -> None:
    library = MapLibrary(tmp_path / "maps")
    one = library.import_file(rasters.write(tmp_path / "1.tif", np.full((1, 40, 40), 90, np.uint8)))
    two = library.import_file(rasters.write(tmp_path / "2.tif", np.full((1, 40, 40), 91, np.uint8)))

    library.delete(one.id)

    assert [record.id for record in library.list()] == [two.id]
    assert [entry.name for entry in library.folder.iterdir()] == [two.id]
    with pytest.raises(MapNotFoundError):
        library.delete(one.id)


@pytest.mark.parametrize("map_id", ["../../etc", "", ".", "000000000000", "a/b", "0123456789ab/.."])
def test_foreign_ids_are_not_found_and_touch_nothing(tmp_path: Path, map_id: str) -> None:
    library = MapLibrary(tmp_path / "maps")
    keep = library.import_file(rasters.write(tmp_path / "1.tif", np.full((1, 40, 40), 90, np.uint8)))
    for use in (library.get, library.delete, library.raster_path):
        with pytest.raises(MapNotFoundError):
            use(map_id)
    assert library.get(keep.id) == keep


def test_refused_files_leave_nothing_behind(tmp_path: Path) -> None:
    library = MapLibrary(tmp_path / "maps")
    whole = rasters.write(
        tmp_path / "w.tif", np.random.default_rng(1).integers(0, 255, (1, 600, 600), np.uint8), compress="deflate"
    )
    cut = tmp_path / "cut.tif"
    cut.write_bytes(whole.read_bytes()[:200_000])
    blank = rasters.write(tmp_path / "blank.tif", np.zeros((1, 40, 40), np.uint8), nodata=0)
    lost = rasters.write(
        tmp_path / "lost.tif", np.zeros((1, 40, 40), np.uint8), crs=None, transform=rasterio.Affine(1, 0, 5, 0, -1, 5)
    )

    for path, error in ((cut, CorruptRasterError), (blank, EmptyRasterError), (lost, NoCrsError)):
        with pytest.raises(error, match=path.name):
            library.import_file(path)

    assert library.list() == []
    assert not library.folder.exists() or not list(library.folder.iterdir())


def test_damaged_record_is_reported_and_hides_no_other(tmp_path: Path) -> None:
    library = MapLibrary(tmp_path / "maps")
    good = library.import_file(rasters.write(tmp_path / "1.tif", np.full((1, 40, 40), 90, np.uint8)))
    bad = library.import_file(rasters.write(tmp_path / "2.tif", np.full((1, 40, 40), 91, np.uint8)))
    (library.folder / bad.id / "map.json").write_text("{")

    assert [record.id for record in library.list()] == [good.id]
    assert len(library.broken()) == 1
    assert bad.id in library.broken()[0]
    with pytest.raises(MapLibraryError, match="import the map again"):
        library.get(bad.id)


def test_library_that_cannot_be_written_says_so(tmp_path: Path) -> None:
    (tmp_path / "maps").write_text("in the way")
    with pytest.raises(MapLibraryError, match="cannot be written"):
        MapLibrary(tmp_path / "maps").import_file(rasters.write(tmp_path / "1.tif", np.full((1, 40, 40), 90, np.uint8)))


def _import(folder: Path, path: Path) -> None:
    MapLibrary(folder).import_file(path)


def test_two_processes_importing_at_once_make_one_map(tmp_path: Path) -> None:
    path = rasters.write(tmp_path / "1.tif", rasters.texture(900, 900).astype(np.uint8)[np.newaxis])
    context = multiprocessing.get_context("spawn")
    other = context.Process(target=_import, args=(tmp_path / "maps", path))
    other.start()
    _import(tmp_path / "maps", path)
    other.join(60)
    assert other.exitcode == 0
    assert len(MapLibrary(tmp_path / "maps").list()) == 1
    assert len(list((tmp_path / "maps").iterdir())) == 1
