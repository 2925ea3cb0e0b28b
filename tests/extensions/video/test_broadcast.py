"""One encode for all who want the same, the newest for the slow, nothing for nobody."""

from __future__ import annotations

import os
import threading
from collections.abc import AsyncIterator, Callable
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

import anyio
import anyio.lowlevel
import pytest

from rwt.media.broadcast import Broadcast, EncoderThreads, Viewer
from rwt.media.encoders.encoded import Encoded, Encoder, Track
from rwt.media.errors import ImageUnreadable
from rwt.media.stream_metrics import MAX_STREAMS, Counts, StreamMetrics
from rwt.media.stream_request import read_request
from rwt_graph import MemoryGraph, Node, SimulatedClock
from tests.page_readers import CountedWork
from tests.waiting import until

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload

pytestmark = pytest.mark.anyio


TRACK = Track("vp8", 2, 2)


@dataclass
class CountingEncoder(Encoder):
    """Makes of each picture its first byte; a picture of a 255 is unreadable, one of a 254 is left out."""

    video: bool
    keys: list[bool] = field(default_factory=list)
    threads: set[int] = field(default_factory=set)
    bitrate: int | None = None

    def encode(self, payload: Payload, at_ms: int, *, key: bool) -> Encoded | None:
        self.keys.append(key)
        self.threads.add(threading.get_ident())
        message: Any = payload.value()
        data = bytes(message.data)
        if data == b"\xff":
            raise ImageUnreadable("torn")
        if data == b"\xfe":
            return None
        return Encoded(data, 0, at_ms, track=TRACK if self.video else None, key=key or not self.video)


@dataclass
class Studio:
    graph: MemoryGraph
    clock: SimulatedClock
    camera: Node
    encoder: CountingEncoder
    broadcast: Broadcast
    counts: Counts
    ended: list[bool]
    publish: Callable[[int], None]

    def join(self, work: CountedWork | None = None) -> Viewer:
        return self.broadcast.join(work or CountedWork())

    def listeners(self) -> int:
        topic = self.graph.topic("/a")
        return len(topic.subscribers) if topic else 0

    async def failures(self, count: int) -> None:
        """Wait until so many images could not be encoded."""
        await until(lambda: self.counts.failed == count)

    async def encoded(self, count: int) -> None:
        """Wait until so many images are encoded."""
        await until(lambda: self.counts.encoded == count)


async def _settle() -> None:
    """Long enough for a worker thread that should not be at work."""
    for _ in range(20):
        await anyio.sleep(0.001)


async def _studio(query: str, video: bool) -> AsyncIterator[Studio]:
    clock = SimulatedClock()
    async with MemoryGraph(clock=clock) as graph:
        camera, node = Node(graph, "camera"), Node(graph, "server")
        pictures = camera.advertise("/a", "sensor_msgs/Image")
        encoder, counts, ended = CountingEncoder(video), Counts(), list[bool]()
        broadcast = Broadcast(
            node,
            read_request(query),
            lambda: encoder,
            EncoderThreads(),
            counts,
            lambda: ended.append(True),
            clock.monotonic,
        )

        def publish(number: int) -> None:
            pictures.publish({"width": 1, "height": 1, "encoding": "mono8", "data": bytes((number,))})

        yield Studio(graph, clock, camera, encoder, broadcast, counts, ended, publish)
        broadcast.end()


@pytest.fixture
async def stills(anyio_backend: str) -> AsyncIterator[Studio]:
    async for studio in _studio("topic=/a", video=False):
        yield studio


@pytest.fixture
async def video(anyio_backend: str) -> AsyncIterator[Studio]:
    async for studio in _studio("topic=/a&type=vp8", video=True):
        yield studio


async def _next(viewer: Viewer) -> int | None:
    with anyio.fail_after(20):
        picture = await viewer.next()
    return None if picture is None else picture.data[0]


async def test_many_viewers_and_one_encode_off_the_loops_thread(stills: Studio) -> None:
    viewers = [stills.join() for _ in range(10)]
    for number in range(3):
        stills.publish(number)
        with anyio.fail_after(20):
            shown = [await viewer.next() for viewer in viewers]
        assert all(picture is shown[0] for picture in shown)
        assert shown[0] is not None and shown[0].data == bytes((number,))
    assert len(stills.encoder.keys) == stills.counts.encoded == 3
    assert threading.get_ident() not in stills.encoder.threads


async def test_a_slow_viewer_gets_the_newest_and_costs_no_encodes(stills: Studio) -> None:
    viewer = stills.join()
    stills.publish(0)
    await until(lambda: stills.counts.encoded == 1)
    for number in range(1, 100):
        stills.publish(number)
        if number % 10 == 0:
            await _settle()
    assert stills.counts.encoded == 1
    assert stills.counts.skipped == 98
    assert await _next(viewer) == 0
    assert await _next(viewer) == 99
    assert stills.counts.encoded == 2


async def test_a_slow_viewer_beside_a_fast_one_loses_only_its_own(stills: Studio) -> None:
    slow, fast = stills.join(), stills.join()
    for number in range(10):
        stills.publish(number)
        assert await _next(fast) == number
    assert await _next(slow) == 9
    assert stills.counts.dropped == 9
    assert stills.counts.skipped == 0


async def test_a_viewer_who_joins_late_sees_the_last_picture_at_once(stills: Studio) -> None:
    first = stills.join()
    stills.publish(7)
    assert await _next(first) == 7
    assert await _next(stills.join()) == 7
    assert stills.counts.encoded == 1


async def test_the_last_who_leaves_stops_everything(stills: Studio) -> None:
    one, two = stills.join(), stills.join()
    assert stills.listeners() == 1
    one.leave()
    one.leave()
    assert stills.listeners() == 1
    stills.publish(1)
    assert await _next(two) == 1
    two.leave()
    assert stills.ended == [True]
    assert stills.listeners() == 0
    stills.publish(2)
    await _settle()
    assert stills.counts.encoded == 1
    assert await _next(two) is None


async def test_who_is_waiting_when_it_ends_is_let_go(stills: Studio) -> None:
    viewer = stills.join()
    async with anyio.create_task_group() as tasks:

        async def wait() -> None:
            assert await _next(viewer) is None

        tasks.start_soon(wait)
        await anyio.lowlevel.checkpoint()
        stills.broadcast.end()


async def test_an_unreadable_first_picture_is_the_end_and_a_later_one_is_left_out(
    stills: Studio, caplog: pytest.LogCaptureFixture
) -> None:
    viewer = stills.join()
    stills.publish(1)
    assert await _next(viewer) == 1
    for count in (1, 2):
        stills.publish(255)
        await stills.failures(count)
    stills.publish(2)
    assert await _next(viewer) == 2
    assert [record.getMessage() for record in caplog.records].count("/a: torn") == 1


async def test_an_unreadable_first_picture(video: Studio) -> None:
    viewer = video.join()
    video.publish(255)
    assert await _next(viewer) is None
    assert str(viewer.failure) == "torn"
    assert video.ended == [True]


# -- video --------------------------------------------------------------------------------------------------


async def test_a_video_begins_with_a_key_picture_for_everybody(video: Studio) -> None:
    one = video.join()
    video.publish(0)
    assert await _next(one) == 0
    video.publish(1)
    assert await _next(one) == 1
    two = video.join()
    # The last picture is made again as a key picture, for the camera may be silent.
    assert (await _next(two), await _next(one)) == (1, 1)
    video.publish(2)
    assert (await _next(two), await _next(one)) == (2, 2)
    assert video.encoder.keys == [True, False, True, False]


async def test_a_slow_viewer_of_a_video_gets_fewer_pictures_and_no_gap(video: Studio) -> None:
    viewer = video.join()
    for number in range(4):
        video.publish(number)
        await video.encoded(number + 1)
    for number in range(4, 20):
        video.publish(number)
    assert [await _next(viewer) for _ in range(4)] == [0, 1, 2, 3]
    assert await _next(viewer) == 19
    assert video.counts.dropped == 0
    assert video.encoder.keys.count(True) == 1


async def test_a_slow_viewer_beside_a_fast_one_goes_on_at_the_next_key_picture(video: Studio) -> None:
    slow, fast = video.join(), video.join()
    for number in range(5):
        video.publish(number)
        assert await _next(fast) == number
    # The slow one's queue was full: it is empty now, and a key picture is made, but not at once.
    assert video.counts.dropped == 5
    video.publish(5)
    assert await _next(fast) == 5
    video.clock.advance(0.6)
    video.publish(6)
    assert await _next(fast) == 6
    video.publish(7)
    assert await _next(fast) == 7
    assert video.encoder.keys == [True, False, False, False, False, False, True, False]
    assert (await _next(slow), await _next(slow)) == (6, 7)


async def test_what_is_late_is_left_out_up_to_a_new_key_picture(video: Studio) -> None:
    viewer = video.join()
    for number in range(4):
        video.publish(number)
        await video.encoded(number + 1)
    assert await _next(viewer) == 0
    viewer.skip_late()
    assert await _next(viewer) == 1
    video.clock.advance(1.0)  # Its connection takes no more meanwhile.
    viewer.skip_late()
    assert video.counts.dropped == 2
    video.publish(4)
    assert await _next(viewer) == 4
    assert video.encoder.keys == [True, False, False, False, True]


async def test_a_key_picture_takes_the_place_of_what_waits(video: Studio) -> None:
    slow, fast = video.join(), video.join()
    for number in range(3):
        video.publish(number)
        assert await _next(fast) == number
    third = video.join()
    assert await _next(third) == 2
    assert await _next(slow) == 2
    assert video.counts.dropped == 3


async def test_a_picture_that_the_codec_leaves_out_is_missed_by_nobody(video: Studio) -> None:
    viewer = video.join()
    video.publish(0)
    assert await _next(viewer) == 0
    video.publish(254)
    await until(lambda: video.counts.skipped == 1)
    video.publish(1)
    assert await _next(viewer) == 1


# -- counting ----------------------------------------------------------------------------------------------


def test_counts_are_kept_apart_up_to_a_bound() -> None:
    metrics = StreamMetrics()
    for number in range(MAX_STREAMS + 10):
        metrics.of(f"/t{number}", "mjpeg").encoded += 1
    assert metrics.of("/t3", "mjpeg").encoded == 1
    encoded = next(
        family for family in metrics.families([]) if family[0] == "rwt_video_encoded_pictures_total"
    )
    values = {labels["topic"]: value for labels, value in encoded[3]}
    assert values["/t3"] == 1
    assert values[""] == 10
    assert len(values) == MAX_STREAMS + 1


async def test_viewers_share_the_work_of_the_encoder(stills: Studio) -> None:
    works = [CountedWork() for _ in range(4)]
    viewers = [stills.join(work) for work in works]
    stills.publish(1)
    assert [await _next(viewer) for viewer in viewers] == [1] * 4
    assert works[0].seconds > 0.0
    assert {work.seconds for work in works} == {works[0].seconds}


async def test_pictures_for_viewers_beyond_their_rate_are_made_one_at_a_time() -> None:
    threads = EncoderThreads()
    at_work, most, seen = threading.Semaphore(0), [0], list[int]()
    lock = threading.Lock()

    def encode() -> None:
        with lock:
            seen.append(1)
            most[0] = max(most[0], sum(seen))
        at_work.acquire(timeout=0.02)
        with lock:
            seen.append(-1)

    beyond, within = CountedWork(1.0), CountedWork()
    async with anyio.create_task_group() as tasks:
        for _ in range(8):
            tasks.start_soon(threads.run, encode, (beyond,))
    assert most == [1]
    both = threading.Barrier(2, timeout=60)
    if (os.cpu_count() or 1) > 1:
        async with anyio.create_task_group() as tasks:
            tasks.start_soon(threads.run, both.wait, (beyond,))
            tasks.start_soon(threads.run, both.wait, (beyond, within))
