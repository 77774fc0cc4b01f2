"""What a large correction of the attitude does to the errors of all rotations."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from estimator.filters.nominal import Clone
from tests.estimator.filters.eskf_cases import FULL, quiet_filter


@pytest.mark.parametrize("group", ["attitude", "clone_rotation", "keyframe_rotation"])
def test_a_large_correction_turns_what_is_left_of_every_rotation_error(group: str) -> None:
    """Against the errors themselves: what is left of each, taken about the corrected rotation (SciPy)."""
    left_std_rad, corrected_rad = 0.01, np.array([0.2, -0.15, 0.3])
    P = np.diag(np.full(FULL.size, 1e-8))
    P[FULL.slices[group], FULL.slices[group]] = np.diag([left_std_rad**2, 1e-8, 1e-8])
    eskf = quiet_filter(P)
    dx = np.zeros(FULL.size)
    dx[FULL.slices["attitude"]] = dx[FULL.slices[group]] = corrected_rad
    # no uncertainty is used up by it, so that what is left is what was there
    eskf._inject(dx)

    ends = [Rotation.from_rotvec(corrected_rad + side * np.array([left_std_rad, 0.0, 0.0])) for side in (-1.0, 1.0)]
    left = (ends[1] * ends[0].inv()).as_rotvec() / 2.0

    assert_allclose(eskf.cov(group), np.outer(left, left), atol=4e-6)
    assert abs(eskf.cov(group)[0, 2]) > 5e-6


def test_a_large_correction_leaves_the_clone_as_sure_of_the_turn_since() -> None:
    """What odometry measures right after a picture is known, before and after ten degrees are put right."""
    P = np.diag(np.full(FULL.size, 1e-10))
    P[FULL.slices["attitude"], FULL.slices["attitude"]] = np.eye(3) * np.radians(10.0) ** 2
    eskf = quiet_filter(P)
    by_state = FULL.jacobian(3, attitude=np.eye(3))
    eskf.clone(Clone(eskf.nominal.motion.pos_ned_m, eskf.nominal.motion.q_ned_from_body), by_state)
    eskf.take_keyframe(Clone(eskf.nominal.motion.pos_ned_m, eskf.nominal.motion.q_ned_from_body), by_state, None, None)
    tilt = FULL.jacobian(2, attitude=np.eye(3)[:2])

    eskf.update(np.radians([10.0, -8.0]), tilt, np.eye(2) * np.radians(2.0) ** 2)

    for then in ("clone_rotation", "keyframe_rotation"):
        turn = FULL.jacobian(3, **{"attitude": np.eye(3), then: -np.eye(3)})
        assert_allclose(turn @ eskf.P @ turn.T, 0.0, atol=1e-9)
    assert np.degrees(np.sqrt(eskf.cov("attitude")[2, 2])) == pytest.approx(10.0, abs=0.2)
