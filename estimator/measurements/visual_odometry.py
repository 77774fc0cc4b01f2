"""Displacement between two pictures as a measurement on the filter and its clone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.measurements.camera_attitude import CameraAttitude
from estimator.measurements.innovation import Innovation
from estimator.odometry.planar import DisplacementResidual


def displacement(eskf: ErrorStateFilter, residual: DisplacementResidual, camera: CameraAttitude) -> Innovation:
    """Innovation of the mean track residual, which true poses would make zero."""
    H = eskf.layout.jacobian(
        2,
        position=residual.by_pos_second,
        attitude=residual.by_rotation_second @ camera.by_attitude,
        boresight=residual.by_rotation_second @ camera.by_boresight,
        ground_bias=residual.by_ground[:, [0, 0]],
        clone_position=residual.by_pos_first,
        clone_rotation=residual.by_rotation_first,
    )
    return Innovation(-residual.residual_ne_m, H, residual.cov_m2)


@dataclass(frozen=True, slots=True)
class SurfaceConfig:
    """How far a surface may stand above the ground model, by its relief.

    Fields and roads lie on the ground to ``bare_std_m``; from a relief of ``rough_m`` on, the surface is soon anywhere
    between the ground and the tops of what stands on it (ADR 0009).
    """

    bare_std_m: float = 0.4
    rough_m: float = 0.7


def bare_ground(
    eskf: ErrorStateFilter, residual: DisplacementResidual, distance_m: float, config: SurfaceConfig
) -> Innovation | None:
    """Innovation of the surface's local height above the ground model: a surface without relief is the ground.

    ``distance_m`` is how far the camera moved over it: along one correlation length of the height the steps together
    say it once. None where the relief is unknown.
    """
    if not np.isfinite(residual.relief_m):
        return None
    std_m = config.bare_std_m * (1.0 + (residual.relief_m / config.rough_m) ** 2)
    alike = max(eskf.noise.ground_bias_length_m[0] / max(distance_m, 0.1), 1.0)
    H = eskf.layout.jacobian(1, ground_bias=np.array([[1.0, 0.0]]))
    return Innovation(-eskf.nominal.ground_biases_m[:1], H, np.array([[std_m**2 * alike]]))
