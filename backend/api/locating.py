"""Where pixels of a frame lie, without keeping anything: for a crosshair, and to lay a frame on the map."""

from __future__ import annotations

import math
from http import HTTPStatus
from typing import Annotated, Any

import structlog
from fastapi import APIRouter, Depends, Query

from backend.alignment import Shift, alignment_of
from backend.api.access import the_station
from backend.clicks import place_of_pixel
from backend.clock import unix_us
from backend.coordinates import dms_of, mgrs_of, utm_of
from backend.fleet.feed import FrameIdentity
from backend.fleet.vehicle import VehicleView
from backend.footprints import ellipse_in_frame, footprint_of
from backend.pointing import HIGHEST_HEIGHT_M, LOWEST_HEIGHT_M, GroundKind, Pointing
from backend.recorder.alignments import OPERATOR, AlignmentRow
from backend.schemas.geometry import ellipse_of
from backend.schemas.locating import AlignmentAccepted, AlignmentBody, FootprintBody, LocateBody, LocatedPixel
from backend.station import Station
from backend.uncertainty import circular_error_m

_log = structlog.get_logger(__name__)
router = APIRouter(prefix="/api/v1/vehicles/{vehicle_id}", tags=["targets"])

TheStation = Annotated[Station, Depends(the_station)]
Height = Annotated[float, Query(ge=LOWEST_HEIGHT_M, le=HIGHEST_HEIGHT_M, allow_inf_nan=False)]


@router.post("/locate")
async def locate(vehicle_id: str, body: LocateBody, station: TheStation) -> LocatedPixel:
    """Where a pixel of a frame lies, as a target made of it would be located. Nothing is kept."""
    vehicle, frame = _frame(station, vehicle_id, body.frame_id)
    pointing = Pointing(body.height_above_ground_m or 0.0, body.ground or "terrain")
    place = await place_of_pixel(vehicle, frame, body.u_px, body.v_px, pointing)
    found = place.cut.found
    lat_deg, lon_deg = math.degrees(found.lat_rad), math.degrees(found.lon_rad)
    cov = found.cov_ned_m2
    std: list[float] = [math.sqrt(max(float(cov[axis, axis]), 0.0)) for axis in range(3)]
    return LocatedPixel(
        frame_id=frame.frame_id, u_px=body.u_px, v_px=body.v_px, t_unix_us=place.t_us, mgrs=mgrs_of(lat_deg, lon_deg),
        utm=utm_of(lat_deg, lon_deg), dms=dms_of(lat_deg, lon_deg), lat_deg=lat_deg, lon_deg=lon_deg,
        alt_amsl_m=float(found.alt_amsl_m), method=place.method,
        height_above_ground_m=pointing.height_above_ground_m, ground=pointing.ground,
        std_n_m=std[0], std_e_m=std[1], std_d_m=std[2], cov_ne_m2=float(cov[0, 1]),
        ce90_m=circular_error_m(cov[:2, :2]), ellipse95=ellipse_of(cov[:2, :2]),
        ellipse95_px=ellipse_in_frame(place, frame),
    )  # fmt: skip


@router.get("/frames/{frame_id}/footprint")
async def footprint(
    vehicle_id: str, frame_id: int, station: TheStation,
    columns: Annotated[int, Query(ge=2, le=17)] = 9, rows: Annotated[int, Query(ge=2, le=17)] = 7,
    height_above_ground_m: Height = 0.0, ground: GroundKind = "terrain",
) -> FootprintBody:  # fmt: skip
    """Where a frame lies on the ground, as the estimate has it: a grid of pixels with their coordinates."""
    vehicle, frame = _frame(station, vehicle_id, frame_id)
    found = await footprint_of(vehicle, frame, Pointing(height_above_ground_m, ground), columns, rows)
    points: list[Any] = [None if point is None else list(point) for point in found.points]
    return FootprintBody(
        frame_id=frame_id, t_unix_us=found.t_us, width_px=frame.width_px, height_px=frame.height_px,
        columns=columns, rows=rows, u_px=found.u_px, v_px=found.v_px, points=points, centre=points[found.middle],
        ce90_m=found.ce90_m,
    )  # fmt: skip


@router.post("/alignment", status_code=HTTPStatus.ACCEPTED)
async def align(vehicle_id: str, body: AlignmentBody, station: TheStation) -> AlignmentAccepted:
    """Tell the estimator how far a frame lies beside its place, as an operator who dragged it onto the map saw it."""
    vehicle = station.live_vehicle(vehicle_id)
    _, frame = _frame(station, vehicle_id, body.frame_id)
    sample = await alignment_of(vehicle, frame, Shift(body.north_m, body.east_m, body.std_m), unix_us())
    vehicle.offer(sample)
    if vehicle.setup is not None:
        dragged = (body.north_m, body.east_m, body.std_m)
        station.recorder.alignment(
            AlignmentRow.of(sample, frame.t_us, vehicle.system_id, vehicle.setup.frame, dragged, body.by or OPERATOR)
        )
    std_n_m, std_e_m = (math.sqrt(float(sample.cov_ne_m2[axis, axis])) for axis in range(2))
    _log.info(
        "operator's alignment", vehicle=vehicle_id, frame=frame.frame_id, north_m=body.north_m, east_m=body.east_m,
        std_n_m=round(std_n_m, 2), std_e_m=round(std_e_m, 2),
    )  # fmt: skip
    return AlignmentAccepted(
        frame_id=frame.frame_id, t_frame_unix_us=sample.t_frame_us, std_n_m=std_n_m, std_e_m=std_e_m
    )


def _frame(station: Station, vehicle_id: str, frame_id: int) -> tuple[VehicleView, FrameIdentity]:
    vehicle = station.vehicle(vehicle_id)
    return vehicle, station.frame_of(vehicle, frame_id)
