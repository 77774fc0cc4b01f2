"""EXIF and XMP: written here with Pillow, read back by the module, and broken in every way a card breaks files."""

from pathlib import Path

import numpy as np
import pytest
from PIL import ExifTags, Image

from geodata.errors import PhotoError
from geodata.photo import photos_in, read_meta, read_photo
from tests.shared_data import shared_data

GPS = {
    ExifTags.GPS.GPSLatitudeRef: "S", ExifTags.GPS.GPSLatitude: (33.0, 51.0, 30.0),
    ExifTags.GPS.GPSLongitudeRef: "E", ExifTags.GPS.GPSLongitude: (151.0, 12.0, 0.0),
    ExifTags.GPS.GPSAltitudeRef: b"\x00", ExifTags.GPS.GPSAltitude: 88.5, ExifTags.GPS.GPSImgDirection: 271.0,
}  # fmt: skip


def _photo(path: Path, gps: dict[int, object] | None = None, xmp: bytes = b"", focal_35mm: int | None = None) -> Path:
    exif = Image.Exif()
    if gps:
        exif.get_ifd(ExifTags.IFD.GPSInfo).update(gps)
    if focal_35mm is not None:
        exif.get_ifd(ExifTags.IFD.Exif)[ExifTags.Base.FocalLengthIn35mmFilm] = focal_35mm
    pixels = np.random.default_rng(1).integers(0, 255, (60, 80, 3), dtype=np.uint8)
    Image.fromarray(pixels).save(path, exif=exif, xmp=xmp)
    return path


def test_position_altitude_and_direction_are_read(tmp_path: Path) -> None:
    meta = read_meta(_photo(tmp_path / "a.jpg", GPS))

    assert meta.lat_deg == pytest.approx(-33.858333, abs=1e-6)
    assert meta.lon_deg == pytest.approx(151.2)
    assert (meta.alt_amsl_m, meta.heading_deg) == (88.5, 271.0)
    assert (meta.width_px, meta.height_px) == (80, 60)


def test_a_drones_own_file_agrees_with_what_others_read_in_it() -> None:
    # values of photos/brighton/truth.csv, which another reader made of the same file
    meta = read_meta(shared_data("photos/brighton/photos/DJI_0024.JPG"))

    assert meta.lat_deg == pytest.approx(46.84286461, abs=1e-7)
    assert meta.lon_deg == pytest.approx(-91.99369667, abs=1e-7)
    assert meta.rel_alt_m == 39.9
    assert meta.heading_deg == pytest.approx(220.0)
    assert meta.pitch_deg == -89.9
    # 2.3 mm/1000 px of a Phantom 3's camera, f 3.61 mm on 6.2 mm, is 925 px at this width
    assert meta.focal_px == pytest.approx(925.0, rel=0.03)


def test_attitude_is_found_as_attribute_and_as_element(tmp_path: Path) -> None:
    attribute = b'<x drone-dji:GimbalYawDegree="-10.5" drone-dji:GimbalPitchDegree="-45.00"/>'
    element = b"<a:CameraYawDegree>12.5</a:CameraYawDegree><a:CameraPitchDegree> -80 </a:CameraPitchDegree>"

    first = read_meta(_photo(tmp_path / "a.jpg", xmp=attribute))
    second = read_meta(_photo(tmp_path / "b.jpg", xmp=element))

    assert (first.heading_deg, first.pitch_deg) == (349.5, -45.0)
    assert (second.heading_deg, second.pitch_deg) == (12.5, -80.0)


@pytest.mark.parametrize("xmp", [
    b"<!DOCTYPE x [<!ENTITY a 'b'><!ENTITY c '&a;&a;'>]><x d:GimbalPitchDegree='&c;'/>",
    b'<x d:GimbalPitchDegree="-9e99"/>', b'<x d:GimbalPitchDegree="down"/>', b'<x d:GimbalPitchDegree="-4500"/>',
    b"\x00\xff" * 4000,
])  # fmt: skip
def test_nonsense_in_the_packet_is_left_out(tmp_path: Path, xmp: bytes) -> None:
    assert read_meta(_photo(tmp_path / "a.jpg", xmp=xmp)).pitch_deg is None


@pytest.mark.parametrize("change", [
    {ExifTags.GPS.GPSLatitude: (0.0, 0.0, 0.0), ExifTags.GPS.GPSLongitude: (0.0, 0.0, 0.0)},
    {ExifTags.GPS.GPSLatitude: (133.0, 0.0, 0.0)},
    {ExifTags.GPS.GPSLongitude: 5.0},
])  # fmt: skip
def test_an_impossible_position_is_none(tmp_path: Path, change: dict[int, object]) -> None:
    meta = read_meta(_photo(tmp_path / "a.jpg", {**GPS, **change}))

    assert (meta.lat_deg, meta.lon_deg) == (None, None)


def test_damaged_files_are_named(tmp_path: Path) -> None:
    good = _photo(tmp_path / "a.jpg", GPS).read_bytes()
    (tmp_path / "cut.jpg").write_bytes(good[:200])
    (tmp_path / "text.jpg").write_text("not a picture")
    (tmp_path / "empty.jpg").write_bytes(b"")

    for name in ("cut.jpg", "text.jpg", "empty.jpg", "missing.jpg"):
        with pytest.raises(PhotoError, match=name):
            read_photo(tmp_path / name)


def test_pixels_stay_as_they_are_stored(tmp_path: Path) -> None:
    exif = Image.Exif()
    exif[ExifTags.Base.Orientation] = 6
    Image.fromarray(np.zeros((60, 80, 3), dtype=np.uint8)).save(tmp_path / "a.jpg", exif=exif)

    pixels, meta = read_photo(tmp_path / "a.jpg")

    assert pixels.shape == (60, 80) == (meta.height_px, meta.width_px)


def test_folders_are_listed_by_name_and_empty_ones_refused(tmp_path: Path) -> None:
    for name in ("b.jpg", "a.JPG", "notes.txt"):
        (tmp_path / name).write_bytes(b"x")
    (tmp_path / "empty").mkdir()

    assert [p.name for p in photos_in([tmp_path])] == ["a.JPG", "b.jpg"]
    with pytest.raises(PhotoError, match="holds no pictures"):
        photos_in([tmp_path / "empty"])
