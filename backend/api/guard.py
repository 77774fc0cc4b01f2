"""Keeps web pages of other origins away from a station that, on loopback, asks for no login."""

from __future__ import annotations

import ipaddress
from urllib.parse import urlsplit

from starlette.types import ASGIApp, Receive, Scope, Send

from backend.api.problems import problem

SAFE_METHODS = frozenset({"GET", "HEAD", "OPTIONS"})
POLICY_VIOLATION = 1008


class OriginGuard:
    """Refuses hosts that are not this machine (DNS rebinding), foreign origins on sockets and on changing requests."""

    def __init__(self, app: ASGIApp, host: str) -> None:
        self._app = app
        self._host = host.lower()

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] in ("http", "websocket"):
            reason = self._objection(scope)
            if reason is not None:
                if scope["type"] == "websocket":
                    await receive()
                    await send({"type": "websocket.close", "code": POLICY_VIOLATION, "reason": reason})
                else:
                    await problem(403, reason)(scope, receive, send)
                return
        await self._app(scope, receive, send)

    def _objection(self, scope: Scope) -> str | None:
        headers = {name: value.decode("latin-1") for name, value in scope["headers"] if name in (b"host", b"origin")}
        host = headers.get(b"host", "")
        if not self._is_here(_name_of(host)):
            return f"this station does not answer to the name '{_name_of(host)}'"
        origin = headers.get(b"origin")
        is_socket = scope["type"] == "websocket"
        if origin and (is_socket or scope["method"] not in SAFE_METHODS) and urlsplit(origin).netloc != host:
            return f"a page of '{origin}' may not use this station"
        return None

    def _is_here(self, name: str) -> bool:
        if name in ("localhost", self._host):
            return True
        try:
            return ipaddress.ip_address(name).is_loopback
        except ValueError:
            return False


def _name_of(host: str) -> str:
    try:
        return urlsplit(f"//{host}").hostname or ""
    except ValueError:
        return ""
