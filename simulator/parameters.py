"""The autopilot's parameters: read and written by name, as ArduPilot answers. No I/O.

Values travel as numbers in a float. A name that is not there is not answered.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
from pymavlink.dialects.v20 import ardupilotmega as mavlink

KINDS = frozenset({"PARAM_REQUEST_READ", "PARAM_REQUEST_LIST", "PARAM_SET"})

_INT8, _INT16, _REAL32 = mavlink.MAV_PARAM_TYPE_INT8, mavlink.MAV_PARAM_TYPE_INT16, mavlink.MAV_PARAM_TYPE_REAL32
_RANGES = {_INT8: (-128, 127), _INT16: (-(2**15), 2**15 - 1)}
# GPS in the first set of sources, external navigation in the second, as one sets up a vehicle that may lose GPS.
_DEFAULTS: dict[str, tuple[float, int]] = {
    "AHRS_EKF_TYPE": (3.0, _INT8),
    "EK3_SRC1_POSXY": (3.0, _INT8),
    "EK3_SRC1_VELXY": (3.0, _INT8),
    "EK3_SRC1_POSZ": (1.0, _INT8),
    "EK3_SRC1_VELZ": (3.0, _INT8),
    "EK3_SRC1_YAW": (1.0, _INT8),
    "EK3_SRC2_POSXY": (6.0, _INT8),
    "EK3_SRC2_VELXY": (6.0, _INT8),
    "EK3_SRC2_POSZ": (1.0, _INT8),
    "EK3_SRC2_VELZ": (0.0, _INT8),
    "EK3_SRC2_YAW": (1.0, _INT8),
    "EK3_SRC3_POSXY": (0.0, _INT8),
    "EK3_SRC3_VELXY": (0.0, _INT8),
    "EK3_SRC3_POSZ": (1.0, _INT8),
    "EK3_SRC3_VELZ": (0.0, _INT8),
    "EK3_SRC3_YAW": (1.0, _INT8),
    "GPS1_TYPE": (1.0, _INT8),
    "VISO_TYPE": (1.0, _INT8),
    "VISO_DELAY_MS": (10.0, _INT16),
    "VISO_POS_M_NSE": (0.2, _REAL32),
    "VISO_VEL_M_NSE": (0.1, _REAL32),
}


class ParameterStore:
    """Holds them; ``send`` takes messages to be sent."""

    def __init__(self, send: Callable[[Any], None]) -> None:
        self._send = send
        self._held = dict(_DEFAULTS)

    def value(self, name: str) -> float:
        """What a parameter is now. Raises KeyError for one that is not there."""
        return self._held[name][0]

    def receive(self, message: Any) -> None:
        """Act on one message of ``KINDS`` that is for this vehicle."""
        names = list(self._held)
        if message.get_type() == "PARAM_REQUEST_LIST":
            for name in names:
                self._say(name)
            return
        name = message.param_id
        if message.get_type() == "PARAM_REQUEST_READ" and 0 <= message.param_index < len(names):
            name = names[message.param_index]
        if name not in self._held:
            return
        if message.get_type() == "PARAM_SET":
            self._set(name, message.param_value)
        self._say(name)

    def _set(self, name: str, value: float) -> None:
        """Take a value as far as its type holds it; what is no number changes nothing."""
        kind = self._held[name][1]
        if not np.isfinite(value):
            return
        low, high = _RANGES.get(kind, (-np.inf, np.inf))
        self._held[name] = (float(np.clip(value if kind == _REAL32 else round(value), low, high)), kind)

    def _say(self, name: str) -> None:
        value, kind = self._held[name]
        index = list(self._held).index(name)
        self._send(mavlink.MAVLink_param_value_message(name.encode(), value, kind, len(self._held), index))
