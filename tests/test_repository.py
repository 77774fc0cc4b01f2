"""What holds for every file of the repository."""

from __future__ import annotations

import re
import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[1]
PACKAGES = ("estimator", "guidance", "geodata", "simulator", "backend")
MOST_LINES = 500
MOST_BYTES = 1_000_000
# Written in two halves, so that this file may be looked through too.
REGISTRIES = tuple(
    f"{name}.{ending}"
    for name, ending in (
        ("pypi", "org"), ("pythonhosted", "org"), ("npmjs", "org"), ("npmjs", "com"), ("yarnpkg", "com"),
        ("proxy.golang", "org"),
    )
)  # fmt: skip
HOME_PATH = re.compile(r"(?<![\w.$}~-])/(?:home|Users)/\w|(?<![\w.$}~/-])/roo[t]/")
RELATIVE_LINK = re.compile(r"\]\((?!https?:|#)([^)#\s]+)")


def tracked_files() -> list[Path]:
    # A checkout that belongs to another user, as in a container, is still this checkout.
    done = subprocess.run(
        ["git", "-c", f"safe.directory={ROOT}", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=True, text=True
    )
    return [ROOT / name for name in done.stdout.split("\0") if name and (ROOT / name).is_file()]


def text_of(path: Path) -> str | None:
    """A file's text, None for a binary one."""
    try:
        return path.read_text(encoding="utf-8")
    except UnicodeDecodeError:
        return None


FILES = tracked_files()
TEXTS = {path.relative_to(ROOT).as_posix(): text for path in FILES if (text := text_of(path)) is not None}


def foreign_hosts(text: str) -> list[str]:
    return [host for host in REGISTRIES if host in text.lower()]


def test_no_module_is_longer_than_500_lines() -> None:
    modules = {name: text for name, text in TEXTS.items() if name.startswith(PACKAGES) and name.endswith(".py")}

    assert len(modules) > 100
    assert {name: n for name, text in modules.items() if (n := text.count("\n")) > MOST_LINES} == {}


def test_no_console_source_is_longer_than_500_lines() -> None:
    """Written ones; `schema.d.ts` is generated."""
    sources = {name: t for name, t in TEXTS.items() if name.startswith("frontend/src/") and not name.endswith(".d.ts")}

    assert len(sources) > 20
    assert {name: n for name, text in sources.items() if (n := text.count("\n")) > MOST_LINES} == {}


def test_no_tracked_file_is_large() -> None:
    assert {path.name: size for path in FILES if (size := path.stat().st_size) > MOST_BYTES} == {}


def test_no_file_names_a_package_registry() -> None:
    """Where packages come from is the business of the machine that installs them."""
    assert {name: found for name, text in TEXTS.items() if (found := foreign_hosts(text))} == {}


def test_no_file_names_somebodys_home() -> None:
    assert {name: found.group() for name, text in TEXTS.items() if (found := HOME_PATH.search(text))} == {}


@pytest.mark.parametrize("text", ['open("/home/' + 'kim/map.tif")', "cd /root" + "/x", "see /Users/" + "kim"])
def test_home_paths_are_recognised(text: str) -> None:
    assert HOME_PATH.search(text)


@pytest.mark.parametrize("text", ["~/.local/share", "$HOME/x", "https://example.test/home/page", "docs/root/x", "/"])
def test_other_paths_are_no_home_paths(text: str) -> None:
    assert not HOME_PATH.search(text)


def test_registries_are_recognised() -> None:
    assert foreign_hosts(f"https://files.{'PythonHosted'}.org/x") == [REGISTRIES[1]]
    assert foreign_hosts("https://example.test/simple") == []


def test_readme_begins_with_the_two_commands() -> None:
    blocks = re.findall(r"```\n(.*?)```", TEXTS["README.md"], re.DOTALL)
    commands = [line.split("  ")[0] for line in blocks[0].splitlines()]

    assert commands == ["make demo", "make test"]
    for target in ("demo", "test"):
        assert re.search(rf"^{target}:", TEXTS["Makefile"], re.MULTILINE)


def test_relative_links_of_documents_lead_somewhere() -> None:
    lost = [
        f"{name}: {target}"
        for name, text in TEXTS.items()
        if name.endswith(".md")
        for target in RELATIVE_LINK.findall(text)
        if not (ROOT / name).parent.joinpath(target).exists()
    ]
    assert lost == []


def test_modules_that_documents_name_exist() -> None:
    """A path in backticks that begins with a package is a file or a folder."""
    path = re.compile(rf"`((?:{'|'.join(PACKAGES)}|frontend|tests|docs)/[\w./-]+)`")
    documents = {name: text for name, text in TEXTS.items() if re.match(r"docs/|README|CONTRIBUTING", name)}
    named = {(name, found) for name, text in documents.items() for found in path.findall(text)}

    assert len(named) > 40
    built = ("frontend/node_modules", "frontend/dist")
    assert {(n, f) for n, f in named if f not in built and not (ROOT / f).exists()} == set()


def test_adrs_are_numbered_and_listed() -> None:
    records = sorted(name for name in TEXTS if re.match(r"docs/adr/\d", name))

    assert [Path(name).name[:4] for name in records] == [f"{n:04d}" for n in range(1, len(records) + 1)]
    for name in records:
        assert f"({Path(name).name})" in TEXTS["docs/adr/README.md"]
        assert TEXTS[name].startswith(f"# {Path(name).name[:4]}: ")


def test_everything_that_is_needed_is_pinned() -> None:
    """Every requirement of pyproject.toml has its version in constraints.txt."""
    pinned = {line.partition("==")[0].lower().replace("_", "-") for line in TEXTS["constraints.txt"].splitlines()}
    tables = re.findall(r"^(?:dependencies|dev) = \[\n(.*?)^\]", TEXTS["pyproject.toml"], re.DOTALL | re.MULTILINE)
    needed = {re.split(r"[\[<>=]", name)[0].lower() for table in tables for name in re.findall(r'"([^"]+)"', table)}

    assert len(needed) > 30
    assert needed - pinned == set()
