"""Bundles: one zip of ``evidence.json``, the picture, the pieces of map and ground that it was registered to, and
``status.json`` where the target was changed since.
"""

from __future__ import annotations

import hashlib
import io
import json
import zipfile
import zlib
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import get_args

from backend.errors import BundleError
from backend.evidence.schema import Evidence, PieceName, read_document

DOCUMENT, PICTURE, STATUS = "evidence.json", "frame.jpg", "status.json"
PIECES: tuple[PieceName, ...] = get_args(PieceName)
MAX_BYTES = 64_000_000


@dataclass(frozen=True, slots=True)
class Bundle:
    """A bundle that was read: the hashes of its files fit. ``picture`` is None where there is none beside the document.

    ``pieces`` are the files of map and ground, by name. ``status`` is what the station said of the target when it gave
    the bundle out; it is under no hash.
    """

    evidence: Evidence
    document: bytes
    picture: bytes | None
    status: str | None = None
    pieces: Mapping[PieceName, bytes] = field(default_factory=dict)


def pack(
    document: bytes, picture: bytes | None, status: str | None = None, pieces: Mapping[PieceName, bytes] | None = None
) -> bytes:
    """The bytes of a bundle."""
    out = io.BytesIO()
    with zipfile.ZipFile(out, "w") as archive:
        archive.writestr(zipfile.ZipInfo(DOCUMENT), document, zipfile.ZIP_DEFLATED)
        if picture is not None:
            archive.writestr(zipfile.ZipInfo(PICTURE), picture, zipfile.ZIP_STORED)
        for file, data in (pieces or {}).items():
            kind = zipfile.ZIP_STORED if file.endswith(".png") else zipfile.ZIP_DEFLATED
            archive.writestr(zipfile.ZipInfo(file), data, kind)
        if status is not None:
            archive.writestr(zipfile.ZipInfo(STATUS), json.dumps({"status": status}) + "\n", zipfile.ZIP_STORED)
    return out.getvalue()


def read_bundle(path: Path) -> Bundle:
    """Read a bundle (.zip), or the document alone (.json).

    Raises
    ------
    BundleError
        The file cannot be read, something is missing in it, or was altered.
    """
    name = str(path)
    try:
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except OSError as error:
        raise BundleError(name, f"cannot be read: {error.strerror or error}") from None
    if len(data) > MAX_BYTES:
        raise BundleError(name, f"is larger than {MAX_BYTES} bytes: no evidence of a target is")
    if data[:1].isspace() or data[:1] == b"{":
        return Bundle(read_document(data, name), data, None)
    return unpack(data, name)


def unpack(data: bytes, name: str) -> Bundle:
    """The bundle in a zip's bytes; errors as for `read_bundle`."""
    members = _members(data, name)
    if DOCUMENT not in members:
        raise BundleError(name, f"holds no {DOCUMENT}: it is no evidence of a target, or was cut")
    evidence = read_document(members[DOCUMENT], f"{name}: {DOCUMENT}")
    expected: dict[str, str] = {file.file: file.sha256 for file in evidence.pieces()}
    if evidence.picture.file is not None:
        expected[PICTURE] = evidence.picture.sha256 or ""
    for file in (PICTURE, *PIECES):
        _check_file(file, members.get(file), expected.get(file), name)
    pieces = {file: members[file] for file in PIECES if file in members}
    return Bundle(
        evidence, members[DOCUMENT], members.get(PICTURE), _status(members.get(STATUS), name), pieces
    )  # fmt: skip


def _check_file(file: str, data: bytes | None, sha256: str | None, name: str) -> None:
    if sha256 is None:
        if data is not None:
            raise BundleError(name, f"holds a {file} of which {DOCUMENT} knows nothing")
        return
    if data is None:
        raise BundleError(name, f"{file} is missing; {DOCUMENT} names it")
    found = hashlib.sha256(data).hexdigest()
    if found != sha256:
        raise BundleError(name, f"{file} was altered: its SHA-256 is {found}, not {sha256}")


def _members(data: bytes, name: str) -> dict[str, bytes]:
    members: dict[str, bytes] = {}
    try:
        with zipfile.ZipFile(io.BytesIO(data)) as archive:
            for info in archive.infolist():
                if info.filename not in (DOCUMENT, PICTURE, STATUS, *PIECES) or info.filename in members:
                    raise BundleError(name, f"holds {info.filename!r} too much: a bundle has {DOCUMENT} and {PICTURE}")
                if info.file_size > MAX_BYTES:
                    raise BundleError(name, f"{info.filename} would unpack to {info.file_size} bytes")
                members[info.filename] = archive.read(info)
    # Encrypted members are a RuntimeError, unknown methods a NotImplementedError.
    except (zipfile.BadZipFile, zlib.error, EOFError, OSError, RuntimeError, ValueError) as error:
        raise BundleError(name, f"is no whole zip file, or was altered: {error}") from None
    return members


def _status(data: bytes | None, name: str) -> str | None:
    if data is None:
        return None
    try:
        return str(json.loads(data)["status"])
    except (ValueError, KeyError, TypeError, RecursionError):
        raise BundleError(name, f"{STATUS} cannot be read") from None
