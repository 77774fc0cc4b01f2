import numpy as np
from numpy.testing import assert_allclose

from estimator.registration.mind import OFFSETS, self_similarity
from tests.estimator.registration.textured_map import MAP


def test_reversed_contrast_changes_nothing() -> None:
    channels = self_similarity(MAP.image)
    reversed_ = self_similarity(255 - MAP.image)

    assert channels.shape == (len(OFFSETS), *MAP.image.shape)
    # smoothing rounds to whole grey levels, differently for a picture and its negative
    assert_allclose(reversed_, channels, atol=0.12)
    assert np.abs(reversed_ - channels).mean() < 0.01


def test_a_picture_is_most_like_itself_where_it_lies() -> None:
    channels = self_similarity(MAP.image)[:, 50:350, 50:350]
    moved = [
        float((channels[:, 40:260, 40:260] * channels[:, 40 + d : 260 + d, 40:260]).sum()) for d in (-9, -3, 0, 3, 9)
    ]

    assert int(np.argmax(moved)) == 2
    assert moved[2] > 2.0 * max(moved[0], moved[4])
