"""What the measurement of targets reads and says, and that the flown eight is one that can be flown."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

from benchmarks.eights import AIRSPEED_M_S, GRAVITY_M_S2, HEIGHT_M, WIND_M_S, figure_of_eight
from benchmarks.targets import Miss, misses, summary, with_gps
from geodata.flight_tables import TargetTruth

KNOWN = {"a": TargetTruth("a", math.radians(47.0), math.radians(8.0), 400.0)}


def test_misses_are_read_from_what_a_replay_writes(tmp_path: Path) -> None:
    metre_deg = 1.0 / 111_177.0  # of latitude at 47 degrees
    (tmp_path / "targets.csv").write_text(
        "target,lat_deg,lon_deg,alt_amsl_m,ce90_m,method,observations\n"
        f"a,{47.0 + 3.0 * metre_deg:.9f},8.0,400,2.5,fused,4\nunknown,47,8,400,1,fused,1\n"
    )
    (tmp_path / "sightings.csv").write_text(
        "time_us,target,u_px,v_px,method,lat_deg,lon_deg,alt_amsl_m,ce90_m,note\n"
        f"1,a,1,1,ray_terrain,{47.0 - 2.0 * metre_deg:.9f},8.0,400,1.5,\n1,a,1,1,,,,,,sky\n"
    )

    found = misses(tmp_path, KNOWN)

    assert [m.what for m in found] == ["target", "1 click, ray"]
    assert [m.north_m for m in found] == pytest.approx([3.0, -2.0], abs=0.01)
    assert [m.ce90_m for m in found] == [2.5, 1.5]


def test_the_summary_says_how_the_stated_circles_fit() -> None:
    found = summary([Miss("target", float(n), 0.0, 5.0) for n in range(11)])["target"]

    assert (found["ce50_m"], found["ce90_m"], found["worst_m"]) == (5.0, 9.0, 10.0)
    assert found["inside_ce90"] == pytest.approx(6 / 11)
    assert found["mean_north_m"] == 5.0


def test_a_flight_is_given_its_gps_back_and_stays_as_it_is(tmp_path: Path) -> None:
    flight = tmp_path / "flight"
    flight.mkdir()
    (flight / "flight.json").write_text(json.dumps({"name": "x", "gps_denied": [[1, 2]]}))
    (flight / "truth.csv").write_text("t")

    copy = with_gps(flight, tmp_path / "copy")

    assert json.loads((copy / "flight.json").read_text()) == {"name": "x", "gps_denied": []}
    assert (copy / "truth.csv").read_text() == "t"
    assert json.loads((flight / "flight.json").read_text())["gps_denied"] == [[1, 2]]


def test_the_eight_is_flown_at_its_airspeed_and_banked_as_it_turns() -> None:
    about = np.array([30.0, -60.0, -4.0])
    flown = figure_of_eight(about, np.random.default_rng(3))
    step_s = np.diff(flown.t_s)[:, None]
    ground = np.diff(flown.pos_ned_m[:, :2], axis=0) / step_s
    # the mean wind is what is left of the ground speed over whole eights
    speed = np.linalg.norm(ground, axis=1)
    assert AIRSPEED_M_S - WIND_M_S - 0.5 < speed.min() < speed.max() < AIRSPEED_M_S + WIND_M_S + 0.5
    assert abs(np.mean(flown.pos_ned_m[:, 2] - about[2]) + HEIGHT_M) < 2.0
    yaw_rate = np.gradient(np.unwrap(flown.angles_rad[:, 2]), flown.t_s)
    banked = np.arctan(yaw_rate * AIRSPEED_M_S / GRAVITY_M_S2)
    smooth = np.ones(60) / 60  # gusts pass, turns stay
    assert np.corrcoef(np.convolve(banked, smooth), np.convolve(flown.angles_rad[:, 0], smooth))[0, 1] > 0.9
    assert np.degrees(np.abs(flown.angles_rad[:, 0])).max() < 55.0
    # both lobes: turns to either side
    assert flown.angles_rad[:, 0].min() < -0.2 < 0.2 < flown.angles_rad[:, 0].max()
