"""Linear measurement update of a Gaussian state."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dposv

from estimator.types import Float


@dataclass(frozen=True, slots=True, eq=False)
class Correction:
    """Result of a measurement update: error-state correction (n,), covariance (n, n) and the squared innovation.

    ``nis`` is the normalised innovation squared, chi-square with m degrees of freedom if the model is right.
    """

    dx: Float
    P: Float
    nis: float


def correct(P: Float, z: Float, H: Float, R: Float, gate: float = np.inf) -> Correction | None:
    """Condition a zero-mean Gaussian error state on a linear measurement.

    Parameters
    ----------
    P
        Prior covariance (n, n).
    z, H, R
        Innovation (m,), Jacobian (m, n), noise covariance (m, m).
    gate
        Largest normalised innovation squared that is accepted.

    Returns
    -------
    Correction or None
        None when the gate rejects the innovation.

    Notes
    -----
    Joseph form, so P stays symmetric and non-negative for any gain. Raises ``numpy.linalg.LinAlgError`` where the
    innovation covariance is not positive definite.
    """
    PHt = P @ H.T
    S = H @ PHt + R
    _, solved, info = dposv(S, np.column_stack((z, PHt.T)))
    if info != 0:
        message = "innovation covariance is not positive definite"
        raise np.linalg.LinAlgError(message)
    nis = float(z @ solved[:, 0])
    if nis > gate:
        return None
    K = solved[:, 1:].T
    A = -K @ H
    A.flat[:: A.shape[0] + 1] += 1.0
    P_new = A @ P @ A.T + K @ R @ K.T
    return Correction(dx=K @ z, P=0.5 * (P_new + P_new.T), nis=nis)
