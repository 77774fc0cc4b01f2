"""``pilotage verify`` on bundles that were altered, cut, or state what cannot be."""

import asyncio
import io
import json
import math
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from backend.errors import BundleError
from backend.evidence.bundle import pack, unpack
from backend.evidence.schema import HASH_FIELD, content_sha256, read_document
from tests.backend.evidence.flown import click, evidence_zip, hilly_station
from tests.backend.evidence.test_service import run_verify

Change = Callable[[dict[str, Any]], object]


@pytest.fixture(scope="module")
def bundle(tmp_path_factory: pytest.TempPathFactory) -> bytes:
    """A bundle that the service gave out."""

    async def made() -> bytes:
        async with hilly_station(tmp_path_factory.mktemp("station")) as running:
            return (await evidence_zip(running, (await click(running))["id"])).content

    return asyncio.run(made())


def changed(bundle: bytes, change: Change, rehash: bool = True) -> bytes:
    """A bundle with another document, under a hash that fits it."""
    read = unpack(bundle, "bundle")
    content = json.loads(read.document)
    change(content)
    if rehash:
        content[HASH_FIELD] = content_sha256(content)
    return pack(json.dumps(content).encode(), read.picture)


def verified(tmp_path: Path, data: bytes) -> tuple[int, str]:
    path = tmp_path / "target.zip"
    path.write_bytes(data)
    done = run_verify(path)
    assert "Traceback" not in done.output
    assert done.exception is None or isinstance(done.exception, SystemExit), done.exception
    return done.exit_code, done.output


def test_whichever_byte_is_altered_is_noticed(bundle: bytes) -> None:
    whole = unpack(bundle, "bundle")
    noticed = harmless = 0
    for at in range(0, len(bundle), 7):
        altered = bytearray(bundle)
        altered[at] ^= 0x10
        try:
            read = unpack(bytes(altered), "altered")
        except BundleError:
            noticed += 1
        else:
            # zip's own remarks, such as a date, are not of the evidence
            assert (read.document, read.picture) == (whole.document, whole.picture)
            harmless += 1

    assert noticed > 20 * harmless


def test_whichever_byte_of_the_document_is_altered_is_noticed(bundle: bytes) -> None:
    document = unpack(bundle, "bundle").document
    content, noticed = json.loads(document), 0
    for at in range(0, len(document), 3):
        altered = bytearray(document)
        altered[at] ^= 0x01
        try:
            read_document(bytes(altered), "altered")
        except BundleError:
            noticed += 1
        else:
            assert json.loads(altered) == content  # a blank became another

    assert noticed > len(document) / 6


def test_a_bundle_cut_anywhere_is_refused(bundle: bytes) -> None:
    for size in range(0, len(bundle), 97):
        with pytest.raises(BundleError):
            unpack(bundle[:size], "cut")


@pytest.mark.parametrize(
    ("change", "rehash", "said"),
    [
        (lambda c: c.update(schema="pilotage.evidence/9"), True, "use a newer Pilotage"),
        (lambda c: c.update(schema="other"), True, "no evidence of a target"),
        (lambda c: c["click"].update(std_px=3.0), False, "was altered after it was made"),
        (lambda c: c["click"].update(std_px=math.nan), False, "NaN is no number"),
        (lambda c: c["state"].update(pos_ned_m=[0.0, 0.0]), True, "state.pos_ned_m"),
        (lambda c: c["camera"].update(fx_px=-1.0), True, "camera.fx_px"),
        (lambda c: c["camera"].pop("cx_px"), True, "camera.cx_px"),
        (lambda c: c["state"].update(mode="lost in thought"), True, "lost in thought"),
        (lambda c: c["state"]["cov_camera_pose"][0].__setitem__(0, -1.0), True, "not positive definite"),
        (lambda c: c["state"]["cov_camera_pose"][0].__setitem__(1, 5.0), True, "not symmetric"),
        (lambda c: [c["state"]["cov_camera_pose"][i].__setitem__(1 - i, 50.0) for i in (0, 1)], True, "eigenvalue"),
        (lambda c: c["state"]["cov_camera_pose"][2].__setitem__(2, None), True, "is not known"),
        (lambda c: c["state"].update(cov_ground_bias=[5.0, 0, 0, 0, 0, 0, 0.1]), True, "pose and ground bias"),
        (lambda c: c["state"].update(cov_ground_bias=[0.0] * 6), True, "cov_ground_bias"),
        (lambda c: c["state"].update(lever_ned_m=[0.0, 0.0]), True, "state.lever_ned_m"),
        (lambda c: c["ground"].update(slope_std=-0.1), True, "ground.slope_std"),
        (lambda c: c["result"]["cov_ned_m2"][2].__setitem__(2, 0.0), True, "result.cov_ned_m2"),
        (lambda c: c["state"].update(q_ned_from_camera=[1.0, 1.0, 0.0, 0.0]), True, "no rotation"),
        (lambda c: c["state"].update(q_ned_from_camera=[0.0, 1.0, 0.0, 0.0]), True, "gives no coordinate"),
        (lambda c: c["click"].update(camera_u_px=7.0), True, "as stated"),
        (lambda c: c["local_frame"].update(lat_rad=47.0), True, "states what cannot be"),
        (lambda c: c["ground"]["model"]["first_cols"].pop(), True, "first columns"),
        (lambda c: c["ground"].update(max_range_m=1e300), True, "ground.max_range_m"),
        (lambda c: c["picture"].update(sha256="0" * 64), True, "frame.jpg was altered"),
        (lambda c: c["picture"].update(file=None, sha256=None), True, "knows nothing"),
    ],
)
def test_what_cannot_be_is_refused_in_words(
    tmp_path: Path, bundle: bytes, change: Change, rehash: bool, said: str
) -> None:
    status, output = verified(tmp_path, changed(bundle, change, rehash))

    assert status == 1
    assert said in output
    assert "target.zip" in output


@pytest.mark.parametrize(
    "change",
    [
        lambda c: c["result"].update(lat_deg=c["result"]["lat_deg"] + 1e-7),
        lambda c: c["result"].update(alt_amsl_m=c["result"]["alt_amsl_m"] + 0.002),
        lambda c: c["result"]["cov_ned_m2"][0].__setitem__(0, 1.001 * c["result"]["cov_ned_m2"][0][0]),
        lambda c: c["result"].update(ray_method="ray_flat"),
        lambda c: c["ground"].update(model={"kind": "flat", "alt_amsl_m": 400.0}),
        lambda c: c["ground"].update(std_m=2.5),
        lambda c: c["ground"].update(target_height_m=0.5),
        lambda c: c["state"]["pos_ned_m"].__setitem__(2, c["state"]["pos_ned_m"][2] - 0.01),
        lambda c: c["ground"]["model"].update(north_max_m=c["ground"]["model"]["north_max_m"] + 5.0),
    ],
)
def test_another_coordinate_does_not_agree(tmp_path: Path, bundle: bytes, change: Change) -> None:
    status, output = verified(tmp_path, changed(bundle, change))

    assert status == 1
    assert output.endswith("  does not agree\n")


def test_the_distance_is_told_in_metres_and_sigmas(tmp_path: Path, bundle: bytes) -> None:
    read = unpack(bundle, "bundle")
    std_d = math.sqrt(read.evidence.result.cov_ned_m2[2][2] or 0.0)
    north = 10.0 / 6.368e6

    status, output = verified(
        tmp_path, changed(bundle, lambda c: c["result"].update(lat_deg=c["result"]["lat_deg"] + math.degrees(north)))
    )

    (line,) = [line for line in output.splitlines() if line.startswith("  distance")]
    assert status == 1
    assert abs(float(line.split()[1]) - 10.0) < 0.05  # metres per radian of latitude, roughly
    assert 0.1 < float(line.split()[3]) < 100.0
    assert std_d > 0.1


def test_files_that_are_no_bundle(tmp_path: Path, bundle: bytes) -> None:
    read = unpack(bundle, "bundle")
    more = io.BytesIO(bundle)
    with zipfile.ZipFile(more, "a") as archive:
        archive.writestr("../evil.sh", "x")
    (tmp_path / "folder").mkdir()
    files = {
        "empty.zip": b"", "text.zip": b"hello", "nothing.zip": pack(b"{}", None), "list.json": b" [1]",
        "deep.json": b" " + b"[" * 100_000, "twice.json": b'{"schema": 1, "schema": 2}', "latin.json": b'{"\xe9": 1}',
        "no-picture.zip": pack(read.document, None), "more.zip": more.getvalue(),
    }  # fmt: skip
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)

    for name in [*files, "folder", "missing.zip"]:
        done = run_verify(tmp_path / name)
        assert done.exit_code == 1, name
        assert "error: " in done.output, name
        assert name in done.output
        assert isinstance(done.exception, SystemExit), name


def test_one_bad_file_among_good_ones_fails_and_all_are_told(tmp_path: Path, bundle: bytes) -> None:
    (tmp_path / "good.zip").write_bytes(bundle)
    (tmp_path / "bad.zip").write_bytes(bundle[:100])

    both = run_verify(tmp_path / "bad.zip", tmp_path / "good.zip")
    no_map = run_verify(tmp_path / "good.zip", "--map", tmp_path / "missing.tif")

    assert (both.exit_code, no_map.exit_code) == (1, 1)
    assert "bad.zip: is no whole zip file" in both.output
    assert "  agrees" in both.output
    assert "missing.tif: cannot be read" in no_map.output
