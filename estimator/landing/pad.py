"""The landing pad: nested triples of rings, as on the pad of Conte's thesis (2009, chapter 6), and boards of AprilTags.

Pad frame: origin at the common centre, x forward (up on the print), y right, z down into the ground; seen from above, x
to y is clockwise. A ring is a black disc with a concentric white one in it. The three of a triple stand on an
equilateral triangle, the first straight ahead, the others following clockwise; smaller triples stand within larger
ones, so that one fills the view at every height.

Identity: the ratios of inner to outer radius are ``CODES``. Within a triple they rise clockwise, which tells the rings
apart and betrays a mirrored print; each triple has its own set of three, which tells its size.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import combinations, pairwise
from typing import Final

import numpy as np

from estimator.errors import GeometryError
from estimator.types import Float

CODES: Final = ((0.32, 0.45, 0.71), (0.32, 0.58, 0.71), (0.32, 0.45, 0.58), (0.45, 0.58, 0.71))
"""Ratios of the triples, the largest triple first."""
FULLNESS: Final = (1.0, 0.78, 1.22, 0.62)
"""Radius by side of the triples, relative to the first.

Codes differ in a single ring; close to the pad, with the larger triples out of view, that alone does not keep one from
being taken for another, nine times as far.
"""
QUIET_SHARE: Final = 0.4
"""White that a ring needs around it, in its outer radii."""
_LEAST_STEP: Final = 0.1
_LEAST_FULLER: Final = 1.15


@dataclass(frozen=True, slots=True)
class Ring:
    """One ring: centre in the pad frame, outer and inner radius; ``triple`` 0 is the largest, ``place`` 0 to 2."""

    x_m: float
    y_m: float
    outer_m: float
    inner_m: float
    triple: int
    place: int

    @property
    def ratio(self) -> float:
        """Inner by outer radius."""
        return self.inner_m / self.outer_m


@dataclass(frozen=True, slots=True)
class Triple:
    """Three equal discs whose centres are ``side_m`` apart, with ratios that rise clockwise from straight ahead."""

    side_m: float
    radius_m: float
    ratios: tuple[float, float, float]

    def __post_init__(self) -> None:
        if not (0.0 < self.radius_m < math.inf and 0.0 < self.side_m < math.inf):
            message = f"a triple needs a positive side and radius, not {self.side_m} and {self.radius_m} m"
            raise GeometryError(message)
        if self.side_m < (2.0 + QUIET_SHARE) * self.radius_m:
            message = (
                f"discs of radius {self.radius_m} m need {(2 + QUIET_SHARE) * self.radius_m:.4g} m or more between "
                f"their centres, not {self.side_m} m: make the side longer or the radius smaller"
            )
            raise GeometryError(message)
        if not all(0.2 <= ratio <= 0.8 for ratio in self.ratios):
            message = f"ratios of inner to outer radius lie between 0.2 and 0.8, not {self.ratios}"
            raise GeometryError(message)
        if any(later - former < _LEAST_STEP - 1e-9 for former, later in pairwise(self.ratios)):
            message = f"a triple's ratios must rise by {_LEAST_STEP} or more, or a mirrored print passes: {self.ratios}"
            raise GeometryError(message)

    @property
    def reach_m(self) -> float:
        """From the pad's centre to the outermost black."""
        return self.side_m / math.sqrt(3.0) + self.radius_m

    @property
    def clear_m(self) -> float:
        """From the pad's centre to where the rings' quiet zone begins."""
        return self.side_m / math.sqrt(3.0) - (1.0 + QUIET_SHARE) * self.radius_m


@dataclass(frozen=True, slots=True)
class CirclePad:
    """A pad of nested triples, the largest first."""

    name: str
    triples: tuple[Triple, ...]

    def __post_init__(self) -> None:
        if not self.triples:
            message = f"pad '{self.name}' has no triple"
            raise GeometryError(message)
        for number, (outer, inner) in enumerate(pairwise(self.triples)):
            if inner.reach_m > outer.clear_m:
                message = (
                    f"pad '{self.name}': triple {number + 2} reaches {inner.reach_m:.4g} m from the centre, but triple "
                    f"{number + 1} leaves only {outer.clear_m:.4g} m clear; list the largest first, each well smaller"
                )
                raise GeometryError(message)
        for one, other in combinations(range(len(self.triples)), 2):
            a, b = self.triples[one], self.triples[other]
            apart = np.abs(np.subtract(a.ratios, b.ratios)) > _LEAST_STEP - 1e-9
            if not apart.any():
                message = f"pad '{self.name}': triples {one + 1} and {other + 1} have the same ratios"
                raise GeometryError(message)
            fuller = a.radius_m / a.side_m / (b.radius_m / b.side_m)
            if np.count_nonzero(apart) < 2 and max(fuller, 1.0 / fuller) < _LEAST_FULLER:
                message = (
                    f"pad '{self.name}': triples {one + 1} and {other + 1} differ in one ratio only, so that one may "
                    f"be taken for the other: let radius by side differ by a factor of {_LEAST_FULLER} or more"
                )
                raise GeometryError(message)

    @property
    def rings(self) -> tuple[Ring, ...]:
        """All rings, triple by triple."""
        return tuple(
            Ring(
                triple.side_m / math.sqrt(3.0) * math.cos(place * 2.0 * math.pi / 3.0),
                triple.side_m / math.sqrt(3.0) * math.sin(place * 2.0 * math.pi / 3.0),
                triple.radius_m, triple.ratios[place] * triple.radius_m, number, place,
            )
            for number, triple in enumerate(self.triples) for place in range(3)
        )  # fmt: skip

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """x and y of the white sheet: least x, least y, greatest x, greatest y; the quiet zone is in it."""
        largest = self.triples[0]
        out, margin = largest.side_m / math.sqrt(3.0), (1.0 + QUIET_SHARE) * largest.radius_m
        return -0.5 * out - margin, -0.5 * largest.side_m - margin, out + margin, 0.5 * largest.side_m + margin

    def mirrored(self) -> tuple[Ring, ...]:
        """The rings of a print seen through the paper: y changes sign."""
        return tuple(Ring(r.x_m, -r.y_m, r.outer_m, r.inner_m, r.triple, r.place) for r in self.rings)


@dataclass(frozen=True, slots=True)
class Tag:
    """A tag of 36h11 with its number: centre in the pad frame and the side of its black square; its top is forward."""

    number: int
    x_m: float
    y_m: float
    side_m: float

    @property
    def corners_m(self) -> Float:
        """Corners (4, 3) in the pad frame: top left, top right, bottom right, bottom left on the print."""
        half = 0.5 * self.side_m
        signs = np.array(((1.0, -1.0), (1.0, 1.0), (-1.0, 1.0), (-1.0, -1.0)))
        return np.column_stack((np.array((self.x_m, self.y_m)) + half * signs, np.zeros(4)))


@dataclass(frozen=True, slots=True)
class TagPad:
    """A board of tags of the AprilTag family 36h11 (Olson, ICRA 2011), the common alternative."""

    name: str
    tags: tuple[Tag, ...]

    def __post_init__(self) -> None:
        if not self.tags:
            message = f"pad '{self.name}' has no tag"
            raise GeometryError(message)
        numbers = [tag.number for tag in self.tags]
        if len(set(numbers)) < len(numbers):
            message = f"pad '{self.name}' uses a tag's number twice: {sorted(numbers)}"
            raise GeometryError(message)
        for tag in self.tags:
            if not (0 <= tag.number < 587 and 0.0 < tag.side_m < math.inf):
                message = f"pad '{self.name}': 36h11 has tags 0 to 586, not {tag.number} of {tag.side_m} m"
                raise GeometryError(message)
        for one, other in combinations(self.tags, 2):
            apart = max(abs(one.x_m - other.x_m), abs(one.y_m - other.y_m))
            if apart < 0.5 * (one.side_m + other.side_m) + max(one.side_m, other.side_m) / 8.0 - 1e-9:
                message = f"pad '{self.name}': tags {one.number} and {other.number} leave less than a cell of white"
                raise GeometryError(message)

    @property
    def bounds_m(self) -> tuple[float, float, float, float]:
        """x and y of the white sheet: least x, least y, greatest x, greatest y; a cell of white is around each tag."""
        reach = [(tag, 0.625 * tag.side_m) for tag in self.tags]
        return (
            min(tag.x_m - r for tag, r in reach), min(tag.y_m - r for tag, r in reach),
            max(tag.x_m + r for tag, r in reach), max(tag.y_m + r for tag, r in reach),
        )  # fmt: skip


Pad = CirclePad | TagPad


def circle_pad(name: str, side_m: float, radius_m: float, triples: int = 4, shrink: float = 3.0) -> CirclePad:
    """A pad whose largest triple has this side and radius, each further side ``shrink`` times smaller."""
    if not 1 <= triples <= len(CODES):
        message = f"a pad has 1 to {len(CODES)} triples, not {triples}"
        raise GeometryError(message)
    if not shrink > 1.0:
        message = f"each triple must be smaller than the one around it; shrink is {shrink}, not above 1"
        raise GeometryError(message)
    sizes = (shrink**-number for number in range(triples))
    return CirclePad(name, tuple(Triple(side_m * s, radius_m * s * FULLNESS[n], CODES[n]) for n, s in enumerate(sizes)))


def tag_pad(name: str, side_m: float, sizes: int = 3, first: int = 0) -> TagPad:
    """A large tag with columns of three smaller ones on its right, each column a quarter of the size before."""
    if not 1 <= sizes <= 4:
        message = f"a board has 1 to 4 sizes of tags, not {sizes}"
        raise GeometryError(message)
    tags = [Tag(first, 0.0, 0.0, side_m)]
    right = 0.5 * side_m + side_m / 8.0
    for column in range(1, sizes):
        small = side_m * 0.25**column
        # The gap to the larger neighbour is a cell of that neighbour.
        y = right + 0.5 * small
        tags += [Tag(first + 3 * column - 2 + row, (1 - row) * 1.4 * small, y, small) for row in range(3)]
        right = y + 0.5 * small + small / 8.0
    shift = 0.5 * (right - 0.5 * side_m - side_m / 8.0)
    return TagPad(name, tuple(Tag(t.number, t.x_m, t.y_m - shift, t.side_m) for t in tags))
