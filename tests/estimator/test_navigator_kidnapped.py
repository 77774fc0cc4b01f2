"""A navigator that is not told where it is, or has lost its place."""

from dataclasses import replace

import numpy as np
import pytest

from estimator.filters.initialise import InitialGuess
from estimator.geometry.camera import Mount
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import q_from_euler
from estimator.measurements.global_fix import GlobalFixConfig
from estimator.navigator import Navigator, NavigatorConfig
from estimator.registration.global_search import SearchConfig
from estimator.types import AttitudeSample, BarometerSample, FrameSample, GnssSample, Mode
from tests.estimator.wide_map import CAMERA, GROUND_ALT_M, HEIGHT_M, Flight, Plain, WideMap

FRAME = LocalFrame(np.deg2rad(47.0), np.deg2rad(8.0), GROUND_ALT_M)
MOUNT = Mount(0.0, -np.pi / 2, 0.0, np.zeros(3))
WORLD = WideMap(3)
FLIGHT = Flight()
T0_US = 1_700_000_000_000_000
HEADING_OFF_RAD = 1.9
SEARCH = GlobalFixConfig(search=SearchConfig(cell_m=3.0), near_cell_m=3.0, stretch_m=60.0)
CONFIG = NavigatorConfig(global_fix=SEARCH)


def _navigator(config: NavigatorConfig) -> Navigator:
    return Navigator(config, CAMERA, MOUNT, "fixed", FRAME, WORLD, Plain())


def _fly(navigator: Navigator, start_s: float, end_s: float, heading_off_rad: float) -> None:
    for k in range(round(start_s * 20), round(end_s * 20)):
        t_s, t_us = k / 20.0, T0_US + k * 50_000
        if k % 2 == 0:
            q = q_from_euler(0.0, 0.0, FLIGHT.heading(t_s) + heading_off_rad)
            navigator.offer(AttitudeSample(t_us, q, np.zeros(3)))
            navigator.offer(BarometerSample(t_us, GROUND_ALT_M + HEIGHT_M + 8.0))
        if k % 5 == 0:
            navigator.offer(FrameSample(t_us, k, FLIGHT.picture(t_s, WORLD)))
        navigator.advance(t_us)


def _error_m(navigator: Navigator, t_s: float) -> float:
    state = navigator.state
    assert state is not None
    return float(np.hypot(*(state.pos_ned_m - FLIGHT.pos_ned_m(t_s))[:2]))


def _fix(t_s: float, off_m: float = 0.0) -> GnssSample:
    lat, lon, alt = FRAME.geodetic_from_ned(FLIGHT.pos_ned_m(t_s) + np.array([off_m, 0.0, 0.0]))
    t_us = T0_US + round(t_s * 1e6)
    return GnssSample(t_us, float(lat), float(lon), float(alt), np.full(3, np.nan), 1.5, 2.5, 12)


def test_it_finds_itself_without_any_position() -> None:
    """
    Fault: no satellites, no home, and a heading 109 degrees off.
    Expected: it says that it searches; then it navigates by vision, heading set right, with an honest ellipse.
    """
    navigator = _navigator(CONFIG)
    _fly(navigator, 0.0, 8.0, HEADING_OFF_RAD)
    assert navigator.state is None
    assert "first position" in str(navigator.waiting_for)
    assert "searching the map" in str(navigator.waiting_for)

    _fly(navigator, 8.0, 42.0, HEADING_OFF_RAD)

    state = navigator.state
    assert state is not None
    assert navigator.waiting_for is None
    assert state.mode is Mode.VISION
    # a map pixel is a metre
    assert _error_m(navigator, 41.95) < 3.0
    yaw = 2.0 * np.arctan2(state.q_ned_from_body[3], state.q_ned_from_body[0])
    assert np.angle(np.exp(1j * (yaw - FLIGHT.heading(41.95)))) == pytest.approx(0.0, abs=0.03)
    error = (state.pos_ned_m - FLIGHT.pos_ned_m(41.95))[:2]
    # chi squared of two degrees of freedom, 99.9 %
    assert error @ np.linalg.inv(state.cov_pos_ned_m2[:2, :2]) @ error < 13.8


def test_a_position_that_comes_ends_the_search() -> None:
    navigator = _navigator(CONFIG)
    _fly(navigator, 0.0, 6.0, 0.0)
    navigator.offer(_fix(6.0))
    _fly(navigator, 6.0, 7.0, 0.0)
    assert navigator.state is not None
    assert navigator.waiting_for is None


def test_it_finds_itself_again_when_lost() -> None:
    """
    Fault: the position to start from is given 260 m off and known to be poor, beyond what fixes look for.
    Expected: mode lost, the whole map is searched, and vision takes over at the true place.
    """
    lat, lon, _ = FRAME.geodetic_from_ned(FLIGHT.pos_ned_m(0.0) + np.array([220.0, 140.0, 0.0]))
    guess = InitialGuess(lat_rad=float(lat), lon_rad=float(lon), position_std_m=150.0)
    search = replace(CONFIG.global_fix, after_loss=True)
    navigator = _navigator(replace(CONFIG, initial=guess, global_fix=search))
    _fly(navigator, 0.0, 5.0, 0.0)
    assert navigator.state is not None
    assert navigator.state.mode is Mode.LOST
    assert "searching the map" in str(navigator.waiting_for)

    _fly(navigator, 5.0, 36.0, 0.0)

    assert navigator.state.mode is Mode.VISION
    assert navigator.waiting_for is None
    assert _error_m(navigator, 35.95) < 3.0
