"""The odometers that can be chosen: pairs of rays in, the disagreement with the predicted motion out."""

from __future__ import annotations

from collections.abc import Callable
from typing import Protocol

from estimator.odometry.depth_average import depth_average_residual
from estimator.odometry.homography import homography_residual
from estimator.odometry.planar import DisplacementResidual, displacement_residual
from estimator.types import Float


class Odometer(Protocol):
    """What the navigator asks of an odometer; see ``planar.displacement_residual`` for the arguments."""

    def __call__(
        self, rays_first: Float, rays_second: Float, pos_first_ned_m: Float, pos_second_ned_m: Float,
        down_at: Callable[[Float, Float], Float], pixel_std_rad: float, relative_std: float,
    ) -> DisplacementResidual | None:  # fmt: skip
        """Compare the motion that tracks show with the motion predicted; None when too few tracks agree."""


ODOMETERS: dict[str, Odometer] = {
    "rays": displacement_residual,
    "homography": homography_residual,
    "depth_average": depth_average_residual,
}
"""By name: rays cut with the terrain (the default), the thesis's homography, the depth average of 2008."""


def odometer(name: str) -> Odometer:
    """The odometer of a name; raises ValueError where there is none."""
    if name not in ODOMETERS:
        message = f"unknown odometer {name!r}; known: {', '.join(ODOMETERS)}"
        raise ValueError(message)
    return ODOMETERS[name]
