"""Bodies about a vehicle's parameters."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel, ConfigDict, Field


class ParameterBody(BaseModel):
    """A parameter ``asked`` for, and its ``name`` as the vehicle spells it; ``value`` is null where that is not known.

    ``unknown``: the vehicle has none of that name. ``timeout``: it did not answer. ``refused``: ``text`` says why.
    """

    asked: str
    name: str
    value: float | None
    status: Literal["known", "written", "unknown", "refused", "timeout"]
    text: str


class ParameterChange(BaseModel):
    """What a parameter shall be; of an armed vehicle only where ``armed`` says that this is meant."""

    model_config = ConfigDict(extra="forbid")

    value: float = Field(allow_inf_nan=False)
    armed: bool = False
