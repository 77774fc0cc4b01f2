"""The truth of a picture of a demonstration, found without the station's estimate.

The same seed flies the same route, so a second simulation knows where the camera truly was at every exposure. Only when
it took off is unknown: the GPS track tells that to within a second, and of the exposures of that second the one whose
true picture is like the station's picture is the right one.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from estimator.geometry.ground import intersect_terrain
from estimator.types import Float, Image
from simulator.scenario import SCENARIOS
from simulator.sensors.camera import CameraView
from simulator.simulation import STEP_US, Exposure, Simulation
from simulator.world.world import World, world_for

_LONGEST_PAUSE_S = 30.0
_SEARCHED_S = 1.2
_BLUR_PX = 1.5
_BACKGROUND_PX = 12.0


@dataclass(frozen=True, slots=True, eq=False)
class FlownTruth:
    """Exposures of a flight from its start, and where it was (n, 2) north and east after each step of 5 ms."""

    world: World
    seed: int
    exposures: list[Exposure]
    ne_m: Float

    @classmethod
    def of_demo(cls, seed: int, worlds: Path, flown_s: float) -> FlownTruth:
        """Fly the demonstration again for a time, out of the cache of worlds that it used."""
        scenario = SCENARIOS["demo"]
        world = world_for(scenario.world.spec(seed), worlds)
        simulation = Simulation(scenario, world, seed, 0)
        exposures, places = [], []
        for _ in range(round(flown_s * 1e6 / STEP_US)):
            exposure = simulation.step().exposure
            assert simulation.state is not None
            places.append(simulation.state.pos_ned_m[:2].copy())
            if exposure is not None:
                exposures.append(exposure)
        return cls(world, seed, exposures, np.array(places))

    def take_off_us(self, t_unix_us: Sequence[int], lat_deg: Sequence[float], lon_deg: Sequence[float]) -> int:
        """When the flight began by the station's clock, from a GPS track; good to about a tenth of a second."""
        gps_ne_m = self.world.frame.ne_from_geodetic(np.radians(lat_deg), np.radians(lon_deg))
        since_first = np.round((np.array(t_unix_us) - t_unix_us[0]) / STEP_US).astype(int)
        last = len(self.ne_m) - 1 - since_first[-1]
        assert last > 0, "the flight was simulated for less time than its GPS track lasts"
        cost = [float(np.mean((self.ne_m[since_first + first] - gps_ne_m) ** 2)) for first in range(last)]
        return int(t_unix_us[0]) - (int(np.argmin(cost)) + 1) * STEP_US

    def exposure_of(self, picture_bgr: Image, t_since_take_off_us: float) -> tuple[Exposure, float]:
        """The exposure that took a picture, and how like the true picture is (correlation, 1 for the same)."""
        section = SCENARIOS["demo"].camera
        view = CameraView(self.world, section.intrinsics(), self.seed, 0.0, section.vignetting)
        near = [e for e in self.exposures if abs(e.t_unix_us - t_since_take_off_us) < 1e6 * _SEARCHED_S]
        assert near, "the picture was taken outside the simulated time"
        wanted = _texture(picture_bgr)
        likeness = [float(np.mean(wanted * _texture(view.render(e.camera_pos_ned_m, e.ned_from_camera)))) for e in near]
        best = int(np.argmax(likeness))
        return near[best], likeness[best]

    def ground_ne_m(self, exposure: Exposure, u_px: float, v_px: float) -> Float:
        """North and east (2,) of the bare ground that a pixel of an exposure shows."""
        camera = SCENARIOS["demo"].camera.intrinsics()
        ray_ned = exposure.ned_from_camera @ camera.rays(np.array([u_px, v_px]))
        return np.asarray(intersect_terrain(exposure.camera_pos_ned_m, ray_ned, self.world.ground_down_m)[:2])


def flown_s(gps_t_unix_us: Sequence[int]) -> float:
    """How long to fly again so that a GPS track which began after the take-off is covered."""
    return (gps_t_unix_us[-1] - gps_t_unix_us[0]) / 1e6 + _LONGEST_PAUSE_S


def _texture(picture_bgr: Image) -> Float:
    """Brightness without slow changes, of mean 0 and variance 1."""
    grey = cv2.cvtColor(picture_bgr, cv2.COLOR_BGR2GRAY).astype(np.float64)
    fine = cv2.GaussianBlur(grey, (0, 0), _BLUR_PX) - cv2.GaussianBlur(grey, (0, 0), _BACKGROUND_PX)
    return np.asarray((fine - fine.mean()) / max(float(fine.std()), 1e-9))
