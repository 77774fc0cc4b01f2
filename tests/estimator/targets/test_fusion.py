from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from estimator.targets.fusion import (
    RAY,
    REGISTERED,
    FusionConfig,
    TargetFusion,
    TargetSighting,
    correlations,
    fuse,
    joint_covariance,
)

TRUE = np.array([120.0, -40.0, 3.0])
ZERO, NONE = np.zeros((3, 3)), np.zeros(3)
SURE = FusionConfig(nu=1e9)


def _sighting(
    pos: np.ndarray, own: np.ndarray, slow: np.ndarray = ZERO, at_m: float = 0.0, kind: str = REGISTERED,
    click: int = 0, way: np.ndarray = NONE, alike_m: float = 40.0,
) -> TargetSighting:  # fmt: skip
    return TargetSighting(pos, own, slow, way, np.array([at_m, 0.0, -80.0]), alike_m, kind, click)


def _spread(rng: np.random.Generator) -> np.ndarray:
    a = rng.normal(size=(3, 3))
    return np.asarray(a @ a.T + 0.3 * np.eye(3))


def test_independent_sightings_give_the_recursive_least_squares_of_the_thesis() -> None:
    rng = np.random.default_rng(1)
    covs = [_spread(rng) for _ in range(20)]
    places = [TRUE + rng.multivariate_normal(np.zeros(3), cov) for cov in covs]
    fusion = TargetFusion(config=SURE)
    x, P = places[0], covs[0]
    for n, (z, R) in enumerate(zip(places, covs, strict=True)):
        if n:
            gain = P @ np.linalg.inv(P + R)
            x, P = x + gain @ (z - x), (np.eye(3) - gain) @ P
        # far apart, so that nothing is alike
        found = fusion.add(_sighting(z, R, at_m=1e5 * n, click=n))

        assert_allclose(found.pos_ned_m, x, atol=5e-3)
        assert_allclose(found.cov_on_map_ned_m2, P, atol=5e-3)
    assert found.effective > 10.0


def test_the_stated_covariance_is_what_draws_from_the_joint_one_scatter_by() -> None:
    rng = np.random.default_rng(2)
    slow = np.diag([1.0, 0.5, 0.1])
    made = [
        _sighting(TRUE, 0.2 * np.eye(3), slow * (1.0 + n % 3), 9.0 * n, RAY if n % 2 else REGISTERED, n // 2,
                  np.array([0.4, 0.1 * n, 1.0]), 40.0 + 10.0 * n)
        for n in range(8)
    ]  # fmt: skip
    joint = joint_covariance(made, correlations(made, SURE), SURE.pose_inflation)
    assert np.linalg.eigvalsh(joint)[0] > 0.0
    errors = rng.multivariate_normal(np.zeros(24), joint, 3000, method="cholesky").reshape(-1, 8, 3)
    found = np.array(
        [fuse([replace(s, pos_ned_m=TRUE + e) for s, e in zip(made, each, strict=True)], 0.0, SURE).pos_ned_m
         for each in errors]
    )  # fmt: skip
    stated = fuse(made, 0.0, SURE).cov_on_map_ned_m2

    assert_allclose(found.mean(axis=0), TRUE, atol=0.06)
    assert_allclose(np.cov(found.T), stated, atol=0.06 * np.trace(stated))


def test_hovering_gains_nothing_and_another_pass_does() -> None:
    slow = np.diag([1.0, 1.0, 0.2])
    own = 1e-4 * np.eye(3)
    hover = [_sighting(TRUE, own, slow, 0.1 * n, click=n) for n in range(20)]
    passes = [_sighting(TRUE, own, slow, 200.0 * n, click=n) for n in range(20)]

    assert fuse(hover).cov_on_map_ned_m2[0, 0] > 0.95
    assert fuse(passes).cov_on_map_ned_m2[0, 0] == pytest.approx(1.0 / 20.0, rel=0.05)
    assert fuse(hover).effective == pytest.approx(1.0, abs=0.1)


def test_a_crowd_from_one_place_does_not_outvote_the_others() -> None:
    slow = np.diag([1.0, 1.0, 0.2])
    crowd = [_sighting(TRUE + np.array([1.5, 0.0, 0.0]), 1e-4 * np.eye(3), slow, 0.01 * n, click=n) for n in range(20)]
    other = _sighting(TRUE - np.array([1.5, 0.0, 0.0]), 1e-4 * np.eye(3), slow, 500.0, click=99)

    assert_allclose(fuse([*crowd, other]).pos_ned_m, TRUE, atol=0.1)


def test_the_click_and_the_height_are_shared_by_the_methods() -> None:
    """Of one click, two methods err alike by pixel and height: the second tells nothing of these."""
    way = np.array([2.0, 0.0, 1.0])
    one = _sighting(TRUE, 4.0 * np.eye(3), 0.01 * np.eye(3), kind=REGISTERED, way=way)
    both = fuse([one, replace(one, kind=RAY)], config=FusionConfig(cross=0.0))

    assert_allclose(both.cov_on_map_ned_m2, 4.0 * np.eye(3) + np.outer(way, way), atol=0.03)


def test_false_matches_do_not_move_the_target() -> None:
    rng = np.random.default_rng(3)
    own = np.diag([1.0, 1.0, 0.1])
    good = [
        _sighting(TRUE + rng.normal(size=3) * np.array([1.0, 1.0, 0.3]), own, at_m=1e4 * n, click=n) for n in range(14)
    ]
    false = [
        _sighting(TRUE + np.array([30.0 + n, -25.0, 0.0]), own, at_m=-1e4 * n - 1e4, click=50 + n) for n in range(6)
    ]

    mixed = fuse([*false, *good])

    assert np.linalg.norm(mixed.pos_ned_m[:2] - TRUE[:2]) < 1.0
    assert np.linalg.norm(fuse([*false, *good], config=SURE).pos_ned_m[:2] - TRUE[:2]) > 8.0
    assert mixed.weights[:6].max() < 0.02
    assert mixed.weights[6:].mean() > 0.7


def test_the_maps_offset_is_kept_apart_and_is_not_averaged_away() -> None:
    many = [_sighting(TRUE, np.eye(3), at_m=1e4 * n, click=n) for n in range(40)]
    found = fuse(many, map_offset_std_m=2.0)

    assert found.cov_on_map_ned_m2[0, 0] < 0.05
    assert_allclose(found.cov_ned_m2[:2, :2] - found.cov_on_map_ned_m2[:2, :2], 4.0 * np.eye(2))
    assert found.cov_ned_m2[2, 2] == found.cov_on_map_ned_m2[2, 2]


def test_only_so_many_are_kept_and_they_are_the_ones_from_apart() -> None:
    fusion = TargetFusion(config=FusionConfig(most=10))
    for n in range(30):
        fusion.add(_sighting(TRUE, np.eye(3), at_m=0.01 * n if n < 25 else 100.0 * n, click=n))

    assert len(fusion.sightings) == 10
    assert {2500.0, 2600.0, 2700.0, 2800.0, 2900.0} < {float(s.seen_from_ned_m[0]) for s in fusion.sightings}


def test_what_cannot_be_is_refused() -> None:
    with pytest.raises(ValueError, match="no sighting"):
        TargetFusion().result()
    with pytest.raises(ValueError, match="not finite"):
        fuse([_sighting(np.array([np.nan, 0.0, 0.0]), np.eye(3))])
    with pytest.raises(ValueError, match="cross"):
        FusionConfig(cross=1.5)
