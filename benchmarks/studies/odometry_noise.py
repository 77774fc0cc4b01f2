"""The thesis's error analysis of its odometry (section 5.6.1, figures 5.6 to 5.11), for every odometer.

Features are drawn over a 360 x 288 picture of a level nadir camera, or over its left part, the camera does not move,
and noise is added to the pixels of both pictures and to the attitude of both. What comes out is the standard deviation
of the translation at unit depth.
"""

from __future__ import annotations

import numpy as np

from estimator.geometry.rotation import matrix_from_q, q_from_euler
from estimator.odometry.odometers import odometer
from estimator.types import Float

WIDTH_PX, HEIGHT_PX = 360, 288
FOCAL_PX = WIDTH_PX / 2.0 / np.tan(np.radians(45.0) / 2.0)
"""The thesis names about 45 degrees across."""
LEFT_SHARE = 0.35
TRIALS = 250
DEPTH_M = 100.0


def translation_noise(
    seed: int, method: str, features: int, pixel_std_px: float, attitude_std_deg: float, left: bool
) -> dict[str, float]:
    """Standard deviation of the translation along the picture's axes over the depth, and the share of trials solved.

    ``sigma_x`` is along the picture's rows, where features to the left tell less, ``sigma_y`` down its columns;
    ``stated`` is what the odometer itself says of pixel noise, along x.
    """
    rng = np.random.default_rng([seed, features, round(10 * pixel_std_px), round(100 * attitude_std_deg), left])
    solve = odometer(method)
    pos = np.array([0.0, 0.0, -DEPTH_M])
    found, stated = [], []
    width = WIDTH_PX * (LEFT_SHARE if left else 1.0)
    for _ in range(TRIALS):
        uv = rng.uniform((0.0, 0.0), (width, HEIGHT_PX), size=(features, 2))
        views = []
        for _ in range(2):
            attitude = np.radians(attitude_std_deg) * rng.standard_normal(3)
            views.append(_rays(uv + rng.normal(0.0, pixel_std_px, uv.shape), attitude))
        noise_rad = max(pixel_std_px, 0.05) / FOCAL_PX
        residual = solve(views[0], views[1], pos, pos, _flat, noise_rad, 0.0)
        if residual is not None:
            found.append(residual.residual_ne_m / DEPTH_M)
            stated.append(residual.cov_m2[1, 1] / DEPTH_M**2)
    if len(found) < 2:
        return {"solved": len(found) / TRIALS}
    sigma_y, sigma_x = np.std(np.array(found), axis=0)
    return {
        "sigma_x": float(sigma_x),
        "sigma_y": float(sigma_y),
        "stated": float(np.sqrt(np.mean(stated))),
        "solved": len(found) / TRIALS,
    }


def _rays(uv_px: Float, attitude_rad: Float) -> Float:
    """Unit rays (n, 3) in NED of pixels, of a camera whose rows run east, its attitude wrong by small Euler angles."""
    x = (uv_px[:, 0] - WIDTH_PX / 2.0) / FOCAL_PX
    y = (uv_px[:, 1] - HEIGHT_PX / 2.0) / FOCAL_PX
    rays = np.stack((-y, x, np.ones(len(x))), axis=-1)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    turned: Float = rays @ matrix_from_q(q_from_euler(*attitude_rad)).T
    return turned


def _flat(north_m: Float, _east_m: Float) -> Float:
    return np.zeros_like(north_m)
