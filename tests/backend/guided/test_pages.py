"""Pages that are there, that hesitate, that have gone."""

import pytest

from backend.guided import pages as module
from backend.guided.pages import GONE_US, SILENT_US, Pages


class Clock:
    now_us = 1_000_000_000

    def __call__(self) -> int:
        return self.now_us


@pytest.fixture
def clock(monkeypatch: pytest.MonkeyPatch) -> Clock:
    found = Clock()
    monkeypatch.setattr(module, "mono_us", found)
    return found


def test_a_page_is_there_while_it_is_heard(clock: Clock) -> None:
    pages = Pages()
    pages.opened("a")
    start_us = clock.now_us

    assert pages.is_there("a", start_us + SILENT_US - 1)
    assert not pages.is_there("a", start_us + SILENT_US)
    clock.now_us += SILENT_US
    pages.heard("a")
    assert pages.is_there("a", clock.now_us)
    assert not pages.is_there("b", clock.now_us)


def test_a_closed_page_has_a_moment_to_come_back(clock: Clock) -> None:
    pages = Pages()
    pages.opened("a")
    pages.closed("a")
    closed_us = clock.now_us

    assert pages.is_there("a", closed_us + GONE_US - 1)
    assert not pages.is_there("a", closed_us + GONE_US)
    clock.now_us += GONE_US // 2
    pages.opened("a")
    assert pages.is_there("a", closed_us + 2 * GONE_US)


def test_a_page_with_two_streams_is_there_until_the_last_is_closed(clock: Clock) -> None:
    """A reconnecting page may open the next before the last one's end is noticed."""
    pages = Pages()
    pages.opened("a")
    pages.opened("a")
    pages.closed("a")

    assert pages.is_there("a", clock.now_us + 3 * GONE_US)


def test_pages_of_the_past_take_no_room(clock: Clock) -> None:
    pages = Pages()
    for number in range(1000):
        pages.opened(str(number))
        pages.closed(str(number))
        clock.now_us += 2 * GONE_US

    assert len(pages._open) + len(pages._heard_us) + len(pages._closed_us) < 10
