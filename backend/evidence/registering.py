"""A kept picture registered to the map: by the station after a click, and again by whoever has its evidence."""

from __future__ import annotations

import json
from dataclasses import dataclass, replace
from typing import Any

import cv2
import numpy as np
from pydantic import TypeAdapter, ValidationError

from backend.evidence.piece import BoundedGround, WatchedMap
from backend.settings import describe_validation
from estimator.errors import CalibrationError
from estimator.geometry.camera import Camera
from estimator.registration.alignment import NoMatch
from estimator.registration.placement import Placement, PlacementConfig
from estimator.sighting import Scene, lay_on_map
from estimator.types import Image, NavigationState

ASPECT_TOLERANCE = 0.01
NO_MAP = "there is no map"
NO_PICTURE = "the picture was no longer held, or could not be decoded"
# What a repetition may be asked to compute: beyond it a bundle would only keep its reader busy.
_MOST = {"radius_m": 200.0, "turn_rad": 1.0, "scale": 0.5}
_LEAST_STEP, _MOST_PX, _MOST_LEVELS = 0.002, 4096, 8
_SETTINGS: TypeAdapter[PlacementConfig] = TypeAdapter(PlacementConfig)


@dataclass(frozen=True, slots=True, eq=False)
class Registered:
    """How a picture lies on the map, or why that is not known, and what was found out with.

    ``state`` is what the search set out from, ``corrected`` whether later fixes had moved it. ``map`` and ``ground``
    have seen where the search looked; None where there was nothing to search.
    """

    placed: Placement | NoMatch
    state: NavigationState
    corrected: bool
    settings: PlacementConfig
    map: WatchedMap | None = None
    ground: BoundedGround | None = None


def grey_picture(jpeg: bytes, camera: Camera) -> Image | None:
    """The kept picture at the calibrated size, grey (rows, cols); None where it is none or of another shape."""
    image = cv2.imdecode(np.frombuffer(jpeg, np.uint8), cv2.IMREAD_GRAYSCALE)
    if image is None:
        return None
    rows, cols = image.shape
    if abs((cols / rows) / (camera.width_px / camera.height_px) - 1.0) > ASPECT_TOLERANCE:
        return None
    if (cols, rows) != (camera.width_px, camera.height_px):
        way = cv2.INTER_AREA if cols > camera.width_px else cv2.INTER_LINEAR
        image = cv2.resize(image, (camera.width_px, camera.height_px), interpolation=way)
    return np.asarray(image, dtype=np.uint8)


def register_picture(
    picture: bytes | None, state: NavigationState, scene: Scene, *, corrected: bool = False
) -> Registered:
    """How a JPEG lies on the map of a scene. Takes some tenths of a second: not for the event loop.

    It is the JPEG of the evidence that is registered, so that whoever has the evidence can do it again.
    """
    settings = scene.placement
    if scene.reference is None:
        return Registered(NoMatch(NO_MAP), state, corrected, settings)
    image = None if picture is None else grey_picture(picture, scene.camera)
    if image is None:
        return Registered(NoMatch(NO_PICTURE), state, corrected, settings)
    reference, ground = WatchedMap(scene.reference), BoundedGround(scene.ground)
    placed = lay_on_map(image, state, replace(scene, reference=reference, ground=ground))
    return Registered(placed, state, corrected, settings, reference, ground)


def settings_part(config: PlacementConfig) -> dict[str, Any]:
    """All settings of a registration for JSON, with the numbers of the matcher's calibration."""
    matcher = replace(config.matcher, calibration=config.matcher.calibrated())
    part: dict[str, Any] = _SETTINGS.dump_python(replace(config, matcher=matcher), mode="json")
    return part


def settings_of(part: dict[str, Any]) -> PlacementConfig:
    """The settings that evidence states.

    Raises
    ------
    ValueError
        They are not those of this Pilotage's registration, or ask for more than any that was made.
    """
    try:
        config = _SETTINGS.validate_json(json.dumps(part), strict=True)
        stated_whole = settings_part(config) == part
    except (ValidationError, CalibrationError) as error:
        problem = describe_validation(error) if isinstance(error, ValidationError) else str(error)
        raise ValueError(f"the settings are not those of this version's registration: {problem[:300]}") from None
    if not stated_whole:
        raise ValueError("the settings are not those of this version's registration: some are missing or unknown")
    matcher = config.matcher
    sizes = (*config.levels_px, matcher.max_template_px, matcher.max_search_px)
    if (
        any(not 0.0 <= getattr(config, name) <= most for name, most in _MOST.items())
        or min(matcher.heading_step_rad, matcher.scale_step) < _LEAST_STEP
        or len(config.levels_px) > _MOST_LEVELS
        or not all(0 < size <= _MOST_PX for size in sizes)
    ):
        raise ValueError("the settings ask for a search that is larger than any that was made")
    return config
