"""Following a line by looking at a point ahead on it, for what cannot stop: the L1 law. Pure.

Park, Deyst and How, "A new nonlinear guidance logic for trajectory tracking", AIAA 2004-4900, equation (1): towards a
point at the distance L1 ahead on the line, the acceleration across the velocity is 2 V^2 / L1 sin(eta), with eta the
angle from the velocity to the point. A straight line is met with a frequency of sqrt(2) V / L1 and a damping of 0.71; a
circle is followed without an error that stays. L1 is a time of flight here, so that the frequency is the same at every
speed.
"""

from __future__ import annotations

import math

import numpy as np

from estimator.types import Float

_SLOW_M_S = 0.1


def acceleration_right_m_s2(vel_ne_m_s: Float, towards_ne: Float, look_ahead_s: float) -> float:
    """Acceleration to the right of a ground velocity (2,), so that it comes to point along a direction (2,).

    A direction behind is turned to as hard as one abeam. Without a velocity or a direction it is zero.

    Raises
    ------
    ValueError
        ``look_ahead_s`` is not positive.
    """
    if not (math.isfinite(look_ahead_s) and look_ahead_s > 0.0):
        message = f"look_ahead_s must be positive, not {look_ahead_s}"
        raise ValueError(message)
    north, east = vel_ne_m_s.tolist()
    to_north, to_east = towards_ne.tolist()
    speed_m_s, far = math.hypot(north, east), math.hypot(to_north, to_east)
    if speed_m_s < _SLOW_M_S or far == 0.0:
        return 0.0
    sine = (north * to_east - east * to_north) / (speed_m_s * far)
    if north * to_north + east * to_east < 0.0:
        sine = math.copysign(1.0, sine)
    return float(2.0 * speed_m_s / look_ahead_s * sine)


def ahead_on_circle(pos_ne_m: Float, centre_ne_m: Float, radius_m: float, ahead_m: float) -> Float:
    """The point (2,) of a circle that is flown clockwise, ``ahead_m`` of its arc on from the place closest to (2,).

    From further away than ``ahead_m`` the circle is entered along a straight line towards that point.

    Raises
    ------
    ValueError
        Radius or arc are not positive.
    """
    if not (math.isfinite(radius_m) and radius_m > 0.0 and math.isfinite(ahead_m) and ahead_m > 0.0):
        message = f"radius_m and ahead_m must be positive, not {radius_m} and {ahead_m}"
        raise ValueError(message)
    north, east = (pos_ne_m - centre_ne_m).tolist()
    bearing_rad = math.atan2(east, north) + min(ahead_m / radius_m, 0.5 * math.pi)
    point: Float = centre_ne_m + radius_m * np.array((math.cos(bearing_rad), math.sin(bearing_rad)))
    return point
