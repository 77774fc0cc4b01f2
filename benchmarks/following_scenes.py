"""Scenes for the study of following: simulated ground, an aircraft that flies figures of eight, cars put into pictures.

The pictures are the simulator's; the target, twins of it and other cars are drawn on them in the camera's perspective,
with shadow, blur, noise and changing exposure, and what a codec leaves.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np
from scipy.ndimage import gaussian_filter1d

from estimator.geometry.camera import Camera, Mount
from estimator.geometry.rotation import matrix_from_euler, matrix_from_q, q_from_rotvec
from estimator.types import Float, Image
from simulator.random_streams import rng_for
from simulator.sensors.camera import CameraView
from simulator.vehicles.gauss_markov import GaussMarkov
from simulator.world.epoch import CURRENT
from simulator.world.layout import WayKind
from simulator.world.settle import base_layout, later_layout
from simulator.world.world import World, WorldSpec, world_for

HALF_SIZE_M, GSD_M = 400.0, 0.25
FRAMES_PER_S = 5.0
PACE_S = 0.02
LENGTH_M, WIDTH_M, BONNET_M, ROOF_M = 4.5, 1.8, 0.9, 1.45
TARGET_HEIGHT_M = 0.7  # what an operator would say of a car
ROUND_S = 36.0
AMPLITUDE_M = (70.0, 36.0)
GRAVITY_M_S2 = 9.81
COLOURS_BGR = (
    (220, 222, 222), (64, 60, 60), (42, 38, 38), (134, 130, 128), (36, 38, 150), (116, 66, 44), (76, 92, 70),
    (60, 170, 200), (150, 140, 60),
)  # fmt: skip
SPEED_M_S = 10.0


@dataclass(frozen=True, slots=True)
class Disturbance:
    """Errors of navigation: Gauss-Markov ones that last, and white ones, each standard deviation on each axis.

    ``keep_s`` is the time in which the lasting ones fall to 1/e.
    """

    pos_std_m: float
    attitude_std_deg: float
    keep_s: float = 20.0
    white_pos_std_m: float = 0.03
    white_attitude_std_deg: float = 0.05


@dataclass(frozen=True, slots=True, eq=False)
class Path2D:
    """Places (n, 2), headings (n,) and speeds (n,) of a car at steps of ``PACE_S``."""

    ne_m: Float
    yaw_rad: Float
    speed_m_s: Float

    def at(self, t_s: float) -> tuple[Float, float, float]:
        """Place (2,), heading and speed at a time."""
        k = min(round(t_s / PACE_S), len(self.ne_m) - 1)
        return self.ne_m[k], float(self.yaw_rad[k]), float(self.speed_m_s[k])


@dataclass(frozen=True, slots=True, eq=False)
class Car:
    """A car and its way."""

    path: Path2D
    colour_bgr: tuple[int, int, int]


@dataclass(frozen=True, slots=True, eq=False)
class Pose:
    """A camera: place (3,) and rotation (3, 3)."""

    pos_ned_m: Float
    ned_from_camera: Float


def world_of(seed: int, cache: Path) -> World:
    """The world of a seed."""
    return world_for(WorldSpec(seed=seed, half_size_m=HALF_SIZE_M, gsd_m=GSD_M), cache)


class FollowScene:
    """One flight over one target: ``cars[0]`` is the target, the rest are others, twins among them."""

    def __init__(self, world: World, seed: int, moving: bool, duration_s: float, camera: Camera, mount: Mount) -> None:
        self.world, self.camera, self.duration_s, self.moving = world, camera, duration_s, moving
        self._rng = rng_for(seed, "following", "moving" if moving else "standing")
        self._view = CameraView(world, camera, seed)
        self._light = GaussMarkov(rng_for(seed, "following", "light"), 0.07, 10.0, 1)
        self._noise = rng_for(seed, "following", "noise")
        self._body_from_camera = mount.body_from_camera
        lines = _streets(world)
        self.cars = self._cars(lines, moving)
        self._flight = self._figure_of_eight()

    def _cars(self, lines: list[Float], moving: bool) -> list[Car]:
        rng = self._rng
        steps = round(self.duration_s / PACE_S) + 2
        colour = COLOURS_BGR[rng.integers(len(COLOURS_BGR))]
        line = lines[0] if moving else lines[rng.integers(min(3, len(lines)))]
        others = [paint for paint in COLOURS_BGR if paint != colour]
        other = others[rng.integers(len(others))]
        if moving:
            start = rng.uniform(0.0, 0.3)
            cars = [Car(_drive(line, start, 1.0, steps), colour), Car(_drive(line, 1.0 - start, -1.0, steps), other)]
        else:
            at = line[len(line) // 2 + rng.integers(-len(line) // 6, len(line) // 6 + 1)]
            place, yaw = self._beside(at, rng.uniform(4.0, 10.0)), rng.uniform(-np.pi, np.pi)
            cars = [Car(_park(place, yaw, steps), colour), Car(_drive(line, 0.0, 1.0, steps), colour)]
        near = cars[0].path.ne_m[:: max(1, steps // 6)]
        for k, about in enumerate(near):
            # a twin of the target and a car of another colour, parked along its way
            for paint in (colour, others[rng.integers(len(others))]):
                if not moving and k > 2:
                    continue
                place = self._beside(about, rng.uniform(7.0, 22.0))
                cars.append(Car(_park(place, rng.uniform(-np.pi, np.pi), steps), paint))
        return cars

    def _beside(self, at_ne_m: Float, away_m: float) -> Float:
        """A place about so far away, not on a house or a tree where that can be had."""
        place = at_ne_m
        for _ in range(40):
            angle = self._rng.uniform(-np.pi, np.pi)
            place = at_ne_m + away_m * np.array([np.cos(angle), np.sin(angle)])
            row, col = self.world.raised_patch.row_col(place)
            r, c = round(float(row)), round(float(col))
            if self.world.raised[max(r - 5, 0) : r + 6, max(c - 5, 0) : c + 6].max(initial=0) < 5:
                break
        return place

    def _figure_of_eight(self) -> tuple[Float, Float, Float]:
        """Places (n, 3), yaws and rolls (n,) of an aircraft that circles about where the target drives."""
        t = np.arange(len(self.cars[0].path.ne_m)) * PACE_S
        about = gaussian_filter1d(self.cars[0].path.ne_m, 6.0 / PACE_S, axis=0, mode="nearest")
        phase, turn = self._rng.uniform(0, 2 * np.pi), self._rng.uniform(-np.pi, np.pi)
        w = 2 * np.pi / ROUND_S
        eight = np.stack((AMPLITUDE_M[0] * np.sin(w * t + phase), AMPLITUDE_M[1] * np.sin(2 * (w * t + phase))), -1)
        c, s = np.cos(turn), np.sin(turn)
        ne = np.clip(about + eight @ np.array([[c, s], [-s, c]]), -HALF_SIZE_M, HALF_SIZE_M)
        ne = gaussian_filter1d(ne, 1.0 / PACE_S, axis=0, mode="nearest")
        vel = np.gradient(ne, PACE_S, axis=0)
        yaw = np.unwrap(np.arctan2(vel[:, 1], vel[:, 0]))
        across = np.hypot(vel[:, 0], vel[:, 1]) * np.gradient(yaw, PACE_S)
        roll = gaussian_filter1d(np.clip(np.arctan(across / GRAVITY_M_S2), -0.3, 0.3), 0.4 / PACE_S, mode="nearest")
        yaw = gaussian_filter1d(yaw, 0.3 / PACE_S, mode="nearest")
        height = self._rng.uniform(75.0, 105.0) + 6.0 * np.sin(2 * np.pi * t / 55.0)
        ground = gaussian_filter1d(self.world.terrain.at(ne[:, 0], ne[:, 1]), 3.0 / PACE_S, mode="nearest")
        return np.column_stack((ne, -(ground + height))), yaw, roll

    def pose(self, t_s: float) -> Pose:
        """The camera's true pose."""
        pos, yaw, roll = self._flight
        k = min(round(t_s / PACE_S), len(yaw) - 1)
        return Pose(pos[k], matrix_from_euler(roll[k], 0.03, yaw[k]) @ self._body_from_camera)

    def target_ned_m(self, t_s: float) -> tuple[Float, float, float]:
        """Where the middle of the target is (3,), half way up, its heading and speed."""
        ne, yaw, speed = self.cars[0].path.at(t_s)
        down = -float(self.world.terrain.at(*ne)) - TARGET_HEIGHT_M
        return np.array([*ne, down]), yaw, speed

    def picture(self, t_s: float, pose: Pose) -> Image:
        """What the camera sees, cars included."""
        picture = self._view.render(pose.pos_ned_m, pose.ned_from_camera)
        for car in self.cars:
            ne, yaw, _ = car.path.at(t_s)
            self._draw(picture, pose, ne, yaw, car.colour_bgr)
        gain = float(np.exp(self._light.step(1.0 / FRAMES_PER_S)[0]))
        lit = cv2.convertScaleAbs(picture, alpha=gain)
        _, packed = cv2.imencode(".jpg", lit, [cv2.IMWRITE_JPEG_QUALITY, 85])
        return np.asarray(cv2.imdecode(packed, cv2.IMREAD_COLOR), np.uint8)

    def _draw(self, picture: Image, pose: Pose, ne: Float, yaw: float, bgr: tuple[int, int, int]) -> None:
        ground = float(self.world.terrain.at(*ne))
        c, s = np.cos(yaw), np.sin(yaw)

        def seen(along: tuple[float, float], half: float, height: float, shift: Float | None = None) -> Float:
            flat = np.array([[a, b] for a in along for b in (-half, half)]) @ np.array([[c, s], [-s, c]]) + ne
            flat = flat if shift is None else flat + shift
            points = np.column_stack((flat, np.full(4, -ground - height)))
            return self.camera.project((points - pose.pos_ned_m) @ pose.ned_from_camera)

        body, half = (-0.5 * LENGTH_M, 0.5 * LENGTH_M), 0.5 * WIDTH_M
        foot = seen(body, half, 0.0)
        if not np.isfinite(foot).all():
            return
        low, high = foot.min(axis=0) - 25, foot.max(axis=0) + 25
        if (high < 0).any() or low[0] > self.camera.width_px or low[1] > self.camera.height_px:
            return
        azimuth, elevation = np.radians(CURRENT.sun_azimuth_deg), np.radians(CURRENT.sun_elevation_deg)
        away = -ROOF_M / np.tan(elevation) * np.array([np.cos(azimuth), np.sin(azimuth)])
        paint = np.array(bgr, float)
        cabin = (-1.8, 1.0)
        roof = seen((-1.4, 0.3), 0.75 * half, ROOF_M)
        faces = [
            (np.vstack((foot, seen(body, half, 0.0, away))), 0.45, np.array([12.0, 10.0, 8.0])),
            (np.vstack((foot, seen(body, half, BONNET_M))), 1.0, 0.6 * paint),
            (seen(body, half, BONNET_M), 1.0, paint),
            (np.vstack((seen(cabin, 0.85 * half, BONNET_M), roof)), 1.0, 0.25 * paint + 22),
            (roof, 1.0, np.minimum(1.05 * paint, 255.0)),
        ]  # fmt: skip
        self._blend(picture, np.floor(low).astype(int), np.ceil(high).astype(int), faces)

    def _blend(self, picture: Image, low: Float, high: Float, faces: list[tuple[Float, float, Float]]) -> None:
        """Draw faces four times as fine, soften them as the lens does, and lay them on the picture."""
        fine = 4
        size = (high - low + 1).astype(int)
        colour = np.zeros((size[1] * fine, size[0] * fine, 3), np.float32)
        cover = np.zeros(colour.shape[:2], np.float32)
        for corners, alpha, paint in faces:
            hull = cv2.convexHull(((corners - low + 0.5) * fine - 0.5).astype(np.float32))
            face = np.zeros(cover.shape, np.uint8)
            cv2.fillConvexPoly(face, np.round(hull * 16).astype(np.int32), 1, cv2.LINE_8, 4)
            on = face > 0
            colour[on] = paint
            cover[on] = np.maximum(alpha, cover[on]) if alpha < 1.0 else 1.0
        premultiplied = cv2.GaussianBlur(colour * cover[..., None], (0, 0), 0.7 * fine)
        softened = cv2.GaussianBlur(cover, (0, 0), 0.7 * fine)
        small = cv2.resize(premultiplied, tuple(size.tolist()), interpolation=cv2.INTER_AREA)
        alpha_small = cv2.resize(softened, tuple(size.tolist()), interpolation=cv2.INTER_AREA)[..., None]
        r0, c0 = max(int(low[1]), 0), max(int(low[0]), 0)
        r1, c1 = min(int(high[1]) + 1, picture.shape[0]), min(int(high[0]) + 1, picture.shape[1])
        if r0 >= r1 or c0 >= c1:
            return
        part = slice(r0 - int(low[1]), r1 - int(low[1])), slice(c0 - int(low[0]), c1 - int(low[0]))
        u, v = (0.5 * (c0 + c1) - self.camera.cx_px), (0.5 * (r0 + r1) - self.camera.cy_px)
        r2 = (u * u + v * v) / (self.camera.cx_px**2 + self.camera.cy_px**2)
        shade = 1.0 - 0.28 * r2 * (0.6 + 0.4 * r2)
        below = picture[r0:r1, c0:c1].astype(np.float32)
        noise = self._noise.normal(0.0, 2.4, below.shape) * alpha_small[part]
        mixed = below * (1.0 - alpha_small[part]) + shade * small[part] + noise
        picture[r0:r1, c0:c1] = np.clip(np.round(mixed), 0, 255).astype(np.uint8)


class NavigationErrors:
    """What navigation believes of a true pose, and its covariance: lasting errors (6, 6)."""

    def __init__(self, seed: int, disturbance: Disturbance) -> None:
        self._d = disturbance
        rng = rng_for(seed, "following", "navigation")
        self._rng = rng
        self._pos = GaussMarkov(rng, disturbance.pos_std_m, disturbance.keep_s, 3)
        self._turn = GaussMarkov(rng, float(np.radians(disturbance.attitude_std_deg)), disturbance.keep_s, 3)
        self.cov = np.diag([disturbance.pos_std_m**2] * 3 + [np.radians(disturbance.attitude_std_deg) ** 2] * 3)

    def believed(self, pose: Pose, dt_s: float) -> Pose:
        """The pose as it is told, ``dt_s`` after the last."""
        white = np.radians(self._d.white_attitude_std_deg) * self._rng.standard_normal(3)
        turn = matrix_from_q(q_from_rotvec(self._turn.step(dt_s) + white))
        pos = pose.pos_ned_m + self._pos.step(dt_s) + self._d.white_pos_std_m * self._rng.standard_normal(3)
        return Pose(pos, turn @ pose.ned_from_camera)


def _streets(world: World) -> list[Float]:
    """Centre lines (n, 2) of the longest roads, a place a metre, within the middle of the world."""
    spec = world.spec
    layout = later_layout(base_layout(spec.seed, spec.half_size_m), spec.seed, spec.changed_share)
    out = []
    for way in layout.ways:
        if way.kind not in (WayKind.MAIN, WayKind.STREET):
            continue
        steps = np.hypot(*np.diff(way.line_ne_m, axis=0).T)
        along = np.concatenate(([0.0], np.cumsum(steps)))
        at = np.arange(0.0, along[-1], 1.0)
        line = np.stack([np.interp(at, along, way.line_ne_m[:, k]) for k in (0, 1)], axis=-1)
        line = line[(np.abs(line) < HALF_SIZE_M - 90.0).all(axis=1)]
        if len(line) > 60:
            out.append(gaussian_filter1d(line, 4.0, axis=0, mode="nearest"))
    if not out:
        message = f"world {spec.seed} has no road to drive on"
        raise ValueError(message)
    return sorted(out, key=len, reverse=True)


def _park(ne: Float, yaw: float, steps: int) -> Path2D:
    return Path2D(np.tile(ne, (steps, 1)), np.full(steps, yaw), np.zeros(steps))


def _drive(line: Float, start: float, way: float, steps: int) -> Path2D:
    """Up and down a road on its right side at 10 m/s, slower where it bends, turning about at its ends."""
    tangent = np.gradient(line, axis=0)
    tangent /= np.linalg.norm(tangent, axis=1, keepdims=True)
    right = np.stack((-tangent[:, 1], tangent[:, 0]), axis=-1)
    up, down = line + 2.0 * right, (line - 2.0 * right)[::-1]
    loop = np.vstack([_bend(up[-1], down[0], tangent[-1]), down, _bend(down[-1], up[0], -tangent[0]), up])
    loop = np.vstack((loop, loop[:1]))
    along = np.concatenate(([0.0], np.cumsum(np.hypot(*np.diff(loop, axis=0).T))))
    total = float(along[-1])
    at = np.arange(0.0, total, 0.25)
    fine = np.stack([gaussian_filter1d(np.interp(at, along, loop[:, k]), 10.0, mode="wrap") for k in (0, 1)], axis=-1)
    heading = np.unwrap(np.arctan2(*np.gradient(fine, axis=0).T[::-1]))
    bend = np.abs(np.gradient(heading) / np.maximum(np.hypot(*np.gradient(fine, axis=0).T), 1e-3))
    limit = np.minimum(SPEED_M_S, np.sqrt(2.5 / np.maximum(bend, 1e-3)))
    for order in (range(1, 2 * len(limit)), range(2 * len(limit) - 1, 0, -1)):
        for k in order:  # no faster than 2 m/s^2 of pulling away and braking allow
            here, there = k % len(limit), (k - 1) % len(limit)
            here, there = (here, there) if order.step == 1 else (there, here)
            limit[here] = min(limit[here], float(np.sqrt(limit[there] ** 2 + 2 * 2.0 * 0.25)))
    middle = len(_bend(up[-1], down[0], tangent[-1])) + len(down)
    first = along[min(len(along) - 1, middle + round(start * len(up)))] if way > 0 else along[round(start * len(down))]
    s, out = float(first), np.zeros((steps, 4))
    for k in range(steps):
        row = (s / 0.25) % len(fine)
        i, f = int(row), row - int(row)
        j = (i + 1) % len(fine)
        speed = float(limit[i])
        yaw = heading[i] + f * float(np.angle(np.exp(1j * (heading[j] - heading[i]))))
        out[k] = (*((1 - f) * fine[i] + f * fine[j]), yaw, speed)
        s = (s + speed * PACE_S) % total
    return Path2D(out[:, :2], out[:, 2], out[:, 3])


def _bend(start: Float, end: Float, ahead: Float) -> Float:
    """Half a round (n, 2) from one side of the road to the other, wide enough to drive."""
    centre, radius = 0.5 * (start + end), 7.0
    side = (start - end) / np.linalg.norm(start - end)
    angle = np.linspace(0.0, np.pi, 24)[1:-1]
    return centre + radius * (np.cos(angle)[:, None] * side + np.sin(angle)[:, None] * ahead) + 6.0 * ahead
