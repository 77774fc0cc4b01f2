"""A rigid aeroplane with six degrees of freedom, (2-5) to (2-12) of Kaiser's thesis (2008), page 13.

Forces and static moments grow with the square of the airspeed, what comes of rates with the airspeed; they act on the
motion relative to wind and gusts. Attitude is a quaternion where the thesis has Euler angles, which meet their pole in
a loop. Beyond the stall the lift stays and the drag grows. Air density does not change with height, thrust does not
with airspeed, and gusts are the same all over the wing. ``simulator.vehicles.airframes`` has the parameters.

Integrated by Runge and Kutta's method of fourth order in steps of 10 ms at most: roll and short period of the PingWing
take a tenth of a second.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

import numpy as np
from scipy.optimize import least_squares

from estimator.geometry.checks import check_step, check_vectors
from estimator.geometry.local import LocalFrame
from estimator.geometry.rotation import euler_from_q, matrix_from_q, q_from_euler, q_normalise
from estimator.types import Float
from simulator.random_streams import rng_for
from simulator.vehicles.airframes import OSPREY, Airframe
from simulator.vehicles.gauss_markov import GaussMarkov
from simulator.vehicles.inertial import InertialReadings
from simulator.vehicles.state import VehicleState, check_start

_LONGEST_STEP_S, _LONGEST_PART_S = 0.02, 0.01
_GUST_TIME_S = 3.0
_SLOWEST_M_S = 0.1
_TRIMMED_M_S2 = 1e-6
STATES = 13
"""Position NED (3), velocity in body axes (3), quaternion ned_from_body (4), rates in body axes (3)."""

Vector = tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class Controls:
    """Deflections and thrust; what lies beyond the limits of an airframe is held at them."""

    aileron_rad: float = 0.0
    elevator_rad: float = 0.0
    rudder_rad: float = 0.0
    thrust_n: float = 0.0

    def __post_init__(self) -> None:
        for one in fields(self):
            if not math.isfinite(getattr(self, one.name)):
                message = f"{one.name} must be finite, not {getattr(self, one.name)}"
                raise ValueError(message)


@dataclass(frozen=True, slots=True)
class Trim:
    """Steady straight flight: angle of attack, pitch, and what holds them."""

    airspeed_m_s: float
    alpha_rad: float
    pitch_rad: float
    controls: Controls


def derivative(
    airframe: Airframe, state: Float, controls: Controls, wind_ned_m_s: Vector, gravity_m_s2: float
) -> Float:
    """Time derivative (13,) of a state (13,), for controls that are where they are."""
    values: list[float] = state.tolist()
    u, v, w, qw, qx, qy, qz, p, q, r = values[3:]
    north, east, down = _rotation_rows(qw, qx, qy, qz)
    wn, we, wd = wind_ned_m_s
    forces = _accelerations(
        airframe, controls,
        (
            u - north[0] * wn - east[0] * we - down[0] * wd,
            v - north[1] * wn - east[1] * we - down[1] * wd,
            w - north[2] * wn - east[2] * we - down[2] * wd,
        ),
        (p, q, r),
    )  # fmt: skip
    fx, fy, fz, roll, pitch, yaw = forces
    ix, iy, iz = airframe.inertia
    return np.array((
        north[0] * u + north[1] * v + north[2] * w,
        east[0] * u + east[1] * v + east[2] * w,
        down[0] * u + down[1] * v + down[2] * w,
        fx + r * v - q * w + gravity_m_s2 * down[0],
        fy + p * w - r * u + gravity_m_s2 * down[1],
        fz + q * u - p * v + gravity_m_s2 * down[2],
        -0.5 * (qx * p + qy * q + qz * r),
        0.5 * (qw * p + qy * r - qz * q),
        0.5 * (qw * q + qz * p - qx * r),
        0.5 * (qw * r + qx * q - qy * p),
        roll + (iy - iz) / ix * q * r,
        pitch + (iz - ix) / iy * p * r,
        yaw + (ix - iy) / iz * p * q,
    ))  # fmt: skip


def runge_kutta(
    airframe: Airframe, state: Float, controls: Controls, wind_ned_m_s: Vector, gravity_m_s2: float, dt_s: float
) -> Float:
    """The state (13,) after ``dt_s`` more under held controls and wind."""

    def slope(at: Float) -> Float:
        return derivative(airframe, at, controls, wind_ned_m_s, gravity_m_s2)

    first = slope(state)
    second = slope(state + 0.5 * dt_s * first)
    third = slope(state + 0.5 * dt_s * second)
    after: Float = state + dt_s / 6.0 * (first + 2.0 * (second + third) + slope(state + dt_s * third))
    after[6:10] = q_normalise(after[6:10])
    return after


def trim(airframe: Airframe, airspeed_m_s: float, climb_rad: float = 0.0, gravity_m_s2: float = 9.81) -> Trim:
    """Straight flight in still air at an airspeed along a climbing (positive) or sinking line, wings level.

    Raises
    ------
    ValueError
        Airspeed or climb are not finite or cannot be held within the airframe's limits.
    """
    if not (math.isfinite(airspeed_m_s) and airspeed_m_s > 0.0 and abs(climb_rad) < math.pi / 2):
        message = f"airspeed_m_s must be positive and climb_rad within a right angle, not {airspeed_m_s}, {climb_rad}"
        raise ValueError(message)

    def residuals(unknown: Float) -> Float:
        alpha_rad, elevator_rad, thrust_share = unknown.tolist()
        state = _straight(airspeed_m_s, alpha_rad, climb_rad, 0.0)
        controls = Controls(0.0, elevator_rad, 0.0, thrust_share * airframe.thrust_max_n)
        return derivative(airframe, state, controls, (0.0, 0.0, 0.0), gravity_m_s2)[[3, 5, 11]]

    found = least_squares(residuals, (0.0, 0.0, 0.2), xtol=1e-14, ftol=1e-14, gtol=1e-14)
    alpha_rad, elevator_rad, share = found.x.tolist()
    flies = float(np.abs(found.fun).max()) < _TRIMMED_M_S2 and abs(alpha_rad) < airframe.stall_rad
    if not (flies and abs(elevator_rad) <= airframe.surface_max_rad and 0.0 <= share <= 1.0):
        message = (
            f"the {airframe.name} cannot hold {airspeed_m_s:g} m/s on a climb of {math.degrees(climb_rad):g} degrees: "
            f"reference airspeed is {airframe.airspeed_m_s:g} m/s"
        )
        raise ValueError(message)
    controls = Controls(0.0, elevator_rad, 0.0, share * airframe.thrust_max_n)
    return Trim(airspeed_m_s, alpha_rad, alpha_rad + climb_rad, controls)


class FixedWing:
    """Integrates the motion, from trimmed level flight on; deflections and thrust come with their rates and limits.

    ``wind_ned_m_s`` (3,) is steady, gusts come from the seed; the airspeed is the airframe's own if none is given.

    Raises
    ------
    ValueError
        Position or wind are not three finite numbers, the heading is not finite, the gusts' deviation is negative, or
        the airspeed cannot be held.
    """

    def __init__(
        self, frame: LocalFrame, pos_ned_m: Float, yaw_rad: float, seed: int, wind_ned_m_s: Float, gust_std_m_s: float,
        airframe: Airframe = OSPREY, airspeed_m_s: float | None = None,
    ) -> None:  # fmt: skip
        check_start(pos_ned_m, yaw_rad, wind_ned_m_s, gust_std_m_s)
        self.airframe = airframe
        self._mean_wind: Float = np.array(wind_ned_m_s, np.float64)
        self._gust = GaussMarkov(rng_for(seed, "air", "gusts"), gust_std_m_s, _GUST_TIME_S, 3)
        self._readings = InertialReadings(frame)
        speed_m_s = airframe.airspeed_m_s if airspeed_m_s is None else airspeed_m_s
        self.trim = trim(airframe, speed_m_s, 0.0, self._readings.gravity_m_s2)
        self.controls = self.trim.controls
        state = _straight(speed_m_s, self.trim.alpha_rad, 0.0, yaw_rad)
        state[:3] = pos_ned_m
        state[3:6] += matrix_from_q(state[6:10]).T @ self._mean_wind
        self._state: Float = state

    @property
    def motion(self) -> Float:
        """Position NED, velocity in body axes, quaternion, rates: (13,)."""
        return self._state.copy()

    def step(self, t_us: int, dt_s: float, command: Controls, gust_ned_m_s: Float | None = None) -> VehicleState:
        """Advance by ``dt_s`` to the time ``t_us``; ``gust_ned_m_s`` (3,) comes on top of the seed's gusts.

        Raises
        ------
        ValueError
            ``dt_s`` is not above 0 and at most 20 ms, or the gust is not three finite numbers.
        """
        check_step(dt_s, _LONGEST_STEP_S)
        wind = self._mean_wind + self._gust.step(dt_s) * (1.0, 1.0, 0.5)
        if gust_ned_m_s is not None:
            check_vectors(gust_ned_m_s=gust_ned_m_s)
            wind = wind + gust_ned_m_s
        before = self._state
        self.controls = moved(self.airframe, self.controls, command, dt_s)
        parts = math.ceil(dt_s / _LONGEST_PART_S - 1e-9)
        north, east, down = wind.tolist()
        for _ in range(parts):
            self._state = runge_kutta(
                self.airframe, self._state, self.controls, (north, east, down), self._readings.gravity_m_s2,
                dt_s / parts,
            )  # fmt: skip
        q, q_before = self._state[6:10], before[6:10]
        return self._readings.state(
            t_us, dt_s, self._state[:3], matrix_from_q(q) @ self._state[3:6], np.array(euler_from_q(q)), wind, q,
            matrix_from_q(q_before) @ before[3:6], q_before,
        )  # fmt: skip


def moved(airframe: Airframe, now: Controls, command: Controls, dt_s: float) -> Controls:
    """Where surfaces and thrust have come to after ``dt_s``: surfaces at their rate, the thrust also with its lag."""
    most_rad, way_rad = airframe.surface_max_rad, airframe.surface_rate_max_rad_s * dt_s

    def surface(at_rad: float, wanted_rad: float) -> float:
        return at_rad + _bounded(_bounded(wanted_rad, most_rad) - at_rad, way_rad)

    wanted_n = min(max(command.thrust_n, 0.0), airframe.thrust_max_n)
    more_n = (1.0 - math.exp(-dt_s / airframe.thrust_time_s)) * (wanted_n - now.thrust_n)
    return Controls(
        surface(now.aileron_rad, command.aileron_rad),
        surface(now.elevator_rad, command.elevator_rad),
        surface(now.rudder_rad, command.rudder_rad),
        now.thrust_n + _bounded(more_n, airframe.thrust_rate_max_n_s * dt_s),
    )


def _accelerations(
    airframe: Airframe, controls: Controls, air: Vector, rates: Vector
) -> tuple[float, float, float, float, float, float]:
    """Forces by mass and moments by inertia in body axes, at a velocity relative to the air and body rates."""
    u, v, w = air
    p, q, r = rates
    speed = max(math.sqrt(u * u + v * v + w * w), _SLOWEST_M_S)
    alpha, beta = math.atan2(w, u), math.asin(min(max(v / speed, -1.0), 1.0))
    fast = speed / airframe.airspeed_m_s
    aileron, elevator, rudder = controls.aileron_rad, controls.elevator_rad, controls.rudder_rad
    attached = _bounded(alpha, airframe.stall_rad)
    lift_0, lift_a, lift_q, lift_e = airframe.lift_m_s2
    lift = fast * (fast * (lift_0 + lift_a * attached + lift_e * elevator) + lift_q * q)
    drag_0, drag_1, drag_2 = airframe.drag_m_s2
    drag = fast * fast * (drag_0 + drag_1 * attached + drag_2 * alpha * alpha)
    forward_q, forward_e = airframe.forward_m_s2

    def sideways(by: tuple[float, float, float, float, float]) -> float:
        return fast * (fast * (by[0] * beta + by[3] * aileron + by[4] * rudder) + by[1] * p + by[2] * r)

    pitch_a, pitch_q, pitch_e = airframe.pitch_rad_s2
    level = math.hypot(u, w)
    sin_a, cos_a = (w / level, u / level) if level > _SLOWEST_M_S else (0.0, 1.0)
    along = fast * (forward_q * q + fast * forward_e * elevator)
    return (
        lift * sin_a - drag * u / speed + along + controls.thrust_n / airframe.mass_kg,
        sideways(airframe.side_m_s2) - drag * v / speed,
        -lift * cos_a - drag * w / speed + airframe.down_by_thrust_m_s2_n * controls.thrust_n,
        sideways(airframe.roll_rad_s2),
        fast * (fast * (pitch_a * alpha + pitch_e * elevator) + pitch_q * q),
        sideways(airframe.yaw_rad_s2),
    )


def _rotation_rows(w: float, x: float, y: float, z: float) -> tuple[Vector, Vector, Vector]:
    """``ned_from_body`` in plain numbers: four times a step an array costs more than the arithmetic."""
    return (
        (1.0 - 2.0 * (y * y + z * z), 2.0 * (x * y - w * z), 2.0 * (x * z + w * y)),
        (2.0 * (x * y + w * z), 1.0 - 2.0 * (x * x + z * z), 2.0 * (y * z - w * x)),
        (2.0 * (x * z - w * y), 2.0 * (y * z + w * x), 1.0 - 2.0 * (x * x + y * y)),
    )


def _straight(airspeed_m_s: float, alpha_rad: float, climb_rad: float, yaw_rad: float) -> Float:
    """A state of straight flight in still air, wings level, at the origin."""
    state = np.zeros(STATES)
    state[3], state[5] = airspeed_m_s * math.cos(alpha_rad), airspeed_m_s * math.sin(alpha_rad)
    state[6:10] = q_from_euler(0.0, alpha_rad + climb_rad, yaw_rad)
    return state


def _bounded(value: float, most: float) -> float:
    return min(max(value, -most), most)
