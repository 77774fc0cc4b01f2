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
    Crop((95, 121, 73), 0.32, 18.0, 0.05, True, 0.10, 0.035),
    Crop((114, 136, 82), 0.14, 24.0, 0.05, True, 0.12, 0.035),
    Crop((187, 180, 90), 0.14, 21.0, 0.04, True, 0.07, 0.04),
    Crop((147, 127, 103), 0.16, 0.75, 0.06, False, 0.14, 0.05),
    Crop((125, 109, 90), 0.12, 3.0, 0.07, False, 0.15, 0.06),
    Crop((127, 125, 94), 0.12, 0.5, 0.05, False, 0.16, 0.05),
)
_AUTUMN_CROPS = (
    Crop((185, 172, 133), 0.26, 6.0, 0.07, True, 0.08, 0.05),
    Crop((115, 95, 78), 0.20, 2.4, 0.11, False, 0.12, 0.09),
    Crop((133, 133, 86), 0.16, 0.75, 0.13, False, 0.12, 0.08),
    Crop((77, 105, 63), 0.12, 0.5, 0.08, False, 0.10, 0.06),
    Crop((157, 139, 115), 0.14, 4.0, 0.05, False, 0.12, 0.05),
    Crop((110, 130, 79), 0.12, 24.0, 0.04, True, 0.18, 0.05),
)

REFERENCE = Epoch(
    name="reference",
    sun_azimuth_deg=148.0,
    sun_elevation_deg=52.0,
    shadow=0.52,
    crops=_SPRING_CROPS,
    meadow=(109, 137, 83),
    lawn=(114, 138, 89),
    wood_floor=(67, 75, 52),
    broadleaf=((94, 120, 69), (84, 110, 63), (106, 128, 76), (89, 106, 69)),
    conifer=((56, 78, 56), (50, 70, 52), (64, 82, 59)),
    bare=(150, 136, 114),
    gravel=(176, 166, 146),
    asphalt=(124, 124, 126),
    water=(64, 79, 79),
    verge=(121, 140, 93),
    reed=(139, 139, 99),
    sensor=Sensor(0.80, 118.0, (0.97, 1.0, 1.06), 0.62, 2.6, 0.13, 65.0),
)

CURRENT = Epoch(
    name="current",
    sun_azimuth_deg=229.0,
    sun_elevation_deg=34.0,
    shadow=0.42,
    crops=_AUTUMN_CROPS,
    meadow=(126, 135, 89),
    lawn=(119, 130, 87),
    wood_floor=(77, 74, 54),
    broadleaf=((111, 115, 64), (93, 104, 59), (135, 122, 68), (121, 104, 62), (85, 96, 56)),
    conifer=((48, 67, 48), (54, 71, 49), (44, 59, 44)),
    bare=(144, 128, 107),
    gravel=(162, 150, 130),
    asphalt=(106, 106, 109),
    water=(46, 57, 56),
    verge=(135, 135, 95),
    reed=(147, 130, 92),
    sensor=Sensor(1.0, 118.0, (1.0, 1.0, 0.97), 0.0, 0.0, 0.0, 0.0),
)
