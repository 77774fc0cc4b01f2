"""A pan-tilt camera that is kept on the pad: control of the gimbal is asked for, and angles sent while it is ours."""

from __future__ import annotations

from dataclasses import dataclass, field

from backend.clock import mono_us
from backend.fleet.links import LinkEndpoint
from backend.fleet.vehicle import LiveVehicle
from estimator.geometry.rotation import euler_from_q
from estimator.types import NavigationState
from guidance.pan_tilt import PanTilt

ASK_AGAIN_US = 5_000_000
PAN_TILT = "pan_tilt"


@dataclass(slots=True)
class Gaze:
    """One vehicle's camera, for an operator's page; ``reason`` is empty while it is pointed."""

    page: str
    reason: str = "control of the gimbal was asked for"
    _aim: PanTilt = field(default_factory=PanTilt)
    _asked_us: int = 0

    def point(self, vehicle: LiveVehicle, state: NavigationState, link: LinkEndpoint) -> None:
        """Point the gimbal by a new state, or ask for control of it where that is not ours."""
        manager = link.link.vehicles[vehicle.system_id].gimbals.manager
        if manager is None or not manager.obeys(link.link.system_id, link.link.component_id):
            self.reason = (
                "the gimbal has not given control" if manager is not None else "no gimbal manager has answered"
            )
            if mono_us() - self._asked_us > ASK_AGAIN_US:
                self._asked_us = mono_us()
                link.link.take_gimbal(vehicle.system_id)
                link.send_soon()
            return
        pad = state.pad
        known = pad is not None and pad.mode.known
        target = -(pad.pos_ned_m + state.lever_ned_m) if pad is not None and known else None
        self.reason = "" if known else "the pad is not found: the camera stays as it is"
        angles = self._aim.step(state.t_us, float(euler_from_q(state.q_ned_from_body)[2]), target)
        if known:
            link.link.point_gimbal(vehicle.system_id, angles.pitch_rad, angles.yaw_rad)
            link.send_soon()

    @staticmethod
    def release(vehicle: LiveVehicle, link: LinkEndpoint | None) -> None:
        """Hand the gimbal back."""
        if link is not None and vehicle.connected:
            link.link.release_gimbal(vehicle.system_id)
            link.send_soon()
