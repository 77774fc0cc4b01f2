"""What the estimator's target methods need of a station's setup."""

from __future__ import annotations

from backend.navigation.setup import NavigationSetup
from estimator.sighting import Scene
from estimator.types import NavigationState


def scene_of(setup: NavigationSetup, state: NavigationState) -> Scene:
    """What a vehicle's pictures look at, with the ground's errors beside what ``state`` has learned of it."""
    ground_std_m, slope_std = setup.ground_errors(state)
    return Scene(setup.camera, setup.ground, setup.frame, setup.reference, ground_std_m, slope_std)
