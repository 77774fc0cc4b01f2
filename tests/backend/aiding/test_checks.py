"""Parameters held against what they should be."""

import pytest

from backend.aiding.checks import check, names_of, verdict
from backend.link.aiding import FORMS, AidingForm
from backend.link.events import Autopilot

AP, PX4 = Autopilot.ARDUPILOT, Autopilot.PX4
# Those with which the recorded copter flew by ODOMETRY alone, and EKF3 as it comes.
FLEW = {
    "AHRS_EKF_TYPE": 3.0, "VISO_TYPE": 1.0, "VISO_DELAY_MS": 100.0, "EK3_SRC1_POSXY": 6.0, "EK3_SRC1_VELXY": 6.0,
    "EK3_SRC1_POSZ": 1.0, "EK3_SRC1_YAW": 1.0,
}  # fmt: skip


def test_what_was_flown_with_is_right() -> None:
    rows, to_do = check(AP, AidingForm.ODOMETRY, FLEW)
    assert verdict(rows) is True
    assert to_do == ""
    assert {row.name for row in rows} == set(FLEW)


@pytest.mark.parametrize(("name", "value"), [("EK3_SRC1_YAW", 6.0), ("VISO_TYPE", 0.0), ("VISO_DELAY_MS", 250.0)])
def test_one_that_is_wrong_is_named_with_what_it_should_be(name: str, value: float) -> None:
    rows, _ = check(AP, AidingForm.ODOMETRY, {**FLEW, name: value})
    (wrong,) = [row for row in rows if row.ok is False]
    assert (wrong.name, wrong.value) == (name, value)
    assert wrong.text.startswith(f"is {value:g} and should be {wrong.should_be}")
    assert verdict(rows) is False


def test_one_that_is_not_said_is_neither_right_nor_wrong() -> None:
    rows, _ = check(AP, AidingForm.ODOMETRY, {**FLEW, "VISO_TYPE": None})
    (unknown,) = [row for row in rows if row.ok is None]
    assert unknown.text.startswith("the vehicle does not say")
    assert verdict(rows) is None


def test_external_navigation_in_the_second_set_is_found_and_the_switch_named() -> None:
    """As in the recorded flight whose GPS was lost: GPS in the first set, external navigation in the second."""
    second = {name.replace("SRC1", "SRC2"): value for name, value in FLEW.items()}
    values = {**second, "EK3_SRC1_POSXY": 3.0, "EK3_SRC1_VELXY": 3.0, "EK3_SRC1_POSZ": 1.0, "EK3_SRC1_YAW": 1.0}
    rows, to_do = check(AP, AidingForm.ODOMETRY, values)
    assert verdict(rows) is True
    assert "set 2" in to_do


@pytest.mark.parametrize(("value", "ok"), [(0.0, False), (1.0, True), (3.0, True), (2.0, False)])
def test_px4_s_mask_counts_by_its_bit(value: float, ok: bool) -> None:
    rows, _ = check(PX4, AidingForm.GLOBAL_POSITION_SENSOR, {"EKF2_AGP0_CTRL": value})
    assert [row.ok for row in rows] == [ok]


def test_every_form_of_every_autopilot_has_its_names() -> None:
    for autopilot, forms in FORMS.items():
        for form in forms:
            names = names_of(autopilot, form)
            rows, _ = check(autopilot, form, dict.fromkeys(names))
            assert {row.name for row in rows} <= set(names)
            assert verdict(rows) is None
    with pytest.raises(KeyError):
        names_of(PX4, AidingForm.GPS_INPUT)
