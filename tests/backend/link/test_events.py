from backend.link.events import CommandResult, CommandStatus


def test_only_progress_is_not_final() -> None:
    open_ones = [s for s in CommandStatus if not CommandResult(0, 1, 1, 400, s, "").final]

    assert open_ones == [CommandStatus.IN_PROGRESS]
