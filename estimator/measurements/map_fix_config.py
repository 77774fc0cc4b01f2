"""How map fixes are made, all in one place."""

from __future__ import annotations

from dataclasses import dataclass, field
from enum import StrEnum

from estimator.filters.point_mass import PointMassConfig
from estimator.integrity.map_evidence import MapEvidenceConfig
from estimator.measurements.sliding_window import SlidingWindowConfig


class HandOver(StrEnum):
    """What the inertial filter is given of a density.

    ``increment`` is what the picture added. ``density`` is the density's mean with a constant sigma, and the density
    lives on (Conte 2009, section 5.8.4): for comparison.
    """

    INCREMENT = "increment"
    DENSITY = "density"


class Acceptance(StrEnum):
    """What makes a fix of a match: the tests of one picture and the density, or the scatter of many (2008)."""

    VERIFIED = "verified"
    SLIDING_WINDOW = "sliding_window"


@dataclass(frozen=True, slots=True)
class MapFixConfig:
    """Search and acceptance of map fixes.

    ``correlation_share`` is the distance, as a share of the footprint, over which errors of consecutive fixes stay
    alike, ``ambiguity_share`` that over which pictures confuse the same places; ``min_weight`` what a fix from the
    same place still counts. ``noise_inflation`` multiplies the windows' own sigma (neighbours err alike),
    ``density_inflation`` that of the density, ``slices_inflation`` that of one for each heading. Of the variance
    ``white_share`` is each picture's own, ``regional_share`` the region's, and the rest alike over ``local_share`` of
    the footprint; either displacement is between ``min_map_bias_m`` and ``max_map_bias_m`` and follows the pictures by
    its memory. An axis on which a picture tells less than ``least_information`` of what is known is left out. Windows
    count where ``min_agreement`` of them agree. From a heading sigma of ``slice_heading_rad`` on, the density is kept
    for each heading that is tried. ADR 0008 and 0015 say how the numbers were found.

    Switches for comparisons: ``hand_over`` with ``constant_std_m``; ``couple_attitude`` off leaves the Jacobian of the
    horizontal position alone, H = [I 0 0]; ``temper`` off counts every fix in full; ``search_pose`` off tries the
    predicted heading and height only; ``use_windows`` off leaves the density; ``evidence`` None believes every map;
    ``by_probability`` off gives every match that is accepted its whole information, and not the part of it that is as
    large as the probability that it is right (as in Bar-Shalom and Tse, Automatica 11, 1975).
    ``acceptance`` by the sliding window has neither density nor windows.
    """

    search_sigmas: float = 3.5
    min_search_m: float = 10.0
    max_search_m: float = 160.0
    correlation_share: float = 0.4
    min_weight: float = 0.03
    ambiguity_share: float = 0.12
    noise_inflation: float = 3.0
    density_inflation: float = 0.8
    slices_inflation: float = 1.25
    white_share: float = 0.15
    regional_share: float = 0.3
    local_share: float = 1.0
    least_information: float = 0.01
    min_agreement: float = 0.4
    max_innovation_sigmas: float = 6.0
    map_bias_memory: float = 0.9
    map_region_memory: float = 0.95
    min_map_bias_m: float = 0.05
    max_map_bias_m: float = 2.0
    max_outlier_probability: float = 0.99
    min_unimodality: float = 0.9
    max_lost_probability: float = 0.5
    heading_floor_rad: float = 0.01
    scale_floor: float = 0.03
    slice_heading_rad: float = float("inf")
    point_mass: PointMassConfig = field(default_factory=PointMassConfig)
    acceptance: Acceptance = Acceptance.VERIFIED
    sliding_window: SlidingWindowConfig = field(default_factory=SlidingWindowConfig)
    hand_over: HandOver = HandOver.INCREMENT
    constant_std_m: float = 2.0
    couple_attitude: bool = True
    temper: bool = True
    by_probability: bool = True
    search_pose: bool = True
    use_windows: bool = True
    evidence: MapEvidenceConfig | None = field(default_factory=MapEvidenceConfig)
