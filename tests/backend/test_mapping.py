"""Which map a vehicle's estimator gets."""

import math
from pathlib import Path

import numpy as np
import pytest
from rasterio.transform import from_origin

from backend.errors import StartError
from backend.mapping import StationMaps
from backend.navigation.setup import Place
from geodata.raster import write_geotiff

HERE = Place(math.radians(46.9995), math.radians(9.0005), 400.0)
ELSEWHERE = Place(math.radians(10.0), math.radians(10.0), 400.0)


def imagery(path: Path, gsd_m: float, seed: int) -> Path:
    image = np.random.default_rng(seed).integers(0, 255, (200, 200, 3), dtype=np.uint8)
    write_geotiff(path, image, from_origin(499_990.0, 5_205_400.0, gsd_m, gsd_m), "EPSG:32632")
    return path


async def test_the_finest_map_that_covers_the_place_is_used(tmp_path: Path) -> None:
    maps = StationMaps(tmp_path / "maps")
    coarse = await maps.import_file(imagery(tmp_path / "coarse.tif", 4.0, 1), None, "imagery")
    fine = await maps.import_file(imagery(tmp_path / "fine.tif", 3.0, 2), None, "imagery")
    found, nothing = maps.files_for(HERE), maps.files_for(ELSEWHERE)
    await maps.choose("coarse")
    chosen = maps.files_for(HERE)
    maps.close()

    assert coarse.bounds.south_deg < math.degrees(HERE.lat_rad) < coarse.bounds.north_deg
    assert found.map_id == fine.id
    assert found.reference == maps.library.raster_path(fine.id)
    assert (nothing.map_id, nothing.reference) == (None, None)
    assert chosen.map_id == coarse.id


async def test_a_chosen_file_is_imported(tmp_path: Path) -> None:
    maps = StationMaps(tmp_path / "maps")
    await maps.choose(str(imagery(tmp_path / "new.tif", 2.0, 3)))

    assert [body.name for body in maps.bodies()] == ["new"]
    assert maps.chosen == maps.bodies()[0].id
    assert maps.holds(maps.library.raster_path(maps.bodies()[0].id))
    assert not maps.holds(tmp_path / "new.tif")


async def test_a_choice_that_is_nothing_is_refused(tmp_path: Path) -> None:
    (tmp_path / "letter.tif").write_text("Dear all")
    for given in ("nowhere", str(tmp_path / "letter.tif")):
        with pytest.raises(StartError, match="--map"):
            await StationMaps(tmp_path / "maps").choose(given)


async def test_without_a_place_the_only_map_is_searched_from_its_middle(tmp_path: Path) -> None:
    maps = StationMaps(tmp_path / "maps")
    assert maps.middle(120.0) is None
    first = await maps.import_file(imagery(tmp_path / "one.tif", 2.0, 1), None, "imagery")
    middle = maps.middle(120.0)
    await maps.import_file(imagery(tmp_path / "two.tif", 4.0, 2), None, "imagery")
    undecided = maps.middle(120.0)
    await maps.choose("one")
    chosen = maps.middle(120.0)
    maps.close()

    assert middle is not None
    assert math.degrees(middle.lat_rad) == pytest.approx((first.bounds.south_deg + first.bounds.north_deg) / 2)
    assert math.degrees(middle.lon_rad) == pytest.approx((first.bounds.west_deg + first.bounds.east_deg) / 2)
    assert middle.alt_amsl_m == 120.0
    assert undecided is None
    assert chosen == middle
