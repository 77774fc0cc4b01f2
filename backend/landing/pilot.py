"""The landings that the station flies: who may begin one, and what is told of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from backend.clock import unix_us
from backend.errors import CommandRefusedError
from backend.fleet.vehicle import LiveVehicle
from backend.guided.pilot import GuidedPilot
from backend.landing.descent import Descent
from guidance.landing import LandingConfig


class LandingPilot:
    """Begins landings that ``pilot`` then flies."""

    def __init__(self, pilot: GuidedPilot, config: LandingConfig) -> None:
        self._pilot = pilot
        self._config = config

    def begin(self, vehicle: LiveVehicle, page: str) -> None:
        """Land a vehicle for an operator's page; the errors say why that cannot be."""
        self._pilot.check_free(vehicle)
        pad = None if vehicle.latest is None else vehicle.latest.state.pad
        if pad is None or not pad.mode.known:
            why = f": {pad.reason}" if pad is not None and pad.reason else ""
            raise CommandRefusedError(f"the pad must be followed when a landing begins{why}")
        self.go_on(vehicle, page)

    def go_on(self, vehicle: LiveVehicle, page: str) -> None:
        """Land a vehicle that the station flies already, or that may be flown."""
        before = self._pilot.flight_of(vehicle)
        before = before if before is not None and before.active else None
        self._pilot.begin(vehicle, Descent(vehicle.autopilot, page, unix_us(), self._config_for(vehicle), before))

    def _config_for(self, vehicle: LiveVehicle) -> LandingConfig:
        """The guidance counts how old the last picture is; the newest is as old as the estimator is behind."""
        behind_s = 0.0 if vehicle.worker is None else vehicle.worker.delay_us / 1e6
        return replace(
            self._config, hold_after_s=self._config.hold_after_s + behind_s,
            lost_after_s=self._config.lost_after_s + behind_s,
        )  # fmt: skip

    def message(self, vehicle: LiveVehicle) -> dict[str, Any] | None:
        """What is told of a vehicle's landing, None where its last flight was none."""
        descent = self._pilot.flight_of(vehicle)
        if not isinstance(descent, Descent):
            return None
        point = descent.set_point_ned_m_s
        return {
            "active": descent.active, "phase": str(descent.phase), "reason": descent.reason,
            "set_point_ned_m_s": None if point is None else tuple(float(value) for value in point),
        }  # fmt: skip
