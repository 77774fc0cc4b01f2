"""Strapdown inertial navigation in a local north-east-down frame.

Conte 2009, section 4.2; Groves, Principles of GNSS, Inertial and Multisensor Integrated Navigation Systems, 2nd
edition, chapter 5.4.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from estimator.geometry.earth import EARTH_RATE_RAD_S, gravity_m_s2, meridian_radius_m, transverse_radius_m
from estimator.geometry.rotation import Quaternion, quaternion_exponential, quaternion_product
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

    def transport_rate_ned_rad_s(self, north_m_s: float, east_m_s: float) -> tuple[float, float, float]:
        """Rotation about NED of the frame itself as it follows a vehicle of this velocity over the curved Earth."""
        by_east = east_m_s / self.transverse_radius_m
        return by_east, -north_m_s / self.meridian_radius_m, -by_east * self.tan_lat


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
    # in plain numbers: on so few of them each call of numpy costs more than the arithmetic
    vn, ve, vd = motion.vel_ned_m_s.tolist()
    fx, fy, fz = specific_force_body_m_s2.tolist()
    earth_n, _, earth_d = earth.rate_ned_rad_s.tolist()
    turn_n, turn_e, turn_d = earth.transport_rate_ned_rad_s(vn, ve)
    half_turn = quaternion_exponential(*(rate_body_rad_s * (0.5 * dt_s)).tolist())
    q_half = quaternion_product(tuple(motion.q_ned_from_body.tolist()), half_turn)
    an, ae, ad = _rotated(q_half, fx, fy, fz)
    # Coriolis, of the Earth and of the frame that follows the vehicle
    cn, ce, cd = 2.0 * earth_n + turn_n, turn_e, 2.0 * earth_d + turn_d
    an -= ce * vd - cd * ve
    ae -= cd * vn - cn * vd
    ad += earth.gravity_m_s2 - (cn * ve - ce * vn)
    dn, de, dd = an * dt_s, ae * dt_s, ad * dt_s
    step = np.array(((vn + 0.5 * dn) * dt_s, (ve + 0.5 * de) * dt_s, (vd + 0.5 * dd) * dt_s))
    frame_turn = quaternion_exponential(-(earth_n + turn_n) * dt_s, -turn_e * dt_s, -(earth_d + turn_d) * dt_s)
    w, x, y, z = quaternion_product(frame_turn, quaternion_product(q_half, half_turn))
    norm = math.sqrt(w * w + x * x + y * y + z * z)
    return Motion(
        motion.pos_ned_m + step, motion.vel_ned_m_s + np.array((dn, de, dd)),
        np.array((w / norm, x / norm, y / norm, z / norm)),
    )  # fmt: skip


def _rotated(q: Quaternion, x: float, y: float, z: float) -> tuple[float, float, float]:
    """A vector turned by a unit quaternion: v + 2 w (u x v) + 2 u x (u x v)."""
    w, a, b, c = q
    tx, ty, tz = 2.0 * (b * z - c * y), 2.0 * (c * x - a * z), 2.0 * (a * y - b * x)
    return x + w * tx + b * tz - c * ty, y + w * ty + c * tx - a * tz, z + w * tz + a * ty - b * tx
