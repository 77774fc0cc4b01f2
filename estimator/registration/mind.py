"""Self-similarity channels: a second opinion that owes nothing to gradients.

Heinrich et al., MIND: modality independent neighbourhood descriptor for multi-modal deformable registration, Medical
Image Analysis 16(7), 2012. What a pixel's surroundings have in common with those two pixels further on survives changes
of light, season and sensor.
"""

from __future__ import annotations

import cv2
import numpy as np

from estimator.registration.channels import Channels
from estimator.types import Image

OFFSETS = ((2, 0), (-2, 0), (0, 2), (0, -2), (2, 2), (-2, -2), (2, -2), (-2, 2))
NOISE_VARIANCE = 4.0
"""Grey levels squared: what differs by less is sensor noise."""


def self_similarity(image: Image) -> Channels:
    """Channels (8, rows, cols) exp(-D_r / V) over offsets r, the largest one, their mean taken off.

    D_r is the smoothed squared difference to the picture moved by r, V the mean of all D_r.
    """
    smooth = cv2.GaussianBlur(image, (0, 0), 0.8).astype(np.float32)
    distance = np.stack([cv2.GaussianBlur((smooth - np.roll(smooth, r, (0, 1))) ** 2, (0, 0), 1.2) for r in OFFSETS])
    similarity = np.exp(-distance / (distance.mean(axis=0) + NOISE_VARIANCE))
    similarity /= similarity.max(axis=0)
    return np.asarray(similarity - similarity.mean(axis=0), dtype=np.float32)
