"""Calibrations of the matcher as data: one versioned file for each measure of similarity, refitted by a command.

Beside this module, in ``calibrations/``, are those that ``pilotage fit-likelihood`` wrote
(docs/howto/refit-the-likelihood.md).
"""

from __future__ import annotations

import math
import tomllib
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from estimator.errors import CalibrationError
from estimator.registration.likelihood import LikelihoodCalibration
from estimator.registration.verify import FEATURES, OutlierWeights

SCHEMA = "pilotage.likelihood/1"
_LIKELIHOOD = {
    "temperature": (1e-6, 1e3),
    "power": (-2.0, 2.0),
    "map_std_m": (0.0, 100.0),
    "map_std_px": (0.0, 100.0),
    "floor": (1e-6, 0.5),
    "doubt": (0.0, 1.0),
}


@dataclass(frozen=True, slots=True)
class Calibration:
    """What a matcher of one ``channel`` believes of its surfaces; ``version`` goes into results.

    ``fitted_on`` says what the numbers were found on: command, seeds, worlds, samples, as far as it applies.
    """

    version: str
    channel: str
    fitted_on: Mapping[str, str | int]
    likelihood: LikelihoodCalibration
    outlier: OutlierWeights


@cache
def calibration_of(channel: str) -> Calibration:
    """The calibration that comes with the package for a channel.

    Raises
    ------
    CalibrationError
        There is none for this channel.
    """
    folder = files("estimator.registration") / "calibrations"
    file = folder / f"{channel}.toml"
    if not file.is_file():
        raise CalibrationError(channel, "no calibration of this channel; 'pilotage fit-likelihood' makes one")
    return parse_calibration(file.read_text(encoding="utf-8"), f"{channel}.toml")


def parse_calibration(text: str, source: str) -> Calibration:
    """A calibration from its TOML text; ``source`` names it in errors.

    Raises
    ------
    CalibrationError
        Not TOML, not of this schema, or a number that is missing, unknown or out of its range.
    """
    try:
        data = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise CalibrationError(source, f"is not TOML ({error})") from error
    if data.get("schema") != SCHEMA:
        raise CalibrationError(source, f"schema is {data.get('schema')!r}; this version reads {SCHEMA!r}")
    version, channel = (_text(data, name, source) for name in ("version", "channel"))
    section = _section(data, "likelihood", source)
    numbers = {name: _number(section, name, source, *limits) for name, limits in _LIKELIHOOD.items()}
    likelihood = LikelihoodCalibration(
        numbers["temperature"], numbers["power"], numbers["map_std_m"], numbers["map_std_px"], numbers["floor"],
        numbers["doubt"],
    )  # fmt: skip
    _no_others(section, "likelihood", tuple(_LIKELIHOOD), source)
    outlier = _section(data, "outlier", source)
    _no_others(outlier, "outlier", ("bias", *FEATURES), source)
    weights = OutlierWeights(
        _number(outlier, "bias", source), tuple(_number(outlier, name, source) for name in FEATURES)
    )
    fitted = {str(k): v if isinstance(v, int) else str(v) for k, v in _section(data, "fitted_on", source).items()}
    return Calibration(version, channel, fitted, likelihood, weights)


def toml_of(calibration: Calibration) -> str:
    """The TOML text that ``parse_calibration`` reads."""
    c = calibration
    lines = [f'schema = "{SCHEMA}"', f'version = "{c.version}"', f'channel = "{c.channel}"', "", "[fitted_on]"]
    lines += [f"{k} = {v}" if isinstance(v, int) else f'{k} = "{v}"' for k, v in c.fitted_on.items()]
    lines += ["", "[likelihood]", *(f"{name} = {float(getattr(c.likelihood, name)):.5g}" for name in _LIKELIHOOD)]
    lines += ["", "[outlier]", f"bias = {float(c.outlier.bias):.5g}"]
    lines += [f"{name} = {float(w):.5g}" for name, w in zip(FEATURES, c.outlier.weights, strict=True)]
    return "\n".join(lines) + "\n"


def _text(data: Mapping[str, Any], name: str, source: str) -> str:
    value = data.get(name)
    if not isinstance(value, str) or not value:
        raise CalibrationError(source, f"{name} must be a text that is not empty")
    return value


def _section(data: Mapping[str, Any], name: str, source: str) -> Mapping[str, Any]:
    value = data.get(name)
    if not isinstance(value, Mapping):
        raise CalibrationError(source, f"section [{name}] is missing")
    return value


def _number(
    section: Mapping[str, Any], name: str, source: str, least: float = -math.inf, most: float = math.inf
) -> float:
    value = section.get(name)
    if isinstance(value, bool) or not isinstance(value, int | float) or not math.isfinite(value):
        raise CalibrationError(source, f"{name} must be a finite number, not {value!r}")
    if not least <= value <= most:
        raise CalibrationError(source, f"{name} is {value:g}; it must lie between {least:g} and {most:g}")
    return float(value)


def _no_others(section: Mapping[str, Any], title: str, known: tuple[str, ...], source: str) -> None:
    others = sorted(set(section) - set(known))
    if others:
        raise CalibrationError(source, f"[{title}] has no {others[0]!r}; known: {', '.join(known)}")
