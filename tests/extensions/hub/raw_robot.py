"""Robot that speaks the frames of an uplink itself, to say what no robot says."""

from __future__ import annotations

from collections.abc import AsyncIterator, Callable, Iterable, Mapping
from contextlib import asynccontextmanager

from rwt.extensions.hub.hub import Hub
from rwt.extensions.hub.uplink.frames import (
    SUBPROTOCOL,
    Hello,
    Lane,
    Open,
    decode_frame,
    encode_accept,
    encode_data,
    encode_end,
    encode_hello,
)
from rwt_protocol.frames import Frame
from rwt_transports import Limits
from rwt_transports.connect import connect
from rwt_transports.endpoint import Endpoint, PeerInfo, Sink
from tests.waiting import until

Answer = Callable[[int], Iterable[bytes]]
"""Returns the frames that answer the opening of a stream, by its number."""


def text(stream: int, data: bytes) -> bytes:
    """Return a text message."""
    return encode_data(stream, Lane.REPLIES, memoryview(data), binary=False, is_last=True)


def binary(stream: int, data: bytes) -> bytes:
    """Return a binary message."""
    return encode_data(stream, Lane.BULK, memoryview(data), binary=True, is_last=True)


def end(stream: int, code: int, reason: str = "") -> bytes:
    """Return the end of a stream."""
    return encode_end(stream, code, reason)


class RawRobot:
    """Endpoint of the uplink at the robot.

    Attributes:
        opened: numbers of the streams that the hub has opened.
        frames: all frames of the hub.
        ending: code and reason of the connection's end.
    """

    def __init__(self, sink: Sink, answer: Answer) -> None:
        self.sink = sink
        self.opened: list[int] = []
        self.frames: list[bytes] = []
        self.ending: tuple[int, str] | None = None
        self._answer = answer

    def send(self, frame: bytes) -> None:
        self.sink.send(Frame(frame, binary=True))

    def receive(self, data: bytes, binary: bool) -> None:
        self.frames.append(data)
        frame = decode_frame(data)
        if isinstance(frame, Open):
            self.opened.append(frame.stream)
            for answer in self._answer(frame.stream):
                self.send(answer)

    def closed(self, code: int, reason: str) -> None:
        self.ending = (code, reason)


@asynccontextmanager
async def raw_robot(
    hub: Hub,
    name: str = "rosie",
    answer: Answer = lambda stream: [encode_accept(stream)],
    hello: Hello | None = None,
    headers: Mapping[str, str] | None = None,
) -> AsyncIterator[RawRobot]:
    """Dial in with a greeting, and answer each opening, by default by admitting the client."""
    robots: list[RawRobot] = []

    def accept(sink: Sink, info: PeerInfo) -> Endpoint:
        robots.append(RawRobot(sink, answer))
        return robots[0]

    url, given = f"{hub.url}/robots/{name}", {"Sec-WebSocket-Protocol": SUBPROTOCOL, **(headers or {})}
    async with connect(url, accept, headers=given, limits=Limits(close_seconds=0.5)):
        robots[0].send(encode_hello(hello or Hello()))
        await until(lambda: robots[0].frames or robots[0].ending)
        yield robots[0]
