"""Errors of the service, and the one table from error class to HTTP status.

StationError            base: ``str()`` is fit for an operator's eyes
  StartError            the station cannot start as it was told to
  UnknownVehicleError   no vehicle with that id
  UnknownSourceError    no video source with that id
  UnknownTargetError    no target with that id
  UnknownFlightError    no flight with that id
  UnknownReplayError    no replay under that vehicle id
  LayerMissingError     the map has no such layer yet
  FrameGoneError        the frame is not, or no longer, in the ring
  NoStateForFrameError  the vehicle's state at the frame's exposure is not known
  NoStateYetError       the vehicle's estimator has no state yet
  NoPadError            no landing pad is described
  NoPlanError           no plan is kept for the vehicle
  PlanChangedError      the kept plan is another than the request expects
  PlanFileError         a mission plan that cannot be used, and where in it
  NoGroundError         the ray of a click meets no ground
  CannotFollowTargetError  what a click shows cannot be followed
  AlignmentRefusedError an operator's alignment of a frame that cannot be meant
  NoEvidenceError       nothing proves the coordinate that the target has
  BundleError           evidence that cannot be read or believed
  TargetNotKeptError    the target or its evidence could not be written: neither is kept
  TargetChangedError    the target has another version than the request expects
  ConflictError         the request does not fit the present state of the station
  CommandRefusedError   the vehicle cannot be given this command now
  InvalidRequestError   a value that makes no sense
"""

from __future__ import annotations

from http import HTTPStatus

from geodata.errors import FlightFolderError, MapLibraryError, MapNotFoundError, PadFileError, RasterError


class StationError(Exception):
    """An error of the service; its text says what was wrong, with which input, and what to do."""


class StartError(StationError):
    """The station cannot start as it was told to."""


class UnknownVehicleError(StationError):
    """No vehicle with that id."""

    def __init__(self, vehicle_id: str) -> None:
        self.vehicle_id = vehicle_id
        super().__init__(f"no vehicle '{vehicle_id}': GET /api/v1/vehicles lists those heard so far")


class UnknownSourceError(StationError):
    """No video source with that id."""

    def __init__(self, source: str) -> None:
        self.source = source
        super().__init__(f"no video source '{source}': sources are named cam-<vehicle id>")


class UnknownTargetError(StationError):
    """No target with that id."""

    def __init__(self, target_id: str) -> None:
        self.target_id = target_id
        super().__init__(f"no target '{target_id}': it may have been deleted")


class UnknownFlightError(StationError):
    """No flight with that id."""

    def __init__(self, flight_id: str) -> None:
        self.flight_id = flight_id
        super().__init__(f"no flight '{flight_id}': GET /api/v1/flights lists them")


class UnknownReplayError(StationError):
    """No replay under that vehicle id."""

    def __init__(self, vehicle_id: str) -> None:
        self.vehicle_id = vehicle_id
        super().__init__(f"no replay runs as vehicle '{vehicle_id}'")


class LayerMissingError(StationError):
    """The map has no such layer yet."""

    def __init__(self, map_id: str) -> None:
        self.map_id = map_id
        super().__init__(f"map '{map_id}' has no matchability layer: POST /api/v1/maps/{map_id}/matchability makes one")


class FrameGoneError(StationError):
    """The frame is not, or no longer, in the ring."""

    def __init__(self, source: str, frame_id: int) -> None:
        self.source = source
        self.frame_id = frame_id
        super().__init__(f"frame {frame_id} of '{source}' is not held: it is too old, or was never received")


class NoStateForFrameError(StationError):
    """The vehicle's state at the frame's exposure is not known."""

    def __init__(self, vehicle_id: str, frame_id: int, reason: str) -> None:
        self.vehicle_id = vehicle_id
        self.frame_id = frame_id
        self.reason = reason
        super().__init__(f"no position of vehicle '{vehicle_id}' at the exposure of frame {frame_id}: {reason}")


class NoStateYetError(StationError):
    """The vehicle's estimator has no state yet."""

    def __init__(self, vehicle_id: str) -> None:
        self.vehicle_id = vehicle_id
        super().__init__(f"no position of vehicle '{vehicle_id}' yet: GET /readyz says what the station waits for")


class NoPadError(StationError):
    """No landing pad is described."""

    def __init__(self) -> None:
        super().__init__("no landing pad is described: PUT its file to /api/v1/pad, or start with --pad PAD.json")


class NoPlanError(StationError):
    """No plan is kept for the vehicle."""

    def __init__(self, vehicle_id: str) -> None:
        self.vehicle_id = vehicle_id
        super().__init__(
            f"no plan is kept for vehicle '{vehicle_id}': PUT one to /api/v1/vehicles/{vehicle_id}/plan, or download "
            "the vehicle's"
        )


class PlanChangedError(StationError):
    """The kept plan is another than the request expects: ``etag`` is its own, None where none is kept."""

    def __init__(self, vehicle_id: str, etag: str | None) -> None:
        self.vehicle_id = vehicle_id
        self.etag = etag
        by_now = "none is kept" if etag is None else f'its ETag is "{etag}"'
        super().__init__(
            f"the plan of vehicle '{vehicle_id}' was changed elsewhere, {by_now} by now: fetch it again, then repeat "
            "the change"
        )


class PlanFileError(StationError):
    """A mission plan cannot be used: ``where`` in it, and ``reason``."""

    def __init__(self, where: str, reason: str) -> None:
        self.where = where
        self.reason = reason
        super().__init__(f"{where}: {reason}")


class NoGroundError(StationError):
    """The ray of a click meets no ground."""

    def __init__(self, u_px: float, v_px: float, reason: str) -> None:
        self.u_px = u_px
        self.v_px = v_px
        super().__init__(f"pixel ({u_px:.1f}, {v_px:.1f}) shows no known ground: {reason}")


class CannotFollowTargetError(StationError):
    """What a click shows, or a target is, cannot be followed."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(f"this cannot be followed: {reason}")


class AlignmentRefusedError(StationError):
    """An operator's alignment of a frame that cannot be meant, or comes too late."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(f"the alignment was not used: {reason}")


class TargetChangedError(StationError):
    """The target has another version than the request expects."""

    def __init__(self, target_id: str, version: int) -> None:
        self.target_id = target_id
        self.version = version
        super().__init__(f"target '{target_id}' has version {version} by now: fetch it again, then repeat the change")


class NoEvidenceError(StationError):
    """Nothing proves the coordinate that the target has."""

    def __init__(self, target_id: str, reason: str) -> None:
        self.target_id = target_id
        self.reason = reason
        super().__init__(f"no evidence for the coordinate of target '{target_id}': {reason}")


class BundleError(StationError):
    """Evidence that cannot be read or believed: ``name`` of the file and ``reason``."""

    def __init__(self, name: str, reason: str) -> None:
        self.name = name
        self.reason = reason
        super().__init__(f"{name}: {reason}")


class TargetNotKeptError(StationError):
    """The target or its evidence could not be written: neither is kept."""

    def __init__(self, reason: str) -> None:
        self.reason = reason
        super().__init__(
            f"the target was not kept, because the data folder cannot be written: {reason}; "
            "make room or mend the folder's rights, then click again"
        )


class ConflictError(StationError):
    """The request does not fit the present state of the station."""


class CommandRefusedError(StationError):
    """The vehicle cannot be given this command now."""


class InvalidRequestError(StationError):
    """A value that makes no sense."""


# The most specific class of an error's ancestry wins.
STATUS_OF_ERROR: dict[type[Exception], HTTPStatus] = {
    UnknownVehicleError: HTTPStatus.NOT_FOUND,
    UnknownSourceError: HTTPStatus.NOT_FOUND,
    UnknownTargetError: HTTPStatus.NOT_FOUND,
    UnknownFlightError: HTTPStatus.NOT_FOUND,
    UnknownReplayError: HTTPStatus.NOT_FOUND,
    MapNotFoundError: HTTPStatus.NOT_FOUND,
    LayerMissingError: HTTPStatus.NOT_FOUND,
    FrameGoneError: HTTPStatus.NOT_FOUND,
    NoStateForFrameError: HTTPStatus.CONFLICT,
    NoStateYetError: HTTPStatus.CONFLICT,
    NoPadError: HTTPStatus.NOT_FOUND,
    NoPlanError: HTTPStatus.NOT_FOUND,
    PlanFileError: HTTPStatus.UNPROCESSABLE_ENTITY,
    NoGroundError: HTTPStatus.UNPROCESSABLE_ENTITY,
    CannotFollowTargetError: HTTPStatus.UNPROCESSABLE_ENTITY,
    AlignmentRefusedError: HTTPStatus.UNPROCESSABLE_ENTITY,
    NoEvidenceError: HTTPStatus.NOT_FOUND,
    TargetNotKeptError: HTTPStatus.INSUFFICIENT_STORAGE,
    TargetChangedError: HTTPStatus.PRECONDITION_FAILED,
    PlanChangedError: HTTPStatus.PRECONDITION_FAILED,
    ConflictError: HTTPStatus.CONFLICT,
    CommandRefusedError: HTTPStatus.CONFLICT,
    InvalidRequestError: HTTPStatus.BAD_REQUEST,
    FlightFolderError: HTTPStatus.UNPROCESSABLE_ENTITY,
    PadFileError: HTTPStatus.UNPROCESSABLE_ENTITY,
    RasterError: HTTPStatus.UNPROCESSABLE_ENTITY,
    MapLibraryError: HTTPStatus.UNPROCESSABLE_ENTITY,
    StationError: HTTPStatus.INTERNAL_SERVER_ERROR,
}


def status_of(error: Exception) -> HTTPStatus:
    """The HTTP status of an error, by its most specific class in the table."""
    for ancestor in type(error).__mro__:
        if ancestor in STATUS_OF_ERROR:
            return STATUS_OF_ERROR[ancestor]
    return HTTPStatus.INTERNAL_SERVER_ERROR
