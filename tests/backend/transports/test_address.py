import pytest

from backend.transports.address import Connection
from backend.transports.base import TransportError


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("udpin:0.0.0.0:14550", ("0.0.0.0", 14550)),  # noqa: S104
        ("udpin://0.0.0.0:14550", ("0.0.0.0", 14550)),  # noqa: S104
        ("udpin::14550", ("any", 14550)),
        ("udpin://:14550/", ("any", 14550)),
        ("tcp:[::1]:5760", ("::1", 5760)),
        (" TCP:vehicle.local:5760 ", ("vehicle.local", 5760)),
    ],
)
def test_hosts_and_ports(text: str, expected: tuple[str, int]) -> None:
    assert Connection.parse(text).host_and_port("any") == expected


@pytest.mark.parametrize(
    "text", ["udpin:host", "udpin:host:", "udpin:host:x", "udpin:host:70000", "udpin:host:-1", "x:"]
)
def test_bad_ports_are_told_with_an_example(text: str) -> None:
    with pytest.raises(TransportError, match=r"such as|expected") as caught:
        Connection.parse(text).host_and_port("any")
    assert text in str(caught.value)


def test_a_host_is_needed_where_none_is_implied() -> None:
    with pytest.raises(TransportError, match="a host and a port"):
        Connection.parse("udpout::14550").host_and_port()


@pytest.mark.parametrize("text", ["", "14550", ":14550", "   "])
def test_no_scheme(text: str) -> None:
    with pytest.raises(TransportError, match="udpin:"):
        Connection.parse(text)


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("serial:/dev/ttyUSB0:115200", ("/dev/ttyUSB0", 115_200)),
        ("serial:///dev/ttyUSB0:115200", ("/dev/ttyUSB0", 115_200)),
        ("serial:/dev/ttyACM0", ("/dev/ttyACM0", 57_600)),
        ("serial:COM3:57600", ("COM3", 57_600)),
    ],
)
def test_devices_and_rates(text: str, expected: tuple[str, int]) -> None:
    assert Connection.parse(text).device_and_baud() == expected


@pytest.mark.parametrize("text", ["serial:", "serial:/dev/x:fast", "serial:/dev/x:0"])
def test_bad_devices(text: str) -> None:
    with pytest.raises(TransportError, match=r"serial:/dev"):
        Connection.parse(text).device_and_baud()
