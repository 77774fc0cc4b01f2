"""What the link reports: frozen events in SI units, each with its time on the station's base (Unix microseconds)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from estimator.types import Sample
from guidance.mission import MissionItem, MissionType


class Autopilot(StrEnum):
    """The autopilot families whose dialects differ here."""

    ARDUPILOT = "ardupilot"
    PX4 = "px4"
    OTHER = "other"


class VehicleType(StrEnum):
    """What kind of vehicle flies, as far as the station treats kinds differently."""

    HELICOPTER = "helicopter"
    MULTIROTOR = "multirotor"
    FIXED_WING = "fixed_wing"
    VTOL = "vtol"
    OTHER = "other"


class CommandStatus(StrEnum):
    """How a command ended; ``IN_PROGRESS`` is the only one that is not final."""

    ACCEPTED = "accepted"
    IN_PROGRESS = "in_progress"
    TEMPORARILY_REJECTED = "temporarily_rejected"
    DENIED = "denied"
    UNSUPPORTED = "unsupported"
    FAILED = "failed"
    CANCELLED = "cancelled"
    TIMEOUT = "timeout"


@dataclass(frozen=True, slots=True)
class VehicleAppeared:
    """A vehicle's autopilot was heard for the first time."""

    t_us: int
    system_id: int
    component_id: int
    autopilot: Autopilot
    vehicle_type: VehicleType


@dataclass(frozen=True, slots=True)
class VehicleLost:
    """No heartbeat for five seconds; ``last_heartbeat_us`` is the last one's time."""

    t_us: int
    system_id: int
    last_heartbeat_us: int


@dataclass(frozen=True, slots=True)
class VehicleReturned:
    """A lost vehicle was heard again after ``silent_us``."""

    t_us: int
    system_id: int
    silent_us: int


@dataclass(frozen=True, slots=True)
class VehicleRebooted:
    """The vehicle's boot clock ran backwards; its time has been anchored anew."""

    t_us: int
    system_id: int


@dataclass(frozen=True, slots=True, eq=False)
class SampleEvent:
    """One measurement for the estimator; the sample's own time is when it was made, ``t_us`` when it came."""

    t_us: int
    system_id: int
    sample: Sample


@dataclass(frozen=True, slots=True)
class TelemetryHeartbeat:
    """The autopilot's heartbeat. ``simulated``: it says itself that it flies hardware in the loop."""

    t_us: int
    system_id: int
    autopilot: Autopilot
    vehicle_type: VehicleType
    armed: bool
    mode: str
    simulated: bool


@dataclass(frozen=True, slots=True)
class TelemetryBattery:
    """The first battery; None where the vehicle does not say."""

    t_us: int
    system_id: int
    voltage_v: float | None
    remaining_pct: float | None
    current_a: float | None = None


@dataclass(frozen=True, slots=True)
class TelemetryGps:
    """The receiver's status, with or without a fix; MAVLink's ``fix_type`` (3 is a 3-D fix)."""

    t_us: int
    system_id: int
    fix_type: int
    satellites: int | None
    lat_rad: float | None
    lon_rad: float | None
    alt_amsl_m: float | None
    std_horizontal_m: float | None


@dataclass(frozen=True, slots=True)
class TelemetryPosition:
    """The autopilot's own position for display; it may come from GPS and must not reach the estimator."""

    t_us: int
    system_id: int
    lat_rad: float
    lon_rad: float
    alt_amsl_m: float
    alt_rel_m: float
    vn_m_s: float
    ve_m_s: float
    vd_m_s: float


@dataclass(frozen=True, slots=True)
class TelemetryLocalPosition:
    """Where the autopilot has itself in its own local frame at ``t_us``. It may come from GPS."""

    t_us: int
    system_id: int
    pos_ned_m: tuple[float, float, float]
    vel_ned_m_s: tuple[float, float, float]


@dataclass(frozen=True, slots=True)
class TelemetryMission:
    """Where in its mission a vehicle is: ``seq`` as it counts itself, see ``mission_items.number_of``."""

    t_us: int
    system_id: int
    seq: int


@dataclass(frozen=True, slots=True)
class TelemetrySpeed:
    """The autopilot's head-up figures for display; without an airspeed sensor the airspeed may come from GPS."""

    t_us: int
    system_id: int
    airspeed_m_s: float
    ground_speed_m_s: float
    throttle_pct: float


@dataclass(frozen=True, slots=True)
class TelemetryWind:
    """The autopilot's own estimate of the wind for display; ``from_rad`` is where it comes from, from true north."""

    t_us: int
    system_id: int
    speed_m_s: float
    from_rad: float


@dataclass(frozen=True, slots=True)
class StatusText:
    """A message to the operator, put together from its chunks; MAVLink severity, 0 emergency to 7 debug."""

    t_us: int
    system_id: int
    component_id: int
    severity: int
    text: str


@dataclass(frozen=True, slots=True)
class CommandResult:
    """News of a command sent with ``VehicleLink.command``."""

    t_us: int
    system_id: int
    command_id: int
    command: int
    status: CommandStatus
    text: str
    progress_pct: int | None = None

    @property
    def final(self) -> bool:
        """Whether nothing more comes for this command."""
        return self.status is not CommandStatus.IN_PROGRESS


class TransferAction(StrEnum):
    """What is done with one of a vehicle's lists of items."""

    UPLOAD = "upload"
    DOWNLOAD = "download"
    CLEAR = "clear"


@dataclass(frozen=True, slots=True)
class TransferNews:
    """News of a transfer begun with ``VehicleLink.transfer``: ``done`` of ``total`` items, as the vehicle counts them.

    ``items`` are those of a download that was accepted. ``unconfirmed``: the vehicle has taken every item of an upload,
    only its last word is missing, so that reading back will tell.
    """

    t_us: int
    system_id: int
    transfer_id: int
    action: TransferAction
    kind: MissionType
    status: CommandStatus
    text: str
    done: int = 0
    total: int = 0
    items: tuple[MissionItem, ...] = ()
    unconfirmed: bool = False

    @property
    def final(self) -> bool:
        """Whether nothing more comes for this transfer."""
        return self.status is not CommandStatus.IN_PROGRESS


class ParameterStatus(StrEnum):
    """How a read or write of a parameter ended; ``UNKNOWN``: the vehicle has none of that name."""

    KNOWN = "known"
    WRITTEN = "written"
    UNKNOWN = "unknown"
    REFUSED = "refused"
    TIMEOUT = "timeout"


@dataclass(frozen=True, slots=True)
class ParameterNews:
    """What became of a parameter ``asked`` for with ``VehicleLink.read_parameters`` or ``write_parameter``.

    ``name`` is how the vehicle spells it; ``value`` is what it holds, None where that is not known.
    """

    t_us: int
    system_id: int
    request_id: int
    asked: str
    name: str
    status: ParameterStatus
    text: str
    value: float | None = None


@dataclass(frozen=True, slots=True)
class TelemetryOrigin:
    """Where the autopilot's own local frame begins, as it says itself."""

    t_us: int
    system_id: int
    lat_rad: float
    lon_rad: float
    alt_amsl_m: float


@dataclass(frozen=True, slots=True)
class PositionAnswer:
    """What the autopilot said to a position that was given to it by command."""

    t_us: int
    system_id: int
    status: CommandStatus


@dataclass(frozen=True, slots=True)
class LinkStats:
    """The state of the link to one vehicle over the last second, and totals since it appeared.

    ``loss_pct`` is from gaps in the sequence numbers over the last seconds. ``noise_bytes`` and ``unknown_packets``
    (types outside the dialect) are of the whole link. ``signed_packets`` counts packets that carry a signature; the
    signature itself is not verified here. ``rejected`` counts measurements dropped by reason.
    """

    t_us: int
    system_id: int
    connected: bool
    heartbeat_age_s: float
    messages_per_s: float
    bytes_per_s: float
    loss_pct: float
    packets: int
    lost_packets: int
    signed_packets: int
    noise_bytes: int
    unknown_packets: int
    version: int
    round_trip_ms: float | None
    rates_hz: tuple[tuple[str, float], ...]
    rejected: tuple[tuple[str, int], ...]


LinkEvent = (
    VehicleAppeared
    | VehicleLost
    | VehicleReturned
    | VehicleRebooted
    | SampleEvent
    | TelemetryHeartbeat
    | TelemetryBattery
    | TelemetryGps
    | TelemetryPosition
    | TelemetryLocalPosition
    | TelemetrySpeed
    | TelemetryWind
    | StatusText
    | TelemetryMission
    | CommandResult
    | TransferNews
    | ParameterNews
    | TelemetryOrigin
    | PositionAnswer
    | LinkStats
)
