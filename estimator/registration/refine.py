"""Sub-window refinement: one picture as a measurement of the camera's whole pose.

The coarse match says where the template lies as a whole. Here it is cut into windows, each is correlated with the map
in the neighbourhood of the coarse match, and the camera pose is sought whose ground displacements J x climb the sum of
the windows' surfaces. A shift of the aircraft moves all windows alike, a turn, a tilt and a wrong height do not, so the
picture itself tells them apart (Pilotage methods, section 2.2, "6-DoF").

How far to trust the sum is not a constant: at the best pose the windows' own gradients scatter about zero, and their
scatter against their curvature gives the temperature of the likelihood (the information equality of a well specified
model, used backwards; White, Maximum likelihood estimation of misspecified models, Econometrica 50, 1982).
"""

from __future__ import annotations

from dataclasses import dataclass

import cv2
import numpy as np
from numpy.typing import NDArray

from estimator.registration.channels import Channels
from estimator.types import Float


@dataclass(frozen=True, slots=True)
class RefineConfig:
    """Windows and iterations; pixels are those of the template, and so many ``windows`` are aimed at."""

    windows: int = 30
    min_window_px: int = 12
    max_window_px: int = 32
    reach_px: int = 6
    min_cover: float = 0.5
    min_windows: int = 8
    iterations: int = 6
    max_step_px: float = 1.5
    inlier_px: float = 2.0


@dataclass(frozen=True, slots=True, eq=False)
class Windows:
    """Similarity surfaces of the template's windows about a common displacement.

    ``surface`` (k, n, n) over displacements of -reach to +reach pixels, rows to the south; ``row``, ``col`` (k,) are
    the windows' centres in the template.
    """

    surface: NDArray[np.float32]
    row: Float
    col: Float


@dataclass(frozen=True, slots=True, eq=False)
class Refinement:
    """Camera pose error as one picture has it.

    ``x`` (6,) is the most likely error (true minus predicted: position NED in metres, of which down means height above
    what is seen, then rotation about the NED axes) under prior and picture. ``best`` (6,) is what the picture alone
    says, with ``information`` (6, 6); both are without the prior. ``agreement`` is the share of the windows whose own
    best place lies near the common one.
    """

    x: Float
    best: Float
    information: Float
    agreement: float
    windows: int


def cut_windows(
    template: Channels, mask: NDArray[np.bool_], search: Channels, row: int, col: int, config: RefineConfig
) -> Windows | None:
    """Correlate windows of a template (c, rows, cols) with the searched channels about the offset (row, col).

    ``search`` is the larger area; offset (0, 0) puts the template's first pixel on the area's. None where too few
    windows hold picture, or the offset leaves no room about it.
    """
    rows, cols = mask.shape
    wanted_px = round(float(np.sqrt(mask.sum() / config.windows)))
    size, reach = int(np.clip(wanted_px, config.min_window_px, config.max_window_px)), config.reach_px
    count_r, count_c = rows // size, cols // size
    if count_r * count_c < config.min_windows:
        return None
    first_r, first_c = (rows - count_r * size) // 2, (cols - count_c * size) // 2
    masked = template * mask
    surfaces, at_r, at_c = [], [], []
    for i in range(count_r):
        for j in range(count_c):
            r, c = first_r + i * size, first_c + j * size
            if mask[r : r + size, c : c + size].mean() < config.min_cover:
                continue
            top, left = r + row - reach, c + col - reach
            bottom, right = top + size + 2 * reach, left + size + 2 * reach
            if top < 0 or left < 0 or bottom > search.shape[1] or right > search.shape[2]:
                continue
            around = search[:, top:bottom, left:right]
            window = masked[:, r : r + size, c : c + size]
            surface = sum(
                cv2.matchTemplate(np.ascontiguousarray(a), np.ascontiguousarray(w), cv2.TM_CCORR)
                for a, w in zip(around, window, strict=True)
            )
            surfaces.append(surface)
            at_r.append(r + 0.5 * (size - 1))
            at_c.append(c + 0.5 * (size - 1))
    if len(surfaces) < config.min_windows:
        return None
    return Windows(np.array(surfaces, dtype=np.float32), np.array(at_r), np.array(at_c))


def refine(
    windows: Windows, jacobian_px: Float, offset_px: Float, start: Float, prior_information: Float, config: RefineConfig
) -> Refinement | None:
    """Find the pose error that the windows and the prior agree on.

    Parameters
    ----------
    windows
        Surfaces of k windows.
    jacobian_px
        Displacement of each window (k, 2, 6), rows and columns, by the pose error.
    offset_px
        Displacement (k, 2) at which a window's surface has its middle: window k is at surface position
        jacobian_px[k] x - offset_px[k] from it.
    start
        Pose error (6,) to start from.
    prior_information
        Inverse covariance (6, 6) of the pose error before this picture; its mean is zero.

    Returns
    -------
    Refinement or None
        None where the windows do not hold together.
    """
    fields = _fields(windows.surface)
    x = start.copy()
    reach = config.reach_px
    for step in range(config.iterations + 1):
        at = np.einsum("kij,j->ki", jacobian_px, x) - offset_px
        usable = (np.abs(at) <= reach - 1.0).all(axis=1)
        if usable.sum() < config.min_windows:
            return None
        g, M = _slopes(fields, at, reach)
        J, g, M = jacobian_px[usable], g[usable], M[usable]
        A = np.einsum("kia,kij,kjb->ab", J, M, J)
        B = np.einsum("kia,ij,kjb->ab", J, _scatter(g), J)
        spread = np.linalg.inv(B + np.diag(1e-9 * np.diag(B)))
        information = A @ spread @ A
        gain = A @ spread @ np.einsum("kij,ki->j", J, g)
        if step == config.iterations:
            break
        dx = np.linalg.solve(information + prior_information, gain - prior_information @ x)
        moved = np.abs(np.einsum("kij,j->ki", jacobian_px, dx)).max()
        x = x + dx * min(1.0, config.max_step_px / max(moved, 1e-9))
    information = 0.5 * (information + information.T)
    eigenvalues, axes = np.linalg.eigh(information)
    known = eigenvalues > 1e-9 * max(float(eigenvalues[-1]), 1e-12)
    best = x + axes[:, known] @ ((axes[:, known].T @ gain) / eigenvalues[known])
    agreement = _agreement(windows.surface, at, usable, reach, config.inlier_px)
    return Refinement(x, best, information, agreement, int(usable.sum()))


def _fields(surface: NDArray[np.float32]) -> NDArray[np.float32]:
    """Value, slopes and curvatures (6, k, n, n) of surfaces by central differences, after a light smoothing."""
    smooth = np.stack([cv2.GaussianBlur(one, (0, 0), 0.8) for one in surface])
    d_r = np.gradient(smooth, axis=1)
    d_c = np.gradient(smooth, axis=2)
    fields = (smooth, d_r, d_c, np.gradient(d_r, axis=1), np.gradient(d_c, axis=2), np.gradient(d_r, axis=2))
    return np.stack(fields).astype(np.float32)


def _slopes(fields: NDArray[np.float32], at_px: Float, reach: int) -> tuple[Float, Float]:
    """Gradient (k, 2) and negative curvature (k, 2, 2) at places relative to the middle."""
    k = fields.shape[1]
    where = np.clip(at_px + reach, 0.0, 2.0 * reach - 1e-3)
    low = where.astype(int)
    share = where - low
    index = np.arange(k)
    out = np.zeros((6, k))
    for dr in (0, 1):
        for dc in (0, 1):
            weight = np.abs(1 - dr - share[:, 0]) * np.abs(1 - dc - share[:, 1])
            out += fields[:, index, low[:, 0] + dr, low[:, 1] + dc] * weight
    g = out[1:3].T.copy()
    M = -np.stack((np.stack((out[3], out[5]), -1), np.stack((out[5], out[4]), -1)), -2)
    return g, M


def _scatter(g: Float) -> Float:
    """Covariance (2, 2) of the windows' gradients about zero, with the degrees of freedom that the pose took."""
    count = len(g)
    scatter: Float = g.T @ g / max(count - 3, 1)
    return scatter + np.eye(2) * (1e-6 * float(np.trace(scatter)) + 1e-12)


def _agreement(
    surface: NDArray[np.float32], at_px: Float, usable: NDArray[np.bool_], reach: int, inlier_px: float
) -> float:
    k, n, _ = surface.shape
    peak = surface.reshape(k, -1).argmax(axis=1)
    place = np.stack((peak // n - reach, peak % n - reach), axis=-1)
    near = np.hypot(*(place - at_px).T) <= inlier_px
    return float(near[usable].mean())
