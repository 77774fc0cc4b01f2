"""What the tracker of clicked targets is set by."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np


@dataclass(frozen=True, slots=True)
class TrackerConfig:
    """Sizes in pixels of the grid, scores in [-1, 1], times in seconds.

    Attributes
    ----------
    size_m, size_px, most_size_px
        A target's greatest extent where the start does not say: metres where the scale is known, pixels of the picture
        otherwise; and what it has on the grid at most.
    keep_score, find_score, worse
        What a target in sight must fit; what one that was lost must, and by how much at most it may fit worse than
        usual.
    find_moving_score, worse_moving, worse_in_sight, keep_margin
        The same of one that drives, which is known by its motion as well, and in other light looks different; by how
        much it may fit worse than usual in sight; and how far in sight it must lead whatever else fits, natural log
        units.
    find_pictures, find_s, moving_pictures, find_moving_s, judged_s
        In how many pictures and over what time it must be seen before it is found; of one that drives; and how far
        back candidates are judged by.
    margin
        By how many natural log units it must lead whatever else fits.
    least_way_m, speed_std_m_s, speed_sigmas, uneven_m, course_off_rad, parked_m_s
        How one that drives must move while it is judged: at least so far; its velocity, measured so well, within so
        many standard deviations; so evenly; along its long axis. What seems slower than the last is taken to stand,
        and tells how fast what stands seems to move.
    uneven_share, turn_step_rad, least_weight
        How uneven its motion may be at most, of its way; how far it may seem to turn from picture to picture; and what
        must speak for it at least, natural log units: the farther from where it should be, the less is believed.
    long_way_m, long_way_score, long_way_weight
        From what way on one that goes much as the target went need but fit so well, with so much that speaks for it.
    likelier
        By how much better its surroundings must correlate with the ground that it left than with what goes along.
    long_away_s, about_sigmas, any_speed_m_s
        After what time away one that drives may have turned about or stopped, how many standard deviations of its
        velocity that counts as, and by how much, at one standard deviation, it may have braked or pulled away.
    surroundings, sure_surroundings, surroundings_sizes
        The correlation that the surroundings of one that stands must reach, from which on it may fit worse than usual,
        and how far they reach, in its sizes.
    anchor_px, anchored_px
        How far about the expected place the ground that it stands on is sought, half as far in sight; and how far from
        where that has it, it may be.
    step_m
        How far in sight it may be from where it should have gone since an earlier picture, on the ground of that.
    score_std
        The score's standard deviation: what a difference in score is worth.
    gate_sigmas, most_reach_m, chain_m
        How far from the expected place is searched, in standard deviations and at most; and what a candidate may jump.
    pursued, standing, pursued_m, fastest_m_s, refuted_s
        How many candidates are looked for where they should be next, how many of them of those that stand, and how far
        about it; how fast one that was seen once may be; and for how long a place that showed nothing is not looked at
        again.
    lost_after_s, least_std_px, candidates, moved
        When it is lost; the least standard deviation of a place on the grid; how many places are looked at closely, and
        how many more, of one that drives, at which something has come or gone.
    hue_std, lighter_std
        How far the colour of one that drives may lie from that at the click, standard deviations: a* and b* of CIE
        L*a*b* in OpenCV's 8-bit units, and the natural logarithm of the lightness over what the light explains.
    """

    size_m: float = 5.0
    size_px: float = 32.0
    most_size_px: float = 36.0
    keep_score: float = 0.45
    find_score: float = 0.58
    find_moving_score: float = 0.48
    worse_moving: float = 0.35
    worse_in_sight: float = 0.3
    keep_margin: float = 1.5
    find_pictures: int = 3
    find_s: float = 0.3
    moving_pictures: int = 5
    find_moving_s: float = 0.75
    least_way_m: float = 2.5
    long_away_s: float = 4.0
    about_sigmas: float = 2.0
    any_speed_m_s: float = 5.0
    pursued: int = 10
    standing: int = 3
    pursued_m: float = 2.8
    fastest_m_s: float = 25.0
    refuted_s: float = 1.0
    speed_std_m_s: float = 0.7
    speed_sigmas: float = 3.0
    judged_s: float = 1.2
    most_reach_m: float = 250.0
    parked_m_s: float = 3.5
    chain_m: float = 0.8
    uneven_m: float = 0.4
    likelier: float = 0.03
    uneven_share: float = 0.08
    turn_step_rad: float = 0.45
    least_weight: float = 7.0
    long_way_m: float = 15.0
    long_way_score: float = 0.38
    long_way_weight: float = 5.2
    course_off_rad: float = 0.55
    worse: float = 0.13
    margin: float = 3.0
    surroundings: float = 0.40
    sure_surroundings: float = 0.70
    surroundings_sizes: float = 1.8
    anchor_px: int = 48
    anchored_px: int = 6
    step_m: float = 0.9
    score_std: float = 0.07
    gate_sigmas: float = 3.0
    lost_after_s: float = 0.7
    least_std_px: float = 0.35
    candidates: int = 6
    moved: int = 3
    hue_std: float = 5.0
    lighter_std: float = 0.35

    def __post_init__(self) -> None:
        for name in self.__dataclass_fields__:
            if not (np.isfinite(getattr(self, name)) and getattr(self, name) > 0):
                message = f"{name} must be positive and finite, not {getattr(self, name)}"
                raise ValueError(message)
