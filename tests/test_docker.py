"""Checks the container files where no engine runs: what they say has to agree with the code and the README."""

from __future__ import annotations

import json
import re
import shlex
import tomllib
from dataclasses import dataclass
from pathlib import Path
from typing import Any
from urllib.parse import urlsplit

import pytest
import typer.main
import yaml

from backend.api import health
from backend.cli import build_app
from backend.settings import Settings

ROOT = Path(__file__).resolve().parents[1]
DOCKERFILE = (ROOT / "docker" / "Dockerfile").read_text(encoding="utf-8")
COMPOSE: dict[str, Any] = yaml.safe_load((ROOT / "docker" / "compose.yaml").read_text(encoding="utf-8"))
SERVICES: dict[str, dict[str, Any]] = COMPOSE["services"]
VERSION = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]["version"]

START = ["pilotage", "serve"]
KEYWORDS = {
    "ARG", "CMD", "COPY", "ENTRYPOINT", "ENV", "EXPOSE", "FROM", "HEALTHCHECK", "LABEL", "RUN", "STOPSIGNAL", "USER",
    "VOLUME", "WORKDIR",
}  # fmt: skip
SERVICE_KEYS = {
    "build", "cap_drop", "command", "depends_on", "environment", "healthcheck", "image", "init", "network_mode",
    "profiles", "read_only", "restart", "security_opt", "stop_grace_period", "tmpfs", "volumes",
}  # fmt: skip
CONDITIONS = {"service_started", "service_healthy", "service_completed_successfully"}


@dataclass(frozen=True)
class Instruction:
    keyword: str
    text: str

    @property
    def words(self) -> list[str]:
        """The arguments without flags."""
        return [word for word in self.text.split() if not word.startswith("--")]

    def flag(self, name: str) -> str | None:
        found = re.search(rf"--{name}=(\S+)", self.text)
        return found.group(1) if found else None


def instructions(dockerfile: str) -> list[Instruction]:
    lines = [line for line in dockerfile.splitlines() if line.strip() and not line.lstrip().startswith("#")]
    joined = re.sub(r"\\\n\s*", " ", "\n".join(lines))
    split = [line.strip().partition(" ") for line in joined.splitlines()]
    return [Instruction(keyword, text.strip()) for keyword, _, text in split]


def stages(dockerfile: str) -> list[list[Instruction]]:
    found: list[list[Instruction]] = []
    for instruction in instructions(dockerfile):
        if instruction.keyword == "FROM":
            found.append([])
        found[-1].append(instruction)
    return found


def unpinned(image: str) -> bool:
    """Whether an image's name leaves open which one it is."""
    name, _, digest = image.partition("@")
    tag = name.rpartition("/")[2].partition(":")[2]
    return not digest and (not tag or tag.startswith("latest") or not re.search(r"\d+\.\d+", tag))


def faults(dockerfile: str) -> list[str]:
    """What is wrong with a Dockerfile, in words."""
    found = []
    names: list[str] = []
    for stage in stages(dockerfile):
        image, *alias = stage[0].words
        if image not in names and unpinned(image):
            found.append(f"{image} is not pinned")
        for instruction in stage:
            if instruction.keyword not in KEYWORDS:
                found.append(f"unknown or unwanted instruction {instruction.keyword}")
            source = instruction.flag("from")
            if source is not None and source not in names:
                found.append(f"--from={source} names no earlier stage")
            if instruction.keyword in ("CMD", "ENTRYPOINT") and not instruction.text.startswith("["):
                found.append(f"{instruction.keyword} runs in a shell, which swallows signals")
            if re.search(r"\bnpm i(nstall)?\b", instruction.text):
                found.append("npm install changes the lock file; use npm ci")
            if "pip install" in instruction.text and "--constraint constraints.txt" not in instruction.text:
                found.append("pip install without the constraints")
            if instruction.keyword in ("ENV", "ARG") and re.search(r"(?i)passw|secret|token", instruction.text):
                found.append("a secret in the image")
        names += alias[1:]
    users = [i.text.partition(":")[0] for i in stages(dockerfile)[-1] if i.keyword == "USER"]
    if not users or users[-1] in ("root", "0"):
        found.append("the image runs as root")
    return found


def only(keyword: str) -> Instruction:
    """The one such instruction of the final stage."""
    (found,) = [i for i in stages(DOCKERFILE)[-1] if i.keyword == keyword]
    return found


def test_dockerfile_has_no_faults() -> None:
    assert faults(DOCKERFILE) == []


@pytest.mark.parametrize(
    ("spoilt", "fault"),
    [
        (DOCKERFILE.replace("USER 10001:10001\n", ""), "the image runs as root"),
        (DOCKERFILE.replace("USER 10001:10001", "USER 0:0"), "the image runs as root"),
        (DOCKERFILE.replace("python:3.11-slim-bookworm", "python:latest"), "python:latest is not pinned"),
        (DOCKERFILE.replace("python:3.11-slim-bookworm", "python"), "python is not pinned"),
        (DOCKERFILE.replace("--from=console", "--from=frontend"), "--from=frontend names no earlier stage"),
        (DOCKERFILE.replace('["pilotage", "serve"]', "pilotage serve"), "CMD runs in a shell, which swallows signals"),
        (DOCKERFILE.replace("npm ci", "npm install"), "npm install changes the lock file; use npm ci"),
        (DOCKERFILE.replace("HEALTHCHECK", "HEALTCHECK"), "unknown or unwanted instruction HEALTCHECK"),
    ],
)
def test_faults_are_found(spoilt: str, fault: str) -> None:
    assert fault in faults(spoilt)


def test_image_is_built_in_stages() -> None:
    """Compilers, caches and node_modules stay behind: the last stage only copies."""
    final = stages(DOCKERFILE)[-1]

    assert len(stages(DOCKERFILE)) == 3
    assert not any("install" in i.text and "pip" in i.text for i in final)
    assert {i.flag("from") for i in final if i.keyword == "COPY"} == {"station", "console"}


def test_image_starts_as_the_readme_says() -> None:
    readme = (ROOT / "README.md").read_text(encoding="utf-8")

    assert json.loads(only("CMD").text) == START
    assert "\n```\npilotage serve\n```\n" in readme
    assert not [i for i in stages(DOCKERFILE)[-1] if i.keyword == "ENTRYPOINT"]


def test_exposed_ports_are_the_stations_own(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in Settings.model_fields:
        monkeypatch.delenv(f"PILOTAGE_{name.upper()}", raising=False)
    settings = Settings()
    mavlink = {f"{endpoint.rpartition(':')[2]}/udp" for endpoint in settings.mavlink}

    assert set(only("EXPOSE").words) == {f"{settings.port}/tcp", f"{urlsplit(settings.video).port}/udp", *mavlink}
    assert f":{settings.port}/healthz" in only("HEALTHCHECK").text
    assert "/healthz" in {getattr(route, "path", None) for route in health.router.routes}


def test_environment_of_the_image_is_understood() -> None:
    names = {word.partition("=")[0] for word in only("ENV").words}

    assert "PILOTAGE_CONSOLE_DIR" in names
    assert_settings(name for name in names if name.startswith("PILOTAGE_"))


def assert_settings(names: Any) -> None:
    known = {f"PILOTAGE_{name.upper()}" for name in Settings.model_fields}
    assert set(names) <= known


def test_what_is_copied_is_there_and_not_ignored() -> None:
    """The ignore file lets in a list of names; whatever the build copies has to be in it."""
    ignore = (ROOT / ".dockerignore").read_text(encoding="utf-8").split("\n")
    let_in = {line[1:] for line in ignore if line.startswith("!")}

    assert "*" in ignore
    for instruction in instructions(DOCKERFILE):
        if instruction.keyword == "COPY" and instruction.flag("from") is None:
            for source in instruction.words[:-1]:
                assert (ROOT / source).exists(), source
                assert Path(source).parts[0] in let_in, source


def test_all_packages_are_in_the_image() -> None:
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))
    packages = set(project["tool"]["hatch"]["build"]["targets"]["wheel"]["packages"])
    copied = {word.strip("/") for i in instructions(DOCKERFILE) if i.keyword == "COPY" for word in i.words[:-1]}

    assert packages <= copied


def test_compose_has_the_station_alone_and_with_the_simulator() -> None:
    assert SERVICES["station"]["command"] == START
    assert "profiles" not in SERVICES["station"]
    assert SERVICES["simulated-station"]["command"] == START
    assert needed_by("simulator") == {"simulated-station", "world"}
    assert needed_by("station") == set()


def needed_by(name: str) -> set[str]:
    """All services that one depends on, however indirectly."""
    direct = set(SERVICES[name].get("depends_on", {}))
    return direct.union(*(needed_by(other) for other in direct))


@pytest.mark.parametrize("name", SERVICES)
def test_service_is_valid(name: str) -> None:
    service = SERVICES[name]

    assert set(service) <= SERVICE_KEYS
    assert service["image"] == f"pilotage:{VERSION}"
    assert (ROOT / "docker" / service["build"]["context"]).resolve() == ROOT
    assert (ROOT / service["build"]["dockerfile"]).is_file()
    for other, how in service.get("depends_on", {}).items():
        # A service that is named starts its profile only: what it needs has to be of the same one, or of none.
        assert set(SERVICES[other].get("profiles", service.get("profiles", []))) <= set(service.get("profiles", []))
        assert how["condition"] in CONDITIONS
    for volume in service.get("volumes", []):
        source, _, target = volume.partition(":")
        assert source in COMPOSE["volumes"]
        assert target == only("VOLUME").text == "/data"


@pytest.mark.parametrize("name", SERVICES)
def test_service_has_few_rights(name: str) -> None:
    service = SERVICES[name]

    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert "no-new-privileges:true" in service["security_opt"]
    assert "user" not in service


@pytest.mark.parametrize("name", SERVICES)
def test_service_is_on_the_network_where_loopback_is_reached(name: str) -> None:
    """The station listens on loopback only; a published port of a network of its own would lead nowhere."""
    assert SERVICES[name]["network_mode"] == "host"
    assert "ports" not in SERVICES[name]


@pytest.mark.parametrize("name", SERVICES)
def test_environment_of_a_service_is_understood(name: str, monkeypatch: pytest.MonkeyPatch) -> None:
    settings = [entry.partition("=") for entry in SERVICES[name].get("environment", [])]

    assert_settings(key for key, _, _ in settings)
    for key, equals, value in settings:
        if equals:
            monkeypatch.setenv(key, value)
    Settings()


@pytest.mark.parametrize("name", SERVICES)
def test_commands_of_a_service_are_ones_that_exist(name: str) -> None:
    words = SERVICES[name]["command"]
    lines = words[2].split("&&") if words[:2] == ["sh", "-c"] else [shlex.join(words)]

    for line in lines:
        program, *arguments = shlex.split(line)
        assert program == "pilotage"
        parse(arguments)


def parse(arguments: list[str]) -> None:
    """Read a command line down to its last option without running anything; click raises on what it does not know."""
    command: Any = typer.main.get_command(build_app())
    while hasattr(command, "commands"):
        name, *arguments = arguments
        command = command.commands[name]
    command.make_context("pilotage", arguments)


def test_simulated_station_uses_what_the_world_service_makes() -> None:
    (_, _, script) = SERVICES["world"]["command"]
    environment = dict(entry.split("=", 1) for entry in SERVICES["simulated-station"]["environment"])

    assert f"--name '{environment['PILOTAGE_MAP']}'" in script
    assert environment["PILOTAGE_CAMERA"] == "/data/world/flight.json"
    assert "--prepare /data/world " in script
    assert SERVICES["world"]["volumes"] == SERVICES["simulated-station"]["volumes"]
