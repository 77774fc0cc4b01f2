"""Locating photos on one map: reads map and terrain once, turns hints into a prior, and answers in degrees."""

from __future__ import annotations

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np

from backend.navigation.setup import UNKNOWN_SLOPE_STD, CameraProfile, camera_of
from backend.photos.hints import DEFAULT_RADIUS_M, HintError, Hints, hints_of_photo
from backend.uncertainty import ellipse95
from estimator.geometry.camera import Camera
from estimator.geometry.local import LocalFrame
from estimator.ports import GroundModel, ReferenceMap
from estimator.registration.locate import LocateConfig, Located, NotLocated, locate
from estimator.registration.pose_prior import PosePrior
from estimator.types import Image
from geodata.elevation import ElevationGrid, FlatGround
from geodata.errors import EmptyRasterError, FlightFolderError, PhotoError, RasterError
from geodata.imagery import ImageryGrid, NeBounds, ReferenceImagery
from geodata.photo import PhotoMeta, read_photo

WHOLE_MAP_PIXELS = 25_000_000
WHOLE_MAP_RADIUS_M = 1500.0
PICTURE_PX = 640
GUESSED_AGL_M = (45.0, 75.0, 120.0, 190.0)
HEADING_STD_RAD = math.radians(5.0)
KNOWN_TILT_STD_RAD, OPEN_TILT_STD_RAD = math.radians(2.0), math.radians(7.0)


@dataclass(frozen=True, slots=True)
class PhotoAnswer:
    """Where a photo was taken, or why that is not known; numbers are None where there is no candidate at all.

    A refused answer may name its best place all the same; it is no position. ``score`` is the similarity at the
    place, -1 to 1. ``failed`` marks a photo that could not be tried.
    """

    photo: str
    accepted: bool
    reason: str
    elapsed_ms: float
    lat_deg: float | None = None
    lon_deg: float | None = None
    alt_amsl_m: float | None = None
    heading_deg: float | None = None
    std_n_m: float | None = None
    std_e_m: float | None = None
    cov_ne_m2: float | None = None
    semi_major_m: float | None = None
    semi_minor_m: float | None = None
    azimuth_deg: float | None = None
    score: float | None = None
    outlier_probability: float | None = None
    method: str | None = None
    failed: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class Attempt:
    """Everything that one try needs: grey picture (rows, cols), camera, map, ground and prior."""

    image: Image
    camera: Camera
    reference: ReferenceMap
    terrain: GroundModel
    prior: PosePrior
    config: LocateConfig

    def locate(self, origin_alt_amsl_m: float) -> Located | NotLocated:
        """Try it."""
        return locate(self.image, self.camera, self.reference, self.terrain, origin_alt_amsl_m, self.prior, self.config)


class PhotoSession:
    """One map with its terrain, ready for photos."""

    def __init__(
        self, map_path: Path, elevation_path: Path | None = None, profile: CameraProfile | None = None,
        ground_alt_amsl_m: float | None = None, config: LocateConfig | None = None,
    ) -> None:  # fmt: skip
        """Raises RasterError where a file cannot be used."""
        self.config = config or LocateConfig()
        if elevation_path is None:
            steeper = max(self.config.ground_slope_std, UNKNOWN_SLOPE_STD)
            self.config = replace(self.config, ground_slope_std=steeper)
        self._profile = profile
        self._imagery = ReferenceImagery.open(map_path, profile.map.offset_ne_m if profile else (0.0, 0.0))
        known = profile.map.ground_alt_amsl_m if profile and ground_alt_amsl_m is None else ground_alt_amsl_m
        self._ground_alt_amsl_m = known
        self.frame = LocalFrame(*self._imagery.raster.bounds.middle_rad, known or 0.0)
        self._elevation = elevation_path
        self._terrain: GroundModel | None = None
        if elevation_path is not None:
            self._terrain = ElevationGrid.open(elevation_path, self.frame)
        elif known is not None:
            self._terrain = FlatGround(known)
        self._grids: dict[tuple[float, ...], ImageryGrid] = {}

    def close(self) -> None:
        """Release the map's file."""
        self._imagery.close()

    def answer(self, path: Path, hints: Hints, use_exif_gps: bool = False) -> PhotoAnswer:
        """Locate one photo; what is wrong with it is an answer, too."""
        started = time.perf_counter()
        try:
            _, found = self.found(path, hints, use_exif_gps)
        except (PhotoError, RasterError, HintError, FlightFolderError) as error:
            return PhotoAnswer(path.name, False, str(error), _since_ms(started), failed=True)
        if isinstance(found, NotLocated):
            return PhotoAnswer(path.name, False, found.reason, _since_ms(started))
        return self.in_degrees(path.name, found, _since_ms(started))

    def found(
        self, path: Path, hints: Hints, use_exif_gps: bool = False
    ) -> tuple[Attempt | None, Located | NotLocated]:
        """The first attempt that was accepted and what it found, else the first; raises as ``attempts`` does."""
        best: tuple[Attempt | None, Located | NotLocated] = None, NotLocated("nothing was tried")
        for attempt in self.attempts(path, hints, use_exif_gps):
            tried = attempt.locate(self.frame.alt_m)
            if isinstance(best[1], NotLocated) or (isinstance(tried, Located) and tried.accepted):
                best = attempt, tried
            if isinstance(best[1], Located) and best[1].accepted:
                break
        return best

    def attempts(self, path: Path, hints: Hints, use_exif_gps: bool = False) -> Iterator[Attempt]:
        """What there is to try with a photo, the likeliest first.

        Where the height is unknown some are guessed; pictures may be stored upside down and headings be those of the
        aircraft, so looking down the heading is left open in the end. Keypoints alone try those.

        Raises
        ------
        PhotoError, RasterError, HintError
            Photo, map or hints cannot be used.
        """
        image, meta = read_photo(path)
        hints = hints.over(hints_of_photo(meta, use_exif_gps))
        camera = self._camera(meta, hints, path)
        centre_ne_m, radius_m, std_m = self._place(hints)
        quick = replace(self.config, proposers=("sift", "akaze"))
        guesses: list[Hints] = []
        if hints.agl_m is None and hints.alt_amsl_m is None:
            guesses = [replace(hints, agl_m=agl_m, height_std_m=0.25 * agl_m) for agl_m in GUESSED_AGL_M]
        for tried in guesses or [hints]:
            terrain, prior = self._prior(centre_ne_m, radius_m, std_m, tried)
            reference = self._reference(prior, terrain, camera)
            yield Attempt(image, camera, reference, terrain, prior, quick if guesses else self.config)
        looks_down = hints.pitch_deg is None or hints.pitch_deg < -70.0
        if hints.heading_deg is not None and looks_down and not guesses:
            open_prior = replace(prior, heading_rad=0.0, heading_std_rad=math.inf)
            yield Attempt(image, camera, reference, terrain, open_prior, quick)

    def _camera(self, meta: PhotoMeta, hints: Hints, path: Path) -> Camera:
        if self._profile is not None:
            camera = camera_of(self._profile.camera)
            if (camera.width_px, camera.height_px) == (meta.width_px, meta.height_px):
                return camera
            scaled = camera.scaled(meta.width_px / camera.width_px)
            if (scaled.width_px, scaled.height_px) == (meta.width_px, meta.height_px):
                return scaled
            size = f"{camera.width_px} x {camera.height_px}"
            raise HintError(
                f"{path}: the picture has {meta.width_px} x {meta.height_px} pixels, its camera file is for {size}; "
                "give the camera file of these pictures"
            )
        if hints.hfov_deg is None:
            raise HintError(f"{path}: says nothing of its field of view; give --hfov DEG or --camera CAM.json")
        return Camera.from_hfov(meta.width_px, meta.height_px, math.radians(hints.hfov_deg))

    def _place(self, hints: Hints) -> tuple[np.ndarray, float, float]:
        if hints.lat_deg is None or hints.lon_deg is None:
            bounds = self._imagery.bounds_ne(self.frame)
            low = np.array([bounds.north_min_m, bounds.east_min_m])
            high = np.array([bounds.north_max_m, bounds.east_max_m])
            radius_m = float(0.5 * np.linalg.norm(high - low))
            if radius_m > WHOLE_MAP_RADIUS_M:
                raise HintError(
                    f"the map is {2 * radius_m / 1000:.1f} km across; say where to look with --near LAT,LON --radius M"
                    " (or --use-exif-gps)"
                )
            return 0.5 * (low + high), radius_m, math.inf
        centre = self.frame.ne_from_geodetic(math.radians(hints.lat_deg), math.radians(hints.lon_deg))
        if hints.sigma_m is not None:
            return centre, 3.0 * hints.sigma_m, hints.sigma_m
        radius_m = DEFAULT_RADIUS_M if hints.radius_m is None else hints.radius_m
        # who says "within 100 m" does not mean that 101 m are out of the question
        return centre, 1.05 * radius_m + 5.0, math.inf

    def _prior(
        self, centre_ne_m: np.ndarray, radius_m: float, std_m: float, hints: Hints
    ) -> tuple[GroundModel, PosePrior]:
        terrain = self._terrain
        if terrain is None:
            if hints.agl_m is None:
                raise HintError(
                    "an altitude above sea level needs the ground's: give --elevation D.tif, --ground-alt M, or --agl M"
                )
            terrain = FlatGround(self.frame.alt_m)
        steps = radius_m * np.linspace(-1.0, 1.0, 9)
        north, east = np.meshgrid(centre_ne_m[0] + steps, centre_ne_m[1] + steps)
        heights = terrain.alt_amsl_m(north.ravel(), east.ravel())
        heights = heights[np.isfinite(heights)]
        if not heights.size:
            raise HintError("the elevation does not reach the place where the photo is looked for")
        middle, relief = float(np.median(heights)), float(np.std(heights))
        if hints.agl_m is not None:
            alt = middle + hints.agl_m
            std = math.hypot(hints.height_std_m or max(3.0, 0.08 * hints.agl_m), relief)
        else:
            alt, std = hints.alt_amsl_m or 0.0, hints.height_std_m or 3.0
            if alt < float(heights.min()) + 3.0:
                raise HintError(f"{alt:.0f} m above sea level is below the ground, which is {middle:.0f} m high here")
        has_heading = hints.heading_deg is not None
        return terrain, PosePrior(
            centre_ne_m, radius_m, std_m, self.frame.alt_m - alt, std,
            math.radians(hints.heading_deg or 0.0) if has_heading else 0.0,
            HEADING_STD_RAD if has_heading else math.inf,
            math.radians(-90.0 if hints.pitch_deg is None else hints.pitch_deg), math.radians(hints.roll_deg or 0.0),
            KNOWN_TILT_STD_RAD if hints.attitude_is_known else OPEN_TILT_STD_RAD,
        )  # fmt: skip

    def _reference(self, prior: PosePrior, terrain: GroundModel, camera: Camera) -> ReferenceMap:
        """The map about the prior at the picture's own resolution or the map's, whichever is coarser."""
        at = prior.pos_ne_m
        ground = terrain.alt_amsl_m(at[0:1], at[1:2])[0]
        agl_m = max((prior.down_m * -1.0 + self.frame.alt_m) - (float(ground) if np.isfinite(ground) else 0.0), 5.0)
        wanted_m = agl_m * camera.width_px / camera.fx_px / PICTURE_PX
        steps = max(0, math.floor(math.log(max(wanted_m / self._imagery.gsd_m, 1.0), 1.25)))
        gsd_m = self._imagery.gsd_m * 1.25**steps
        whole = self._imagery.bounds_ne(self.frame)
        area_m2 = (whole.north_max_m - whole.north_min_m) * (whole.east_max_m - whole.east_min_m)
        bounds = whole
        if area_m2 / gsd_m**2 > WHOLE_MAP_PIXELS:
            reach = prior.radius_m + 4.0 * agl_m + 200.0
            if not _overlap(whole, at, reach):
                raise EmptyRasterError(
                    self._imagery.raster.path, "does not reach the place where the photo is looked for", "check --near"
                )
            bounds = NeBounds(
                max(whole.north_min_m, at[0] - reach), max(whole.east_min_m, at[1] - reach),
                min(whole.north_max_m, at[0] + reach), min(whole.east_max_m, at[1] + reach),
            )  # fmt: skip
        key = (gsd_m, bounds.north_min_m, bounds.east_min_m, bounds.north_max_m, bounds.east_max_m)
        if key not in self._grids:
            self._grids.clear()
            self._grids[key] = self._imagery.grid(self.frame, gsd_m, bounds)
        return self._grids[key]

    @property
    def has_datum(self) -> bool:
        """Whether heights are above sea level: by elevation, or the altitude of level ground."""
        return self._terrain is not None

    @property
    def has_elevation(self) -> bool:
        """Whether the ground's shape is known."""
        return self._elevation is not None

    def in_degrees(self, name: str, found: Located, elapsed_ms: float) -> PhotoAnswer:
        """An answer in degrees."""
        lat, lon, alt = self.frame.geodetic_from_ned(found.pose.pos_ned_m)
        ellipse = ellipse95(found.cov_ne_m2)
        return PhotoAnswer(
            name, found.accepted, found.reason, elapsed_ms, math.degrees(float(lat)), math.degrees(float(lon)),
            float(alt) if self.has_datum else None, math.degrees(found.heading_rad),
            math.sqrt(found.cov_ne_m2[0, 0]), math.sqrt(found.cov_ne_m2[1, 1]), float(found.cov_ne_m2[0, 1]),
            ellipse.semi_major_m, ellipse.semi_minor_m, ellipse.azimuth_deg, found.evidence.similarity,
            found.outlier_probability, found.source,
        )  # fmt: skip


def _overlap(whole: NeBounds, at: Any, reach_m: float) -> bool:
    return bool(
        at[0] - reach_m < whole.north_max_m and at[0] + reach_m > whole.north_min_m
        and at[1] - reach_m < whole.east_max_m and at[1] + reach_m > whole.east_min_m
    )  # fmt: skip


def _since_ms(started_s: float) -> float:
    return (time.perf_counter() - started_s) * 1e3
