"""Displacement between two pictures as a measurement on the filter and its clone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.filters.eskf import ErrorStateFilter
from estimator.measurements.camera_attitude import CameraAttitude
from estimator.measurements.innovation import Innovation
from estimator.odometry.planar import DisplacementResidual, MomentResidual
from estimator.types import Float


def displacement(
    eskf: ErrorStateFilter, residual: DisplacementResidual, camera: CameraAttitude, since: str = "clone"
) -> Innovation:
    """Innovation of the mean track residual, which true poses would make zero; ``since`` is clone or keyframe."""
    by_first = np.concatenate((residual.by_pos_first, residual.by_rotation_first), axis=1)
    by_second = np.concatenate((residual.by_pos_second, residual.by_rotation_second), axis=1)
    if residual.by_heights is None:
        heights = {"ground_bias": residual.by_ground[:, [0, 0]]}
    else:
        heights = {"structure": residual.by_heights}
    H = _by_poses(eskf, camera, since, by_first, by_second, heights)
    return Innovation(-residual.residual_ne_m, H, residual.cov_m2)


def moments(eskf: ErrorStateFilter, residual: MomentResidual, camera: CameraAttitude, since: str) -> Innovation:
    """Innovation of the tracks' turn and growth about their middle; ``since`` is clone or keyframe."""
    heights = {"structure": residual.by_heights}
    H = _by_poses(eskf, camera, since, residual.by_pose_first, residual.by_pose_second, heights)
    return Innovation(-residual.residual, H, residual.cov)


def _by_poses(
    eskf: ErrorStateFilter, camera: CameraAttitude, since: str, by_first: Float, by_second: Float,
    heights: dict[str, Float],
) -> Float:  # fmt: skip
    """Jacobian (2, size) of a residual with derivatives (2, 6) by the earlier and by the present camera pose."""
    return eskf.layout.jacobian(
        2,
        position=by_second[:, :3],
        attitude=by_second[:, 3:] @ camera.by_attitude,
        boresight=by_second[:, 3:] @ camera.by_boresight,
        **heights,
        **{f"{since}_position": by_first[:, :3], f"{since}_rotation": by_first[:, 3:]},
    )


@dataclass(frozen=True, slots=True)
class SurfaceConfig:
    """How far a surface may stand above the ground model, by its relief.

    Fields and roads lie on the ground to ``bare_std_m``; from a relief of ``rough_m`` on, the surface is soon anywhere
    between the ground and the tops of what stands on it (ADR 0009). ``tie_std_m`` is how far the mean of the points
    that have a height may differ from that of all that is seen.
    """

    bare_std_m: float = 0.4
    rough_m: float = 0.7
    tie_std_m: float = 0.3


def surface(eskf: ErrorStateFilter, residual: DisplacementResidual, config: SurfaceConfig) -> Innovation | None:
    """Innovation of how far what is seen lies below the ground model, by known heights; None where there are none."""
    if residual.below_by_heights is None:
        return None
    variance = residual.below_variance_m2 + config.tie_std_m**2
    H = eskf.layout.jacobian(1, ground_bias=np.ones((1, 2)), structure=-residual.below_by_heights)
    return Innovation(np.array([residual.below_m]), H, np.array([[variance]]))


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
