import math

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.registration.pose_prior import PosePrior, heading_of


def _prior(**changes: object) -> PosePrior:
    known = {"pos_ne_m": np.array([10.0, -20.0]), "radius_m": 100.0, "std_m": 40.0, "down_m": -80.0, "down_std_m": 4.0}
    return PosePrior(**{**known, **changes})


def test_straight_down_the_heading_is_the_pictures_top() -> None:
    # picture's up is camera -y; looking down and heading east it points east
    rotation = _prior(heading_rad=math.pi / 2).ned_from_camera()

    assert_allclose(rotation @ [0.0, 0.0, 1.0], [0.0, 0.0, 1.0], atol=1e-12)
    assert_allclose(rotation @ [0.0, -1.0, 0.0], [0.0, 1.0, 0.0], atol=1e-12)
    assert heading_of(rotation) == pytest.approx(math.pi / 2)


def test_oblique_the_heading_is_the_optical_axis() -> None:
    rotation = _prior(heading_rad=math.pi, pitch_rad=-math.pi / 4).ned_from_camera()

    assert_allclose(rotation @ [0.0, 0.0, 1.0], [-math.sqrt(0.5), 0.0, math.sqrt(0.5)], atol=1e-12)
    assert heading_of(rotation) == pytest.approx(math.pi)


def test_density_ends_at_the_radius_and_falls_by_the_deviation() -> None:
    prior = _prior()
    places = np.array([[10.0, -20.0], [50.0, -20.0], [111.0, -20.0]])

    assert_allclose(prior.log_density(places), [0.0, -0.5, -np.inf])


@pytest.mark.parametrize("changes", [{"radius_m": 0.0}, {"down_std_m": -1.0}, {"down_m": math.nan}])
def test_senseless_priors_are_refused(changes: dict[str, float]) -> None:
    with pytest.raises(ValueError, match="pose prior must be"):
        _prior(**changes)
