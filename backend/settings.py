"""What the station is told: options, then environment (``PILOTAGE_*``), then a TOML file, then defaults."""

from __future__ import annotations

import ipaddress
import os
import socket
import tomllib
from pathlib import Path
from typing import Annotated, Any

from pydantic import BaseModel, Field, ValidationError, field_validator
from pydantic_settings import BaseSettings, NoDecode, PydanticBaseSettingsSource, SettingsConfigDict

from backend.errors import StartError
from backend.exports.destination import Destination
from guidance.landing import LandingConfig

DEFAULT_PORT = 8700


def default_data_dir() -> Path:
    """Where targets, maps and flights live when nobody says otherwise."""
    base = os.environ.get("XDG_DATA_HOME")
    return (Path(base) if base else Path.home() / ".local" / "share") / "pilotage"


class Settings(BaseSettings):
    """Everything that can be set, with its default. Unknown names in the TOML file are errors."""

    model_config = SettingsConfigDict(env_prefix="PILOTAGE_", extra="forbid", frozen=True)

    host: str = "127.0.0.1"
    port: int = Field(default=DEFAULT_PORT, ge=0, le=65535)
    data_dir: Path = Field(default_factory=default_data_dir)
    mavlink: Annotated[tuple[str, ...], NoDecode] = ("udpin:0.0.0.0:14550",)
    video: str | None = "udp://0.0.0.0:5600"
    map: str | None = None
    camera: Path | None = None
    pad: Path | None = None
    gear_height_m: float = Field(default=LandingConfig().gear_m, ge=0, le=10)
    time_offset_s: float | None = Field(default=None, ge=-10, le=10)
    flights: Annotated[tuple[Path, ...], NoDecode] = ()
    cot: Annotated[tuple[str, ...], NoDecode] = ()
    record: bool = False
    console_dir: Path | None = None
    estimator_delay_ms: int = Field(default=250, ge=0, le=2000)
    disk_low_bytes: int = Field(default=2_000_000_000, ge=0)

    @field_validator("mavlink", "flights", "cot", mode="before")
    @classmethod
    def _split_commas(cls, value: object) -> object:
        # An environment variable is one string; connection strings hold no comma.
        parts = value.split(",") if isinstance(value, str) else value
        if not isinstance(parts, list | tuple):
            return parts
        stripped = (part.strip() if isinstance(part, str) else part for part in parts)
        return tuple(part for part in stripped if part not in ("", "none"))

    @field_validator("cot")
    @classmethod
    def _check_destinations(cls, value: tuple[str, ...]) -> tuple[str, ...]:
        for text in value:
            Destination.parse(text)
        return value

    @field_validator("video", mode="before")
    @classmethod
    def _none_means_no_video(cls, value: object) -> object:
        return None if value in ("", "none") else value


class _TomlSource(PydanticBaseSettingsSource):
    """Values of an already parsed TOML file."""

    def __init__(self, settings_class: type[BaseSettings], values: dict[str, Any]) -> None:
        super().__init__(settings_class)
        self._values = values

    def get_field_value(self, field: Any, field_name: str) -> tuple[Any, str, bool]:
        """Unused: all values come at once from ``__call__``."""
        del field
        return self._values.get(field_name), field_name, False

    def __call__(self) -> dict[str, Any]:
        """All values of the file."""
        return self._values


def load_settings(config: Path | None = None, **options: Any) -> Settings:
    """The settings from options (those that are not None), environment and the TOML file.

    Raises
    ------
    StartError
        A file that cannot be read or a value that makes no sense, with its name.
    """
    values = _read_toml(config) if config else {}

    class Layered(Settings):
        @classmethod
        def settings_customise_sources(
            cls,
            settings_cls: type[BaseSettings],
            init_settings: PydanticBaseSettingsSource,
            env_settings: PydanticBaseSettingsSource,
            dotenv_settings: PydanticBaseSettingsSource,
            file_secret_settings: PydanticBaseSettingsSource,
        ) -> tuple[PydanticBaseSettingsSource, ...]:
            del dotenv_settings, file_secret_settings
            return init_settings, env_settings, _TomlSource(settings_cls, values)

    given = {name: value for name, value in options.items() if value is not None}
    try:
        return Layered(**given)
    except ValidationError as error:
        raise StartError(f"settings: {describe_validation(error)}") from None


def describe_validation(error: ValidationError) -> str:
    """A validation error in one line: where, what is wrong, what was given."""
    parts = []
    for item in error.errors():
        where = ".".join(str(part) for part in item["loc"]) or "value"
        given = f" (given: {item['input']!r})" if not isinstance(item["input"], dict | BaseModel) else ""
        parts.append(f"{where}: {item['msg']}{given}")
    return "; ".join(parts)


def is_loopback(host: str) -> bool:
    """Whether binding to a host reaches this machine only; every address a name resolves to must be loopback."""
    try:
        return ipaddress.ip_address(host).is_loopback
    except ValueError:
        pass
    try:
        found = socket.getaddrinfo(host, None)
    except OSError as error:
        raise StartError(f"host '{host}' cannot be resolved: {error.strerror or error}") from None
    return bool(found) and all(ipaddress.ip_address(item[4][0]).is_loopback for item in found)


def _read_toml(path: Path) -> dict[str, Any]:
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise StartError(f"configuration file '{path}' cannot be read: {error.strerror or error}") from None
    except (tomllib.TOMLDecodeError, UnicodeDecodeError) as error:
        raise StartError(f"configuration file '{path}' is not valid TOML: {error}") from None
