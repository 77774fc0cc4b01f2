"""What flows through the estimator: samples in, states and reports out.

Every ``t_us`` here is Unix microseconds on the station's one time base; the link and the video map their own clocks to
it. Everything is a frozen dataclass; arrays are float64 unless said and are not to be written to.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

Float = NDArray[np.float64]
Image = NDArray[np.uint8]


class Mode(StrEnum):
    """Where the horizontal position comes from."""

    GPS = "gps"
    VISION = "vision"
    DEAD_RECKONING = "dead_reckoning"
    LOST = "lost"


class Doubt(StrEnum):
    """What the estimator has noticed of its inputs that an operator should know.

    ``no_texture``: pictures show too little to navigate by. ``map_mismatch``: those of different places together do not
    fit the map. ``map_offset``: map and satellites disagree by a steady distance. ``barometer_drift``: the
    barometer's zero moves faster than weather.
    """

    NO_TEXTURE = "no_texture"
    MAP_MISMATCH = "map_mismatch"
    MAP_OFFSET = "map_offset"
    BAROMETER_DRIFT = "barometer_drift"


@dataclass(frozen=True, slots=True, eq=False)
class InertialSample:
    """One reading of gyroscopes and accelerometers: rates (3,) and specific force (3,) in body FRD."""

    t_us: int
    rate_body_rad_s: Float
    specific_force_body_m_s2: Float


@dataclass(frozen=True, slots=True, eq=False)
class AttitudeSample:
    """The autopilot's own attitude: quaternion (4,) Hamilton [w, x, y, z] and rates (3,) in body FRD."""

    t_us: int
    q_ned_from_body: Float
    rate_body_rad_s: Float


@dataclass(frozen=True, slots=True, eq=False)
class CameraAttitudeSample:
    """Attitude of the gimbal frame (x along the optical axis, y right, z down in the picture) as the gimbal reports it.

    ``yaw_is_earth`` says whether the yaw is from true north; otherwise it is relative to the body's yaw, with roll and
    pitch still relative to the horizon.
    """

    t_us: int
    q_ned_from_gimbal: Float
    yaw_is_earth: bool


@dataclass(frozen=True, slots=True, eq=False)
class BarometerSample:
    """Pressure altitude above the ISA standard sea level, metres; its zero drifts with the weather."""

    t_us: int
    pressure_alt_m: float


@dataclass(frozen=True, slots=True, eq=False)
class MagnetometerSample:
    """Magnetic field (3,) in body FRD, any scale."""

    t_us: int
    field_body: Float


@dataclass(frozen=True, slots=True, eq=False)
class AirspeedSample:
    """True airspeed, metres per second."""

    t_us: int
    airspeed_m_s: float


@dataclass(frozen=True, slots=True, eq=False)
class GnssSample:
    """One fix of the receiver. ``vel_ned_m_s`` (3,) may hold NaN where the receiver does not say."""

    t_us: int
    lat_rad: float
    lon_rad: float
    alt_amsl_m: float
    vel_ned_m_s: Float
    std_horizontal_m: float
    std_vertical_m: float
    satellites: int


@dataclass(frozen=True, slots=True, eq=False)
class HomeSample:
    """Where the autopilot calls home."""

    t_us: int
    lat_rad: float
    lon_rad: float
    alt_amsl_m: float


@dataclass(frozen=True, slots=True, eq=False)
class FrameSample:
    """One picture of the video: ``image`` is (height, width) uint8 grey, or (height, width, 3) BGR.

    ``stamped`` says that its time was written by the vehicle's own clock, and so needs no offset. Another ``epoch`` may
    have another clock.
    """

    t_us: int
    frame_id: int
    image: Image
    epoch: int = 0
    stamped: bool = False


@dataclass(frozen=True, slots=True, eq=False)
class AlignmentSample:
    """An operator's word, given at ``t_us``, on where the vehicle was when a frame was exposed at ``t_frame_us``.

    ``pos_ne_m`` (2,) is that place in the local frame by the reference imagery, ``cov_ne_m2`` (2, 2) its covariance.
    """

    t_us: int
    t_frame_us: int
    frame_id: int
    pos_ne_m: Float
    cov_ne_m2: Float


Sample = (
    InertialSample
    | AttitudeSample
    | CameraAttitudeSample
    | BarometerSample
    | MagnetometerSample
    | AirspeedSample
    | GnssSample
    | HomeSample
    | FrameSample
    | AlignmentSample
)


class OffsetSource(StrEnum):
    """Where the offset between the video's clock and the telemetry's comes from."""

    GIVEN = "given"
    STAMPED = "stamped"
    SEARCHING = "searching"
    FOUND = "found"


@dataclass(frozen=True, slots=True)
class VideoOffset:
    """What is added to frame times. ``std_s`` is None where nobody has measured it, both are while it is searched.

    ``reason`` says why it has not been found yet.
    """

    source: OffsetSource
    offset_s: float | None = None
    std_s: float | None = None
    reason: str = ""


class PadMode(StrEnum):
    """How the place relative to the landing pad is known.

    ``searching``: no picture has shown it. ``tracking``: a picture has, just now. ``dead_reckoning``: carried on since
    the last that did, while the stated sigma is still small. ``lost``: carried on for too long to land by.
    """

    SEARCHING = "searching"
    TRACKING = "tracking"
    DEAD_RECKONING = "dead_reckoning"
    LOST = "lost"

    @property
    def known(self) -> bool:
        """Whether the place may be flown by."""
        return self in (PadMode.TRACKING, PadMode.DEAD_RECKONING)


@dataclass(frozen=True, slots=True, eq=False)
class PadSeen:
    """The pad in one picture: pad coordinates turn by ``camera_from_pad`` (3, 3), its centre at ``pad_in_camera_m``.

    ``triple`` is the largest that was used (0 the pad's largest, -1 for tags), ``seen_share`` of its edges were there.
    """

    t_us: int
    frame_id: int
    camera_from_pad: Float
    pad_in_camera_m: Float
    triple: int
    seen_share: float


@dataclass(frozen=True, slots=True, eq=False)
class PadRelative:
    """Where the vehicle is relative to the landing pad.

    ``pos_ned_m`` (3,) leads from the pad's centre to the vehicle's reference point, axes north, east, down;
    ``vel_ned_m_s`` (3,). Covariances (3, 3) of both are of the pad's estimate too, so they are smaller than the
    position's on the map. ``q_ned_from_pad`` (4,) is the pad's own attitude. ``age_s`` counts from the last accepted
    picture of it, infinity before the first; ``reason`` says why the latest picture was not used, empty where it was.
    Before the first picture position and covariance are NaN, unless somebody has said where the pad lies.
    """

    mode: PadMode
    pos_ned_m: Float
    vel_ned_m_s: Float
    cov_pos_ned_m2: Float
    cov_vel_ned_m2_s2: Float
    q_ned_from_pad: Float
    age_s: float
    reason: str = ""
    seen: PadSeen | None = None


@dataclass(frozen=True, slots=True, eq=False)
class NavigationState:
    """Where the vehicle is at ``t_us`` and how sure that is.

    ``cov_pos_ned_m2`` (3, 3) and ``cov_vel_ned_m2_s2`` (3, 3). ``cov_camera_pose`` (6, 6) is of the camera: position
    NED in metres, then its small rotation error about the NED axes in radians, boresight included.
    ``alt_agl_m`` is above the ground below the vehicle, NaN where the ground is unknown.
    ``last_fix_age_s`` counts from the last accepted absolute position fix, infinity before the first.
    ``doubts`` are those that stand.
    ``lever_ned_m`` (3,) leads from the vehicle's position to the lens. ``ground_bias_m`` is how far what is seen about
    here lies below the ground model, ``cov_ground_bias`` (7,) its covariance with the six of the camera's pose and its
    own variance, None where it is not estimated.
    ``cov_motion`` (10, 10) is of position, velocity, attitude and ground bias together, None where it is not kept.
    ``boresight_rad`` (3,), covariance ``cov_boresight_rad2`` (3, 3), is the small rotation about the axes of body or
    gimbal frame from the stated mount to the true one; None where it is not estimated.
    ``pad`` is the place relative to the landing pad, None where no pad was described.
    """

    t_us: int
    mode: Mode
    process_model: str
    lat_rad: float
    lon_rad: float
    alt_amsl_m: float
    alt_agl_m: float
    pos_ned_m: Float
    vel_ned_m_s: Float
    q_ned_from_body: Float
    q_ned_from_camera: Float
    cov_pos_ned_m2: Float
    cov_vel_ned_m2_s2: Float
    cov_attitude_rad2: Float
    cov_camera_pose: Float
    last_fix_age_s: float
    boresight_rad: Float | None = None
    cov_boresight_rad2: Float | None = None
    video_offset: VideoOffset | None = None
    doubts: tuple[Doubt, ...] = ()
    lever_ned_m: Float = field(default_factory=lambda: np.zeros(3))
    ground_bias_m: float = 0.0
    cov_ground_bias: Float | None = None
    cov_motion: Float | None = None
    pad: PadRelative | None = None

    @property
    def lens_ned_m(self) -> Float:
        """Position (3,) of the lens."""
        lens: Float = self.pos_ned_m + self.lever_ned_m
        return lens


@dataclass(frozen=True, slots=True, eq=False)
class FixReport:
    """One attempt at an absolute position fix, accepted or not.

    ``north_m`` and ``east_m`` are the vehicle's position in the local frame as the fix has it (NaN when there is
    none), ``cov_ne_m2`` (2, 2) its covariance, ``score`` the match's peak in [-1, 1] and ``outlier_probability`` what
    the verification says. ``heading_correction_rad`` and ``scale_correction`` are what the best hypothesis changed.
    """

    t_us: int
    frame_id: int
    kind: str
    accepted: bool
    reason: str
    north_m: float
    east_m: float
    cov_ne_m2: Float
    score: float
    outlier_probability: float
    heading_correction_rad: float
    scale_correction: float
    elapsed_ms: float
