"""Two small aeroplanes by their derivatives: the Osprey of Kaiser (2008) and the PingWing of Conte (2009).

What a rigid aeroplane does depends on forces by its mass and on moments by its inertia only, so derivatives are
accelerations at one airspeed, from which ``simulator.vehicles.fixed_wing`` scales them. Body axes are those in which
level flight at that airspeed has no angle of attack. Positive elevator pitches up, positive aileron rolls right,
positive rudder yaws right: the signs of Kaiser's matrices.

**Osprey.** (2-13) and (2-14), pages 14 and 17, at 25 m/s and 60 m: all entries are taken, those of the inputs from
degrees. Limits are those of table 3-1. The text has neither mass nor inertia: 16.7 kg is 1 / 0.06, the thrust's entry,
and the ratios of the moments of inertia are assumed to be those of the Aerosonde (Beard and McLain, 2012, appendix E).
Assumed are the growth of drag with the square of the angle of attack and the stall.

**PingWing.** The thesis has span, mass and cruise speed (section 7.4.1) and no derivative. Assumed are a mean chord of
24 cm as the pictures show it, moments of inertia of 434 g spread over that wing, and coefficients that are usual for
tailless wings of aspect ratio 1.7: lift slope by Helmbold, 0.8 for Oswald's factor, a static margin of 11 %, two fins
and no rudder, a thrust of up to 60 % of the weight.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields

_PER_DEG = 180.0 / math.pi
_G_M_S2 = 9.81


@dataclass(frozen=True, slots=True)
class Airframe:
    """Accelerations at ``airspeed_m_s``, per rad, rad/s and rad of deflection, and the limits of the inputs.

    Parameters
    ----------
    lift_m_s2
        At no angle of attack; by angle of attack, pitch rate, elevator. Across the flow, upwards.
    drag_m_s2
        At no angle of attack; by it, by its square. Along the flow.
    forward_m_s2, down_by_thrust_m_s2_n
        Along the body's x axis by pitch rate and elevator; along its z axis by a newton of thrust.
    side_m_s2, roll_rad_s2, yaw_rad_s2
        By sideslip, roll rate, yaw rate, aileron, rudder.
    pitch_rad_s2
        By angle of attack, pitch rate, elevator.
    inertia
        Moments about the body's axes; only their ratios count.

    Raises
    ------
    ValueError
        A number is not finite, a tuple has not its length, or airspeed, mass, a moment of inertia or a limit is not
        positive.
    """

    name: str
    airspeed_m_s: float
    mass_kg: float
    inertia: tuple[float, float, float]
    lift_m_s2: tuple[float, float, float, float]
    drag_m_s2: tuple[float, float, float]
    forward_m_s2: tuple[float, float]
    down_by_thrust_m_s2_n: float
    side_m_s2: tuple[float, float, float, float, float]
    roll_rad_s2: tuple[float, float, float, float, float]
    pitch_rad_s2: tuple[float, float, float]
    yaw_rad_s2: tuple[float, float, float, float, float]
    stall_rad: float
    surface_max_rad: float
    surface_rate_max_rad_s: float
    thrust_max_n: float
    thrust_rate_max_n_s: float
    thrust_time_s: float

    def __post_init__(self) -> None:
        lengths = {"inertia": 3, "lift_m_s2": 4, "drag_m_s2": 3, "forward_m_s2": 2, "pitch_rad_s2": 3}
        lengths |= dict.fromkeys(("side_m_s2", "roll_rad_s2", "yaw_rad_s2"), 5)
        signed = {"down_by_thrust_m_s2_n", *lengths} - {"inertia"}
        for one in fields(self):
            if one.name == "name":
                continue
            value = getattr(self, one.name)
            numbers = value if isinstance(value, tuple) else (value,)
            if len(numbers) != lengths.get(one.name, 1) or not all(math.isfinite(number) for number in numbers):
                message = f"{one.name} must be {lengths.get(one.name, 1)} finite numbers, not {value}"
                raise ValueError(message)
            if one.name not in signed and not min(numbers) > 0.0:
                message = f"{one.name} must be positive, not {value}"
                raise ValueError(message)


def _osprey() -> Airframe:
    airspeed_m_s, x_thrust, z_thrust = 25.0, 0.06, 1e-4
    # X_u = -2 D / V of a drag that grows with the square of the speed.
    drag_m_s2 = 0.15 * airspeed_m_s / 2.0
    down_m_s2_n = z_thrust * airspeed_m_s
    lift_m_s2 = _G_M_S2 + down_m_s2_n * drag_m_s2 / x_thrust
    return Airframe(
        name="Osprey", airspeed_m_s=airspeed_m_s, mass_kg=1.0 / x_thrust, inertia=(0.824, 1.135, 1.759),
        # Along the body's axes the drag has a part in Z_alpha and Y_beta, and the lift one in X_alpha.
        lift_m_s2=(
            lift_m_s2, 7.17 * airspeed_m_s - drag_m_s2, (1.0 - 0.83) * airspeed_m_s, -1e-5 * airspeed_m_s * _PER_DEG,
        ),
        drag_m_s2=(drag_m_s2, lift_m_s2 - 11.08, 25.0), forward_m_s2=(0.08, 3e-3 * _PER_DEG),
        down_by_thrust_m_s2_n=down_m_s2_n,
        side_m_s2=(-0.69 * airspeed_m_s + drag_m_s2, -0.03 * airspeed_m_s, (1.0 - 0.99) * airspeed_m_s, 0.0, 0.0),
        roll_rad_s2=(-3.13, -12.92, 1.10, 1.50 * _PER_DEG, -0.02 * _PER_DEG),
        pitch_rad_s2=(-37.35, -9.96, 0.98 * _PER_DEG),
        yaw_rad_s2=(17.03, -0.10, -0.97, -0.09 * _PER_DEG, 0.17 * _PER_DEG),
        stall_rad=math.radians(12.0), surface_max_rad=math.radians(30.0), surface_rate_max_rad_s=math.radians(300.0),
        thrust_max_n=200.0, thrust_rate_max_n_s=200.0, thrust_time_s=0.1,
    )  # fmt: skip


def _ping_wing() -> Airframe:
    airspeed_m_s, mass_kg, span_m = 19.0, 0.434, 0.41
    chord_m, density_kg_m3, oswald = 0.24, 1.225, 0.8
    inertia = (0.0020, 0.0016, 0.0034)
    area_m2, aspect = span_m * chord_m, span_m / chord_m
    force_n = 0.5 * density_kg_m3 * airspeed_m_s**2 * area_m2
    a = force_n / mass_kg
    roll, pitch, yaw = force_n * span_m / inertia[0], force_n * chord_m / inertia[1], force_n * span_m / inertia[2]
    turn_s, nod_s = span_m / (2.0 * airspeed_m_s), chord_m / (2.0 * airspeed_m_s)
    lift, slope = _G_M_S2 / a, 2.0 * math.pi * aspect / (2.0 + math.sqrt(4.0 + aspect**2))
    induced = 1.0 / (math.pi * aspect * oswald)
    return Airframe(
        name="PingWing", airspeed_m_s=airspeed_m_s, mass_kg=mass_kg, inertia=inertia,
        lift_m_s2=(_G_M_S2, a * slope, a * 2.0 * nod_s, -a * 0.3),
        drag_m_s2=(a * (0.035 + induced * lift**2), a * 2.0 * induced * lift * slope, a * induced * slope**2),
        forward_m_s2=(0.0, 0.0), down_by_thrust_m_s2_n=0.0,
        side_m_s2=(-a * 0.3, 0.0, a * 0.1 * turn_s, 0.0, 0.0),
        roll_rad_s2=(-roll * 0.05, -roll * 0.25 * turn_s, roll * 0.06 * turn_s, roll * 0.12, 0.0),
        pitch_rad_s2=(-pitch * 0.25, -pitch * 1.2 * nod_s, pitch * 0.35),
        yaw_rad_s2=(yaw * 0.06, -yaw * 0.02 * turn_s, -yaw * 0.08 * turn_s, -yaw * 0.005, 0.0),
        stall_rad=math.radians(18.0), surface_max_rad=math.radians(25.0), surface_rate_max_rad_s=math.radians(400.0),
        thrust_max_n=0.6 * mass_kg * _G_M_S2, thrust_rate_max_n_s=10.0, thrust_time_s=0.1,
    )  # fmt: skip


OSPREY = _osprey()
PING_WING = _ping_wing()
