"""The map library: imported imagery and elevation in one form, each in its own folder with a record.

A map appears whole or not at all: it is converted under a temporary name and renamed last. Importing the same file
again gives the map that is there.
"""

from __future__ import annotations

import hashlib
import os
import re
import shutil
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any, Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, ValidationError

from geodata.elevation import height_planes, height_scaling
from geodata.errors import EmptyRasterError, HugeRasterError, MapLibraryError, MapNotFoundError
from geodata.flight_write import write_atomically
from geodata.radiometry import Radiometry
from geodata.raster import Bands, LatLonBounds, Mask, Raster, TiledWriter, open_raster

MapKind = Literal["imagery", "elevation"]
Progress = Callable[[float], None]
Dtype = np.dtype[Any]

MAX_IMPORT_PIXELS = 4_000_000_000

_RASTER_FILE, _RECORD_FILE = "map.tif", "map.json"
_WINDOW_PX = 1024
_ID = re.compile(r"[0-9a-f]{12}")
_STALE_S = 86_400.0


class MapRecord(BaseModel):
    """What the library knows of a map. ``sha256`` is of the source file, ``size_bytes`` of the library's copy."""

    model_config = ConfigDict(frozen=True)

    id: str
    name: str
    kind: MapKind
    crs: str
    bounds: LatLonBounds
    gsd_m: float
    width_px: int
    height_px: int
    bands: int
    size_bytes: int
    sha256: str
    source_file: str
    imported_unix_us: int


Records = list[MapRecord]
Problems = list[str]


class MapLibrary:
    """The maps of one folder. Several processes may use it at once."""

    def __init__(self, folder: str | os.PathLike[str]) -> None:
        self.folder = Path(folder).expanduser()

    def import_file(
        self,
        path: str | os.PathLike[str],
        name: str | None = None,
        kind: MapKind | None = None,
        progress: Progress | None = None,
    ) -> MapRecord:
        """Validate a raster and convert it into the library.

        Parameters
        ----------
        kind
            What it is; guessed from bands, type and values when not given.
        progress
            Called with the part done, 0 to 1.

        Raises
        ------
        RasterError
            One of its subclasses, saying what is wrong with the file.
        MapLibraryError
            The library cannot be written, or its disk is too full.
        """
        with open_raster(path) as raster:
            if raster.width_px * raster.height_px > MAX_IMPORT_PIXELS:
                raise HugeRasterError(
                    raster.path,
                    f"holds {raster.width_px} x {raster.height_px} pixels, more than 4 thousand million",
                    "cut out the area of operation, for example with gdal_translate -projwin",
                )
            kind = kind or guess_kind(raster)
            sha256 = sha256_of_file(raster.path)
            map_id = hashlib.sha256(f"{sha256} {kind}".encode()).hexdigest()[:12]
            try:
                return self._renamed(self.get(map_id), name)
            except MapNotFoundError:
                pass
            try:
                return self._convert(raster, map_id, name or raster.path.stem, kind, sha256, progress)
            except OSError as error:
                problem = f"map library {self.folder} cannot be written: {error.strerror or error}"
                raise MapLibraryError(problem) from error

    def list(self) -> Records:
        """All usable maps by name."""
        records, _ = self._scan()
        return sorted(records, key=lambda record: (record.name.lower(), record.id))

    def broken(self) -> Problems:
        """What is wrong with the folders that hold no usable map."""
        _, problems = self._scan()
        return problems

    def get(self, map_id: str) -> MapRecord:
        """One map; :class:`MapNotFoundError` when there is none of that id."""
        self._check_id(map_id)
        record = self.folder / map_id / _RECORD_FILE
        if not record.is_file():
            raise MapNotFoundError(map_id)
        return _read_record(record)

    def raster_path(self, map_id: str) -> Path:
        """The library's GeoTIFF of a map: 8-bit grey or colour with a mask, or float heights with NaN."""
        self.get(map_id)
        return self.folder / map_id / _RASTER_FILE

    def delete(self, map_id: str) -> None:
        """Remove a map; :class:`MapNotFoundError` when there is none of that id."""
        self._check_id(map_id)
        if not (self.folder / map_id).is_dir():
            raise MapNotFoundError(map_id)
        grave = Path(tempfile.mkdtemp(prefix=".deleted-", dir=self.folder))
        (self.folder / map_id).rename(grave / map_id)
        shutil.rmtree(grave, ignore_errors=True)

    def _check_id(self, map_id: str) -> None:
        # Ids come from the network; nothing but our own may become a path.
        if not _ID.fullmatch(map_id):
            raise MapNotFoundError(map_id)

    def _scan(self) -> tuple[Records, Problems]:
        records: Records = []
        problems: Problems = []
        if not self.folder.is_dir():
            return records, problems
        for entry in sorted(self.folder.iterdir()):
            if not _ID.fullmatch(entry.name) or not entry.is_dir():
                continue
            try:
                records.append(_read_record(entry / _RECORD_FILE))
            except MapLibraryError as error:
                problems.append(str(error))
        return records, problems

    def _renamed(self, record: MapRecord, name: str | None) -> MapRecord:
        if name is None or name == record.name:
            return record
        record = record.model_copy(update={"name": name})
        write_atomically(self.folder / record.id / _RECORD_FILE, record.model_dump_json(indent=1).encode())
        return record

    def _convert(
        self, raster: Raster, map_id: str, name: str, kind: MapKind, sha256: str, progress: Progress | None
    ) -> MapRecord:
        self.folder.mkdir(parents=True, exist_ok=True)
        self._sweep()
        self._check_space(raster)
        folder = Path(tempfile.mkdtemp(prefix=".import-", dir=self.folder))
        try:
            bands = _write_copy(raster, folder / _RASTER_FILE, kind, progress)
            record = MapRecord(
                id=map_id,
                name=name,
                kind=kind,
                crs=raster.crs_name,
                bounds=raster.bounds,
                gsd_m=raster.gsd_m,
                width_px=raster.width_px,
                height_px=raster.height_px,
                bands=bands,
                size_bytes=(folder / _RASTER_FILE).stat().st_size,
                sha256=sha256,
                source_file=raster.path.name,
                imported_unix_us=time.time_ns() // 1000,
            )
            write_atomically(folder / _RECORD_FILE, record.model_dump_json(indent=1).encode())
            folder.chmod(0o755)
            try:
                folder.rename(self.folder / map_id)
            except OSError:
                if not (self.folder / map_id / _RECORD_FILE).is_file():
                    raise
                return self.get(map_id)  # another process imported the same file meanwhile
        finally:
            shutil.rmtree(folder, ignore_errors=True)
        return record

    def _check_space(self, raster: Raster) -> None:
        needed = raster.width_px * raster.height_px * min(raster.band_count, 4) + 50_000_000
        free = shutil.disk_usage(self.folder).free
        if needed > free:
            message = (
                f"map library {self.folder}: {free / 1e9:.1f} GB free, up to {needed / 1e9:.1f} GB needed for "
                f"{raster.path.name}; free some space or choose another data folder"
            )
            raise MapLibraryError(message)

    def _sweep(self) -> None:
        """Remove what a killed import or deletion left, once it is a day old."""
        for entry in self.folder.iterdir():
            if entry.name.startswith((".import-", ".deleted-")) and time.time() - entry.stat().st_mtime > _STALE_S:
                shutil.rmtree(entry, ignore_errors=True)


def guess_kind(raster: Raster) -> MapKind:
    """Elevation is one band of signed or floating numbers that are not reflectances; all else is imagery."""
    if raster.palette is not None or raster.band_count != 1 or raster.has_alpha:
        return "imagery"
    if np.issubdtype(raster.dtype, np.signedinteger):
        return "elevation"
    if not np.issubdtype(raster.dtype, np.floating):
        return "elevation" if raster.unit in ("m", "metre", "meter", "ft", "feet") else "imagery"
    bands, valid = raster.sample()
    known = bands[0][valid]
    is_reflectance = known.size > 0 and known.min() >= 0 and known.max() <= 1.6
    return "imagery" if is_reflectance else "elevation"


def _write_copy(raster: Raster, path: Path, kind: MapKind, progress: Progress | None) -> int:
    """Write the library's copy, tile by tile; returns its band count."""
    dtype: Dtype
    nodata: float | None
    if kind == "elevation":
        scale, offset = height_scaling(raster)
        bands, dtype, nodata = 1, np.dtype(np.float32), float("nan")

        def render(pixels: Bands, valid: Mask) -> tuple[Bands, Mask]:
            heights = height_planes(pixels, scale, offset)
            known = valid & np.isfinite(heights[0])
            return np.where(known, heights, np.float32(np.nan)), known
    else:
        radiometry = Radiometry.of(raster)
        bands = 3 if raster.palette is not None or raster.band_count >= 3 else 1
        dtype, nodata = np.dtype(np.uint8), None

        def render(pixels: Bands, valid: Mask) -> tuple[Bands, Mask]:
            return np.where(valid, np.rint(radiometry.colour(pixels)), 0).astype(np.uint8), valid

    any_valid = False
    with TiledWriter(
        path,
        width=raster.width_px,
        height=raster.height_px,
        bands=bands,
        dtype=dtype,
        transform=raster.transform,
        crs_wkt=raster.crs.to_wkt(),
        nodata=nodata,
        with_mask=kind == "imagery",
        overviews=True,
    ) as writer:
        for row in range(0, raster.height_px, _WINDOW_PX):
            for col in range(0, raster.width_px, _WINDOW_PX):
                width, height = min(_WINDOW_PX, raster.width_px - col), min(_WINDOW_PX, raster.height_px - row)
                pixels, valid = render(*raster.read(raster.levels[0], col, row, width, height))
                any_valid = any_valid or bool(valid.any())
                writer.write(pixels, valid, col, row)
            if progress is not None:
                progress(0.9 * min(1.0, (row + _WINDOW_PX) / raster.height_px))
        if not any_valid:
            raise EmptyRasterError(
                raster.path, "holds no valid pixel (all nodata)", "check its nodata value, mask and alpha band"
            )
    if progress is not None:
        progress(1.0)
    return bands


def _read_record(path: Path) -> MapRecord:
    try:
        record = MapRecord.model_validate_json(path.read_bytes())
    except (OSError, ValidationError) as error:
        message = f"{path}: the map's record is missing or damaged; delete the folder and import the map again"
        raise MapLibraryError(message) from error
    if record.id != path.parent.name or not (path.parent / _RASTER_FILE).is_file():
        message = f"{path.parent}: the map's raster is missing; delete the folder and import the map again"
        raise MapLibraryError(message)
    return record


def sha256_of_file(path: Path) -> str:
    """SHA-256 of a file in hexadecimal, read in pieces; raises OSError."""
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
