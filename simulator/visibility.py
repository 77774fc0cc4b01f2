"""Which landmarks a camera sees, and where in the picture."""

from __future__ import annotations

import numpy as np

from estimator.geometry.camera import Camera
from estimator.types import Float
from simulator.world.world import RAISED_UNIT_M, World

_RIM_PX = 25.0
_TALLEST_M = 22.0
_OWN_REACH_M = 3.0


class Sight:
    """Projects the world's landmarks and leaves out those that something hides."""

    def __init__(self, world: World, camera: Camera) -> None:
        self._world, self._camera = world, camera
        self._places = np.array([[m.north_m, m.east_m, -m.height_m] for m in world.landmarks]).reshape(-1, 3)

    def visible(self, camera_pos_ned_m: Float, ned_from_camera: Float) -> list[tuple[str, Float]]:
        """Names and pixels (2,) of the landmarks well inside the picture."""
        if not len(self._places):
            return []
        uv_px = self._camera.project((self._places - camera_pos_ned_m) @ ned_from_camera)
        low = np.array([_RIM_PX, _RIM_PX])
        high = np.array([self._camera.width_px - _RIM_PX, self._camera.height_px - _RIM_PX])
        inside = np.all((uv_px > low) & (uv_px < high), axis=1)
        return [
            (self._world.landmarks[index].name, uv_px[index])
            for index in np.flatnonzero(inside)
            if not self._is_hidden(self._places[index], camera_pos_ned_m)
        ]

    def _is_hidden(self, place_ned_m: Float, camera_pos_ned_m: Float) -> bool:
        """Whether anything raised stands between, other than what is at the place itself."""
        toward = camera_pos_ned_m - place_ned_m
        if toward[2] >= -1.0:
            return True
        rise_m = np.arange(0.5, _TALLEST_M, 0.25)
        line = place_ned_m + np.outer(rise_m / -toward[2], toward)
        patch = self._world.raised_patch
        row_col = np.round(patch.row_col(line[:, :2])).astype(int)
        row_col = np.clip(row_col, 0, [patch.rows - 1, patch.cols - 1])
        raised_m = self._world.raised[row_col[:, 0], row_col[:, 1]] * RAISED_UNIT_M
        elsewhere = np.linalg.norm(line[:, :2] - place_ned_m[:2], axis=1) > _OWN_REACH_M
        return bool(np.any(elsewhere & (raised_m > rise_m)))
