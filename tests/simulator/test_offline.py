"""Recorded flights: complete, readable by the station's reader, repeatable, true."""

from __future__ import annotations

import threading
from pathlib import Path

import av
import cv2
import numpy as np
import pyproj
import pytest

from geodata.flight import FlightFolder
from geodata.raster import open_raster
from simulator.errors import SimulatorError
from simulator.mavlink_input import messages_in
from simulator.offline import record_offline
from simulator.scenario import Scenario
from simulator.world.world import World


@pytest.fixture(scope="module")
def recorded(scenario: Scenario, world: World, tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("flight") / "one"
    record_offline(scenario, world, 7, folder, threading.Event())
    return folder


def decoded(folder: Path) -> list[np.ndarray]:
    with av.open(str(folder / "video.mp4")) as container:
        return [frame.to_ndarray(format="bgr24") for frame in container.decode(video=0)]


def test_folder_is_complete_and_consistent(recorded: Path, scenario: Scenario) -> None:
    flight = FlightFolder.open(recorded)
    assert flight.meta.vehicle.type == "helicopter"
    start_us = scenario.start_unix_us
    assert flight.meta.gps_denied == ((start_us + 2_000_000, start_us + 5_000_000),)
    times, truth = flight.frame_times(), flight.truth()
    assert times is not None
    assert truth is not None
    assert len(times.frame) == len(truth.t_unix_us) == len(decoded(recorded)) == 150
    np.testing.assert_array_equal(times.t_video_us, truth.t_unix_us)
    assert set(np.diff(times.t_video_us)) == {40_000}
    assert flight.meta.video.start_time_us == times.t_video_us[0]
    packets = list(flight.telemetry())
    assert np.all(np.diff([t for t, _ in packets]) >= 0)
    kinds = {m.get_type() for _, packet in packets for m in messages_in(packet)}
    assert {"HEARTBEAT", "HIGHRES_IMU", "ATTITUDE", "GPS_RAW_INT", "HOME_POSITION", "SYSTEM_TIME"} <= kinds


def test_packets_arrive_after_they_were_sent(recorded: Path, scenario: Scenario) -> None:
    delays_us = [
        t_us - scenario.start_unix_us - (message.time_usec - 42_000_000)
        for t_us, packet in FlightFolder.open(recorded).telemetry()
        for message in messages_in(packet)
        if message.get_type() == "HIGHRES_IMU"
    ]
    assert min(delays_us) >= 2_000
    assert np.median(delays_us) < 12_000
    assert max(delays_us) < 60_000


def test_truth_moves_as_its_velocity_says(recorded: Path) -> None:
    truth = FlightFolder.open(recorded).truth()
    assert truth is not None
    geod = pyproj.Geod(ellps="WGS84")
    lon, lat = np.degrees(truth.lon_rad), np.degrees(truth.lat_rad)
    _, _, moved_m = geod.inv(lon[0], lat[0], lon[-1], lat[-1])
    speed = (truth.vel_ned_m_s[1:, :2] + truth.vel_ned_m_s[:-1, :2]) / 2
    assert moved_m == pytest.approx(float(np.linalg.norm(speed.sum(axis=0) * 0.04)), rel=0.01, abs=0.1)


def test_same_seed_gives_the_same_folder(recorded: Path, scenario: Scenario, world: World, tmp_path: Path) -> None:
    short = scenario.model_copy(update={"duration_s": 2.0})
    for name in ("a", "b"):
        record_offline(short, world, 7, tmp_path / name, threading.Event())
    for file in (tmp_path / "a").iterdir():
        assert file.read_bytes() == (tmp_path / "b" / file.name).read_bytes(), file.name
    whole = (recorded / "telemetry.tlog").read_bytes()
    assert whole.startswith((tmp_path / "a" / "telemetry.tlog").read_bytes())


def test_clicks_hit_their_targets(recorded: Path) -> None:
    """Every click, sent along a ray by OpenCV and pyproj, meets the target's true place."""
    flight = FlightFolder.open(recorded)
    truth, targets, meta = flight.truth(), flight.targets_truth(), flight.meta
    assert truth is not None
    assert meta.camera is not None
    clicks = flight.clicks()
    assert clicks
    camera = meta.camera
    matrix = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    for click in clicks:
        at = int(np.searchsorted(truth.t_unix_us, click.t_video_us))
        target = targets[click.target]
        place = f"+lon_0={np.degrees(truth.lon_rad[at])} +lat_0={np.degrees(truth.lat_rad[at])}"
        pipeline = f"+proj=pipeline +step +proj=cart +ellps=WGS84 +step +proj=topocentric +ellps=WGS84 {place}"
        local = pyproj.Transformer.from_pipeline(f"{pipeline} +h_0={truth.alt_amsl_m[at]}")
        east, north, up = local.transform(np.degrees(target.lon_rad), np.degrees(target.lat_rad), target.alt_amsl_m)
        c, s = (
            np.cos([truth.roll_rad[at], truth.pitch_rad[at], truth.yaw_rad[at]]),
            np.sin([truth.roll_rad[at], truth.pitch_rad[at], truth.yaw_rad[at]]),
        )
        turn_x = np.array([[1, 0, 0], [0, c[0], -s[0]], [0, s[0], c[0]]])
        turn_y = np.array([[c[1], 0, s[1]], [0, 1, 0], [-s[1], 0, c[1]]])
        turn_z = np.array([[c[2], -s[2], 0], [s[2], c[2], 0], [0, 0, 1]])
        body = (turn_z @ turn_y @ turn_x).T @ np.array([north, east, -up]) - camera.mount.lever_arm_frd_m
        # Nadir camera: right is the body's right, down in the picture is backwards.
        seen, _ = cv2.projectPoints(
            np.array([[body[1], -body[0], body[2]]]), np.zeros(3), np.zeros(3), matrix, np.array(camera.distortion)
        )
        # Clicks have one pixel of noise per axis.
        assert np.linalg.norm(seen.ravel() - (click.u_px, click.v_px)) < 4.5


def test_picture_shows_the_mapped_ground(recorded: Path, world: World) -> None:
    """A frame taken apart by truth alone lies on the map: edges agree better there than anywhere around."""
    flight = FlightFolder.open(recorded)
    truth, camera = flight.truth(), flight.meta.camera
    assert truth is not None
    assert camera is not None
    frame = decoded(recorded)[-1]
    raster = open_raster(recorded / "reference.tif")
    assert raster.crs_name == "EPSG:32633"
    ned = world.frame.ned_from_geodetic(truth.lat_rad[-1], truth.lon_rad[-1], truth.alt_amsl_m[-1])
    gsd_m = 0.5
    north, east = np.meshgrid(np.arange(32, -32, -gsd_m), np.arange(-40, 40, gsd_m), indexing="ij")
    down = -world.terrain.at(ned[0] + north, ned[1] + east) - ned[2]
    roll, pitch, yaw = truth.roll_rad[-1], truth.pitch_rad[-1], truth.yaw_rad[-1]
    turn, _ = cv2.Rodrigues(np.array([0.0, 0.0, yaw]))
    tilt = cv2.Rodrigues(np.array([0.0, pitch, 0.0]))[0] @ cv2.Rodrigues(np.array([roll, 0.0, 0.0]))[0]
    body = np.stack([north, east, down], axis=-1).reshape(-1, 3) @ (turn @ tilt) - camera.mount.lever_arm_frd_m
    points = np.stack([body[:, 1], -body[:, 0], body[:, 2]], axis=1)
    matrix = np.array([[camera.fx_px, 0, camera.cx_px], [0, camera.fy_px, camera.cy_px], [0, 0, 1]])
    uv, _ = cv2.projectPoints(points, np.zeros(3), np.zeros(3), matrix, np.array(camera.distortion))
    uv = uv.reshape(*north.shape, 2).astype(np.float32)
    smooth = cv2.GaussianBlur(frame, (0, 0), 1.0)
    seen = cv2.remap(smooth, uv[..., 0], uv[..., 1], cv2.INTER_LINEAR)
    inner = (uv > 4).all(axis=-1) & (uv < (camera.width_px - 4, camera.height_px - 4)).all(axis=-1)
    truth_map = cv2.GaussianBlur(world.ground_bgr, (0, 0), 1.0)
    scores = {}
    for shift_n in range(-6, 7):
        for shift_e in range(-6, 7):
            place = np.stack([ned[0] + north + shift_n * gsd_m, ned[1] + east + shift_e * gsd_m], axis=-1)
            row_col = world.ground_patch.row_col(place).astype(np.float32)
            cut = cv2.remap(truth_map, row_col[..., 1], row_col[..., 0], cv2.INTER_LINEAR)
            scores[shift_n, shift_e] = np.corrcoef(cut[inner, 1], seen[inner, 1])[0, 1]
    best = max(scores, key=lambda key: scores[key])
    assert best == (0, 0)
    assert scores[best] > 0.6


def test_a_full_folder_is_never_overwritten(recorded: Path, scenario: Scenario, world: World) -> None:
    before = (recorded / "telemetry.tlog").read_bytes()
    with pytest.raises(SimulatorError, match="not empty"):
        record_offline(scenario, world, 7, recorded, threading.Event())
    assert (recorded / "telemetry.tlog").read_bytes() == before


def test_stopped_early_leaves_a_readable_folder(scenario: Scenario, world: World, tmp_path: Path) -> None:
    stop = threading.Event()

    def after_a_second(flown_s: float) -> None:
        if flown_s > 1.0:
            stop.set()

    flown_s = record_offline(scenario, world, 7, tmp_path / "cut", stop, after_a_second)
    assert flown_s < 3.0
    times = FlightFolder.open(tmp_path / "cut").frame_times()
    assert times is not None
    assert len(times.frame) == len(decoded(tmp_path / "cut"))
