import pytest

from backend.transports import TRANSPORTS, TransportError, create_transport
from backend.transports.serial_port import SerialTransport
from backend.transports.tcp import TcpClientTransport, TcpServerTransport
from backend.transports.udp import UdpInTransport, UdpOutTransport


@pytest.mark.parametrize(
    ("text", "kind"),
    [
        ("udpin:0.0.0.0:14550", UdpInTransport),
        ("udp://:14540", UdpInTransport),
        ("udpin://0.0.0.0:14550", UdpInTransport),
        ("udpout:127.0.0.1:14550", UdpOutTransport),
        ("tcp:127.0.0.1:5760", TcpClientTransport),
        ("tcpout://127.0.0.1:5760", TcpClientTransport),
        ("tcpin::5760", TcpServerTransport),
        ("serial:/dev/ttyUSB0:57600", SerialTransport),
    ],
)
def test_each_scheme_makes_its_transport(text: str, kind: type) -> None:
    transport = create_transport(text)

    assert isinstance(transport, kind)
    assert transport.status.endswith("not open")


def test_an_unknown_scheme_names_the_known_ones() -> None:
    with pytest.raises(TransportError) as caught:
        create_transport("carrier-pigeon:loft:1")

    assert all(scheme in str(caught.value) for scheme in TRANSPORTS)
