"""Connection strings, as operators of pymavlink and MAVSDK write them."""

from __future__ import annotations

from dataclasses import dataclass

from backend.transports.base import TransportError

_LARGEST_PORT = 65_535
DEFAULT_BAUD = 57_600
_LARGEST_BAUD = 12_000_000


@dataclass(frozen=True, slots=True)
class Connection:
    """``scheme`` and what follows it, without the two slashes of the URL form."""

    text: str
    scheme: str
    rest: str

    @classmethod
    def parse(cls, text: str) -> Connection:
        """``scheme:rest`` or ``scheme://rest``. Raises TransportError without a scheme."""
        scheme, colon, rest = text.strip().partition(":")
        if not colon or not scheme:
            raise TransportError(text, "expected a scheme and an address, such as udpin:0.0.0.0:14550")
        return cls(text, scheme.lower(), rest.removeprefix("//"))

    def host_and_port(self, default_host: str | None = None) -> tuple[str, int]:
        """``host:port``, ``[v6]:port``, or ``:port`` where there is a default host."""
        host, colon, port_text = self.rest.rstrip("/").rpartition(":")
        host = host.removeprefix("[").removesuffix("]") or (default_host or "")
        example = f"{self.scheme}:{default_host or '127.0.0.1'}:14550"
        if not colon or not host:
            raise TransportError(self.text, f"expected a host and a port, such as {example}")
        if not port_text.isascii() or not port_text.isdigit() or not 0 <= int(port_text) <= _LARGEST_PORT:
            raise TransportError(self.text, f"'{port_text}' is not a port (0 to {_LARGEST_PORT}), expected {example}")
        return host, int(port_text)

    def device_and_baud(self) -> tuple[str, int]:
        """``/dev/x:57600``; without a rate it is 57600, the telemetry radios'."""
        device, colon, baud_text = self.rest.rpartition(":")
        if not colon:
            device, baud_text = self.rest, str(DEFAULT_BAUD)
        if not device:
            raise TransportError(self.text, "expected a device, such as serial:/dev/ttyUSB0:57600")
        if not baud_text.isascii() or not baud_text.isdigit() or not 0 < int(baud_text) <= _LARGEST_BAUD:
            raise TransportError(self.text, f"'{baud_text}' is not a baud rate, expected serial:{device}:57600")
        return device, int(baud_text)
