"""Displacement between two pictures as a measurement on the filter and its clone."""

from __future__ import annotations

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
