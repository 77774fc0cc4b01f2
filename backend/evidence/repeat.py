"""The registration behind a target's coordinate made again: the bundle's picture on the map in use, or on its piece."""

from __future__ import annotations

import tempfile
from dataclasses import dataclass
from enum import StrEnum
from pathlib import Path

import cv2
import numpy as np

from backend.errors import BundleError
from backend.evidence.bundle import Bundle
from backend.evidence.piece import ground_of, map_of, same_map
from backend.evidence.registering import register_picture, settings_of
from backend.evidence.schema import Evidence, RegistrationPart
from backend.evidence.verify import FileMatch, Verdict, camera_and_frame, recomputed, state_of
from backend.navigation.setup import reference_of
from estimator.errors import GeometryError
from estimator.geometry.local import LocalFrame
from estimator.ports import GroundModel, ReferenceMap
from estimator.registration.alignment import NoMatch
from estimator.registration.placement import PlacementConfig
from estimator.sighting import Scene
from geodata.elevation import ElevationGrid, FlatGround
from geodata.maps import MapLibrary

# Correlations are sums in an order of the machine's own: another machine's are as far off, and no further.
TOLERANCE_M = 0.01
COV_TOLERANCE = 0.01
PROBABILITY_TOLERANCE = 0.01
# Pictures are brought to the camera's size: a bundle must not ask for gigabytes.
MOST_PICTURE_PIXELS = 100_000_000
ITS_PIECE = "the piece of it in the bundle"


class Outcome(StrEnum):
    """What came out of repeating a registration; `NONE` where no registration took part in the coordinate."""

    NONE = "none"
    AGREES = "agrees"
    DISAGREES = "disagrees"
    NOT_REPEATED = "not repeated"


@dataclass(frozen=True, slots=True)
class Repetition:
    """A registration repeated ``on`` a map, in words, or the ``reason`` why it was not or disagrees.

    ``displacement_ne_m`` is what it found of the picture's middle. ``distance_m`` is between the coordinates by the
    stated and the repeated one, ``cov_change`` the largest difference of their covariances over the largest variance.
    """

    outcome: Outcome
    reason: str = ""
    on: str = ""
    displacement_ne_m: tuple[float, float] | None = None
    distance_m: float | None = None
    cov_change: float | None = None


class _CannotError(Exception):
    """Something that is needed is not there."""


def repeat(bundle: Bundle, verdict: Verdict, given: list[FileMatch], name: str) -> Repetition:
    """Register a bundle's picture again and compare. Takes a second, and more to read the map that is ``given``.

    Raises
    ------
    BundleError
        The bundle states what cannot be; ``name`` says in it which.
    GeodataError
        A file that is given cannot be read.
    """
    part = bundle.evidence.registration
    if part is None:
        return Repetition(Outcome.NONE)
    try:
        if bundle.picture is None:
            raise _CannotError(bundle.evidence.picture.problem or "the picture is in the .zip")
        settings = _settings(part)
        camera, frame = camera_and_frame(bundle.evidence, name)
        if camera.width_px * camera.height_px > MOST_PICTURE_PIXELS:
            raise _CannotError(f"a camera of {camera.width_px} x {camera.height_px} pixels is larger than any in use")
        reference, on = _reference(bundle, part, given, frame, name)
        scene = Scene(
            camera, _ground(bundle, part, given, frame, name), frame, reference, bundle.evidence.ground.std_m,
            bundle.evidence.ground.slope_std, placement=settings,
        )  # fmt: skip
    except _CannotError as error:
        return Repetition(Outcome.NOT_REPEATED, str(error))
    if on != ITS_PIECE:
        piece = map_of(part.map, bundle.pieces, name)
        differs = None if piece is None else same_map(part.map, piece, reference)
        if differs is not None:
            return Repetition(Outcome.DISAGREES, f"the piece in the bundle is not of this map: {differs}", on)
    try:
        placed = register_picture(bundle.picture, state_of(part.state, "registration.state", name), scene).placed
        if isinstance(placed, NoMatch):
            return Repetition(Outcome.DISAGREES, f"no match: {placed.reason}", on)
        again = recomputed(bundle.evidence, placed, name)
    except (GeometryError, ValueError, np.linalg.LinAlgError, cv2.error) as error:
        return Repetition(Outcome.DISAGREES, f"it fails: {error}", on)
    before = verdict.recomputed
    distance_m = float(np.linalg.norm(again.pos_ned_m - before.pos_ned_m))
    largest = float(np.max(np.diag(before.cov_ned_m2)))
    cov_change = float(np.max(np.abs(again.cov_ned_m2 - before.cov_ned_m2))) / largest
    north_m, east_m = (float(value) for value in placed.correction[:2])
    stated = bundle.evidence.placement
    reason = ""
    if stated is None or placed.by != stated.by:
        reason = f"matched by {placed.by}"
    elif abs(placed.outlier_probability - stated.outlier_probability) > PROBABILITY_TOLERANCE:
        reason = f"outlier probability {placed.outlier_probability:.2f}"
    elif not (distance_m <= TOLERANCE_M and cov_change <= COV_TOLERANCE):
        reason = "another coordinate" if distance_m > TOLERANCE_M else "another covariance"
    outcome = Outcome.DISAGREES if reason else Outcome.AGREES
    return Repetition(outcome, reason, on, (north_m, east_m), distance_m, cov_change)


def _settings(part: RegistrationPart) -> PlacementConfig:
    try:
        return settings_of(part.settings)
    except ValueError as error:
        raise _CannotError(str(error)) from None


def _reference(
    bundle: Bundle, part: RegistrationPart, given: list[FileMatch], frame: LocalFrame, name: str
) -> tuple[ReferenceMap, str]:
    """The map to register to, and which it is: the one given, else the bundle's piece."""
    north_m, east_m = part.map_offset_ne_m
    for file in given:
        if file.role == "reference":
            with tempfile.TemporaryDirectory() as scratch:
                path = _as_in_use(bundle.evidence, file, Path(scratch))
                return reference_of(path, frame, (north_m, east_m)), f"'{file.path}'"
    piece = map_of(part.map, bundle.pieces, name)
    if piece is None:
        raise _CannotError(f"the bundle has no piece of the map ({part.map.problem}): give the map with --map")
    return piece, ITS_PIECE


def _ground(
    bundle: Bundle, part: RegistrationPart, given: list[FileMatch], frame: LocalFrame, name: str
) -> GroundModel:
    if part.ground is None:
        return FlatGround(part.ground_alt_amsl_m or 0.0)
    for file in given:
        if file.role == "elevation":
            with tempfile.TemporaryDirectory() as scratch:
                return ElevationGrid.open(_as_in_use(bundle.evidence, file, Path(scratch)), frame)
    piece = ground_of(part.ground, bundle.pieces, name)
    if piece is None:
        reason = f"the bundle has no piece of the elevation ({part.ground.problem})"
        raise _CannotError(f"{reason}: give the elevation with --elevation")
    return piece


def _as_in_use(evidence: Evidence, file: FileMatch, scratch: Path) -> Path:
    """The file that the station had in use: the one given, or what importing that makes of it."""
    if not file.is_source:
        return file.path
    library = MapLibrary(scratch)
    record = library.import_file(file.path, kind="imagery" if file.role == "reference" else "elevation")
    path = library.raster_path(record.id)
    if not any(used.role == file.role and used.source_sha256 == record.sha256 for used in evidence.files):
        raise BundleError(str(file.path), "has changed while it was read")
    return path
