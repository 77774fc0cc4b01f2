"""The magnetometer."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from simulator.sensors.magnetometer import Magnetometer


@pytest.mark.parametrize("heading_deg", [0.0, 100.0, -70.0])
def test_heading_from_the_field_is_off_by_the_declination(heading_deg: float) -> None:
    magnetometer = Magnetometer(4)
    ned_from_body = Rotation.from_euler("z", heading_deg, degrees=True).as_matrix()
    field = np.mean([magnetometer.field_body_gauss(ned_from_body) for _ in range(200)], axis=0)
    magnetic_deg = np.degrees(np.arctan2(-field[1], field[0]))
    # Five degrees of declination; the airframe's iron turns the needle by some degrees more.
    assert (magnetic_deg + 5.0 - heading_deg + 180) % 360 - 180 == pytest.approx(0.0, abs=9.0)
    assert np.linalg.norm(field) == pytest.approx(0.513, abs=0.05)
