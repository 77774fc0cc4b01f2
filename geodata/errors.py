"""Errors of the geodata package.

GeodataError              base of all
  RasterError             a raster file cannot be used; carries ``path``
    RasterMissingError      no such file
    CorruptRasterError      not a raster, truncated or damaged
    EmptyRasterError        no bytes, no pixels, or no valid pixel
    HugeRasterError         larger than can be handled safely
    NoCrsError              no coordinate reference system, or one that is not tied to the Earth
    NotGeoreferencedError   no usable geotransform
    UnsupportedRasterError  a band count or data type that means nothing here
  MapLibraryError         the library cannot do what was asked
    MapNotFoundError        no map of that id
  PhotoError              a photo cannot be used; carries ``path``, ``problem``, ``remedy``
  FlightFolderError       a flight folder cannot be used; carries ``path``, ``field``, ``problem``, ``remedy``
"""

from __future__ import annotations

from pathlib import Path


class GeodataError(Exception):
    """Base of what goes wrong with geographic data."""


class RasterError(GeodataError):
    """A raster file cannot be used: which, why, and what to do."""

    def __init__(self, path: Path, problem: str, remedy: str = "") -> None:
        self.path = path
        self.problem = problem
        self.remedy = remedy
        super().__init__(f"{path}: {problem}" + (f"; {remedy}" if remedy else ""))


class RasterMissingError(RasterError):
    """There is no such file."""


class CorruptRasterError(RasterError):
    """The file is not a raster, is truncated, or is damaged."""


class EmptyRasterError(RasterError):
    """The file has no bytes, no pixels, or no valid pixel."""


class HugeRasterError(RasterError):
    """The raster, or the grid asked of it, is larger than can be handled safely."""


class NoCrsError(RasterError):
    """The file names no coordinate reference system, or one that is not tied to the Earth."""


class NotGeoreferencedError(RasterError):
    """The file has no usable geotransform."""


class UnsupportedRasterError(RasterError):
    """The file's bands or data type cannot be interpreted."""


class MapLibraryError(GeodataError):
    """The map library cannot do what was asked."""


class MapNotFoundError(MapLibraryError):
    """The library has no map of that id."""

    def __init__(self, map_id: str) -> None:
        self.map_id = map_id
        super().__init__(f"no map {map_id!r} in the library; list the maps to see their ids")


class UnusableFileError(GeodataError):
    """A file cannot be used: which, the field of it where one is to blame, why, and what to do."""

    def __init__(self, path: Path, problem: str, remedy: str = "", *, field: str = "") -> None:
        self.path = path
        self.field = field
        self.problem = problem
        self.remedy = remedy
        where = f"{path}: {field}" if field else f"{path}"
        super().__init__(f"{where}: {problem}" + (f"; {remedy}" if remedy else ""))


class PhotoError(UnusableFileError):
    """A photo cannot be used."""


class PadFileError(UnusableFileError):
    """A description of a landing pad cannot be used."""


class FlightFolderError(UnusableFileError):
    """A flight folder cannot be used."""
