"""Studies of bad or poorer input: the ladder's flights, with something made worse before the estimator sees it."""

from __future__ import annotations

from benchmarks.studies.degraded import Degradation, MapFault, PictureFault
from benchmarks.studies.scenarios import denied_s, flight
from benchmarks.studies.study import HEADLINE, HEADLINE_MEANING, Column, FlownRow, Study
from estimator.navigator import NavigatorConfig

BAD_S = 30.0
FOCAL_FACTOR = 1.05
DRIFT_M = 20.0
BORESIGHT_DEG = (1.5, 1.5, 1.5)


def degraded(short: bool) -> Study:
    """Maps, pictures, camera and barometer that are wrong, for half a minute or for good."""
    scenario, config = flight(short), NavigatorConfig()
    middle_s = denied_s(short) / 2.0
    stretch_s = (middle_s - BAD_S / 2.0, middle_s + BAD_S / 2.0)
    rows = [FlownRow("as flown", "nothing", scenario, config, Degradation(stretch_s))]
    for fault, change in (
        (MapFault.ELSEWHERE, "another place's imagery, all the time"),
        (MapFault.TURNED, "turned by 5 degrees about its middle, all the time"),
        (MapFault.SHIFTED, "shifted by 20 m, all the time"),
        (MapFault.CHANGED, "40 % of it other land, all the time"),
        (MapFault.WATER, "half of it water, all the time"),
    ):
        rows.append(FlownRow(f"map {fault}", change, scenario, config, Degradation(map=fault)))
    for seen, change in (
        (PictureFault.FOG, "5 % of the contrast left, for 30 s"),
        (PictureFault.GLARE, "the sun in the lens, for 30 s"),
        (PictureFault.NIGHT, "4 % of the light left, for 30 s"),
        (PictureFault.FROZEN, "one picture again and again, for 30 s"),
    ):
        rows.append(FlownRow(f"{seen}", change, scenario, config, Degradation(stretch_s, picture=seen)))
    longer = Degradation(focal_factor=FOCAL_FACTOR)
    drift = Degradation((0.0, 60.0), barometer_drift_m=DRIFT_M)
    rows += [
        FlownRow("lens", "focal length 5 % too long, all the time", scenario, config, longer),
        FlownRow("barometer", "drifts by 20 m in a minute", scenario, config, drift),
    ]
    columns = (
        Column("before: rms / 95 %, m", "before"),
        Column("during", "during"),
        Column("after", "after"),
        Column("vision / dead reckoning / lost, % of during", "modes"),
        Column("largest error, sigma", "largest_sigmas", 1),
        Column("> 5 sigma", "wrong", 1, percent=True),
        Column("of it in vision", "sure_and_wrong", 1, percent=True),
        Column("recovered after", "recovered"),
        Column("alarms (flights)", "alarms"),
    )
    about = (
        "Errors are horizontal, unaligned, while GPS is denied; before, during and after what is wrong, or all of them "
        "as `during` where it lasts. Recovered: mode `vision` and the error within twice what it was before. "
        "More than 5 sigma: share of states without GPS whose normalised error exceeds five, and of those the ones "
        "in mode `vision`. Alarms: those that the station would raise, with the number of flights."
    )
    return Study("degraded", "Bad and odd input", about, tuple(rows), columns, "rms_m", "horizontal rms, m")


def sensors(short: bool) -> Study:
    """Fewer or worse sensors: without inertial readings, with an unknown clock, a crooked mount, a coarse map."""
    scenario, config = flight(short), NavigatorConfig()
    clockless = NavigatorConfig(find_video_offset=True)
    crooked = "mount wrong by 1.5 degrees about each axis"

    def late(seconds: float) -> FlownRow:
        change = f"the video's clock unknown, {abs(seconds):g} s {'late' if seconds > 0.0 else 'early'}"
        return FlownRow(f"clock {seconds:+g} s", change, scenario, clockless, Degradation(frames_late_s=seconds))

    rows = (
        FlownRow("default", "all sensors", scenario, config, Degradation()),
        FlownRow(
            "no inertial", "attitude at 10 Hz, barometer and video alone", scenario,
            NavigatorConfig(use_inertial=False), Degradation(attitude_hz=10.0),
        ),
        late(-0.3), late(0.2), late(0.5),
        FlownRow("boresight", crooked, scenario, config, Degradation(boresight_deg=BORESIGHT_DEG)),
        FlownRow(
            "clock and boresight", f"clock unknown, 0.5 s late; {crooked}", scenario, clockless,
            Degradation(frames_late_s=0.5, boresight_deg=BORESIGHT_DEG),
        ),
        FlownRow("map 1 m", "reference at 1 m a pixel", scenario, config, Degradation(map_gsd_m=1.0)),
    )  # fmt: skip
    columns = (
        *HEADLINE,
        Column("inside 95 %", "inside_95", 0, percent=True),
        Column("fixes accepted", "accepted", 0, percent=True),
        Column("alarms (flights)", "alarms"),
    )
    about = f"{HEADLINE_MEANING} Alarms: those that the station would raise, with the number of flights."
    return Study("sensors", "Fewer or worse sensors", about, rows, columns, "rms_m", "horizontal rms, m")
