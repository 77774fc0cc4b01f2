from dataclasses import replace

import numpy as np
import pytest

from estimator.measurements.visual_odometry import SurfaceConfig, bare_ground
from estimator.odometry.planar import DisplacementResidual
from tests.estimator.measurements.filters import general_filter


def _residual(relief_m: float) -> DisplacementResidual:
    nothing = np.zeros((2, 3))
    return DisplacementResidual(
        np.zeros(2), nothing, nothing, nothing, nothing, np.zeros((2, 1)), np.eye(2), 100, 1.0, relief_m
    )


def _over_ground(relief_m: float, steps: int, step_m: float) -> tuple[float, float]:
    """Local surface height and its sigma after steps over ground of some relief, from -9 m, a canopy's top, on."""
    eskf = general_filter()
    eskf.nominal = replace(eskf.nominal, ground_biases_m=np.array([-9.0, 0.5]))
    where = eskf.layout.slices["ground_bias"]
    eskf.P[where, where] = np.diag([6.0**2, 0.7**2])
    for _ in range(steps):
        innovation = bare_ground(eskf, _residual(relief_m), step_m, SurfaceConfig())
        assert innovation is not None
        eskf.update(innovation.z, innovation.H, innovation.R)
    return float(eskf.nominal.ground_biases_m[0]), float(np.sqrt(eskf.P[where, where][0, 0]))


def test_surface_without_relief_is_taken_for_the_ground() -> None:
    height_m, std_m = _over_ground(relief_m=0.1, steps=30, step_m=3.0)

    assert abs(height_m) < 0.2
    assert std_m < 0.6


def test_canopy_keeps_its_height() -> None:
    height_m, std_m = _over_ground(relief_m=3.5, steps=30, step_m=3.0)

    assert height_m < -6.0
    assert std_m > 4.0


def test_how_often_one_looks_at_the_same_ground_tells_nothing_new() -> None:
    """Fault: pictures three times as often. Expected: the same knowledge over the same distance."""
    seldom = _over_ground(relief_m=0.6, steps=20, step_m=4.5)
    often = _over_ground(relief_m=0.6, steps=60, step_m=1.5)

    assert often == pytest.approx(seldom, rel=1e-6)


def test_unknown_relief_says_nothing() -> None:
    assert bare_ground(general_filter(), _residual(float("inf")), 3.0, SurfaceConfig()) is None
