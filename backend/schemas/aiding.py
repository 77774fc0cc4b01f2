"""Bodies about telling an autopilot's own filter where the vehicle is."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel

FormName = Literal["external_position", "odometry", "gps_input", "global_position_sensor"]


class PositionAidingBody(BaseModel):
    """How it stands; the fields of the stream's ``aiding`` message.

    ``reason`` says why nothing is sent now. ``accepted`` and ``refused`` count the autopilot's answers, to
    ``external_position`` only. ``gap_…_m`` are from the estimate to where the autopilot has itself, when it began and
    now. ``effect`` is whether the autopilot uses it, and ``effect_text`` why that is said.
    """

    vehicle_id: str
    on: bool
    form: FormName | None
    last_resort: bool
    sending: bool
    sent: int
    reason: str
    accepted: int
    refused: int
    gap_began_m: float | None
    gap_now_m: float | None
    std_horizontal_m: float | None
    effect: Literal["used", "not_used", "cannot_tell"]
    effect_text: str


class CheckedBody(BaseModel):
    """A parameter that counts; ``ok`` is null where the vehicle does not say."""

    name: str
    value: float | None
    should_be: str
    ok: bool | None
    text: str


class AidingCheckBody(BaseModel):
    """Whether an autopilot can be told in one form.

    ``forms`` are those that it takes, the best first. ``parameters_ok`` is null where one is not known and none is
    wrong. ``to_do`` is what else there is to do, ``objection`` why it cannot be begun now; both may be empty.
    """

    forms: list[FormName]
    form: FormName
    last_resort: bool
    parameters: list[CheckedBody]
    parameters_ok: bool | None
    to_do: str
    objection: str
    status: PositionAidingBody
