"""Errors of the estimator.

GeometryError     a geometric quantity that does not exist for the input given
CalibrationError  a calibration that is missing or cannot be used as it is written
"""


class GeometryError(ValueError):
    """A geometric quantity that does not exist for the input given."""


class CalibrationError(ValueError):
    """A calibration that is missing or cannot be used as it is written."""

    def __init__(self, source: str, problem: str) -> None:
        super().__init__(f"calibration '{source}': {problem}")
        self.source = source
        self.problem = problem
