"""The receiver."""

from __future__ import annotations

import numpy as np
import pytest

from simulator.scenario import SensorSection
from simulator.sensors.gnss import GnssReceiver
from simulator.vehicles.state import VehicleState


def state(t_us: int) -> VehicleState:
    zero = np.zeros(3)
    pos = np.array([10.0, 20.0, -100.0])
    return VehicleState(t_us, pos, np.array([5.0, 0, 0]), 0.0, 0.0, 0.0, np.array([1.0, 0, 0, 0]), zero, zero, zero)


def test_errors_have_the_stated_size() -> None:
    errors = []
    for seed in range(60):
        receiver = GnssReceiver(seed, SensorSection())
        errors.append(receiver.measure(state(0), 0.2).pos_ned_m - state(0).pos_ned_m)
    # 120 draws: the standard deviation is known to 7 %.
    assert np.std(np.array(errors)[:, :2]) == pytest.approx(0.8, rel=0.3)
    assert np.std(np.array(errors)[:, 2]) == pytest.approx(1.5, rel=0.4)


def test_cut_receiver_has_no_fix_and_needs_time_to_come_back() -> None:
    receiver = GnssReceiver(1, SensorSection())
    first = receiver.measure(state(0), 0.2)
    assert first.has_fix
    receiver.cut(True, 200_000)
    dark = receiver.measure(state(200_000), 0.2)
    assert not dark.has_fix
    assert dark.satellites == 0
    np.testing.assert_array_equal(dark.pos_ned_m, first.pos_ned_m)
    receiver.cut(False, 1_000_000)
    assert not receiver.measure(state(2_000_000), 0.2).has_fix
    assert receiver.measure(state(8_000_000), 0.2).has_fix
