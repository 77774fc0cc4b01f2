"""A board of AprilTags in a picture: OpenCV's detector, both planar poses (IPPE), least squares with the tilt known."""

from __future__ import annotations

import cv2
import numpy as np

from estimator.errors import GeometryError
from estimator.geometry.camera import Camera
from estimator.landing.pad import Tag, TagPad
from estimator.landing.pose import PadPose, TiltPrior, both_solutions, corners
from estimator.landing.sighting import NoPad, PadSighting, Refusal
from estimator.types import Float, Image

CORNER_STD_PX = 0.35
"""Blur draws corners of black squares inwards alike, so they err more than by noise: NEES of 3 in rendered pictures."""
_AMBIGUOUS_BELOW = 13.8
_LEAST_SIDE_PX = 12.0
_MISFIT = 10.0
"""Cost a coordinate beyond which tags stand otherwise than described; photos with a plain lens reach 3."""


def find_tags(image: Image) -> list[tuple[int, Float]]:
    """Numbers and corner pixels (4, 2) of all tags of 36h11 in a grey picture; top left first, then clockwise."""
    parameters = cv2.aruco.DetectorParameters()
    parameters.cornerRefinementMethod = cv2.aruco.CORNER_REFINE_SUBPIX
    parameters.cornerRefinementWinSize = 3
    parameters.cornerRefinementMaxIterations = 20
    dictionary = cv2.aruco.getPredefinedDictionary(cv2.aruco.DICT_APRILTAG_36h11)
    pixels, numbers, _ = cv2.aruco.ArucoDetector(dictionary, parameters).detectMarkers(image)
    if not len(pixels):
        return []
    return [
        (int(number), np.asarray(quad, np.float64).reshape(4, 2))
        for number, quad in zip(np.ravel(numbers), pixels, strict=True)
    ]


def detect_tags(image: Image, camera: Camera, pad: TagPad, prior: TiltPrior | None = None) -> PadSighting | NoPad:
    """The board in a grey picture (rows, cols), or why there is none to use.

    A mirrored tag is no tag, so a mirrored board is not seen at all.
    """
    if image.ndim != 2 or image.shape != (camera.height_px, camera.width_px):
        message = f"the picture is {image.shape}, the camera's are grey of ({camera.height_px}, {camera.width_px})"
        raise GeometryError(message)
    seen = find_tags(image)
    known = {tag.number: tag for tag in pad.tags}
    mine = [
        (known[number], quad) for number, quad in seen
        if number in known and float(np.ptp(quad, axis=0).max()) >= _LEAST_SIDE_PX
    ]  # fmt: skip
    if not mine:
        others = sorted({number for number, _ in seen} - set(known))
        if others:
            return NoPad(Refusal.FOREIGN, f"tags {others} are in view, but pad '{pad.name}' has {sorted(known)}")
        return NoPad(Refusal.NOTHING, "no pad in view")
    numbers = [tag.number for tag, _ in mine]
    if len(set(numbers)) < len(numbers):
        return NoPad(Refusal.TWO_PADS, f"two pads '{pad.name}' are in view; which one to land on is not known")
    return _sighting(camera, pad, mine, prior)


def _sighting(
    camera: Camera, pad: TagPad, mine: list[tuple[Tag, Float]], prior: TiltPrior | None
) -> PadSighting | NoPad:
    points = np.concatenate([tag.corners_m for tag, _ in mine])
    pixels = np.concatenate([quad for _, quad in mine])
    start = planar_poses(camera, points, pixels)
    edges = corners(camera, points, pixels)
    both = both_solutions(edges, start[0], prior, CORNER_STD_PX, _AMBIGUOUS_BELOW, CORNER_STD_PX) if start else ()
    if not both or both[0].cost > _MISFIT * 2 * len(points):
        numbers = sorted(tag.number for tag, _ in mine)
        return NoPad(
            Refusal.FOREIGN,
            f"tags {numbers} of pad '{pad.name}' do not stand as described: another print or description",
        )
    return PadSighting(both, -1, len(mine) / len(pad.tags), len(points))


def planar_poses(camera: Camera, points_m: Float, pixels: Float) -> list[PadPose]:
    """Both poses of coplanar points (n, 3), the better first (Collins and Bartoli, IJCV 109, 2014); empty if none."""
    rays = camera.rays(pixels)
    count, turns, shifts, _ = cv2.solvePnPGeneric(
        points_m, rays[:, :2] / rays[:, 2:], np.eye(3), np.zeros(5), flags=cv2.SOLVEPNP_IPPE
    )
    return [
        PadPose(np.asarray(cv2.Rodrigues(turns[i])[0], np.float64), np.asarray(shifts[i], np.float64).reshape(3))
        for i in range(count)
    ]
