"""Hypothesis strategies for attitudes and vectors."""

import math

import numpy as np
from hypothesis import strategies as st

from estimator.geometry.rotation import q_from_rotvec


def vectors(limit: float = 1e3) -> st.SearchStrategy[np.ndarray]:
    """Vectors (3,) with components up to ``limit``."""
    component = st.floats(-limit, limit)
    return st.tuples(component, component, component).map(np.array)


def attitudes() -> st.SearchStrategy[np.ndarray]:
    """Unit quaternions (4,)."""
    return vectors(math.pi).map(q_from_rotvec)
