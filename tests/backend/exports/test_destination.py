"""Destinations of CoT events: what is read, what is refused, and in which words."""

from __future__ import annotations

import socket

import pytest

from backend.exports.destination import Destination


@pytest.mark.parametrize(
    ("text", "expected"),
    [
        ("udp://10.0.0.7:4242", ("udp", "10.0.0.7", 4242, None, False)),
        (" udp://239.2.3.1:6969 ", ("udp", "239.2.3.1", 6969, None, True)),
        ("udp://239.2.3.1:6969?interface=eth0", ("udp", "239.2.3.1", 6969, "eth0", True)),
        ("udp://239.2.3.1:6969/?interface=192.168.1.5", ("udp", "239.2.3.1", 6969, "192.168.1.5", True)),
        ("tcp://tak.example:8087", ("tcp", "tak.example", 8087, None, False)),
        ("TCP://[::1]:8087", ("tcp", "::1", 8087, None, False)),
        ("udp://[ff02::1]:6969?interface=lo", ("udp", "ff02::1", 6969, "lo", True)),
    ],
)
def test_destinations_are_read(text: str, expected: tuple[object, ...]) -> None:
    found = Destination.parse(text)

    assert (found.scheme, found.host, found.port, found.interface, found.is_multicast) == expected


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("239.2.3.1:6969", "unknown kind"), ("", "unknown kind"), ("tls://h:8089", "unknown kind 'tls'"),
        ("udp://10.0.0.7", "a host and a port"), ("udp://:6969", "a host and a port"),
        ("udp://h:0", "a host and a port"), ("udp://h:65536", "[Pp]ort"), ("udp://h:six", "[Pp]ort"),
        ("tcp://[::1:8087", "IPv6"), ("tcp://h:1/path", "nothing but"), ("tcp://me@h:1", "nothing but"),
        ("udp://239.2.3.1:6969?ttl=9", "nothing but"), ("udp://239.2.3.1:6969?interface=", "nothing but"),
        ("udp://10.0.0.7:1?interface=eth0", "multicast group only"), ("tcp://239.2.3.1:1", "by TCP"),
    ],
)  # fmt: skip
def test_what_is_wrong_is_said_with_an_example(text: str, words: str) -> None:
    with pytest.raises(ValueError, match=rf"(?s){words}.*udp://239\.2\.3\.1:6969") as caught:
        Destination.parse(text)
    assert f"'{text}'" in str(caught.value)


def test_a_missing_interface_is_named_with_those_there_are() -> None:
    with pytest.raises(OSError, match=r"no interface 'wlan99' .*\blo\b"):
        Destination.parse("udp://239.2.3.1:6969?interface=wlan99").check_interface()
    with pytest.raises(OSError, match=r"203\.0\.113\.9"):
        Destination.parse("udp://239.2.3.1:6969?interface=203.0.113.9").check_interface()
    Destination.parse("udp://239.2.3.1:6969?interface=lo").check_interface()
    Destination.parse("udp://10.0.0.7:1").check_interface()


def test_a_groups_packets_stay_in_the_local_network() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as sock:
        Destination.parse("udp://239.2.3.1:6969?interface=127.0.0.1").prepare(sock)

        assert sock.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_TTL) == 1
        chosen = sock.getsockopt(socket.IPPROTO_IP, socket.IP_MULTICAST_IF, 4)
        assert socket.inet_ntoa(chosen) == "127.0.0.1"
