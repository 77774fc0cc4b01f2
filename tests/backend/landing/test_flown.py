"""The station lands a simulated helicopter without GPS: what goes to the vehicle and what it says are packets.

As in ``benchmarks.landing_flights``, with the station's pilot, gaze and aiding in place of the bare guidance, and with
simulated clocks, so that it depends on no machine.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any, cast

import numpy as np
import pytest

from backend.fleet.commands import send_command
from backend.fleet.fleet import Fleet
from backend.fleet.links import LinkEndpoint
from backend.fleet.vehicle import LiveVehicle
from backend.guided import pilot as pilot_module
from backend.guided.pilot import GuidedPilot, Wires
from backend.landing import gaze as gaze_module
from backend.landing import pilot as landing_module
from backend.landing.aiding import Aiding
from backend.landing.descent import Descent
from backend.landing.gaze import Gaze
from backend.landing.pilot import LandingPilot
from backend.link.events import LinkEvent, SampleEvent
from backend.link.landing_target import TargetForm
from backend.link.link import VehicleLink
from backend.navigation.worker import StateUpdate
from backend.schemas.vehicles import CommandBody
from benchmarks import landing_flights
from benchmarks.closed_loop import GUIDANCE_US, STATION, UPLINK_DELAY_US
from benchmarks.landing_flights import LandingLoop, scenario_for
from estimator.geometry.rotation import matrix_from_q
from estimator.types import Float, PadMode
from guidance.landing import LandingConfig, LandingPhase
from simulator.scenario import Scenario

SEED = 151
WORST_MISS_M = 0.5
FOLLOWED_US = 1_500_000


def small(seed: int, gimbal: str) -> Scenario:
    """From eight metres, in pictures that cost a quarter."""
    whole = scenario_for(seed, gimbal)
    camera = whole.camera.model_copy(update={"width_px": 320, "height_px": 240, "hfov_deg": 50.0, "frames_per_s": 10.0})
    assert whole.pad is not None
    pad = whole.pad.model_copy(update={"height_m": 8.0, "away_m": 1.5, "circle_m": 8.0})
    return whole.model_copy(update={"camera": camera, "pad": pad})


class Radio(VehicleLink):
    """The station's link; what it hears beside samples goes to the fleet."""

    def __init__(self, fleet: Fleet) -> None:
        super().__init__(*STATION)
        self.fleet = fleet

    def receive(self, data: bytes, t_unix_us: int) -> list[LinkEvent]:
        events = super().receive(data, t_unix_us)
        for event in events:
            if not isinstance(event, SampleEvent):
                self.fleet.take("radio", event)
        return events


class Station(LandingLoop):
    """Decides as a station does: with every state."""

    def __init__(self, folder: Path, cache: Path | None) -> None:
        super().__init__(SEED, "pan_tilt", folder, cache)
        self.alarms: list[str] = []
        self.told: list[tuple[Float, Float]] = []
        self.fleet = Fleet(
            0, lambda kind, **fields: None, on_heard=lambda _: None, on_place=lambda *_: None, on_state=lambda *_: None,
            on_reports=lambda *_: None,
        )  # fmt: skip
        self._link = self.link = Radio(self.fleet)
        self.pilot = GuidedPilot(
            Wires(lambda _: cast(LinkEndpoint, self), self._command, lambda _, code, text: self.alarms.append(code))
        )
        self.landing = LandingPilot(self.pilot, LandingConfig())
        self.gaze = Gaze("page")
        self.aiding = Aiding(TargetForm.BODY, "page")
        self._followed_since_us: int | None = None
        self._count = 0

    def send_soon(self) -> None:
        self.link.tick(self.now_us)
        self._up += [(self.now_us + UPLINK_DELAY_US, data) for data in self.link.data_to_send()]

    def _command(self, vehicle: LiveVehicle, body: CommandBody) -> str:
        return str(send_command(self.link, vehicle, body))

    def _decide(self) -> None:
        state, vehicle = self.navigator.predict(self.now_us), self.fleet.vehicles.get("1")
        if state is None or vehicle is None:
            return
        vehicle.latest = StateUpdate(state, 1, self.navigator.gps_denied)
        self.gaze.point(vehicle, state, cast(LinkEndpoint, self))
        if (message := self.aiding.message(vehicle, state)) is not None:
            self._compare(message)
        followed = state.pad is not None and state.pad.mode is PadMode.TRACKING and self.navigator.gps_denied
        if not followed:
            self._followed_since_us = None
        elif self._followed_since_us is None:
            self._followed_since_us = self.now_us
        elif self.guidance is None and self.now_us - self._followed_since_us > FOLLOWED_US:
            self.landing.begin(vehicle, "page")
            self.guidance = cast(Descent, self.pilot.flight_of(vehicle))._guidance
            self.began, self.began_us = self.simulation.state, self.now_us
        self.pilot.on_state(vehicle, state)
        self._count += 1
        if self._count % 2 == 0:
            self.pilot.tick(vehicle, lambda *_: True)

    def _compare(self, message: Any) -> None:
        """What the autopilot is told of the pad beside where it truly is in its body."""
        truth = self.simulation.state
        assert truth is not None
        ned_from_body = matrix_from_q(truth.q_ned_from_body)
        true = ned_from_body.T @ (self.pad.pos_ned_m - truth.pos_ned_m)
        self.told.append((np.array((message.x, message.y, message.z)), true))


@pytest.mark.timeout(900)
def test_the_station_lands_a_helicopter_without_gps(
    tmp_path: Path, tmp_path_factory: pytest.TempPathFactory, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(landing_flights, "scenario_for", small)
    station = Station(tmp_path, tmp_path_factory.getbasetemp() / "worlds")
    monkeypatch.setattr(pilot_module, "unix_us", lambda: station.now_us)
    monkeypatch.setattr(pilot_module, "mono_us", lambda: station.now_us)
    monkeypatch.setattr(landing_module, "unix_us", lambda: station.now_us)
    monkeypatch.setattr(gaze_module, "mono_us", lambda: station.now_us)

    landed = station.fly()

    assert landed.outcome == LandingPhase.LANDED, landed.reason
    assert station.alarms == ["landed"]
    assert station.gaze.reason == ""
    assert landed.rest_m < WORST_MISS_M
    told, true = (np.array([pair[n] for pair in station.told]) for n in (0, 1))
    assert len(told) > 10e6 / GUIDANCE_US
    # From 8 m to the ground: 15 cm, and a degree of attitude at that height.
    rms_m = float(np.sqrt(np.mean(np.sum((told - true) ** 2, axis=1))))
    assert rms_m < 0.15 + 8.0 * np.radians(1.0)
