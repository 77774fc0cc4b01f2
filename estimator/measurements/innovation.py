"""What every measurement gives the filter."""

from __future__ import annotations

from dataclasses import dataclass

from estimator.types import Float


@dataclass(frozen=True, slots=True, eq=False)
class Innovation:
    """Innovation z (m,), Jacobian H (m, n) and noise covariance R (m, m).

    ``R_one`` (m, m) is what one reading errs by, where R is wider because readings in a row err alike; else None.
    """

    z: Float
    H: Float
    R: Float
    R_one: Float | None = None
