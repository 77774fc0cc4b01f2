"""The coordinate from the bundle alone, by OpenCV, PROJ and this file's own arithmetic: nothing is missing in it."""

import json
import math
from pathlib import Path
from typing import Any

import cv2
import numpy as np
import pyproj
import pytest
from numpy.typing import NDArray

from backend.evidence.bundle import unpack
from tests.backend.evidence.flown import click, evidence_zip, hilly_station

Array = NDArray[np.float64]


def ray_of(content: dict[str, Any]) -> Array:
    """Direction in NED of the pixel clicked, by OpenCV's undistortion."""
    camera, click, frame = content["camera"], content["click"], content["frame"]
    u = (click["u_px"] + 0.5) * camera["width_px"] / frame["width_px"] - 0.5
    v = (click["v_px"] + 0.5) * camera["height_px"] / frame["height_px"] - 0.5
    matrix = np.array([[camera["fx_px"], 0, camera["cx_px"]], [0, camera["fy_px"], camera["cy_px"]], [0, 0, 1.0]])
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-14)
    at = np.array([[[u, v]]])
    flat = cv2.undistortPointsIter(at, matrix, np.array(camera["distortion"]), None, None, criteria)  # type: ignore[call-overload]
    w, x, y, z = content["state"]["q_ned_from_camera"]
    ned_from_camera = np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
            [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
            [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
        ]
    )
    ray: Array = ned_from_camera @ np.array([*flat[0, 0], 1.0])
    return ray / float(np.linalg.norm(ray))


def height_m(content: dict[str, Any], north_m: float, east_m: float) -> float:
    """Altitude of the ground, bilinear between the cells that the bundle lists."""
    model = content["ground"]["model"]
    row, col = (model["north_max_m"] - north_m) / model["gsd_m"], (east_m - model["east_min_m"]) / model["gsd_m"]
    total = 0.0
    for r in (math.floor(row), math.floor(row) + 1):
        for c in (math.floor(col), math.floor(col) + 1):
            i = r - model["first_row"]
            height = model["alt_amsl_m"][i][c - model["first_cols"][i]]
            assert i >= 0
            assert c >= model["first_cols"][i]
            total += (1.0 - abs(row - r)) * (1.0 - abs(col - c)) * height
    return total - float(content["state"]["ground_bias_m"])


def cut(content: dict[str, Any], origin: Array, ray: Array) -> Array:
    """First place where the ray is below the ground: steps of half a metre, then halving.

    Where flat ground was chosen, the level plane at its altitude.
    """
    raised_m = float(content["ground"]["target_height_m"])
    if content["ground"]["model"]["kind"] == "flat":
        lowered_m = content["state"]["ground_bias_m"] - raised_m
        level_m = content["local_frame"]["alt_m"] - content["ground"]["model"]["alt_amsl_m"] + lowered_m
        plane: Array = origin + ray * (level_m - origin[2]) / ray[2]
        return plane

    def above(s: float) -> float:
        north, east, down = origin + s * ray
        return (
            float(content["local_frame"]["alt_m"])
            - float(down)
            - raised_m
            - height_m(content, float(north), float(east))
        )

    far = 0.0
    while above(far) > 0.0:
        far += 0.5
    near = far - 0.5
    while far - near > 1e-7:
        middle = 0.5 * (near + far)
        near, far = (middle, far) if above(middle) > 0.0 else (near, middle)
    return origin + far * ray


def covariance(content: dict[str, Any], origin: Array, ray: Array, point: Array) -> Array:
    """By differences: pose, two turns across the ray and the ground's height are moved, on the plane at the point."""
    step = content["ground"]["slope_step_m"]
    north, east = float(point[0]), float(point[1])
    slope = np.zeros(2)
    if content["ground"]["model"]["kind"] == "elevation_grid":
        along_north = height_m(content, north + step, east) - height_m(content, north - step, east)
        along_east = height_m(content, north, east + step) - height_m(content, north, east - step)
        slope = -np.array([along_north, along_east]) / (2.0 * step)
    normal = np.array([-slope[0], -slope[1], 1.0])

    def on_plane(start: Array, along: Array, lower_m: float = 0.0) -> Array:
        hit: Array = start + along * (normal @ (point + np.array([0.0, 0.0, lower_m]) - start)) / (normal @ along)
        return hit

    def turned(axis: Array, angle_rad: float) -> Array:
        rotation, _ = cv2.Rodrigues(axis * angle_rad)
        return np.asarray(rotation @ ray, dtype=np.float64)

    h, unit = 1e-5, np.eye(3)
    moved = [(on_plane(origin + h * e, ray) - on_plane(origin - h * e, ray)) / (2 * h) for e in unit]
    turns = [(on_plane(origin, turned(e, h)) - on_plane(origin, turned(e, -h))) / (2 * h) for e in unit]
    across = np.linalg.svd(ray[np.newaxis])[2][1:]
    pixels = [(on_plane(origin, turned(e, h)) - on_plane(origin, turned(e, -h))) / (2 * h) for e in across]
    lower = (on_plane(origin, ray, h) - on_plane(origin, ray, -h)) / (2 * h)
    by_pose, by_pixel = np.stack(moved + turns, axis=-1), np.stack(pixels, axis=-1)
    pixel_std_rad = content["click"]["std_px"] / content["camera"]["fx_px"]
    # ground lower by one metre everywhere moves places along their rays
    by_all = np.column_stack((by_pose, lower))
    joint = np.zeros((7, 7))
    joint[:6, :6] = content["state"]["cov_camera_pose"]
    if content["state"]["cov_ground_bias"] is not None:
        joint[6] = joint[:, 6] = content["state"]["cov_ground_bias"]
    cov: Array = by_all @ joint @ by_all.T
    cov = cov + pixel_std_rad**2 * by_pixel @ by_pixel.T
    away_m = math.hypot(*(point - origin)[:2])
    std_m = math.hypot(content["ground"]["std_m"], content["ground"]["slope_std"] * away_m)
    return cov + std_m**2 * np.outer(lower, lower)


def geodetic(content: dict[str, Any], ned_m: Array) -> tuple[float, float, float]:
    """Longitude, latitude (degrees) and height by PROJ."""
    place = content["local_frame"]
    lat_deg, lon_deg = math.degrees(place["lat_rad"]), math.degrees(place["lon_rad"])
    pipeline = pyproj.Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 "
        f"+lat_0={lat_deg!r} +lon_0={lon_deg!r} +h_0={place['alt_m']!r} "
        "+step +inv +proj=cart +ellps=WGS84"
    )
    lon, lat, height = pipeline.transform(float(ned_m[1]), float(ned_m[0]), -float(ned_m[2]))
    return lon, lat, height


@pytest.mark.parametrize(
    ("u_px", "v_px", "method", "height_m"),
    [
        (100.25, 190.75, "ray_terrain", 0.0), (300.5, 70.25, "ray_terrain", 7.5), (160.0, 230.0, "ray_terrain", -3.0),
        (8.0, 16.0, "ray_flat", 0.0),  # meets the ground beside the elevation model
        (160.0, 230.0, "ray_flat", 12.0),
    ],
)  # fmt: skip
async def test_the_bundle_alone_gives_the_coordinate_to_a_millimetre(
    tmp_path: Path, u_px: float, v_px: float, method: str, height_m: float
) -> None:
    async with hilly_station(tmp_path) as running:
        choice = {"height_above_ground_m": height_m, "ground": method.removeprefix("ray_")}
        target = await click(running, 37, u_px, v_px, **choice)
        bundle = unpack((await evidence_zip(running, target["id"])).content, "bundle")
    content = json.loads(bundle.document)
    origin, ray = np.array(content["state"]["pos_ned_m"]) + content["state"]["lever_ned_m"], ray_of(content)

    point = cut(content, origin, ray)
    lon_deg, lat_deg, alt_m = geodetic(content, point)

    stated = target["properties"]
    _, _, apart_m = pyproj.Geod(ellps="WGS84").inv(lon_deg, lat_deg, stated["lon_deg"], stated["lat_deg"])
    assert content["result"]["method"].startswith(method)
    assert float(np.linalg.norm(point - origin)) > 90.0  # the ground is that far down
    assert apart_m < 1e-3
    assert abs(alt_m - stated["alt_amsl_m"]) < 1e-3
    cov = covariance(content, origin, ray, point)
    # the scale of differences of 1e-5
    np.testing.assert_allclose(cov, content["result"]["cov_ned_m2"], rtol=1e-5, atol=1e-5 * np.trace(cov))
