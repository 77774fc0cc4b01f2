"""What a picture says about a pad: where the camera is, or why it cannot be told."""

from __future__ import annotations

from dataclasses import dataclass
from enum import StrEnum

from estimator.landing.pose import Solution


class Refusal(StrEnum):
    """Why a picture gives no position over the pad."""

    NOTHING = "nothing"
    FOREIGN = "foreign"
    MIRRORED = "mirrored"
    INCOMPLETE = "incomplete"
    TWO_PADS = "two_pads"


@dataclass(frozen=True, slots=True)
class NoPad:
    """No pad to land on: why, in a word for programs and a sentence for people."""

    refusal: Refusal
    reason: str


@dataclass(frozen=True, slots=True, eq=False)
class PadSighting:
    """A pad in a picture.

    Attributes
    ----------
    solutions
        The pose, and where the picture does not tell them apart also the one mirrored in the line of sight; the
        likelier first.
    triple
        The largest triple that was used (0 is the pad's largest), or -1 for a board of tags.
    seen_share
        Of the edges that this pose puts into the picture, how many are there.
    edges
        How many edge points, or corners, the pose rests on.
    """

    solutions: tuple[Solution, ...]
    triple: int
    seen_share: float
    edges: int

    @property
    def best(self) -> Solution:
        """The likelier pose."""
        return self.solutions[0]

    @property
    def ambiguous(self) -> bool:
        """A second pose explains the picture as well: do not use one of them alone."""
        return len(self.solutions) > 1
