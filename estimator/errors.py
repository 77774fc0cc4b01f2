"""Errors of the estimator.

GeometryError   a geometric quantity that does not exist for the input given
"""


class GeometryError(ValueError):
    """A geometric quantity that does not exist for the input given."""
