"""Errors of the simulator: SimulatorError, ScenarioError, LinkAddressError."""

from __future__ import annotations


class SimulatorError(Exception):
    """Base of everything the simulator refuses to do."""


class ScenarioError(SimulatorError):
    """A scenario that cannot be flown: unknown name, unreadable file, or values that contradict each other."""

    def __init__(self, scenario: str, problem: str, advice: str) -> None:
        self.scenario, self.problem, self.advice = scenario, problem, advice
        super().__init__(f"scenario {scenario!r}: {problem}; {advice}")


class LinkAddressError(SimulatorError):
    """An address for MAVLink or video that cannot be understood or opened."""

    def __init__(self, address: str, problem: str, example: str) -> None:
        self.address, self.problem, self.example = address, problem, example
        super().__init__(f"address {address!r}: {problem}; write it like {example}")
