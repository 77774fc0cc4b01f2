"""Calibrations are data: every selectable channel has one, and what is wrong in a file is said."""

import pytest

from estimator.errors import CalibrationError
from estimator.registration.alignment import COMPARED
from estimator.registration.calibration import calibration_of, parse_calibration, toml_of


@pytest.mark.parametrize("channel", COMPARED)
def test_every_channel_of_the_matcher_has_a_calibration(channel: str) -> None:
    calibration = calibration_of(channel)

    assert calibration.channel == channel
    assert calibration.version.startswith(f"{channel}/")
    assert calibration.fitted_on["command"]


def test_written_text_is_read_back_the_same() -> None:
    calibration = calibration_of("mind")

    assert parse_calibration(toml_of(calibration), "again") == calibration


@pytest.mark.parametrize(
    ("old", "new", "said"),
    [
        ("temperature = ", "temperature = -", "temperature is -.*must lie between"),
        ("temperature = ", "temprature = ", "temperature must be a finite number, not None"),
        ("floor = ", "floor = true # ", "floor must be a finite number, not True"),
        ("map_std_m = ", "map_std_m = nan # ", "map_std_m must be a finite number, not nan"),
        ("[outlier]", "[outlier]\nluck = 1.0", "has no 'luck'"),
        ("[outlier]", "[other]", r"section \[outlier\] is missing"),
        ("version = ", "version = 3 # ", "version must be a text"),
        ("likelihood/1", "likelihood/9", "this version reads 'pilotage.likelihood/1'"),
        ("[likelihood]", "[likelihood", "is not TOML"),
    ],
)
def test_what_is_wrong_is_named_with_its_file(old: str, new: str, said: str) -> None:
    text = toml_of(calibration_of("double_angle"))
    assert old in text

    with pytest.raises(CalibrationError, match=said) as caught:
        parse_calibration(text.replace(old, new, 1), "mine.toml")

    assert caught.value.source == "mine.toml"
    assert "mine.toml" in str(caught.value)


def test_a_channel_without_calibration_is_an_error() -> None:
    with pytest.raises(CalibrationError, match="fit-likelihood"):
        calibration_of("smell")
