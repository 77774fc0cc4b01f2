"""The station's maps: the library, its tiles, and which of them a vehicle's estimator uses."""

from __future__ import annotations

import asyncio
import math
from collections import OrderedDict
from pathlib import Path

from backend.clock import mono_us
from backend.errors import ConflictError, LayerMissingError, StartError
from backend.navigation.setup import MapFiles, Place, middle_of_map
from backend.schemas.vehicles import MapBody, MapBounds
from geodata.errors import GeodataError, MapNotFoundError
from geodata.maps import MapKind, MapLibrary, MapRecord
from geodata.matchability import MatchabilitySummary, add_to_library, matchability_of, of_library
from geodata.tiles import MapTiles

OPEN_TILE_SOURCES = 8


class StationMaps:
    """Maps for the console and for estimators. ``chosen`` is a map id or a file that ``--map`` named."""

    def __init__(self, folder: Path) -> None:
        self.library = MapLibrary(folder)
        self.chosen: str | None = None
        self._tiles: OrderedDict[str, MapTiles] = OrderedDict()
        self._records: dict[str, MapRecord] = {}
        self._refreshed_us = 0
        self._predicting = asyncio.Lock()  # one at a time: each takes a core for seconds

    async def choose(self, given: str | None) -> None:
        """Use the map that ``--map`` names, by id or by name, or import the file it names.

        Raises
        ------
        StartError
            It is neither, or the file is no usable map.
        """
        await self.refresh()
        if given is None:
            return
        for record in self._records.values():
            if given in (record.id, record.name):
                self.chosen = record.id
                return
        if not Path(given).exists():
            raise StartError(f"--map '{given}' is neither a file nor a map of the library; see 'pilotage map list'")
        try:
            record = await asyncio.to_thread(self.library.import_file, Path(given))
        except GeodataError as error:
            raise StartError(f"--map: {error}") from None
        self._records[record.id] = record
        self.chosen = record.id

    async def refresh(self, older_than_s: float = 0.0) -> None:
        """Look at the library again, unless that was done a moment ago; other processes import into it too."""
        now_us = mono_us()
        if now_us - self._refreshed_us < older_than_s * 1e6:
            return
        self._refreshed_us = now_us
        records = await asyncio.to_thread(self.library.list)
        self._records = {record.id: record for record in records}

    async def import_file(self, path: Path, name: str | None, kind: MapKind | None) -> MapRecord:
        """Import a file; a GeodataError says what is wrong with it."""
        record = await asyncio.to_thread(self.library.import_file, path, name, kind)
        self._records[record.id] = record
        return record

    async def delete(self, map_id: str) -> None:
        """Remove a map from the library."""
        await asyncio.to_thread(self.library.delete, map_id)
        self._records.pop(map_id, None)
        self._forget_tiles(map_id)
        self._forget_tiles(_layer_key(map_id))

    def bodies(self) -> list[MapBody]:
        """All maps, as the API shows them."""
        return [body_of_map(record) for record in sorted(self._records.values(), key=lambda r: (r.name.lower(), r.id))]

    def body(self, map_id: str) -> MapBody:
        """One map, as the API shows it."""
        if map_id not in self._records:
            raise MapNotFoundError(map_id)
        return body_of_map(self._records[map_id])

    async def tile(self, map_id: str, z: int, x: int, y: int) -> bytes:
        """One picture tile as PNG."""
        await self._known(map_id)
        return await self._tile_of(map_id, self.library.raster_path(map_id), z, x, y)

    async def matchability(self, map_id: str) -> MatchabilitySummary:
        """What was predicted for a map; LayerMissingError where nothing was."""
        await self._known(map_id)
        found = await asyncio.to_thread(of_library, self.library, map_id)
        if found is None:
            raise LayerMissingError(map_id)
        return found[1]

    async def predict_matchability(self, map_id: str, footprint_m: float, radius_m: float) -> MatchabilitySummary:
        """Predict how well each place of an imagery map can be matched, and keep it as a layer."""
        record = await self._known(map_id)
        if record.kind != "imagery":
            raise ConflictError(f"map '{map_id}' is elevation: only imagery is matched")
        async with self._predicting:
            layer = await asyncio.to_thread(matchability_of, self.library.raster_path(map_id), footprint_m, radius_m)
            summary = await asyncio.to_thread(add_to_library, self.library, map_id, layer)
        self._forget_tiles(_layer_key(map_id))
        return summary

    async def matchability_tile(self, map_id: str, z: int, x: int, y: int) -> bytes:
        """One tile of a map's layer as PNG."""
        await self._known(map_id)
        found = await asyncio.to_thread(of_library, self.library, map_id)
        if found is None:
            raise LayerMissingError(map_id)
        return await self._tile_of(_layer_key(map_id), found[0], z, x, y)

    async def _known(self, map_id: str) -> MapRecord:
        if map_id not in self._records:
            await self.refresh()
        if map_id not in self._records:
            raise MapNotFoundError(map_id)
        return self._records[map_id]

    async def _tile_of(self, key: str, path: Path, z: int, x: int, y: int) -> bytes:
        tiles = self._tiles.get(key)
        if tiles is None:
            tiles = await asyncio.to_thread(MapTiles, path)
            tiles = self._tiles.setdefault(key, tiles)
            while len(self._tiles) > OPEN_TILE_SOURCES:
                self._tiles.popitem(last=False)[1].close()
        self._tiles.move_to_end(key)
        return await asyncio.to_thread(tiles.tile, z, x, y)

    def _forget_tiles(self, key: str) -> None:
        tiles = self._tiles.pop(key, None)
        if tiles is not None:
            tiles.close()

    def files_for(self, here: Place) -> MapFiles:
        """The imagery and elevation for a place: the chosen map, else the finest imagery that covers the place."""
        imagery = self._records.get(self.chosen) if self.chosen else None
        if imagery is None or imagery.kind != "imagery":
            imagery = self._finest("imagery", here)
        elevation = self._finest("elevation", here)
        bounds = None
        if imagery is not None:
            box = imagery.bounds
            bounds = (box.south_deg, box.west_deg, box.north_deg, box.east_deg)
        return MapFiles(
            None if imagery is None else imagery.id,
            None if imagery is None else self.library.raster_path(imagery.id),
            None if elevation is None else self.library.raster_path(elevation.id),
            bounds,
        )

    def middle(self, ground_alt_amsl_m: float | None) -> Place | None:
        """The middle of the chosen map, or of the only one; None where there is no such map. Reads files."""
        imagery = [record for record in self._records.values() if record.kind == "imagery"]
        chosen = [record for record in imagery if record.id == self.chosen] or imagery
        if len(chosen) != 1:
            return None
        elevation = self._finest("elevation", Place(*chosen[0].bounds.middle_rad, 0.0))
        return middle_of_map(
            self.library.raster_path(chosen[0].id),
            None if elevation is None else self.library.raster_path(elevation.id),
            ground_alt_amsl_m,
        )

    def holds(self, path: Path) -> bool:
        """Whether a file is the library's own, under another name: recordings link their map from here."""
        for record in self.library.list():
            try:
                if path.samefile(self.library.raster_path(record.id)):
                    return True
            except (OSError, GeodataError):
                continue
        return False

    def record_of(self, path: Path) -> MapRecord | None:
        """The map whose raster in the library a file is, None for any other file."""
        record = self._records.get(path.parent.name)
        return record if record is not None and path.parent.parent == self.library.folder else None

    def close(self) -> None:
        """Release all files."""
        for tiles in self._tiles.values():
            tiles.close()
        self._tiles.clear()

    def _finest(self, kind: str, here: Place) -> MapRecord | None:
        lat_deg, lon_deg = math.degrees(here.lat_rad), math.degrees(here.lon_rad)
        covering = [
            record for record in self._records.values()
            if record.kind == kind
            and record.bounds.south_deg <= lat_deg <= record.bounds.north_deg
            and 0.0 <= (lon_deg - record.bounds.west_deg) % 360.0 <= record.bounds.east_deg - record.bounds.west_deg
        ]  # fmt: skip
        return min(covering, key=lambda record: (record.gsd_m, -record.imported_unix_us), default=None)


def _layer_key(map_id: str) -> str:
    return f"{map_id}/matchability"


def body_of_map(record: MapRecord) -> MapBody:
    """A map, as the API shows it."""
    box = record.bounds
    return MapBody(
        id=record.id, name=record.name, kind=record.kind, gsd_m=record.gsd_m,
        bounds=MapBounds(
            south_deg=box.south_deg, west_deg=box.west_deg, north_deg=box.north_deg, east_deg=box.east_deg
        ),
        crs=record.crs, bands=record.bands, size=[record.width_px, record.height_px], source_file=record.source_file,
    )  # fmt: skip
