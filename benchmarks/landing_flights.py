"""One landing on the pad in a closed loop: see ``benchmarks.closed_loop``."""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

from backend.link.gimbals import pitch_yaw
from backend.link.landing_target import velocity_set_point
from benchmarks.closed_loop import AUTOPILOT, GUIDANCE_US, START_US, STATION, ClosedLoop
from estimator.geometry.rotation import euler_from_q, matrix_from_q
from estimator.types import Float, NavigationState, PadMode
from guidance.landing import LandingCommand, LandingGuidance, LandingPhase
from guidance.pan_tilt import PanTilt
from simulator.random_streams import rng_for
from simulator.scenario import SCENARIOS, Scenario
from simulator.vehicles.pilot import FlightMode
from simulator.vehicles.state import VehicleState

PICTURES_PER_S = 20.0
GIVE_UP_S = 240.0
FOLLOWED_S = 1.5
"""So long must the pad be followed before the landing is begun."""
WIND_M_S, GUST_SHARE = 6.0, 0.35


@dataclass(frozen=True, slots=True)
class Landing:
    """How one landing ended. Lengths are horizontal, from the pad's centre to the vehicle's reference point.

    ``touch_m`` is where the skids first touched, ``rest_m`` where the vehicle then stood, NaN without touchdown;
    ``estimate_m`` how far off the estimate was at touchdown, ``away_m`` how far beside the pad the landing began.
    """

    seed: int
    wind_m_s: float
    outcome: str
    reason: str
    touch_m: float
    rest_m: float
    sink_m_s: float
    drift_m_s: float
    estimate_m: float
    away_m: float
    landing_s: float
    blind_s: float
    drift_of_autopilot_m_s: float
    times_real_time: float


def scenario_for(seed: int, gimbal: str) -> Scenario:
    """The scenario ``pad`` in a wind of this seed, from calm to ``WIND_M_S``."""
    pad = SCENARIOS["pad"]
    wind_m_s = float(rng_for(seed, "landings", "wind").uniform(0.0, WIND_M_S))
    flight = pad.flight.model_copy(update={"wind_m_s": wind_m_s, "gust_std_m_s": max(0.3, GUST_SHARE * wind_m_s)})
    camera = pad.camera.model_copy(update={"gimbal": gimbal, "frames_per_s": PICTURES_PER_S})
    return pad.model_copy(update={"flight": flight, "camera": camera, "start_unix_us": START_US})


class LandingLoop(ClosedLoop):
    """A vehicle that comes to the pad, and a station that lands it there."""

    def __init__(self, seed: int, gimbal: str, folder: Path, cache: Path | None) -> None:
        super().__init__(seed, scenario_for(seed, gimbal), folder, cache)
        if self.simulation.pad is None:
            message = f"scenario '{self.scenario.name}' has no pad"
            raise ValueError(message)
        self.pad = self.simulation.pad
        self._lever = self.scenario.camera.mount().lever_arm_frd_m
        self._pan_tilt = PanTilt() if gimbal == "pan_tilt" else None
        self.guidance: LandingGuidance | None = None
        self.command: LandingCommand | None = None
        self._followed_us = 0
        self.began: VehicleState | None = None
        self.began_us = 0
        self.at_touchdown: NavigationState | None = None

    def fly(self, watch: Callable[[LandingLoop], None] = lambda _: None) -> Landing:
        """Until the vehicle stands, the landing is given up, or nothing comes of it; ``watch`` is called at 20 Hz."""
        started = time.perf_counter()
        standing_us = 0
        while self.simulation.elapsed_us < GIVE_UP_S * 1e6:
            self._step()
            if self.simulation.elapsed_us % GUIDANCE_US == 0:
                self._decide()
                watch(self)
            if self.simulation.touchdown is not None and self.at_touchdown is None:
                self.at_touchdown = self.navigator.predict(self.now_us)
            if self.guidance is not None and self.guidance.over:
                standing_us += 5_000
                if standing_us > 1_000_000:
                    break
        return self._told(time.perf_counter() - started)

    def _decide(self) -> None:
        state = self.navigator.predict(self.now_us)
        pad = None if state is None else state.pad
        if self._pan_tilt is not None:
            self._point(self._pan_tilt, state)
        if self.guidance is None:
            followed = pad is not None and pad.mode is PadMode.TRACKING and self.navigator.gps_denied
            self._followed_us = self._followed_us + GUIDANCE_US if followed else 0
            if self._followed_us < FOLLOWED_S * 1e6:
                return
            self.guidance, self.began, self.began_us = LandingGuidance(), self.simulation.state, self.now_us
            self._order(mavlink.MAV_CMD_DO_SET_MODE, 1.0, float(FlightMode.GUIDED))
        self.command = self.guidance.step(self.now_us, pad)
        self._send(velocity_set_point(self.scenario.system_id, AUTOPILOT, self.command.vel_ned_m_s))

    def _point(self, pan_tilt: PanTilt, state: NavigationState | None) -> None:
        if self.simulation.elapsed_us == GUIDANCE_US:
            self._order(mavlink.MAV_CMD_DO_GIMBAL_MANAGER_CONFIGURE, float(STATION[0]), float(STATION[1]), -1.0, -1.0)
        if state is None:
            return
        target: Float | None = None
        if state.pad is not None and state.pad.mode is not PadMode.SEARCHING:
            target = -state.pad.pos_ned_m - matrix_from_q(state.q_ned_from_body) @ self._lever
        heading = float(euler_from_q(state.q_ned_from_body)[2])
        angles = pan_tilt.step(self.now_us, heading, target)
        self._send(pitch_yaw(self.scenario.system_id, AUTOPILOT, angles.pitch_rad, angles.yaw_rad))

    def off_m(self, state: VehicleState) -> float:
        """How far beside the pad's centre the vehicle is."""
        return float(np.hypot(*(state.pos_ned_m - self.pad.pos_ned_m)[:2]))

    def _told(self, elapsed_s: float) -> Landing:
        touched, now, at = self.simulation.touchdown, self.simulation.state, self.at_touchdown
        estimate_m = math.nan
        if touched is not None and at is not None and at.pad is not None:
            estimate_m = float(np.hypot(*(at.pad.pos_ned_m - touched.pos_ned_m + self.pad.pos_ned_m)[:2]))
        guidance = self.guidance
        outcome, reason = "not begun", "the pad was not followed with GPS off"
        if guidance is not None:
            outcome, reason = str(guidance.phase), guidance.reason
        if touched is not None and outcome == LandingPhase.ABORT:
            outcome = "aborted on the ground"
        return Landing(
            seed=self.seed, wind_m_s=self.scenario.flight.wind_m_s, outcome=outcome, reason=reason,
            touch_m=math.nan if touched is None else self.off_m(touched),
            rest_m=math.nan if touched is None or now is None else self.off_m(now),
            sink_m_s=math.nan if touched is None else float(touched.vel_ned_m_s[2]),
            drift_m_s=math.nan if touched is None else float(np.hypot(*touched.vel_ned_m_s[:2])),
            estimate_m=estimate_m,
            away_m=math.nan if self.began is None else self.off_m(self.began),
            landing_s=math.nan if touched is None else (START_US + touched.t_us - self.began_us) / 1e6,
            blind_s=math.nan if at is None or at.pad is None else at.pad.age_s,
            drift_of_autopilot_m_s=float(np.hypot(*self.simulation.believed_vel_error_ned_m_s[:2])),
            times_real_time=self.simulation.elapsed_us / 1e6 / elapsed_s,
        )  # fmt: skip
