"""A pixel of a registered picture becomes a coordinate: the match carries it to the map, not the camera's pose.

The rectified picture lies on the map with its middle displaced, turned and scaled as the match has it. A pixel is
rectified (its ray cut with the ground) and carried along. An error of the pose in position has no part in that: the
camera is hung over the matched middle, so only what changes across the picture counts, times the way from the middle.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

import numpy as np

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.geometry.ground import intersect_terrain
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec
from estimator.ports import GroundModel
from estimator.targets.ray import no_ground, pixel_ray
from estimator.types import Float

METHOD = "registered"
MIN_STEP = 1e-6
HEIGHT_SIGMAS = 3


class Registration(Protocol):
    """How a picture lies on the map.

    ``centre_ned_m`` (3,) is the ground point that the camera at ``pos_ned_m`` (3,) with ``ned_from_camera`` (3, 3) was
    predicted to see. ``correction`` (6,), true minus predicted, with ``cov`` (6, 6): displacement of that point north
    and east in metres, the camera's height above it as a share of the predicted, and the rotation about the NED axes
    in radians (tilt about north and east, heading), in the sense R_true = Exp(rotation) R.
    """

    @property
    def centre_ned_m(self) -> Float:
        """Ground point (3,) about which the rest is taken."""

    @property
    def pos_ned_m(self) -> Float:
        """Predicted camera (3,)."""

    @property
    def ned_from_camera(self) -> Float:
        """Predicted rotation (3, 3)."""

    @property
    def correction(self) -> Float:
        """Correction (6,)."""

    @property
    def cov(self) -> Float:
        """Its covariance (6, 6)."""


@dataclass(frozen=True, slots=True)
class TargetErrors:
    """Standard deviations of what is not the match's.

    ``pixel_std_px`` of the click on each axis, ``ground_std_m`` of the ground's height at a point, ``slope_std`` of
    what the ground model leaves of the land's slope between the match's centre and there, rise over run,
    ``target_height_std_m`` of the target's height above ground, and ``map_offset_std_m`` of the whole map's
    displacement on each axis, which all targets on it share. ``ground_bias_std_m`` is of the height of all the ground
    in sight: the camera hangs over it whatever it is, so that it is in the target's altitude alone.
    """

    pixel_std_px: float = 2.0
    ground_std_m: float = 1.0
    slope_std: float = 0.0
    target_height_std_m: float = 0.0
    map_offset_std_m: float = 0.0
    ground_bias_std_m: float = 0.0

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            value = getattr(self, name)
            if not (np.isfinite(value) and value >= 0.0):
                message = f"{name} must be finite and not negative, not {value}"
                raise ValueError(message)


@dataclass(frozen=True, slots=True)
class Budget:
    """What the horizontal error is made of, standard deviations in metres along its worse direction each."""

    centre_m: float
    scale_m: float
    tilt_m: float
    heading_m: float
    pixel_m: float
    height_m: float


@dataclass(frozen=True, slots=True, eq=False)
class RegisteredTarget:
    """Where on the map a pixel lies.

    ``cov_on_map_ned_m2`` (3, 3) is of the place on this map; ``map_offset_std_m`` on each horizontal axis comes on top
    for the place in the world, and is common to all targets of the map. Of the former, ``cov_pixel_m2`` (3, 3) is the
    click's own and ``height_way_m`` (3,) how one standard deviation of the height there moves the place. ``lever_m`` is
    how far the place lies from the match's centre, ``off_nadir_rad`` how far from the vertical it is seen.
    """

    lat_rad: float
    lon_rad: float
    alt_amsl_m: float
    pos_ned_m: Float
    cov_on_map_ned_m2: Float
    map_offset_std_m: float
    lever_m: float
    off_nadir_rad: float
    budget: Budget
    cov_pixel_m2: Float
    height_way_m: Float
    method: str = METHOD

    @property
    def cov_ned_m2(self) -> Float:
        """Covariance (3, 3) of the place in the world: on the map, and the map's own."""
        offset_m2 = self.map_offset_std_m**2
        return self.cov_on_map_ned_m2 + np.diag([offset_m2, offset_m2, 0.0])


def locate_registered(
    registration: Registration, camera: Camera, uv_px: tuple[float, float], ground: GroundModel, frame: LocalFrame,
    errors: TargetErrors, height_above_ground_m: float = 0.0, max_range_m: float = 3000.0,
) -> RegisteredTarget:  # fmt: skip
    """Coordinates of what a pixel of a registered picture shows.

    Parameters
    ----------
    uv_px
        Pixel of the picture as stored, distortion included.
    ground
        Heights on the datum of ``frame``'s origin.
    height_above_ground_m
        How far the thing pointed at stands above the ground: the ray is cut that far above it, which moves the place
        towards the camera by the height times the tangent of the angle off the vertical.

    Raises
    ------
    GeometryError
        The pixel lies outside the picture or the lens model; its ray meets no known ground within ``max_range_m``, or
        so flatly that the stated errors would lift it over the horizon.

    Notes
    -----
    The covariance is the sum over independent errors of half the difference of the places one standard deviation to
    either side, so that rough ground is looked at over the very width that the errors span. Where a ray passes closely
    over an edge, heights of two or three deviations more make it stop there, far from where it otherwise does: of the
    ways per deviation of height the longest counts.
    """
    ray = pixel_ray(camera, uv_px)
    place = _Placing(registration, camera, ground, frame.alt_m, height_above_ground_m, max_range_m)
    point = place.points(registration.correction[None], np.asarray([uv_px], dtype=np.float64), np.zeros(1))[0]
    if not np.isfinite(point).all():
        raise GeometryError(_why_not(place, ray, max_range_m))
    lever_m = float(np.linalg.norm((point - place.centre_of(registration.correction[None])[0])[:2]))
    height_std_m = float(np.sqrt(
        errors.ground_std_m**2 + (errors.slope_std * lever_m) ** 2 + errors.target_height_std_m**2
    ))  # fmt: skip
    factor = _root(registration.cov)
    pixel = errors.pixel_std_px * np.eye(2)
    steps = np.zeros((8, 8))
    steps[:6, :6], steps[6:, 6:] = factor.T, pixel
    spread = np.vstack((place.half_differences(uv_px, steps), place.by_height(uv_px, point, height_std_m)))
    if not np.isfinite(spread).all():
        message = "the pixel's ray meets the ground too flatly, or too near the end of the terrain, to say how well"
        raise GeometryError(message)
    cov = spread.T @ spread + np.diag([0.0, 0.0, errors.ground_bias_std_m**2])
    lat, lon, alt = frame.geodetic_from_ned(point)
    seen = point - place.camera_of(registration.correction[None])[0][0]
    return RegisteredTarget(
        float(lat), float(lon), float(alt), point, cov, errors.map_offset_std_m, lever_m,
        float(np.arctan2(np.hypot(seen[0], seen[1]), seen[2])),
        _budget(place, registration.cov, uv_px, spread), spread[6:8].T @ spread[6:8], spread[8],
    )  # fmt: skip


def _budget(place: _Placing, cov: Float, uv_px: tuple[float, float], spread: Float) -> Budget:
    """Each error alone; the match's own are correlated, so theirs do not add up to the whole."""
    alone = np.zeros((6, 8))
    alone[:, :6] = np.diag(np.sqrt(np.maximum(np.diag(cov), MIN_STEP**2)))
    one = place.half_differences(uv_px, alone)[:, :2]

    def worst(rows: Float) -> float:
        return float(np.linalg.norm(rows, 2))

    return Budget(
        worst(one[0:2]), worst(one[2:3]), worst(one[3:5]), worst(one[5:6]), worst(spread[6:8, :2]),
        worst(spread[8:9, :2]),
    )  # fmt: skip


def _why_not(place: _Placing, ray_camera: Float, max_range_m: float) -> str:
    pos, rotation = place.camera_of(place.registration.correction[None])
    if float((rotation[0] @ ray_camera)[2]) <= 0.0:
        return "the pixel looks at or above the horizon: it shows no ground"
    below = place.down_at(pos[:, 0], pos[:, 1])
    far = f"{no_ground(max_range_m)}, or beyond the known terrain"
    return far if np.isfinite(below).all() else "the height of the ground is not known there"


def _root(cov: Float) -> Float:
    """A factor F (n, n) with F F^T = cov, also where that is singular."""
    values, axes = np.linalg.eigh(0.5 * (cov + cov.T))
    root: Float = axes * np.sqrt(np.maximum(values, 0.0))
    return root


@dataclass(frozen=True, slots=True, eq=False)
class _Placing:
    """From corrections (n, 6), pixels (n, 2) and heights (n,) above the assumed to places (n, 3)."""

    registration: Registration
    camera: Camera
    ground: GroundModel
    origin_alt_amsl_m: float
    height_m: float
    max_range_m: float

    def down_at(self, north_m: Float, east_m: Float) -> Float:
        """NED down of the ground; NaN where unknown."""
        return self.origin_alt_amsl_m - self.ground.alt_amsl_m(north_m, east_m)

    def centre_of(self, correction: Float) -> Float:
        """The matched middle (n, 3), on the ground at its displaced place."""
        centre = self.registration.centre_ned_m
        ne = centre[:2] + correction[:, :2]
        down = self.down_at(ne[:, 0], ne[:, 1])
        return np.column_stack((ne, np.where(np.isfinite(down), down, centre[2])))

    def camera_of(self, correction: Float) -> tuple[Float, Float]:
        """Cameras (n, 3) hung over the matched middle, and their rotations (n, 3, 3)."""
        r = self.registration
        turn = np.array([matrix_from_q(q_from_rotvec(each)) for each in correction[:, 3:]])
        to_centre = r.centre_ned_m - r.pos_ned_m
        towards = turn @ to_centre
        height_m = to_centre[2] * (1.0 + correction[:, 2:3])
        pos = self.centre_of(correction) - towards * (height_m / towards[:, 2:3])
        return pos, turn @ r.ned_from_camera

    def points(self, correction: Float, uv_px: Float, raised_m: Float) -> Float:
        """Where the rays meet the ground raised by the target's height, and ``raised_m`` (n,) more; NaN where none."""
        pos, rotation = self.camera_of(correction)
        rays = np.einsum("nij,nj->ni", rotation, self.camera.rays(uv_px))
        found = np.full(pos.shape, np.nan)
        for raised in np.unique(raised_m):
            which = raised_m == raised
            lift_m = self.height_m + float(raised)

            def down_at(north_m: Float, east_m: Float, lift_m: float = lift_m) -> Float:
                return self.down_at(north_m, east_m) - lift_m

            found[which] = intersect_terrain(pos[which], rays[which], down_at, self.max_range_m)
        return found

    def half_differences(self, uv_px: tuple[float, float], steps: Float) -> Float:
        """Half the way (n, 3) between the places a step (n, 8) of correction and pixel to either side."""
        both = np.concatenate((steps, -steps))
        correction = self.registration.correction + both[:, :6]
        points = self.points(correction, np.asarray(uv_px) + both[:, 6:], np.zeros(len(both)))
        half: Float = 0.5 * (points[: len(steps)] - points[len(steps) :])
        return half

    def by_height(self, uv_px: tuple[float, float], point_ned_m: Float, height_std_m: float) -> Float:
        """The longest way (3,) from the place per deviation of height, up to ``HEIGHT_SIGMAS`` of them."""
        sigmas = np.array([sign * k for k in range(1, HEIGHT_SIGMAS + 1) for sign in (1.0, -1.0)])
        many = np.ones((len(sigmas), 1))
        points = self.points(many * self.registration.correction, many * np.asarray(uv_px), sigmas * height_std_m)
        ways = (points - point_ned_m) / sigmas[:, None]
        if not np.isfinite(ways[:2]).all():
            return np.full(3, np.nan)
        ways = np.where(np.isfinite(ways).all(axis=1, keepdims=True), ways, 0.0)
        longest: Float = ways[int(np.argmax(np.linalg.norm(ways, axis=1)))]
        return longest
