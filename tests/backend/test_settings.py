"""Settings: precedence, and errors in words."""

from pathlib import Path

import pytest

from backend.errors import StartError
from backend.settings import is_loopback, load_settings


def test_options_win_over_environment_over_file(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    config = tmp_path / "station.toml"
    config.write_text('port = 1\nvideo = "file:a.mp4"\nmavlink = ["tcp:10.0.0.1:5760"]\nestimator_delay_ms = 99\n')
    monkeypatch.setenv("PILOTAGE_PORT", "2")
    monkeypatch.setenv("PILOTAGE_VIDEO", "udp://0.0.0.0:5601")

    settings = load_settings(config, port=3)

    assert settings.port == 3
    assert settings.video == "udp://0.0.0.0:5601"
    assert settings.mavlink == ("tcp:10.0.0.1:5760",)
    assert settings.estimator_delay_ms == 99


def test_environment_lists_are_separated_by_commas(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PILOTAGE_MAVLINK", "udpin:0.0.0.0:14550, serial:/dev/ttyUSB0:57600")

    assert load_settings().mavlink == ("udpin:0.0.0.0:14550", "serial:/dev/ttyUSB0:57600")


def test_none_switches_links_and_video_off() -> None:
    settings = load_settings(mavlink=("none",), video="none")

    assert settings.mavlink == ()
    assert settings.video is None


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("port = 99999", "port"),
        ("colour = 1", "colour"),
        ("port = ", "not valid TOML"),
        ('time_offset_s = "soon"', "time_offset_s"),
        ('cot = ["udp://239.2.3.1:6969", "tls://tak.example:8089"]', "cot: .*'tls://tak.example:8089': unknown kind"),
    ],
)
def test_a_wrong_file_is_named_with_what_is_wrong(tmp_path: Path, text: str, words: str) -> None:
    config = tmp_path / "station.toml"
    config.write_text(text)

    with pytest.raises(StartError, match=words):
        load_settings(config)


def test_receivers_of_targets_are_none_unless_given(monkeypatch: pytest.MonkeyPatch) -> None:
    assert load_settings().cot == ()
    monkeypatch.setenv("PILOTAGE_COT", "udp://239.2.3.1:6969?interface=eth0, tcp://10.0.0.7:8087")
    assert load_settings().cot == ("udp://239.2.3.1:6969?interface=eth0", "tcp://10.0.0.7:8087")


def test_a_missing_file_is_named(tmp_path: Path) -> None:
    with pytest.raises(StartError, match=r"nowhere\.toml"):
        load_settings(tmp_path / "nowhere.toml")


@pytest.mark.parametrize(
    ("host", "expected"),
    [("127.0.0.1", True), ("::1", True), ("localhost", True), ("0.0.0.0", False), ("::", False)],  # noqa: S104
)
def test_loopback(host: str, expected: bool) -> None:
    assert is_loopback(host) is expected


def test_an_unknown_host_is_named() -> None:
    with pytest.raises(StartError, match=r"no-such-host\.invalid"):
        is_loopback("no-such-host.invalid")
