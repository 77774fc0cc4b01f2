"""Asks a running station to keep GPS from its estimator while a flight that is played into it was without."""

from __future__ import annotations

import http.client
import json
import threading
from collections.abc import Sequence
from urllib.parse import urlsplit

from backend.errors import StationError
from geodata.flight import FlightFolder

GROUND_STATION_IDS = frozenset({0, 255})
_HEARTBEAT = 0
_TIMEOUT_S = 5.0
_AGAIN_S = 0.2
_LAST_TRIES_S = 3.0


class StationDenial:
    """Tells one station, over REST, about one vehicle. A thread asks, so that the playing is never held up.

    It asks until it is obeyed: the station knows the vehicle only when it has heard it. ``problem`` says what the last
    answer was while it is not.
    """

    def __init__(self, address: str, vehicle_id: str) -> None:
        parts = urlsplit(address)
        try:
            port = parts.port or 80
        except ValueError:
            port = 0
        if parts.scheme != "http" or not parts.hostname or not port:
            raise StationError(f"--station: '{address}' is not http://HOST:PORT")
        self._host, self._port = parts.hostname, port
        self._address = address.rstrip("/")
        self._path = f"/api/v1/vehicles/{vehicle_id}/navigation"
        self.problem: str | None = None
        self._wanted = self._obeyed = False
        self._closing = False
        self._changed = threading.Condition()
        self._thread = threading.Thread(target=self._run, name="gps-denial", daemon=True)

    def start(self) -> None:
        """Begin; StationError where no station answers."""
        try:
            status, _ = self._request("GET", "/healthz", None)
        except OSError as error:
            raise StationError(self._words(f"no station answers ({error.strerror or error})")) from None
        if status != http.client.OK:
            raise StationError(self._words(f"what answers is no station (status {status})"))
        self._thread.start()

    def want(self, denied: bool) -> None:
        """Have GPS denied from now on, or no longer."""
        with self._changed:
            self._wanted = denied
            self._changed.notify()

    def close(self) -> None:
        """Give GPS back where it was denied, with a few tries."""
        with self._changed:
            self._wanted = False
            self._closing = True
            self._changed.notify()
        if self._thread.is_alive():
            self._thread.join(_LAST_TRIES_S + 2 * _TIMEOUT_S)

    def _run(self) -> None:
        last_tries = round(_LAST_TRIES_S / _AGAIN_S)
        while True:
            with self._changed:
                while self._wanted == self._obeyed and not self._closing:
                    self._changed.wait()
                if self._wanted == self._obeyed:
                    return
                wanted = self._wanted
            self.problem = self._ask(wanted)
            with self._changed:
                if self.problem is None:
                    self._obeyed = wanted
                    continue
                last_tries -= self._closing
                if last_tries <= 0:
                    return
                self._changed.wait(_AGAIN_S)

    def _ask(self, denied: bool) -> str | None:
        """Ask once; None where it was obeyed, else what was answered."""
        try:
            status, said = self._request("POST", self._path, {"gps_denied": denied})
        except (OSError, http.client.HTTPException) as error:
            return f"{self._address} does not answer: {error}"
        return None if status == http.client.OK else f"{self._address} answered {status}: {said[:200]}"

    def _request(self, method: str, path: str, body: dict[str, bool] | None) -> tuple[int, str]:
        connection = http.client.HTTPConnection(self._host, self._port, timeout=_TIMEOUT_S)
        try:
            content = None if body is None else json.dumps(body)
            connection.request(method, path, content, {"Content-Type": "application/json"})
            answer = connection.getresponse()
            return answer.status, answer.read(4096).decode("utf-8", "replace")
        finally:
            connection.close()

    def _words(self, what: str) -> str:
        return (
            f"the flight has times without GPS, and at {self._address} {what}: say where the station's page is with "
            "--station http://HOST:PORT, or --station none to leave it its GPS"
        )


def denied_spans(folder: FlightFolder) -> list[tuple[int, int]]:
    """The flight's ``gps_denied`` in order, those that touch joined."""
    spans: list[tuple[int, int]] = []
    for start_us, end_us in sorted(folder.meta.gps_denied):
        if spans and start_us <= spans[-1][1]:
            spans[-1] = (spans[-1][0], max(spans[-1][1], end_us))
        else:
            spans.append((start_us, end_us))
    return spans


def vehicle_id_of(folder: FlightFolder) -> str:
    """Under which id a station will know the flight's vehicle: the one that is named, else the first that is heard."""
    if folder.meta.vehicle.system_id is not None:
        return str(folder.meta.vehicle.system_id)
    for _, packet in folder.telemetry():
        sender, message = sender_and_message(packet)
        if message == _HEARTBEAT and sender not in GROUND_STATION_IDS:
            return str(sender)
    raise StationError(f"{folder.path}: no vehicle is heard in its telemetry")


def sender_and_message(packet: Sequence[int]) -> tuple[int, int]:
    """System id and the lowest byte of the message id of a framed MAVLink packet, version 1 or 2."""
    return (packet[5], packet[7]) if packet[0] == 0xFD else (packet[3], packet[5])
