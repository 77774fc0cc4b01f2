"""Zero-mean normalised cross-correlation of a masked multi-channel template, by FFT.

Padfield, Masked object registration in the Fourier domain, IEEE Transactions on Image Processing 21(5), 2012, with the
energies of all channels summed.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy import fft

from estimator.registration.channels import Channels

MIN_KNOWN_FRACTION = 0.7


class SearchArea:
    """A searched area with its transforms, so that many templates of one size can be correlated with it."""

    def __init__(self, channels: Channels, valid: NDArray[np.bool_], template_shape: tuple[int, int]) -> None:
        """Channels (c, rows, cols) and their validity (rows, cols); the template must not be larger than the area."""
        rows, cols = valid.shape
        if template_shape[0] > rows or template_shape[1] > cols:
            message = f"template {template_shape} is larger than the searched area {valid.shape}"
            raise ValueError(message)
        self.channels = channels
        self.template_shape = template_shape
        self.out_shape = (rows - template_shape[0] + 1, cols - template_shape[1] + 1)
        self._shape = (fft.next_fast_len(rows, real=True), fft.next_fast_len(cols, real=True))
        known = valid.astype(np.float32)
        masked = channels * known
        self._channels = fft.rfft2(masked, self._shape)
        self._energy = fft.rfft2((masked * masked).sum(axis=0), self._shape)
        spread = np.sqrt(max(float((masked * masked).sum()), 1e-12))
        mean = np.abs(masked.sum(axis=(1, 2))) / np.sqrt(max(float(known.sum()), 1.0))
        # gradient channels average to nothing over any window; grey values do not
        self._has_mean = bool((mean > 0.2 * spread).any())
        self._known = None if valid.all() else fft.rfft2(known, self._shape)

    def correlate(self, template: Channels, mask: NDArray[np.bool_]) -> NDArray[np.float32]:
        """Similarity (rows, cols) at every offset where the template fits; NaN where too little of the map is known.

        Entry (i, j) is for the template's first pixel lying on pixel (i, j) of the area.
        """
        weight = mask.astype(np.float32)
        pixels = float(weight.sum())
        if pixels < 1.0:
            return np.full(self.out_shape, np.nan, dtype=np.float32)
        mean = (template * weight).sum(axis=(1, 2), keepdims=True) / pixels
        centred = (template - mean) * weight
        mask_spectrum = np.conj(fft.rfft2(weight, self._shape))
        spectrum = np.conj(fft.rfft2(centred, self._shape))
        numerator = self._inverse((self._channels * spectrum).sum(axis=0))
        energy = self._inverse(self._energy * mask_spectrum)
        if self._has_mean:
            for channel in self._channels:
                energy = energy - self._inverse(channel * mask_spectrum) ** 2 / pixels
        template_energy = float((centred * centred).sum())
        floor = 1e-6 * pixels
        surface = numerator / np.sqrt(np.maximum(energy, floor) * max(template_energy, floor))
        if self._known is not None:
            known = self._inverse(self._known * mask_spectrum) / pixels
            surface = np.where(known >= MIN_KNOWN_FRACTION, surface, np.nan)
        return np.clip(surface, -1.0, 1.0).astype(np.float32)

    def _inverse(self, spectrum: NDArray[np.complexfloating]) -> NDArray[np.float32]:
        full = fft.irfft2(spectrum, self._shape)
        return np.asarray(full[: self.out_shape[0], : self.out_shape[1]], dtype=np.float32)
