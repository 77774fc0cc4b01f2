import asyncio
import threading

import pytest

from backend.event_loop import call_from_thread


def test_a_thread_reaches_the_loop() -> None:
    async def heard() -> int:
        loop = asyncio.get_running_loop()
        answer = loop.create_future()
        thread = threading.Thread(target=call_from_thread, args=(loop, answer.set_result, 7))
        thread.start()
        return int(await asyncio.wait_for(answer, 5.0))

    assert asyncio.run(heard()) == 7


def test_after_the_end_a_threads_last_value_is_dropped() -> None:
    loop = asyncio.new_event_loop()
    loop.close()
    got: list[int] = []

    call_from_thread(loop, got.append, 7)

    assert got == []


def test_another_error_of_the_loop_is_not_hidden(monkeypatch: pytest.MonkeyPatch) -> None:
    loop = asyncio.new_event_loop()

    def fails(*_: object) -> None:
        raise RuntimeError("something else")

    monkeypatch.setattr(loop, "call_soon_threadsafe", fails)
    try:
        with pytest.raises(RuntimeError, match="something else"):
            call_from_thread(loop, print, 7)
    finally:
        loop.close()
