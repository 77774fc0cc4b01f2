import pytest

from backend.link.events import Autopilot, VehicleType
from backend.link.modes import ModeNumbers, mode_name, mode_numbers, vehicle_type_from_heartbeat

ARDUPILOT, PX4 = Autopilot.ARDUPILOT, Autopilot.PX4
HELICOPTER, PLANE, ROTOR = VehicleType.HELICOPTER, VehicleType.FIXED_WING, VehicleType.MULTIROTOR


@pytest.mark.parametrize(
    ("autopilot", "kind", "custom_mode", "name"),
    [
        (ARDUPILOT, HELICOPTER, 4, "GUIDED"),
        (ARDUPILOT, ROTOR, 6, "RTL"),
        (ARDUPILOT, PLANE, 10, "AUTO"),
        (PX4, ROTOR, 4 << 16 | 5 << 24, "AUTO RTL"),
        (PX4, ROTOR, 6 << 16, "OFFBOARD"),
    ],
)
def test_names_and_numbers(autopilot: Autopilot, kind: VehicleType, custom_mode: int, name: str) -> None:
    assert mode_name(autopilot, kind, 0x81, custom_mode) == name
    numbers = mode_numbers(autopilot, kind, name)
    if autopilot is PX4:
        assert numbers.main << 16 | numbers.sub << 24 == custom_mode
    else:
        assert numbers == ModeNumbers(custom_mode)


def test_unknown_modes_are_shown_as_numbers_and_refused_as_names() -> None:
    assert mode_name(ARDUPILOT, ROTOR, 0x81, 250) == "MODE 250"
    assert mode_name(Autopilot.OTHER, ROTOR, 0x81, 3) == "MODE 3"
    assert mode_name(ARDUPILOT, ROTOR, 0x80, 3) == "BASE 128"
    for autopilot in Autopilot:
        with pytest.raises(ValueError, match="no mode 'SIDEWAYS'"):
            mode_numbers(autopilot, ROTOR, "SIDEWAYS")


def test_vehicle_kinds() -> None:
    assert [vehicle_type_from_heartbeat(t) for t in (1, 2, 4, 13, 20, 10)] == [
        PLANE,
        ROTOR,
        HELICOPTER,
        ROTOR,
        VehicleType.VTOL,
        VehicleType.OTHER,
    ]
