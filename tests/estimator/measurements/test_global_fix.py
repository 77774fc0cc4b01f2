import numpy as np
import pytest

from estimator.geometry.rotation import wrap_pi
from estimator.measurements.global_fix import FoundPose, GlobalFixConfig, GlobalFixer
from estimator.registration.global_search import SearchConfig
from tests.estimator.wide_map import CAMERA, GROUND_ALT_M, HEIGHT_M, Flight, Plain, WideMap, yaw_matrix

WORLD, OTHER = WideMap(3), WideMap(4)
FLIGHT = Flight()
# a low flight over a small map: everything is half as large as by default
CONFIG = GlobalFixConfig(search=SearchConfig(cell_m=3.0), near_cell_m=3.0, stretch_m=60.0)
TURN_RAD, BAROMETER_OFF_M = -2.3, 12.0


def _fly(fixer: GlobalFixer, seconds: float) -> tuple[float, FoundPose] | None:
    """Offer pictures at 4 Hz, the heading turned and the barometer off, until something is found."""
    for k in range(round(4.0 * seconds)):
        t_s = k / 4.0
        level = yaw_matrix(-TURN_RAD) @ FLIGHT.ned_from_camera(t_s)
        pressure_alt_m = GROUND_ALT_M + HEIGHT_M + BAROMETER_OFF_M
        found = fixer.offer(k * 250_000, FLIGHT.picture(t_s, WORLD), level, pressure_alt_m)
        if found is not None:
            return t_s, found
    return None


def test_it_is_found_with_its_heading_and_height() -> None:
    fixer = GlobalFixer(CAMERA, WORLD, Plain(), GROUND_ALT_M, CONFIG)
    assert "searching the map" in fixer.words
    answer = _fly(fixer, 45.0)
    assert answer is not None
    t_s, found = answer
    error = found.pos_ned_m - FLIGHT.pos_ned_m(t_s)
    assert (np.abs(error) < 3.0 * found.pos_std_m).all()
    assert wrap_pi(found.turn_rad - TURN_RAD) == pytest.approx(0.0, abs=2.0 * found.turn_std_rad)
    heading = FLIGHT.heading(t_s)
    np.testing.assert_allclose(found.vel_ned_m_s[:2], 12.0 * np.array([np.cos(heading), np.sin(heading)]), atol=1.5)


def test_on_a_map_of_elsewhere_it_stays_lost() -> None:
    """
    Fault: the map is of another place.
    Expected: never found, and the words say that it is still searched.
    """
    fixer = GlobalFixer(CAMERA, OTHER, Plain(), GROUND_ALT_M, CONFIG)
    assert _fly(fixer, 28.0) is None
    assert fixer.searches > 0
    assert "searching the map" in fixer.words


def test_work_is_rationed() -> None:
    """No picture may cost more than its share, however much waits to be searched."""
    fixer = GlobalFixer(CAMERA, WORLD, Plain(), GROUND_ALT_M, CONFIG)
    steps = []
    for k in range(60):
        before = fixer.slices_done
        fixer.offer(k * 250_000, FLIGHT.picture(k / 4.0, WORLD), FLIGHT.ned_from_camera(k / 4.0), GROUND_ALT_M + 60.0)
        steps.append(fixer.slices_done - before)
    cells = 300 * 300  # of the map; its transforms are larger
    assert 0 < max(steps) <= CONFIG.max_share_s * CONFIG.cells_per_s / cells
