"""Bodies about where pixels of a frame lie."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

from backend.pointing import GroundKind
from backend.schemas.geometry import EllipseBody, HeightAboveGround

GridPoint = Annotated[list[float], Field(min_length=2, max_length=2)]


class LocateBody(BaseModel):
    """A pixel of a frame, and how far what it shows stands above which ground (at the terrain when not said)."""

    model_config = ConfigDict(extra="forbid")

    frame_id: int = Field(ge=0)
    u_px: float = Field(allow_inf_nan=False)
    v_px: float = Field(allow_inf_nan=False)
    height_above_ground_m: float | None = HeightAboveGround
    ground: GroundKind | None = None


class LocatedPixel(BaseModel):
    """Where a pixel lies, with its uncertainty; fields as a target's. Nothing of it is kept.

    ``ellipse95_px`` is the ellipse as the frame would show it if it lay level at the place: a ring of pixels [u, v],
    null where a part of it is out of the camera's sight.
    """

    frame_id: int
    u_px: float
    v_px: float
    t_unix_us: int
    mgrs: str | None
    utm: str | None
    dms: str
    lat_deg: float
    lon_deg: float
    alt_amsl_m: float
    method: str
    height_above_ground_m: float
    ground: GroundKind
    std_n_m: float
    std_e_m: float
    std_d_m: float
    cov_ne_m2: float
    ce90_m: float
    ellipse95: EllipseBody
    ellipse95_px: list[GridPoint] | None


class FootprintBody(BaseModel):
    """Where a frame lies on the ground: a grid of its pixels, from edge to edge.

    Point i is pixel (``u_px[i % columns]``, ``v_px[i // columns]``): [lat, lon] in degrees, or null where that pixel
    shows no known ground. ``ce90_m`` is that of the point nearest to the picture's centre.
    """

    frame_id: int
    t_unix_us: int
    width_px: int
    height_px: int
    columns: int
    rows: int
    u_px: list[float]
    v_px: list[float]
    points: list[GridPoint | None]
    centre: GridPoint | None
    ce90_m: float | None


class AlignmentBody(BaseModel):
    """How far a frame had to be dragged from where the estimate has it to where it lies, and how well that was seen.

    ``by`` is who says so, for the recording.
    """

    model_config = ConfigDict(extra="forbid")

    frame_id: int = Field(ge=0)
    north_m: float = Field(allow_inf_nan=False)
    east_m: float = Field(allow_inf_nan=False)
    std_m: float = Field(default=3.0, ge=0.3, le=100.0, allow_inf_nan=False)
    by: str | None = Field(default=None, min_length=1, max_length=60, pattern=r"^[^\x00-\x1f\x7f]*$")


class AlignmentAccepted(BaseModel):
    """The measurement was handed to the estimator; a ``fix`` message of kind ``operator`` says what it made of it.

    ``std_n_m`` and ``std_e_m`` have the camera's attitude error in them.
    """

    frame_id: int
    t_frame_unix_us: int
    std_n_m: float
    std_e_m: float
