"""The document ``evidence.json``: everything a click's coordinate was computed from, and the coordinate.

Angles in radians and lengths in metres, exactly as the computation had them: a JSON number here gives the same float64
again. ``content_sha256`` is over all other members (see `content_sha256`), so that altered bytes are noticed; it is no
signature.
"""

from __future__ import annotations

import hashlib
import json
from typing import Annotated, Any, Literal, Self

from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from backend.errors import BundleError
from backend.settings import describe_validation

SCHEMA: Literal["pilotage.evidence/4"] = "pilotage.evidence/4"
HASH_FIELD = "content_sha256"
MOST_CELLS = 120_000_000
PieceName = Literal["map.png", "map_valid.png", "ground.f64"]

Finite = Annotated[float, Field(allow_inf_nan=False)]
Positive = Annotated[float, Field(gt=0.0, allow_inf_nan=False)]
Vector3 = Annotated[list[Finite], Field(min_length=3, max_length=3)]
Vector6 = Annotated[list[Finite], Field(min_length=6, max_length=6)]
Quaternion = Annotated[list[Finite], Field(min_length=4, max_length=4)]
Sha256 = Annotated[str, Field(pattern=r"^[0-9a-f]{64}$")]
# Null stands for a number that nobody knew.
Matrix3 = Annotated[
    list[Annotated[list[Finite | None], Field(min_length=3, max_length=3)]], Field(min_length=3, max_length=3)
]
Matrix6 = Annotated[
    list[Annotated[list[Finite | None], Field(min_length=6, max_length=6)]], Field(min_length=6, max_length=6)
]


class _Part(BaseModel):
    model_config = ConfigDict(extra="forbid", frozen=True)


class ProgramPart(_Part):
    """What computed it."""

    name: str
    version: str


class TargetPart(_Part):
    """The target, and the version of it whose coordinate this is."""

    id: str
    version: int
    created_unix_us: int


class FramePart(_Part):
    """The picture's identity; ``t_unix_us`` is its exposure on the state's clock, ``t_video_unix_us`` as it came."""

    vehicle_id: str
    source: str
    frame_id: int
    t_unix_us: int
    t_video_unix_us: int
    stamped: bool
    width_px: Annotated[int, Field(gt=0)]
    height_px: Annotated[int, Field(gt=0)]


class ClickPart(_Part):
    """The pixel: of the video, and of the calibrated camera ((0, 0) is the centre of the top-left pixel)."""

    u_px: Finite
    v_px: Finite
    camera_u_px: Finite
    camera_v_px: Finite
    std_px: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]


class StatePart(_Part):
    """The vehicle at the exposure; names as in `estimator.types.NavigationState`. Null where nobody knew.

    The ray starts at ``pos_ned_m`` + ``lever_ned_m`` and is cut with the ground lowered by ``ground_bias_m``.
    """

    t_unix_us: int
    mode: str
    process_model: str
    assumption: str | None
    corrected_by_later_fixes: bool
    lat_rad: Finite
    lon_rad: Finite
    alt_amsl_m: Finite
    alt_agl_m: Finite | None
    pos_ned_m: Vector3
    vel_ned_m_s: Annotated[list[Finite | None], Field(min_length=3, max_length=3)]
    q_ned_from_body: Quaternion
    q_ned_from_camera: Quaternion
    cov_pos_ned_m2: Matrix3
    cov_camera_pose: Matrix6
    last_fix_age_s: Finite | None
    doubts: list[str]
    lever_ned_m: Vector3
    ground_bias_m: Finite
    cov_ground_bias: Annotated[list[Finite], Field(min_length=7, max_length=7)] | None


class CameraPart(_Part):
    """The pinhole with OpenCV's distortion k1, k2, p1, p2, k3."""

    width_px: Annotated[int, Field(gt=0)]
    height_px: Annotated[int, Field(gt=0)]
    fx_px: Positive
    fy_px: Positive
    cx_px: Finite
    cy_px: Finite
    distortion: Annotated[list[Finite], Field(min_length=5, max_length=5)]


class MountPart(_Part):
    """How the camera sits on the vehicle: as stated. The state's ``q_ned_from_camera`` has it already."""

    gimbal: str
    roll_rad: Finite
    pitch_rad: Finite
    yaw_rad: Finite
    lever_arm_frd_m: Vector3


class FramePlacePart(_Part):
    """The local north-east-down frame: the tangent plane of the ellipsoid at its origin."""

    lat_rad: Finite
    lon_rad: Finite
    alt_m: Finite
    ellipsoid: Literal["WGS84"] = "WGS84"
    vertical_datum: str = "mean sea level as the map and the vehicle have it, taken as ellipsoidal in the geometry"


class FlatPart(_Part):
    """Ground at one altitude."""

    kind: Literal["flat"] = "flat"
    alt_amsl_m: Finite


class StripPart(_Part):
    """The cells of an elevation grid along the ray.

    The centre of row r, column c lies at north = ``north_max_m`` - r ``gsd_m``, east = ``east_min_m`` + c ``gsd_m``.
    ``alt_amsl_m[i]`` is row ``first_row`` + i from column ``first_cols[i]`` on. Null, and all that is not listed, is
    unknown.
    """

    kind: Literal["elevation_grid"] = "elevation_grid"
    interpolation: Literal["bilinear"] = "bilinear"
    north_max_m: Finite
    east_min_m: Finite
    gsd_m: Positive
    first_row: Annotated[int, Field(ge=0)]
    first_cols: Annotated[list[Annotated[int, Field(ge=0)]], Field(min_length=1)]
    alt_amsl_m: list[Annotated[list[Finite | None], Field(min_length=1)]]

    @model_validator(mode="after")
    def _rows_match(self) -> Self:
        if len(self.first_cols) != len(self.alt_amsl_m):
            raise ValueError(f"{len(self.first_cols)} first columns for {len(self.alt_amsl_m)} rows of heights")
        return self


class GroundPart(_Part):
    """What the ray was cut with: the ground, its error, and how far and how finely it was looked at."""

    model: Annotated[FlatPart | StripPart, Field(discriminator="kind")]
    std_m: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
    slope_std: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
    target_height_m: Finite
    slope_step_m: Positive
    # Longer rays than the air lets through would only keep a reader busy.
    max_range_m: Annotated[float, Field(gt=0.0, le=50_000.0)]


class FileUsedPart(_Part):
    """A file of the station that the coordinate leans on. ``sha256`` is null where ``problem`` says why.

    ``source_file`` and ``source_sha256`` are what it was imported from, if the map library knows.
    """

    role: Literal["reference", "elevation"]
    file: str
    size_bytes: int
    sha256: Sha256 | None
    map_id: str | None
    source_file: str | None
    source_sha256: Sha256 | None
    problem: str | None


class CalibrationPart(_Part):
    """The matcher's calibration that the live estimator ran with."""

    channels: str
    version: str


class PicturePart(_Part):
    """The picture clicked on, which is the one that was registered. ``file`` is null where it was gone."""

    file: Literal["frame.jpg"] | None
    sha256: Sha256 | None
    problem: str | None


class PlacementPart(_Part):
    """How the picture lies on the map, found by registering it, and how that was weighed against the ray.

    ``correction`` of the pose ``pos_ned_m``, ``ned_from_camera`` (rows) that was predicted, with its covariance: the
    displacement north and east of the ground point ``centre_ned_m`` in metres, the height above it as a share, and the
    rotation about the NED axes in radians.
    """

    by: str
    centre_ned_m: Vector3
    pos_ned_m: Vector3
    ned_from_camera: Annotated[list[Vector3], Field(min_length=3, max_length=3)]
    correction: Vector6
    cov: Annotated[list[Vector6], Field(min_length=6, max_length=6)]
    map_std_m: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
    outlier_probability: Annotated[float, Field(ge=0.0, le=1.0)]
    map_offset_std_m: Annotated[float, Field(ge=0.0, allow_inf_nan=False)]
    cross: Annotated[float, Field(ge=0.0, le=1.0)]
    pose_inflation: Annotated[float, Field(ge=1.0, allow_inf_nan=False)]


class FilePart(_Part):
    """A file beside the document, in the zip."""

    file: PieceName
    sha256: Sha256


class GridPart(_Part):
    """A cut-out of a grid: ``piece_rows`` x ``piece_cols`` cells from row ``first_row``, column ``first_col`` on.

    The centre of the grid's row r, column c lies at north = ``north_max_m`` - r ``gsd_m``, east = ``east_min_m`` +
    c ``gsd_m``. The cells are in ``files``; where there are none ``problem`` says why.
    """

    north_max_m: Finite
    east_min_m: Finite
    gsd_m: Positive
    rows: Annotated[int, Field(gt=0)]
    cols: Annotated[int, Field(gt=0)]
    first_row: Annotated[int, Field(ge=0)]
    first_col: Annotated[int, Field(ge=0)]
    piece_rows: Annotated[int, Field(ge=0)]
    piece_cols: Annotated[int, Field(ge=0)]
    files: list[FilePart]
    problem: str | None

    @model_validator(mode="after")
    def _fits(self) -> Self:
        if self.rows * self.cols > MOST_CELLS:
            raise ValueError(f"a grid of {self.rows} x {self.cols} cells is larger than any that is in use")
        if self.first_row + self.piece_rows > self.rows or self.first_col + self.piece_cols > self.cols:
            raise ValueError("the piece reaches beyond its grid")
        return self


class RegistrationPart(_Part):
    """What the registration behind ``placement`` was made with, for it to be repeated.

    ``state`` is the one that the search set out from: that of the click, where later fixes have moved it since.
    ``settings`` are those of `estimator.registration.placement.PlacementConfig`, before the search is widened for the
    state's uncertainty. ``map_offset_ne_m`` was added to every position read off the reference file. ``ground`` is null
    where it was at one altitude, ``ground_alt_amsl_m`` where it was not.
    """

    state: StatePart
    settings: dict[str, Any]
    map_offset_ne_m: Annotated[list[Finite], Field(min_length=2, max_length=2)]
    map: GridPart
    ground: GridPart | None
    ground_alt_amsl_m: Finite | None

    @model_validator(mode="after")
    def _one_ground(self) -> Self:
        if (self.ground is None) == (self.ground_alt_amsl_m is None):
            raise ValueError("the ground is either a grid or at one altitude")
        return self


class ResultPart(_Part):
    """The coordinate, its covariance (NED), and the method in the estimator's and in the target's words."""

    lat_deg: Annotated[float, Field(ge=-90.0, le=90.0)]
    lon_deg: Annotated[float, Field(ge=-180.0, le=180.0)]
    alt_amsl_m: Finite
    pos_ned_m: Vector3
    cov_ned_m2: Matrix3
    ray_method: str
    method: str


class Evidence(_Part):
    """The whole document."""

    schema_name: Annotated[Literal["pilotage.evidence/4"], Field(alias="schema")] = SCHEMA
    program: ProgramPart
    target: TargetPart
    frame: FramePart
    click: ClickPart
    state: StatePart
    camera: CameraPart
    mount: MountPart
    local_frame: FramePlacePart
    ground: GroundPart
    files: list[FileUsedPart]
    calibration: CalibrationPart | None
    picture: PicturePart
    placement: PlacementPart | None
    registration: RegistrationPart | None
    result: ResultPart

    @model_validator(mode="after")
    def _registered(self) -> Self:
        if (self.placement is None) != (self.registration is None):
            raise ValueError("a placement and what it was found with go together")
        return self

    def pieces(self) -> list[FilePart]:
        """The files of map and ground that lie beside the document."""
        part = self.registration
        grids = [] if part is None else [part.map, *([] if part.ground is None else [part.ground])]
        return [file for grid in grids for file in grid.files]


def content_sha256(content: dict[str, Any]) -> str:
    """SHA-256 of a document without its hash: JSON in UTF-8, keys sorted, no blanks, shortest floats (Python's)."""
    rest = {name: value for name, value in content.items() if name != HASH_FIELD}
    text = json.dumps(rest, sort_keys=True, separators=(",", ":"), ensure_ascii=False, allow_nan=False)
    return hashlib.sha256(text.encode()).hexdigest()


def document_of(evidence: Evidence) -> bytes:
    """The bytes of ``evidence.json``."""
    content = evidence.model_dump(mode="json", by_alias=True)
    content[HASH_FIELD] = content_sha256(content)
    return (json.dumps(content, indent=1, ensure_ascii=False, allow_nan=False) + "\n").encode()


def read_document(data: bytes, name: str) -> Evidence:
    """The evidence in the bytes of an ``evidence.json``; ``name`` says in errors which file it is.

    Raises
    ------
    BundleError
        It is no JSON, of another schema, altered, or holds what makes no sense.
    """
    try:
        content = json.loads(data.decode("utf-8"), parse_constant=_no_constant, object_pairs_hook=_no_repetition)
    except RecursionError:
        raise BundleError(name, "is nested too deeply to be evidence") from None
    except ValueError as error:
        raise BundleError(name, f"cannot be read as JSON: {error}") from None
    schema = content.get("schema") if isinstance(content, dict) else None
    if not isinstance(content, dict) or schema != SCHEMA:
        advice = _advice(schema)
        raise BundleError(name, f"has the schema {schema!r}, and this Pilotage reads {SCHEMA!r}: {advice}")
    stated = content.pop(HASH_FIELD, None)
    try:
        actual = content_sha256(content)
    except ValueError as error:
        raise BundleError(name, f"holds a number that is not finite: {error}") from None
    if stated != actual:
        raise BundleError(
            name, f"was altered after it was made: its {HASH_FIELD} is {stated!r}, its content's {actual!r}"
        )
    try:
        return Evidence.model_validate(content, strict=True)
    except ValidationError as error:
        raise BundleError(name, f"is not as its schema says: {describe_validation(error)[:400]}") from None


def _advice(schema: object) -> str:
    family, _, own = SCHEMA.partition("/")
    if not isinstance(schema, str) or not schema.startswith(f"{family}/"):
        return "it is no evidence of a target"
    number = schema.removeprefix(f"{family}/")
    older = number.isascii() and number.isdigit() and int(number[:9]) < int(own)
    return "the Pilotage that made it reads it" if older else "use a newer Pilotage"


def _no_constant(text: str) -> float:
    raise ValueError(f"{text} is no number")


def _no_repetition(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    found = dict(pairs)
    if len(found) != len(pairs):
        names = [name for name, _ in pairs]
        raise ValueError(f"{next(n for n in names if names.count(n) > 1)!r} is stated twice")
    return found
