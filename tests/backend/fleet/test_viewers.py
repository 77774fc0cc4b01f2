"""Viewers get whole groups of pictures, whatever their pace."""

import asyncio

from backend.fleet.viewers import MAX_WAITING_FRAMES, Audience, Viewer
from backend.video.frames import EncodedFrame

GROUP = 10


def frame(n: int, size: int = 100) -> EncodedFrame:
    return EncodedFrame(n, 1, n * 40_000, n * 40_000, "h264", "avc1.64001e", n % GROUP == 0, 640, 480, b"x" * size)


async def drain(viewer: Viewer) -> list[int]:
    viewer.close()
    taken = []
    while (got := await viewer.take()) is not None:
        taken.append(got.frame_id)
    return taken


async def test_the_first_frame_is_a_key_frame() -> None:
    viewer = Viewer()
    for n in range(3, 15):
        viewer.put(frame(n))

    assert await drain(viewer) == [10, 11, 12, 13, 14]
    assert viewer.dropped == 7


async def test_a_slow_viewer_continues_at_a_key_frame() -> None:
    viewer = Viewer()
    for n in range(MAX_WAITING_FRAMES + 5):
        viewer.put(frame(n))
    for n in range(MAX_WAITING_FRAMES + 5, MAX_WAITING_FRAMES + 13):
        viewer.put(frame(n))

    taken = await drain(viewer)

    assert taken[0] % GROUP == 0
    assert taken == list(range(taken[0], MAX_WAITING_FRAMES + 13))


async def test_large_frames_are_bounded_by_bytes() -> None:
    viewer = Viewer()
    for n in range(GROUP):
        viewer.put(frame(n, size=1_500_000))

    assert len(await drain(viewer)) <= 2


async def test_a_newcomer_sees_the_present_picture_at_once() -> None:
    audience = Audience()
    for n in range(14):
        audience.show(frame(n))

    viewer = audience.join()
    audience.show(frame(14))

    assert await drain(viewer) == [10, 11, 12, 13, 14]


async def test_one_stuck_viewer_does_not_touch_another() -> None:
    audience = Audience()
    stuck, reading = audience.join(), audience.join()
    taken = []
    for n in range(200):
        audience.show(frame(n))
        taken.append((await asyncio.wait_for(reading.take(), 5)).frame_id)  # type: ignore[union-attr]

    assert taken == list(range(200))
    assert stuck.dropped > 0


async def test_after_a_jump_nothing_old_is_shown() -> None:
    audience = Audience()
    viewer = audience.join()
    for n in range(5):
        audience.show(frame(n))
    audience.restart()
    for n in range(107, 113):
        audience.show(frame(n))

    assert await drain(viewer) == [110, 111, 112]
