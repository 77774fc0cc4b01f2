"""The bookkeeping of the benchmark of targets in photos."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest

from backend.photos.target import PhotoTarget
from benchmarks.phototargets import Miss, miss_of, sightings, summary
from estimator.geometry.local import LocalFrame
from estimator.targets.registered import Budget, RegisteredTarget
from geodata.flight import FlightFolder
from geodata.flight_tables import TargetTruth
from tests.shared_data import shared_data

TRUTH = TargetTruth("T", math.radians(47.0), math.radians(8.0), 400.0)


def test_a_miss_is_measured_from_the_truth_in_the_stated_sigmas() -> None:
    lat, lon = LocalFrame(TRUTH.lat_rad, TRUTH.lon_rad, 0.0).geodetic_from_ne(np.array([3.0, -4.0]))
    found = RegisteredTarget(
        float(lat), float(lon), 400.0, np.zeros(3), np.diag([9.0, 4.0, 1.0]), 0.0, 10.0, 0.1, Budget(0, 0, 0, 0, 0, 0),
        np.eye(3), np.zeros(3),
    )  # fmt: skip

    miss = miss_of(PhotoTarget((1.0, 2.0), found=found), TRUTH, "windows")

    assert miss is not None
    assert miss.error_m == pytest.approx(5.0, abs=1e-3)
    assert miss.nees == pytest.approx(1.0 + 4.0, abs=1e-2)
    assert math.isnan(miss.ray_error_m)
    assert miss_of(PhotoTarget((1.0, 2.0), "sky"), TRUTH, "windows") is None


def test_the_summary_counts_what_was_answered() -> None:
    misses = [Miss("windows" if k else "whole picture", float(k), float(k), 2.0, 2.0 * k, 1.0, 3.0) for k in range(11)]

    found = summary(misses)

    assert (found["answered"], found["by_windows"]) == (11, 10)
    assert (found["ce50_m"], found["ce90_m"], found["worst_m"]) == pytest.approx((5.0, 9.0, 10.0))
    assert (found["ray_ce50_m"], found["stated_ce90_m"]) == pytest.approx((10.0, 2.0))
    assert found["in_ellipse95"] == pytest.approx(6 / 11)  # 5.99 is the limit
    assert summary([]) == {"answered": 0}


def test_frames_of_a_video_come_with_their_own_clicks(tmp_path: Path) -> None:
    data = shared_data("flights").parent
    flight = FlightFolder.open(data / "flights" / "plane_80m")

    found = list(sightings(flight, data, 30, 5, tmp_path))

    clicks = {c.t_video_us for c in flight.clicks()}
    assert len(found) == math.ceil(len(clicks) / 30)
    assert all(s.shot.path.is_file() and s.clicks and s.shot.known.pitch_deg is None for s in found)
    times = [s.clicks[0].t_video_us for s in found]
    assert times == sorted(times) and set(times) <= clicks
