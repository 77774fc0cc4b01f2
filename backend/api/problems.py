"""Every error as an RFC 9457 problem."""

from __future__ import annotations

from http import HTTPStatus

import structlog
from fastapi import FastAPI, Request
from fastapi.exceptions import RequestValidationError
from fastapi.responses import JSONResponse
from pydantic import BaseModel
from starlette.exceptions import HTTPException

from backend.errors import StationError, status_of
from backend.video.errors import VideoError
from geodata.errors import GeodataError

_log = structlog.get_logger(__name__)


class Problem(BaseModel):
    """RFC 9457 problem details; ``type`` is the error's class as an anchor."""

    type: str
    title: str
    status: int
    detail: str
    errors: list[dict[str, object]] | None = None


class ProblemResponse(JSONResponse):
    """A problem in its own media type."""

    media_type = "application/problem+json"


PROBLEM_RESPONSES: dict[int | str, dict[str, object]] = {
    "default": {
        "description": "A problem (RFC 9457)",
        "content": {"application/problem+json": {"schema": Problem.model_json_schema()}},
    }
}


def problem(
    status: int, detail: str, kind: str = "about:blank", *,
    errors: list[dict[str, object]] | None = None, headers: dict[str, str] | None = None,
) -> ProblemResponse:  # fmt: skip
    """One problem as a response."""
    body = Problem(type=kind, title=HTTPStatus(status).phrase, status=status, detail=detail, errors=errors)
    return ProblemResponse(body.model_dump(exclude_none=True), status_code=status, headers=headers)


def add_problem_handlers(app: FastAPI) -> None:
    """Turn all errors of an application into problems."""

    async def known(_request: Request, error: Exception) -> ProblemResponse:
        name = type(error).__name__.removesuffix("Error")
        return problem(status_of(error), str(error), f"/problems#{name}")

    async def invalid(_request: Request, error: Exception) -> ProblemResponse:
        found = error.errors() if isinstance(error, RequestValidationError) else []
        errors: list[dict[str, object]] = [
            {"pointer": "/".join(str(part) for part in item["loc"]), "detail": item["msg"]} for item in found
        ]
        detail = "; ".join(f"{item['pointer']}: {item['detail']}" for item in errors) or "the request cannot be read"
        return problem(HTTPStatus.UNPROCESSABLE_ENTITY, detail, "/problems#InvalidRequest", errors=errors)

    async def http(_request: Request, error: Exception) -> ProblemResponse:
        if not isinstance(error, HTTPException):
            return problem(HTTPStatus.INTERNAL_SERVER_ERROR, str(error))
        return problem(error.status_code, str(error.detail), headers=dict(error.headers) if error.headers else None)

    async def unexpected(request: Request, error: Exception) -> ProblemResponse:
        _log.error("request failed", path=request.url.path, exc_info=error)
        detail = "the station failed to answer this request; its log has the details, everything else goes on"
        return problem(HTTPStatus.INTERNAL_SERVER_ERROR, detail, "/problems#Internal")

    for kind in (StationError, GeodataError, VideoError):
        app.add_exception_handler(kind, known)
    app.add_exception_handler(RequestValidationError, invalid)
    app.add_exception_handler(HTTPException, http)
    app.add_exception_handler(Exception, unexpected)
