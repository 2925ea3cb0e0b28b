"""Frames of a hostile hub at a robot, and of a hostile robot at a hub."""

from __future__ import annotations

from contextlib import suppress

from rwt.extensions.hub.feeds import RobotFeeds
from rwt.extensions.hub.uplink.frames import BadFrame
from rwt.extensions.hub.uplink.openings import BadOpening, decode_head, decode_opening
from rwt.extensions.hub.uplink.streams import CREDIT_BYTES, Stream
from rwt.extensions.hub.uplink.uplink import Uplink
from rwt_graph import SimulatedClock
from rwt_protocol.frames import Frame
from rwt_transports import Limits
from rwt_transports.background import ignore
from rwt_transports.scheduler import MESSAGES, Scheduler
from rwt_transports.shared_pool import Holder
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

ROBOT = Holder("192.0.2.9", "")
LIMITS = Limits(message_bytes=20_000, incoming_bytes=100_000)
STREAMS = 3
"""Streams that a hub has opened to its hostile robot."""


class _Reader:
    """Endpoint that keeps nothing."""

    def receive(self, data: bytes, binary: bool) -> None:
        assert len(data) <= LIMITS.message_bytes

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        assert size > limit

    def closed(self, code: int, reason: str) -> None:
        assert 0 <= code < 65536


def uplink(data: bytes) -> None:
    """Frames that 0x1e ends; bit 7 of the first byte chooses the side, bit 6 loses the connection between."""
    pool = LIMITS.receive_pool()
    side = _robot(pool) if data[0] & 0x80 else _hub(pool)
    assert side.carried(0, 0.0)
    frames = data[1:].split(b"\x1e")
    with suppress(BadFrame):
        for number, frame in enumerate(frames):
            if data[0] & 0x40 and number == len(frames) // 2:
                side.lost(float(number))
                if not side.carried(0, float(number)):
                    return
            side.receive(frame, float(number))
            side.tick(float(number))
            sent = side.take(1000, float(number))
            assert sum(map(len, sent)) < 200_000, "an answer larger than its cause"
    side.end(1006, "over")
    assert not side.streams
    with suppress(BadOpening):
        decode_opening(data)
    with suppress(BadOpening):
        decode_head(data)


def _opened(stream: Stream, opening: bytes) -> None:
    stream.admit()
    stream.begin(_Reader())
    member = stream.flow("/topic", on_drop=ignore).enter("/topic")
    if member is not None:
        member.wish(0.0, 0, apart=bool(stream.number & 1))
        member.feed.send(Frame(b"sample"))


def _robot(pool: ReceiveBufferPool) -> Uplink:
    return Uplink("s", LIMITS, pool, lambda: None, repeats=True, opened=_opened)


def _hub(pool: ReceiveBufferPool) -> Uplink:
    # Clients of the hub are streams here, too: what they do not read is dropped.
    screens = Uplink("screens", LIMITS, pool, lambda: None, repeats=False)
    side = Uplink(
        "s",
        LIMITS,
        pool,
        lambda: None,
        repeats=False,
        closed=lambda stream: feeds.ended(stream),
        fed=lambda frame: feeds.receive(frame),
    )
    feeds = RobotFeeds(side, ROBOT, SimulatedClock(), Scheduler.immediate(MESSAGES))
    for number in range(STREAMS):
        stream = side.open(b"{}", "192.0.2.1")
        stream.begin(_Reader())
        feeds.admit(stream.number, screens.open(b"{}", "192.0.2.1"))
        if number:
            stream.pause()
    assert STREAMS * CREDIT_BYTES < 1 << 20
    return side
