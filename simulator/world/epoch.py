"""The two times at which the same land is seen: season, light and sensor."""

from __future__ import annotations

from dataclasses import dataclass

# Display colours in (red, green, blue), 0 to 255, as level ground looks in full sun.
Colour = tuple[int, int, int]


@dataclass(frozen=True, slots=True)
class Crop:
    """How a field looks in one season."""

    colour: Colour
    share: float
    row_spacing_m: float
    row_contrast: float
    tramlines: bool
    patchiness: float
    grain: float


@dataclass(frozen=True, slots=True)
class Sensor:
    """What the sensor and the air do to a picture: contrast about a level, colour gains, blur, noise."""

    contrast: float
    level: float
    gain_rgb: tuple[float, float, float]
    blur_sigma_px: float
    noise_std: float
    lean_tan: float
    lean_azimuth_deg: float


@dataclass(frozen=True, slots=True)
class Epoch:
    """One time: everything about how the land looks then."""

    name: str
    sun_azimuth_deg: float
    sun_elevation_deg: float
    shadow: float
    crops: tuple[Crop, ...]
    meadow: Colour
    lawn: Colour
    wood_floor: Colour
    broadleaf: tuple[Colour, ...]
    conifer: tuple[Colour, ...]
    bare: Colour
    gravel: Colour
    asphalt: Colour
    water: Colour
    verge: Colour
    reed: Colour
    sensor: Sensor


_SPRING_CROPS = (
    Crop((92, 124, 66), 0.32, 18.0, 0.05, True, 0.10, 0.035),
    Crop((112, 138, 74), 0.14, 24.0, 0.05, True, 0.12, 0.035),
    Crop((190, 182, 74), 0.14, 21.0, 0.04, True, 0.07, 0.04),
    Crop((150, 126, 98), 0.16, 0.75, 0.06, False, 0.14, 0.05),
    Crop((128, 108, 86), 0.12, 3.0, 0.07, False, 0.15, 0.06),
    Crop((128, 126, 88), 0.12, 0.5, 0.05, False, 0.16, 0.05),
)
_AUTUMN_CROPS = (
    Crop((188, 172, 126), 0.26, 6.0, 0.07, True, 0.08, 0.05),
    Crop((118, 94, 74), 0.20, 2.4, 0.11, False, 0.12, 0.09),
    Crop((134, 134, 78), 0.16, 0.75, 0.13, False, 0.12, 0.08),
    Crop((74, 108, 58), 0.12, 0.5, 0.08, False, 0.10, 0.06),
    Crop((160, 138, 110), 0.14, 4.0, 0.05, False, 0.12, 0.05),
    Crop((108, 132, 72), 0.12, 24.0, 0.04, True, 0.18, 0.05),
)

REFERENCE = Epoch(
    name="reference",
    sun_azimuth_deg=148.0,
    sun_elevation_deg=52.0,
    shadow=0.52,
    crops=_SPRING_CROPS,
    meadow=(106, 140, 76),
    lawn=(112, 140, 82),
    wood_floor=(66, 76, 48),
    broadleaf=((92, 122, 62), (82, 112, 56), (104, 130, 68), (88, 108, 64)),
    conifer=((54, 80, 54), (48, 72, 50), (62, 84, 56)),
    bare=(152, 136, 110),
    gravel=(178, 166, 142),
    asphalt=(124, 124, 126),
    water=(62, 80, 80),
    verge=(120, 142, 86),
    reed=(140, 140, 92),
    sensor=Sensor(0.80, 118.0, (0.97, 1.0, 1.06), 0.62, 2.6, 0.13, 65.0),
)

CURRENT = Epoch(
    name="current",
    sun_azimuth_deg=229.0,
    sun_elevation_deg=34.0,
    shadow=0.42,
    crops=_AUTUMN_CROPS,
    meadow=(126, 136, 82),
    lawn=(118, 132, 80),
    wood_floor=(78, 74, 50),
    broadleaf=((112, 116, 56), (92, 106, 52), (138, 122, 58), (124, 104, 54), (84, 98, 50)),
    conifer=((46, 68, 46), (52, 72, 46), (42, 60, 42)),
    bare=(146, 128, 102),
    gravel=(164, 150, 126),
    asphalt=(106, 106, 110),
    water=(44, 58, 56),
    verge=(136, 136, 88),
    reed=(150, 130, 84),
    sensor=Sensor(1.0, 118.0, (1.0, 1.0, 0.97), 0.0, 0.0, 0.0, 0.0),
)
