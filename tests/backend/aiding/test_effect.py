"""What is said of the effect, from what is known."""

from typing import Any

import pytest

from backend.aiding.effect import SETTLED_US, Effect, Evidence, judge


def seen(**known: Any) -> Evidence:
    usual: dict[str, Any] = {
        "sending": True, "sending_us": 2 * SETTLED_US, "sent": 40, "answers": None, "gap_began_m": 60.0,
        "gap_now_m": 3.0, "std_m": 1.0,
    }  # fmt: skip
    return Evidence(**{**usual, **known})


@pytest.mark.parametrize(
    ("known", "effect", "words"),
    [
        ({}, Effect.USED, "was 60 m from the estimate, and is 3 m"),
        ({"sending_us": 500_000}, Effect.USED, "was 60 m"),
        ({"gap_now_m": 61.0}, Effect.NOT_USED, "61 m from the estimate"),
        ({"gap_now_m": 61.0, "sending_us": 500_000}, Effect.CANNOT_TELL, "wait some seconds"),
        ({"gap_began_m": 2.0}, Effect.CANNOT_TELL, "as near before"),
        ({"gap_began_m": None}, Effect.CANNOT_TELL, "as near before"),
        ({"gap_now_m": None}, Effect.CANNOT_TELL, "does not say where it has itself"),
        ({"sending": False}, Effect.CANNOT_TELL, "nothing is sent now"),
        ({"gap_now_m": 9.0, "std_m": 4.0}, Effect.USED, "is 9 m"),
        ({"answers": (9, 0, ""), "gap_began_m": 2.0}, Effect.USED, "accepts it"),
        ({"answers": (9, 0, ""), "gap_now_m": 61.0}, Effect.NOT_USED, "61 m"),
        ({"answers": (9, 3, "denied")}, Effect.NOT_USED, "refuses it (denied)"),
        ({"answers": (0, 0, ""), "sent": 9}, Effect.NOT_USED, "does not answer"),
        ({"answers": (0, 0, ""), "sent": 1}, Effect.CANNOT_TELL, "not answered yet"),
        ({"answers": (9, 0, ""), "gap_now_m": None}, Effect.CANNOT_TELL, "does not say"),
    ],
)
def test_a_verdict_stands_on_what_is_known(known: dict[str, Any], effect: Effect, words: str) -> None:
    found, text = judge(seen(**known))
    assert found is effect
    assert words in text
