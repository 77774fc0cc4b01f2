"""The studies by name."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import Any

import numpy as np

from benchmarks.studies.altitude import hover
from benchmarks.studies.odometry_noise import translation_noise
from benchmarks.studies.robustness import degraded, sensors
from benchmarks.studies.scenarios import PICTURES, flight
from benchmarks.studies.study import HEADLINE, HEADLINE_MEANING, Column, ComputedRow, FlownRow, Study
from estimator.filters.initialise import InitialGuess
from estimator.measurements.map_fix import Acceptance, HandOver, MapFixConfig
from estimator.measurements.picture_to_picture import OdometryConfig
from estimator.measurements.self_watch import SelfWatchConfig
from estimator.navigator import NavigatorConfig
from estimator.odometry.odometers import ODOMETERS
from estimator.odometry.tracker import TrackerConfig
from estimator.registration.alignment import COMPARED, HeadingSource, MatcherConfig
from estimator.registration.calibration import calibration_of
from estimator.registration.likelihood import LikelihoodForm
from simulator.scenario import FlightSection, Scenario

GROUPS_2009 = ("position", "velocity", "attitude", "accelerometer_bias", "clone_position", "clone_rotation")
STRUCTURE = ("keyframe_position", "keyframe_rotation", "structure")
GROUPS_WITHOUT_STRUCTURE = tuple(group for group in NavigatorConfig().groups if group not in STRUCTURE)
REFUSALS = ("max_outlier_probability", "min_unimodality", "max_lost_probability", "max_innovation_sigmas", "evidence")
NAVIGATION = (
    *HEADLINE,
    Column("NIS / dof of fixes", "nis_of_fixes"),
    Column("inside 50 %", "inside_50", 0, percent=True),
    Column("90 %", "inside_90", 0, percent=True),
    Column("95 %", "inside_95", 0, percent=True),
    Column("fixes accepted", "accepted", 0, percent=True),
    Column("ms a fix", "fix_ms", 1),
)
MEANING = (
    f"{HEADLINE_MEANING} "
    "More than 5 sigma: share of states whose normalised error exceeds five. Inside: share of states within the stated "
    "50, 90 and 95 % ellipses."
)


def baseline() -> NavigatorConfig:
    """The system of 2009 as far as it can be set up here: grey values, the correlation as a density, 12 states.

    Its odometry moves both filters, where the thesis lets it move the density alone; and the attitude that the
    autopilot reports stands for its compass, with the sigma of what that errs by.
    """
    grey = calibration_of("intensity")
    as_density = replace(grey, likelihood=replace(grey.likelihood, form=LikelihoodForm.SIMILARITY))
    return NavigatorConfig(
        groups=GROUPS_2009,
        reported_attitude_std_rad=0.03,
        odometry=OdometryConfig(method="homography"),
        matcher=MatcherConfig(channels="intensity", calibration=as_density),
        map_fix=MapFixConfig(
            hand_over=HandOver.DENSITY, couple_attitude=False, temper=False, search_pose=False, use_windows=False,
            max_outlier_probability=1.0, min_unimodality=0.0, max_lost_probability=1.0,
            max_innovation_sigmas=float("inf"), evidence=None, by_probability=False,
        ),
        watch=SelfWatchConfig(enabled=False),
    )  # fmt: skip


def rungs() -> list[tuple[str, str, NavigatorConfig]]:
    """The ladder from the baseline to the defaults: name, change, configuration; one change a rung."""
    default = NavigatorConfig()
    config = baseline()
    found = [("2009", "grey-value correlation as a density, its mean with 2 m, H = [I 0 0], 12 states", config)]

    def step(name: str, change: str, **changes: Any) -> None:
        nonlocal config
        config = replace(config, **changes)
        found.append((name, change, config))

    def fix(**changes: Any) -> dict[str, Any]:
        return {"map_fix": replace(config.map_fix, **changes)}

    step("+ likelihood", "calibrated likelihood with a floor", matcher=MatcherConfig(channels="intensity"))
    step("+ gradients", "double-angle gradients instead of grey values", matcher=MatcherConfig())
    step("+ pose search", "headings and heights around the prediction", **fix(search_pose=True))
    step("+ rays", "odometry by rays cut with the terrain instead of a homography", odometry=default.odometry)
    states = {"groups": GROUPS_WITHOUT_STRUCTURE, "reported_attitude_std_rad": default.reported_attitude_std_rad}
    step("+ slow errors", "biases of sensors, mount, ground and map as states", **states)
    step("+ structure", "heights of followed points and their turn since a keyframe", groups=default.groups)
    step("+ attitude in H", "attitude and height in the measurement matrix", **fix(couple_attitude=True))
    step(
        "+ increment",
        "handed over is what a picture adds, with its own covariance",
        **fix(hand_over=HandOver.INCREMENT),
    )
    step("+ tempering", "fixes from the same place count less", **fix(temper=True))
    tests = {name: getattr(default.map_fix, name) for name in REFUSALS}
    step("+ refusals", "weak, ambiguous and contradicting pictures are refused", **fix(**tests))
    step("+ probability", "a match counts as far as it is probably right", **fix(by_probability=True))
    step("+ self-doubt", "blind pictures are left out, a contradicted position is replaced", watch=default.watch)
    step("+ windows (default)", "windows that agree give the whole pose", **fix(use_windows=True))
    return found


def ladder(short: bool) -> Study:
    """The published baseline and upwards, one change a rung."""
    scenario = flight(short)
    rows = tuple(FlownRow(name, change, scenario, config) for name, change, config in rungs())
    return Study("ladder", "What each step gains", MEANING, rows, NAVIGATION, "rms_m", "horizontal rms, m")


def channels(short: bool) -> Study:
    """The measures of similarity under the present navigator."""
    scenario = flight(short)
    rows = tuple(
        FlownRow(name, f"compares {name.replace('_', ' ')}", scenario, NavigatorConfig(matcher=MatcherConfig(name)))
        for name in COMPARED
    )
    about = f"{MEANING} Each measure has its own fitted calibration of likelihood and outlier probability."
    return Study("channels", "Measures of similarity", about, rows, NAVIGATION, "rms_m", "horizontal rms, m")


def _without_map(odometry: OdometryConfig) -> NavigatorConfig:
    return NavigatorConfig(odometry=odometry, fix_interval_s=float("inf"))


def _drift_study(name: str, title: str, rows: list[tuple[str, str, NavigatorConfig]], short: bool) -> Study:
    flying = flight(short, "odometry", FlightSection(hover_stops=0))
    lengths = (100.0, 200.0, 400.0) if short else (100.0, 200.0, 400.0, 800.0)
    columns = (
        Column("drift", "drift", 2, percent=True),
        *(Column(f"{length:.0f} m", f"drift_{length:.0f}_m", 2, percent=True) for length in lengths),
        Column("rms, m", "rms_m"),
        Column("NEES / dof", "nees_per_dof"),
        Column("inside 95 %", "inside_95", 0, percent=True),
        Column("x real time", "times_real_time", 1),
    )
    about = (
        "Inertial filter and odometer without a map, GPS denied, no hover. Drift: mean horizontal error of segments of "
        "the path relative to their beginnings, position and heading, over their lengths (KITTI style, never scaled); "
        "rms: unaligned error, in which a heading that is wrong from the start counts."
    )
    flown = tuple(FlownRow(row, change, flying, config) for row, change, config in rows)
    return Study(name, title, about, flown, columns, "drift", "drift, share of the distance", lengths)


def odometry(short: bool) -> Study:
    """The odometers, and none."""
    rows = [
        ("inertial alone", "no pictures", OdometryConfig(interval_s=float("inf"))),
        ("depth average", "2008: mean displacement of all features at one depth", OdometryConfig("depth_average")),
        ("homography", "2009: robust homography, rotation and slope known", OdometryConfig("homography")),
        ("rays, structure (default)", "and with the heights that followed points have", OdometryConfig()),
    ]
    configs = [(name, change, _without_map(config)) for name, change, config in rows]
    memoryless = replace(_without_map(OdometryConfig()), groups=GROUPS_WITHOUT_STRUCTURE)
    configs.insert(-1, ("rays", "rays cut with the terrain", memoryless))
    return _drift_study("odometry", "Drift of the odometers", configs, short)


def features(short: bool) -> Study:
    """The thesis's question of figure 5.20: how many corners."""
    numbers = (25, 50, 150) if short else (15, 25, 50, 100, 150, 220, 400)
    rows = [
        (
            f"{method}, {count}",
            f"at most {count} corners",
            _without_map(OdometryConfig(method, TrackerConfig(count, count // 2))),
        )
        for method in ("homography", "rays")
        for count in numbers
    ]
    return _drift_study("features", "Drift over the number of corners", rows, short)


def initial_error(short: bool) -> Study:
    """The thesis's figures 5.21 and 5.22: the filter begins with a wrong attitude and no compass."""
    scenario = flight(short, "initial", gps_s=6.0)
    by_lines = NavigatorConfig(matcher=MatcherConfig(heading_from=HeadingSource.LINES))
    rows = []
    for degrees in (0.0, 5.0, 10.0):
        wrong = float(np.radians(degrees))
        std = float(np.radians(max(degrees, 1.0)))
        guess = InitialGuess(attitude_std_rad=(std,) * 3, attitude_error_rad=(wrong,) * 3)
        change = f"{degrees:.0f} degrees wrong about all three axes"
        for name, base in (("2009", baseline()), ("default", NavigatorConfig()), ("lines", by_lines)):
            config = replace(base, initial=guess, reported_attitude_interval_s=float("inf"))
            rows.append(FlownRow(f"{name}, {degrees:.0f} deg", change, scenario, config))
    columns = (Column("heading rms, deg", "heading_rms_deg"), *NAVIGATION)
    about = (
        f"{MEANING} GPS for the first six seconds only, and the autopilot's attitude for the first moment only. "
        "Heading: rms over the second half of the time without GPS. Rows `lines`: the default with headings from lines."
    )
    title = "Recovery from a wrong attitude"
    return Study("initial-error", title, about, tuple(rows), columns, "heading_rms_deg", "heading rms, degrees")


def experiment_2008(short: bool) -> Study:
    """The experiment of Conte and Doherty: 60 m up at 3 m/s, edges, the sliding window, matches at 4 Hz."""
    denied_s = 90.0 if short else 330.0
    scenario = Scenario(
        name="slow", duration_s=27.0 + denied_s, gps_denied_s=((25.0, 25.0 + denied_s),), camera=PICTURES,
        flight=FlightSection(speed_m_s=3.0, height_agl_m=(60.0, 62.0), hover_stops=0),
    )  # fmt: skip
    odometer = replace(baseline(), odometry=OdometryConfig("depth_average"), fix_interval_s=0.25)
    unlimited = MapFixConfig(
        acceptance=Acceptance.SLIDING_WINDOW, couple_attitude=False, search_pose=False, use_windows=False
    )
    published = replace(odometer, matcher=MatcherConfig("edge_overlap"), map_fix=unlimited)
    rows = (
        ("odometer", "depth average, no map", replace(odometer, fix_interval_s=float("inf"))),
        ("2008", "edges that overlap, accepted by the sliding window", published),
        ("2008, gradients", "double-angle gradients, accepted the same", replace(published, matcher=MatcherConfig())),
        ("2009", "grey values and a density", baseline()),
        ("default", "as it is", NavigatorConfig()),
    )
    flown = tuple(FlownRow(name, change, scenario, config) for name, change, config in rows)
    return Study("experiment-2008", "The experiment of 2008", MEANING, flown, NAVIGATION, "rms_m", "horizontal rms, m")


def altitude(short: bool) -> Study:
    """The thesis's figures 5.15 and 5.16: whether the loop through the attitude is stable with height."""
    heights = (60.0, 300.0, 1000.0) if short else (30.0, 60.0, 100.0, 200.0, 300.0, 500.0, 700.0, 1000.0, 2000.0)
    rows = tuple(
        ComputedRow(
            f"{height:.0f} m, {'coupled' if coupled else 'H = [I 0 0]'}",
            "attitude in the measurement matrix" if coupled else "position alone",
            partial(hover, height_m=height, coupled=coupled, seconds=60.0 if short else 200.0),
        )
        for height in heights
        for coupled in (False, True)
    )
    columns = (
        Column("rms, m", "rms_m"),
        Column("of the height", "share", 2, percent=True),
        Column("tilt rms, deg", "tilt_rms_deg", 3),
        Column("NEES / dof", "nees_per_dof"),
        Column("diverged", "diverged", 0, percent=True),
    )
    about = (
        "Hover, inertial readings of the thesis's table 5.1 and a position from the picture at 4 Hz, drawn without "
        "pictures as in section 5.8.5, with the noise that the likelihood's calibration states. Diverged: tilt wrong "
        "by more than 20 degrees at some time; "
        "the other figures are of the runs that did not."
    )
    return Study("altitude", "Stability with height", about, rows, columns, "rms_m", "horizontal rms, m")


def odometry_noise(short: bool) -> Study:
    """The thesis's figures 5.6 to 5.11 for every odometer."""
    counts = (20, 50) if short else (10, 20, 50, 100, 200)
    cases = [(count, pixel, 0.0, left) for left in (False, True) for pixel in (0.5, 2.0) for count in counts]
    cases += [(50, 0.0, degrees, False) for degrees in ((0.5,) if short else (0.1, 0.25, 0.5, 1.0))]
    cases += [(50, 2.0, 0.5, left) for left in (False, True)]
    rows = tuple(
        ComputedRow(
            f"{method}, {count}, {pixel:g} px, {degrees:g} deg{', left' if left else ''}",
            f"{count} features {'in the left part' if left else 'over the picture'}",
            partial(
                translation_noise, method=method, features=count, pixel_std_px=pixel, attitude_std_deg=degrees,
                left=left,
            ),
        )
        for method in ODOMETERS
        for count, pixel, degrees, left in cases
    )  # fmt: skip
    columns = (
        Column("sigma x / depth", "sigma_x", 5),
        Column("sigma y / depth", "sigma_y", 5),
        Column("stated x (pixels alone)", "stated", 5),
        Column("solved", "solved", 0, percent=True),
    )
    about = (
        "No motion, noise on the pixels and on the attitude of both pictures (360 x 288 px, 45 degrees across). "
        "Rows: odometer, features, pixel noise, attitude noise."
    )
    title = "Noise of the odometers"
    return Study("odometry-noise", title, about, rows, columns, "sigma_x", "translation noise over depth")


STUDIES: dict[str, Callable[[bool], Study]] = {
    "ladder": ladder,
    "channels": channels,
    "odometry": odometry,
    "features": features,
    "initial-error": initial_error,
    "experiment-2008": experiment_2008,
    "altitude": altitude,
    "odometry-noise": odometry_noise,
    "degraded": degraded,
    "sensors": sensors,
}
"""Studies by name: called with whether they are to be short."""
