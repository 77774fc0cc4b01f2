from __future__ import annotations

import math
import threading
from pathlib import Path

import numpy as np
import pyproj
import pytest
import rasterio
import rasterio.warp
from affine import Affine
from numpy.testing import assert_allclose, assert_array_equal
from rasterio.enums import ColorInterp

from geodata.errors import CorruptRasterError, RasterError, RasterMissingError
from geodata.raster import open_raster, write_geotiff
from tests.geodata import rasters
from tests.shared_data import shared_data


@pytest.mark.parametrize(
    ("crs", "gsd"),
    [("EPSG:32632", 0.5), ("EPSG:3857", 0.7), ("EPSG:4326", 5e-6), ("EPSG:31468", 1.0), ("EPSG:2180", 2.0)],
)
@pytest.mark.parametrize("rotation_deg", [0.0, 33.0])
def test_pixels_and_places_agree_with_pyproj(tmp_path: Path, crs: str, gsd: float, rotation_deg: float) -> None:
    """Any CRS and any rotation: the pixel of a place is what pyproj and the geotransform say."""
    path = rasters.write(
        tmp_path / "a.tif", np.zeros((1, 60, 90), np.uint8), crs=crs, gsd=gsd, rotation_deg=rotation_deg
    )
    col, row = np.array([0.0, 89.0, 40.25]), np.array([0.0, 59.0, 12.5])
    with rasterio.open(path) as dataset:
        a, b, c, d, e, f = dataset.transform[:6]
    x, y = a * (col + 0.5) + b * (row + 0.5) + c, d * (col + 0.5) + e * (row + 0.5) + f
    lon_deg, lat_deg = pyproj.Transformer.from_crs(crs, "EPSG:4326", always_xy=True).transform(x, y)

    with open_raster(path) as raster:
        lat_rad, lon_rad = raster.geodetic_from_pixel(col, row)
        assert_allclose(np.degrees(lat_rad), lat_deg, atol=1e-12)
        assert_allclose(np.degrees(lon_rad), lon_deg, atol=1e-12)
        back = raster.pixel_from_geodetic(lat_rad, lon_rad)

    assert_allclose(back, [col, row], atol=1e-3)  # a thousandth of a pixel: datum shifts invert to about that


def test_gsd_is_on_the_ground_not_in_the_projection(tmp_path: Path) -> None:
    """Web Mercator stretches by 1 / cos(latitude); degrees are no metres."""
    mercator = rasters.write(tmp_path / "m.tif", np.zeros((1, 8, 8), np.uint8), crs="EPSG:3857", gsd=1.0)
    degrees = rasters.write(tmp_path / "d.tif", np.zeros((1, 8, 8), np.uint8), crs="EPSG:4326", gsd=1e-5)
    geod = pyproj.Geod(ellps="WGS84")

    with open_raster(mercator) as raster:
        assert raster.gsd_m == pytest.approx(math.cos(math.radians(rasters.LAT_DEG)), rel=4e-3)
    with open_raster(degrees) as raster:
        _, _, east_m = geod.inv(rasters.LON_DEG, rasters.LAT_DEG, rasters.LON_DEG + 1e-5, rasters.LAT_DEG)
        assert raster.gsd_x_m == pytest.approx(east_m, rel=1e-4)
        assert raster.gsd_y_m == pytest.approx(1.112, rel=1e-3)


def test_longitudes_counted_to_360_are_found(tmp_path: Path) -> None:
    transform = Affine(1e-3, 0.0, 190.0, 0.0, -1e-3, 10.0)
    path = rasters.write(tmp_path / "a.tif", np.zeros((1, 10, 10), np.uint8), crs="EPSG:4326", transform=transform)

    with open_raster(path) as raster:
        col, row = raster.pixel_from_geodetic(np.radians([9.9955]), np.radians([190.0045 - 360.0]))

    assert_allclose([col[0], row[0]], [4.0, 4.0], atol=1e-6)


def test_bounds_surround_the_footprint() -> None:
    """The corners as rasterio has them, of a real map."""
    path = shared_data("photos/seneca/map_passA_30cm.tif")
    with rasterio.open(path) as dataset, open_raster(path) as raster:
        west, south, east, north = rasterio.warp.transform_bounds(dataset.crs, "EPSG:4326", *dataset.bounds)
        bounds = raster.bounds

    assert_allclose(
        [bounds.south_deg, bounds.west_deg, bounds.north_deg, bounds.east_deg], [south, west, north, east], atol=1e-7
    )


def test_alpha_nodata_mask_and_nan_each_make_pixels_invalid(tmp_path: Path) -> None:
    hole = np.ones((20, 30), bool)
    hole[4:9, 10:20] = False
    grey = np.full((20, 30), 100, np.uint8)
    rgba = np.stack([grey, grey, grey, np.where(hole, 255, 0).astype(np.uint8)])
    marked = np.where(hole, grey, 7).astype(np.uint8)[np.newaxis]
    files = {
        "labelled alpha": rasters.write(tmp_path / "a.tif", rgba, photometric="RGB", alpha="yes"),
        "unlabelled alpha": rasters.write(tmp_path / "b.tif", rgba, photometric="MINISBLACK"),
        "grey and alpha": rasters.write(tmp_path / "c.tif", rgba[[0, 3]]),
        "nodata": rasters.write(tmp_path / "d.tif", marked, nodata=7),
        "mask band": rasters.write(tmp_path / "e.tif", grey[np.newaxis], mask=hole),
        "nan": rasters.write(tmp_path / "f.tif", np.where(hole, 1.5, np.nan).astype(np.float32)[np.newaxis]),
        "float nodata": rasters.write(
            tmp_path / "g.tif", np.where(hole, 1.5, -3.4028235e38).astype(np.float32)[np.newaxis], nodata=-3.4028235e38
        ),
    }

    for what, path in files.items():
        with open_raster(path) as raster:
            bands, valid = raster.read(raster.levels[0], 0, 0, 30, 20)
            assert_array_equal(valid, hole, err_msg=what)
            assert len(bands) == raster.band_count


def test_fourth_band_of_infrared_is_not_taken_for_alpha(tmp_path: Path) -> None:
    """GDAL labels it alpha unless told otherwise, as does much software that builds on it."""
    bands = np.stack([rasters.texture(40, 40).astype(np.uint8)] * 4)
    path = rasters.write(tmp_path / "a.tif", bands)
    with rasterio.open(path) as dataset:
        assert dataset.colorinterp[3] == ColorInterp.alpha
    with open_raster(path) as raster:
        assert raster.band_count == 4
        assert not raster.has_alpha
        assert raster.read(raster.levels[0], 0, 0, 40, 40)[1].all()


def test_bands_come_as_red_green_blue_however_stored(tmp_path: Path) -> None:
    path = rasters.write(tmp_path / "a.tif", np.stack([np.full((9, 9), v, np.uint8) for v in (3, 2, 1)]))
    with rasterio.open(path, "r+") as dataset:
        dataset.colorinterp = [ColorInterp.blue, ColorInterp.green, ColorInterp.red]

    with open_raster(path) as raster:
        bands, _ = raster.read(raster.levels[0], 0, 0, 9, 9)

    assert bands[:, 0, 0].tolist() == [1, 2, 3]


def test_missing_file_and_folder_are_named(tmp_path: Path) -> None:
    with pytest.raises(RasterMissingError, match="no such file"):
        open_raster(tmp_path / "none.tif")
    with pytest.raises(RasterMissingError, match="is a folder"):
        open_raster(tmp_path)


def test_what_is_no_raster_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "noise.tif"
    path.write_bytes(np.random.default_rng(1).bytes(5000))
    with pytest.raises(CorruptRasterError, match=r"noise\.tif: cannot be read as a raster"):
        open_raster(path)


def test_a_file_cannot_make_the_station_open_another(tmp_path: Path) -> None:
    """A VRT names other files and addresses; it is not opened even when it is called .tif."""
    source = rasters.write(tmp_path / "real.tif", np.zeros((1, 9, 9), np.uint8))
    trick = tmp_path / "trick.tif"
    trick.write_text(
        '<VRTDataset rasterXSize="9" rasterYSize="9"><SRS>EPSG:32632</SRS><GeoTransform>0,1,0,9,0,-1</GeoTransform>'
        f'<VRTRasterBand dataType="Byte" band="1"><SimpleSource><SourceFilename>{source}</SourceFilename>'
        "<SourceBand>1</SourceBand></SimpleSource></VRTRasterBand></VRTDataset>"
    )
    with pytest.raises(CorruptRasterError):
        open_raster(trick)


@pytest.mark.parametrize("options", [{"tiled": True, "blockxsize": 64, "blockysize": 64, "compress": "deflate"}, {}])
def test_truncated_file_fails_clearly_where_it_is_damaged(tmp_path: Path, options: dict[str, object]) -> None:
    whole = rasters.write(
        tmp_path / "whole.tif", np.random.default_rng(2).integers(0, 255, (1, 512, 512), np.uint8), **options
    )
    cut = tmp_path / "cut.tif"
    cut.write_bytes(whole.read_bytes()[: whole.stat().st_size // 2])

    with pytest.raises(CorruptRasterError, match=r"cut\.tif.*truncated or damaged"):  # noqa: SIM117
        with open_raster(cut) as raster:
            raster.read(raster.levels[0], 0, 0, 512, 512)


def test_flipped_bytes_never_raise_anything_else(tmp_path: Path) -> None:
    """Random damage to a small file: it reads, or it fails as a RasterError."""
    whole = rasters.write(
        tmp_path / "whole.tif", rasters.texture(64, 64).astype(np.uint8)[np.newaxis], compress="deflate"
    ).read_bytes()
    rng = np.random.default_rng(3)
    failures = 0
    for case in range(60):
        damaged = bytearray(whole)
        for at in rng.integers(0, min(len(whole), 700), 4):
            damaged[at] = rng.integers(0, 256)
        path = tmp_path / f"{case}.tif"
        path.write_bytes(bytes(damaged))
        try:
            with open_raster(path) as raster:
                raster.read(raster.levels[0], 0, 0, min(64, raster.width_px), min(64, raster.height_px))
        except RasterError as error:
            failures += 1
            assert path.name in str(error)
    assert failures > 5


def test_reads_from_several_threads(tmp_path: Path) -> None:
    pixels = rasters.texture(400, 400).astype(np.uint8)
    path = rasters.write(tmp_path / "a.tif", pixels[np.newaxis], tiled=True, blockxsize=64, blockysize=64)
    wrong: list[int] = []
    with open_raster(path) as raster:

        def read(seed: int) -> None:
            for left in np.random.default_rng(seed).integers(0, 300, 40):
                bands, _ = raster.read(raster.levels[0], int(left), 50, 100, 100)
                if not np.array_equal(bands[0], pixels[50:150, left : left + 100]):
                    wrong.append(int(left))

        threads = [threading.Thread(target=read, args=(seed,)) for seed in range(4)]
        for thread in threads:
            thread.start()
        for thread in threads:
            thread.join()
    assert not wrong


@pytest.mark.parametrize("shape", [(33, 47), (33, 47, 3)])
def test_written_file_reads_back_in_place(tmp_path: Path, shape: tuple[int, ...]) -> None:
    """What write_geotiff writes, rasterio itself reads back: values, place and mask."""
    array = np.random.default_rng(4).integers(0, 255, shape).astype(np.uint8)
    valid = np.ones(shape[:2], bool)
    valid[3:9, 5:11] = False
    path = tmp_path / "a.tif"

    write_geotiff(path, array, (0.5, 0.0, 500000.0, 0.0, -0.5, 5330000.0), "EPSG:32633", valid=valid)

    with rasterio.open(path) as dataset:
        assert dataset.crs.to_epsg() == 32633
        assert dataset.transform == Affine(0.5, 0.0, 500000.0, 0.0, -0.5, 5330000.0)
        stored = dataset.read()
        assert_array_equal(stored[0] if len(shape) == 2 else np.moveaxis(stored, 0, -1), array)
        assert_array_equal(dataset.read_masks(1) > 0, valid)
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.tif"]


def test_refused_array_leaves_no_file(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="rows, cols"):
        write_geotiff(tmp_path / "a.tif", np.zeros(5, np.uint8), (1, 0, 0, 0, -1, 0), "EPSG:32633")
    assert not list(tmp_path.iterdir())
