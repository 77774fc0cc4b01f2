"""Strapdown inertial navigation in a local north-east-down frame.

Conte 2009, section 4.2; Groves, Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems, 2nd
edition, chapter 5.4.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from estimator.geometry.earth import EARTH_RATE_RAD_S, gravity_m_s2, meridian_radius_m, transverse_radius_m
from estimator.geometry.rotation import matrix_from_q, q_from_rotvec, q_multiply, q_normalise
from estimator.types import Float


@dataclass(frozen=True, slots=True, eq=False)
class EarthModel:
    """What of the Earth a flight of a few kilometres needs, fixed at the local frame's origin.

    ``rate_ned_rad_s`` (3,) is the Earth's rotation resolved in NED; the radii are those of curvature.
    """

    rate_ned_rad_s: Float
    gravity_m_s2: float
    meridian_radius_m: float
    transverse_radius_m: float
    tan_lat: float

    @classmethod
    def at(cls, lat_rad: float, alt_m: float) -> EarthModel:
        """The model at a latitude and a height."""
        return cls(
            rate_ned_rad_s=EARTH_RATE_RAD_S * np.array([np.cos(lat_rad), 0.0, -np.sin(lat_rad)]),
            gravity_m_s2=float(gravity_m_s2(lat_rad, alt_m)),
            meridian_radius_m=float(meridian_radius_m(lat_rad)) + alt_m,
            transverse_radius_m=float(transverse_radius_m(lat_rad)) + alt_m,
            tan_lat=float(np.tan(lat_rad)),
        )

    def transport_rate_ned_rad_s(self, vel_ned_m_s: Float) -> Float:
        """Rotation of the NED frame as it follows the vehicle over the curved Earth (3,)."""
        east = vel_ned_m_s[1] / self.transverse_radius_m
        return np.array([east, -vel_ned_m_s[0] / self.meridian_radius_m, -east * self.tan_lat])


@dataclass(frozen=True, slots=True, eq=False)
class Motion:
    """Nominal position, velocity (NED, metres) and attitude (quaternion) of the vehicle."""

    pos_ned_m: Float
    vel_ned_m_s: Float
    q_ned_from_body: Float


def propagate(
    motion: Motion, rate_body_rad_s: Float, specific_force_body_m_s2: Float, dt_s: float, earth: EarthModel
) -> Motion:
    """Motion after ``dt_s`` of constant body rate (3,) and specific force (3,).

    The attitude at the middle of the interval turns the force into NED; Coriolis and transport terms included.
    """
    transport = earth.transport_rate_ned_rad_s(motion.vel_ned_m_s)
    frame_turn = (earth.rate_ned_rad_s + transport) * dt_s
    half_turn = q_from_rotvec(rate_body_rad_s * (0.5 * dt_s))
    q_half = q_multiply(motion.q_ned_from_body, half_turn)
    ned_from_body_mid = matrix_from_q(q_half)
    acceleration = ned_from_body_mid @ specific_force_body_m_s2
    acceleration[2] += earth.gravity_m_s2
    acceleration -= _cross(2.0 * earth.rate_ned_rad_s + transport, motion.vel_ned_m_s)
    vel = motion.vel_ned_m_s + acceleration * dt_s
    pos = motion.pos_ned_m + (motion.vel_ned_m_s + vel) * (0.5 * dt_s)
    q = q_normalise(q_multiply(q_from_rotvec(-frame_turn), q_multiply(q_half, half_turn)))
    return Motion(pos, vel, q)


def _cross(a: Float, b: Float) -> Float:
    # numpy.cross costs ten times as much on single vectors
    return np.array([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
