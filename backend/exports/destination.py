"""Where Cursor on Target events go: ``udp://host:port``, a multicast group and an interface, ``tcp://host:port``."""

from __future__ import annotations

import ipaddress
import socket
import struct
from dataclasses import dataclass
from urllib.parse import parse_qsl, urlsplit

EXAMPLES = "udp://192.168.1.20:4242, udp://239.2.3.1:6969?interface=eth0 or tcp://192.168.1.20:8087"
# A group's packets stay in the local network.
_MULTICAST_TTL = 1


@dataclass(frozen=True, slots=True)
class Destination:
    """``interface`` is a local address or an interface's name, for a group only; None leaves it to routing."""

    text: str
    scheme: str
    host: str
    port: int
    interface: str | None = None

    @classmethod
    def parse(cls, text: str) -> Destination:
        """Read a URL. Raises ValueError that says what is wrong and what was expected."""
        try:
            url = urlsplit(text.strip())
            host, port = url.hostname, url.port
        except ValueError as error:
            raise ValueError(_wrong(text, str(error))) from None
        if url.scheme not in ("udp", "tcp"):
            raise ValueError(_wrong(text, f"unknown kind '{url.scheme}'"))
        if not host or not port:
            raise ValueError(_wrong(text, "a host and a port (1 to 65535) are needed"))
        if url.path not in ("", "/") or url.fragment or url.username is not None:
            raise ValueError(_wrong(text, "nothing but ?interface= may follow the port"))
        options = parse_qsl(url.query, keep_blank_values=True)
        unknown = [name for name, value in options if name != "interface" or not value]
        if unknown or len(options) > 1:
            raise ValueError(_wrong(text, "nothing but ?interface=NAME-OR-ADDRESS may follow the port"))
        found = cls(text.strip(), url.scheme, host, port, options[0][1] if options else None)
        if found.interface is not None and not found.is_multicast:
            raise ValueError(_wrong(text, "an interface can be chosen for a multicast group only"))
        if found.is_multicast and found.scheme == "tcp":
            raise ValueError(_wrong(text, "a multicast group cannot be reached by TCP"))
        return found

    @property
    def is_multicast(self) -> bool:
        """Whether the host is a group's address."""
        address = _address(self.host)
        return address is not None and address.is_multicast

    def check_interface(self) -> None:
        """Raise OSError, with words, when the interface is not this machine's."""
        if self.interface is not None:
            family = socket.AF_INET6 if ":" in self.host else socket.AF_INET
            with socket.socket(family, socket.SOCK_DGRAM) as trial:
                self.prepare(trial)

    def prepare(self, sock: socket.socket) -> None:
        """Set a UDP socket's options; OSError when the interface is not this machine's."""
        if not self.is_multicast:
            return
        index, local = 0, "0.0.0.0"  # noqa: S104 - whichever interface routing takes
        if self.interface is not None and _address(self.interface) is None:
            try:
                index = socket.if_nametoindex(self.interface)
            except OSError:
                names = ", ".join(name for _, name in socket.if_nameindex())
                message = f"no interface '{self.interface}' on this machine (it has {names})"
                raise OSError(message) from None
        elif self.interface is not None:
            local = self.interface
        if sock.family == socket.AF_INET6:
            if local != "0.0.0.0":  # noqa: S104
                message = f"an IPv6 group needs the interface's name, not the address {local}"
                raise OSError(message)
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_HOPS, _MULTICAST_TTL)
            sock.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_MULTICAST_IF, index)
            return
        sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL, _MULTICAST_TTL)
        try:
            # struct ip_mreqn: group, local address, index of the interface
            chosen = struct.pack("@4s4si", bytes(4), socket.inet_aton(local), index)
            sock.setsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, chosen)
        except OSError as error:
            message = f"no interface with the address {local} on this machine ({error.strerror or error})"
            raise OSError(message) from None


def _address(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(text)
    except ValueError:
        return None


def _wrong(text: str, reason: str) -> str:
    return f"'{text}': {reason}; expected something like {EXAMPLES}"
