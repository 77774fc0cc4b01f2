"""Maps over REST: import, tiles, and files that are no maps."""

from pathlib import Path

import numpy as np
import pytest
import rasterio
from rasterio.transform import from_origin

from backend.api.maps import name_of_upload
from geodata.raster import write_geotiff
from tests.backend.station_runner import next_of, running_station

PNG = b"\x89PNG\r\n\x1a\n"


def geotiff(path: Path) -> Path:
    """200 x 200 m of noise near 47 N, 9 E."""
    image = np.random.default_rng(1).integers(0, 255, (200, 200, 3), dtype=np.uint8)
    write_geotiff(path, image, from_origin(500_000.0, 5_205_000.0, 1.0, 1.0), "EPSG:32632")
    return path


def without_crs(path: Path) -> bytes:
    """A TIFF whose pixels lie somewhere, but nobody says on which globe."""
    profile = {"driver": "GTiff", "width": 50, "height": 50, "count": 1, "dtype": "uint8"}
    with rasterio.open(path, "w", transform=from_origin(0.0, 0.0, 1.0, 1.0), **profile) as out:
        out.write(np.full((1, 50, 50), 7, np.uint8))
    return path.read_bytes()


async def test_an_uploaded_map_is_listed_shown_told_and_deleted(tmp_path: Path) -> None:
    data = geotiff(tmp_path / "field.tif").read_bytes()
    async with running_station(tmp_path / "data") as running, running.stream() as stream:
        client = running.client
        made = await client.post("/api/v1/maps", files={"file": ("field.tif", data)}, data={"name": "Field"})
        told = await next_of(stream, "map")
        map_id = made.json()["id"]
        listed = (await client.get("/api/v1/maps")).json()
        tile = await client.get(f"/api/v1/maps/{map_id}/tiles/14/{8601}/{5767}.png")
        no_tile = await client.get(f"/api/v1/maps/{map_id}/tiles/2/9/0.png")
        gone = await client.delete(f"/api/v1/maps/{map_id}")
        after = await client.get(f"/api/v1/maps/{map_id}")
        dropped = await next_of(stream, "map")

    assert made.status_code == 201, made.text
    assert listed == [made.json()]
    assert (made.json()["name"], made.json()["kind"], made.json()["bands"]) == ("Field", "imagery", 3)
    assert told["map"] == made.json()
    assert 46.9 < made.json()["bounds"]["south_deg"] < made.json()["bounds"]["north_deg"] < 47.1
    assert tile.content.startswith(PNG)
    assert no_tile.status_code == 400
    assert (gone.status_code, after.status_code) == (204, 404)
    assert (dropped["action"], dropped["map"]) == ("deleted", map_id)


async def test_a_layer_says_how_well_a_map_can_be_matched(tmp_path: Path) -> None:
    data = geotiff(tmp_path / "field.tif").read_bytes()
    async with running_station(tmp_path / "data") as running:
        client = running.client
        made = await client.post("/api/v1/maps", files={"file": ("field.tif", data)})
        address = f"/api/v1/maps/{made.json()['id']}/matchability"
        before = await client.get(address)
        no_tile_yet = await client.get(f"{address}/14/8601/5767.png")
        predicted = await client.post(address, json={"footprint_m": 60.0})
        after = await client.get(address)
        tile = await client.get(f"{address}/14/8601/5767.png")
        senseless = await client.post(address, json={"footprint_m": -1.0})
        too_large = await client.post(address, json={"footprint_m": 900.0})
        unknown = await client.post("/api/v1/maps/0123456789ab/matchability")
        await client.delete(f"/api/v1/maps/{made.json()['id']}")
        gone = await client.get(address)

    assert (before.status_code, no_tile_yet.status_code) == (404, 404)
    assert "POST" in before.json()["detail"]
    assert predicted.status_code == 201, predicted.text
    assert after.json() == predicted.json()
    # noise of full contrast in every pixel is as distinct as a map can be
    assert after.json()["share_good"] > 0.9
    assert tile.content.startswith(PNG)
    assert (senseless.status_code, too_large.status_code) == (422, 422)
    assert (unknown.status_code, gone.status_code) == (404, 404)


def huge(path: Path) -> bytes:
    """A header that claims 300 000 x 300 000 pixels and holds none of them."""
    profile = {"driver": "GTiff", "width": 300_000, "height": 300_000, "count": 1, "dtype": "uint8"}
    options = {"crs": "EPSG:32632", "transform": from_origin(5e5, 5.2e6, 0.1, 0.1), "tiled": True}
    with rasterio.open(path, "w", sparse_ok=True, BIGTIFF="YES", **profile, **options):
        pass
    return path.read_bytes()


def all_nodata(path: Path) -> bytes:
    """A map in which nothing is known."""
    image = np.zeros((64, 64, 1), np.uint8)
    write_geotiff(path, image, from_origin(5e5, 5.2e6, 1.0, 1.0), "EPSG:32632", nodata=0)
    return path.read_bytes()


@pytest.mark.parametrize(
    ("kind", "words"),
    [
        ("empty", "empty"), ("text", "cannot be read as a raster"), ("no CRS", "coordinate reference system"),
        ("cut", "truncated or damaged"), ("huge", "pixels"), ("all nodata", "no valid pixel"),
    ],
)  # fmt: skip
async def test_what_is_no_map_is_refused_in_words_and_leaves_nothing(tmp_path: Path, kind: str, words: str) -> None:
    whole = geotiff(tmp_path / "a.tif").read_bytes()
    contents = {"empty": b"", "text": b"hello", "cut": whole[: len(whole) // 3]}
    made = {"no CRS": without_crs, "huge": huge, "all nodata": all_nodata}
    data = made[kind](tmp_path / "b.tif") if kind in made else contents[kind]
    async with running_station(tmp_path / "data") as running:
        refused = await running.client.post("/api/v1/maps", files={"file": ("broken.tif", data)})
        listed = (await running.client.get("/api/v1/maps")).json()
        health = await running.client.get("/healthz")

    assert refused.status_code == 422
    said = refused.json()["detail"]
    assert said.startswith("broken.tif: ")
    assert words in said
    assert str(tmp_path) not in said
    assert "inbox" not in said
    assert listed == []
    assert list((tmp_path / "data" / "inbox").iterdir()) == []
    assert health.status_code == 200


async def test_a_file_name_cannot_lead_out_of_the_inbox(tmp_path: Path) -> None:
    data = geotiff(tmp_path / "a.tif").read_bytes()
    async with running_station(tmp_path / "data") as running:
        made = await running.client.post("/api/v1/maps", files={"file": ("../../../evil.tif", data)})

    assert made.status_code == 201
    assert not list(tmp_path.rglob("evil.tif"))


@pytest.mark.parametrize(
    ("given", "kept"),
    [
        ("field.tif", "field.tif"), ("C:\\maps\\field.tif", "field.tif"), ("../../etc/passwd", "passwd"),
        ("..", "map.tif"), (".tif", ".tif"), ("", "map.tif"), (None, "map.tif"), ("a/", "map.tif"),
        ("two\nlines\x00.tif", "twolines.tif"), ("ö" * 300 + ".tif", "ö" * 58 + ".tif"),
    ],
)  # fmt: skip
def test_any_name_becomes_a_harmless_one(given: str | None, kept: str, tmp_path: Path) -> None:
    name = name_of_upload(given)
    (tmp_path / name).write_bytes(b"")

    assert name == kept
    assert [path.name for path in tmp_path.iterdir()] == [kept]
