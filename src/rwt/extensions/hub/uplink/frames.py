"""Frames of an uplink. Each is one binary message of its WebSocket, with the subprotocol :data:`SUBPROTOCOL`.

A frame is a header, a payload, and nothing else::

    byte   0      1      2 3 4 5    6 …
           kind   flags  stream     payload

==== ======== ========================================================================================
kind name     payload
==== ======== ========================================================================================
1    `OPEN`   JSON of :mod:`.openings`. Only a hub opens streams, with numbers that grow from 1.
2    `DATA`   a part of a message. Flags: bits 0 to 2 the lane, bit 3 "binary", bit 4 "last part".
3    `END`    close code (2 bytes) and reason in UTF-8, as in RFC 6455 section 5.5.1
4    `CREDIT` number of bytes (4 bytes) that the other side may send on the stream in addition
5    `ACCEPT` nothing: the robot has admitted the client
6    `REFUSE` JSON of :class:`Refusal`: the robot has not; the stream has ended
7    `FEED`   JSON of :class:`FeedHead`. A feed begins, or its period changes. Its number is in place of the
              stream, as in `SAMPLE`.
8    `JOIN`   JSON of :class:`Join`: the client of the stream is a member of a feed, or wants something else
9    `LEAVE`  number of the feed (4 bytes) that the client of the stream leaves; of stream 0: that has ended
10   `SAMPLE` a part of a sample for the members of a feed. Flags as of `DATA`, and in its first part: bit 5
              "for one": the payload begins with the stream of its only receiver (4 bytes); bit 6 "gap": then
              comes the position (2 bytes) at which each member's own bytes are put in
11   `DROPS`  feed (4 bytes), reason (1 byte) and number (2 bytes) of samples that the stream's client did not
              get at the hub
64   `HELLO`  JSON of :class:`Hello`; the first frame in each direction
65   `ACK`    bytes of sequenced frames received so far (8 bytes)
66   `PING`   anything; answered by a `PONG` with the same payload
67   `PONG`
==== ======== ========================================================================================

Numbers are unsigned, the most significant byte first. Frames of kinds below 64 are *sequenced*: both sides
count their bytes, headers included, for the window and for resumption. Frames of unknown kinds are skipped,
and counted by that rule. The parts of a message follow each other on its stream and lane; frames of other
streams and lanes may come between them.
"""

from __future__ import annotations

from enum import IntEnum
from struct import Struct
from struct import error as StructError
from typing import Annotated, Final, NamedTuple

import msgspec

SUBPROTOCOL: Final = "rwt-uplink.1"
"""WebSocket subprotocol; its number is the major version."""

HEADER: Final = Struct(">BBI")
_END: Final = Struct(">H")
_CREDIT: Final = Struct(">I")
_ACK: Final = Struct(">Q")
_FEED: Final = Struct(">I")
_GAP: Final = Struct(">H")
_DROPS: Final = Struct(">IBH")

MAX_FRAME_BYTES: Final = 128 * 1024
"""Maximum size of a frame."""

MAX_REASON_BYTES: Final = 1024
"""Maximum size of the reason of an `END`; longer ones are cut."""

_UNSEQUENCED: Final = 64
_LANE, _BINARY, _LAST, _FOR_ONE, _GAPPED = 0b111, 0b1000, 0b1_0000, 0b10_0000, 0b100_0000

MAX_DROPS: Final = 1000
"""Maximum number of samples that one `DROPS` reports."""

MAX_QUEUE: Final = 2**31
"""Maximum length of a queue in a `JOIN`; longer ones are as long as this."""

MAX_SECONDS: Final = 1e12
"""Maximum period of a feed, and throttle of a member."""


class BadFrame(ValueError):
    """The frame breaks the rules of the uplink; the text gives the reason."""


class Kind(IntEnum):
    """Kind of a frame, see the module."""

    OPEN = 1
    DATA = 2
    END = 3
    CREDIT = 4
    ACCEPT = 5
    REFUSE = 6
    FEED = 7
    JOIN = 8
    LEAVE = 9
    SAMPLE = 10
    DROPS = 11
    HELLO = 64
    ACK = 65
    PING = 66
    PONG = 67


NO_STREAM: Final = 0
"""Number that no stream has."""


class Lane(IntEnum):
    """Class of priority of a message, the most urgent first."""

    STOP = 0
    """The emergency stop."""
    REPLIES = 1
    """Messages of clients, and replies to them."""
    SMALL = 2
    """Small samples."""
    LARGE = 3
    """Large samples."""
    BULK = 4
    """Large replies, files and pages."""


SMALL_BYTES: Final = 16 * 1024
"""Maximum size of samples and replies that go before large ones."""


class Hello(msgspec.Struct, frozen=True, omit_defaults=True):
    """Greeting of both sides of a new connection.

    Attributes:
        session: random id of the uplink's session: the robot names the one that it wants to resume, the hub
            the one that it resumes or begins. Empty: none.
        received: bytes of sequenced frames that the sender has received in this session.
        software: name and version of the sender's program.
    """

    session: Annotated[str, msgspec.Meta(max_length=64)] = ""
    received: Annotated[int, msgspec.Meta(ge=0, le=2**62)] = 0
    software: Annotated[str, msgspec.Meta(max_length=128)] = ""


class Refusal(msgspec.Struct, frozen=True, omit_defaults=True):
    """Reason why the robot does not admit a client, as it would answer over HTTP."""

    status: Annotated[int, msgspec.Meta(ge=400, le=599)] = 403
    reason: Annotated[str, msgspec.Meta(max_length=MAX_REASON_BYTES)] = ""
    headers: dict[str, str] = {}


_Seconds = Annotated[float, msgspec.Meta(ge=0, le=MAX_SECONDS)]


class FeedHead(msgspec.Struct, frozen=True, omit_defaults=True):
    """Samples of one topic in one form, which cross the uplink once for all clients that are members.

    Attributes:
        topic: name of the topic.
        period: minimum seconds between two samples for all members; 0.0 if all samples are sent.
    """

    topic: Annotated[str, msgspec.Meta(max_length=1024)]
    period: _Seconds = 0.0


class Join(msgspec.Struct, frozen=True, omit_defaults=True):
    """What a client wants of a feed.

    Attributes:
        throttle: minimum seconds between two samples.
        queue: samples that wait for the throttle; the newest stay.
        depth: samples that wait for the connection; the newest stay. None: as many as there is room for.
        keep_all: True if samples of topics without this are dropped first.
        gap: bytes for the gap of each sample, in hexadecimal digits.
        apart: True if the client gets only the samples that are for it alone.
    """

    feed: Annotated[int, msgspec.Meta(ge=1, lt=2**32)]
    throttle: _Seconds = 0.0
    queue: Annotated[int, msgspec.Meta(ge=0, le=MAX_QUEUE)] = 0
    depth: Annotated[int, msgspec.Meta(ge=0, le=MAX_QUEUE)] | None = None
    keep_all: bool = False
    gap: Annotated[str, msgspec.Meta(max_length=32, pattern="^([0-9a-f]{2})*$")] = ""
    apart: bool = False


class DropCause(IntEnum):
    """Reason why a hub did not deliver a sample, see :class:`~rwt_transports.endpoint.DropReason`."""

    QUEUE = 1
    BACKLOG = 2
    SIZE = 3


class FeedBegun(NamedTuple):
    """Beginning or change of a feed."""

    feed: int
    head: FeedHead


class Joined(NamedTuple):
    """Membership of a client in a feed."""

    stream: int
    join: Join


class Left(NamedTuple):
    """End of a membership; of `NO_STREAM`, of the feed."""

    stream: int
    feed: int


class SamplePart(NamedTuple):
    """Part of a sample of a feed.

    Attributes:
        flags: those of the frame; :func:`split_first_part` needs them.
    """

    feed: int
    lane: Lane
    binary: bool
    is_last: bool
    flags: int
    payload: memoryview


class Drops(NamedTuple):
    """Samples of a feed that the client of a stream did not get."""

    stream: int
    feed: int
    cause: DropCause
    samples: int


class Data(NamedTuple):
    """Part of a message.

    Attributes:
        is_last: True if the message is complete.
    """

    stream: int
    lane: Lane
    binary: bool
    is_last: bool
    payload: memoryview


class Open(NamedTuple):
    """Beginning of a stream."""

    stream: int
    opening: bytes


class End(NamedTuple):
    """End of a stream."""

    stream: int
    code: int
    reason: str


class Accepted(NamedTuple):
    """Admission of the client of a stream."""

    stream: int


class Refused(NamedTuple):
    """Refusal of the client of a stream."""

    stream: int
    refusal: Refusal


class Credit(NamedTuple):
    """Bytes that may be sent in addition."""

    stream: int
    size: int


class Ack(NamedTuple):
    """Bytes of sequenced frames that have arrived."""

    received: int


class Ping(NamedTuple):
    """Request for a `PONG`, or the answer."""

    payload: bytes
    is_answer: bool


class Skipped(NamedTuple):
    """Frame of an unknown kind."""

    kind: int


FeedFrame = FeedBegun | Joined | Left | SamplePart
"""Frames of a robot about its feeds."""

UplinkFrame = (
    Data | Open | End | Credit | Accepted | Refused | FeedFrame | Drops | Ack | Ping | Hello | Skipped
)

_hello: Final = msgspec.json.Decoder(Hello)
_refusal: Final = msgspec.json.Decoder(Refusal)
_feed_head: Final = msgspec.json.Decoder(FeedHead)
_join: Final = msgspec.json.Decoder(Join)
_LANES: Final = dict(enumerate(Lane))
_CAUSES: Final = frozenset(DropCause)


def is_sequenced(frame: bytes) -> bool:
    """Return True if the frame counts for window and resumption."""
    return frame[0] < _UNSEQUENCED


def encode_data(stream: int, lane: Lane, payload: memoryview, *, binary: bool, is_last: bool) -> bytes:
    """Return a `DATA` frame."""
    flags = lane | (_BINARY if binary else 0) | (_LAST if is_last else 0)
    return b"".join((HEADER.pack(Kind.DATA, flags, stream), payload))


def encode_open(stream: int, opening: bytes) -> bytes:
    """Return an `OPEN` frame."""
    return HEADER.pack(Kind.OPEN, 0, stream) + opening


def encode_end(stream: int, code: int, reason: str) -> bytes:
    """Return an `END` frame; a long reason is cut."""
    return HEADER.pack(Kind.END, 0, stream) + _END.pack(code) + _cut(reason).encode()


def _cut(reason: str) -> str:
    return reason.encode("utf-8", "replace")[:MAX_REASON_BYTES].decode("utf-8", "ignore")


def encode_credit(stream: int, count: int) -> bytes:
    """Return a `CREDIT` frame."""
    return HEADER.pack(Kind.CREDIT, 0, stream) + _CREDIT.pack(count)


def encode_accept(stream: int) -> bytes:
    """Return an `ACCEPT` frame."""
    return HEADER.pack(Kind.ACCEPT, 0, stream)


def encode_refuse(stream: int, refusal: Refusal) -> bytes:
    """Return a `REFUSE` frame; a long reason is cut."""
    short = msgspec.structs.replace(refusal, reason=_cut(refusal.reason))
    return HEADER.pack(Kind.REFUSE, 0, stream) + msgspec.json.encode(short)


def encode_feed(feed: int, head: FeedHead) -> bytes:
    """Return a `FEED` frame; a long period is cut."""
    bounded = msgspec.structs.replace(head, period=min(head.period, MAX_SECONDS))
    return HEADER.pack(Kind.FEED, 0, feed) + msgspec.json.encode(bounded)


def encode_join(stream: int, join: Join) -> bytes:
    """Return a `JOIN` frame. Large numbers of a client, which the other side rejects, are cut."""
    bounded = msgspec.structs.replace(
        join,
        throttle=min(join.throttle, MAX_SECONDS),
        queue=min(join.queue, MAX_QUEUE),
        depth=None if join.depth is None else min(join.depth, MAX_QUEUE),
    )
    return HEADER.pack(Kind.JOIN, 0, stream) + msgspec.json.encode(bounded)


def encode_leave(stream: int, feed: int) -> bytes:
    """Return a `LEAVE` frame; of `NO_STREAM`, the feed has ended."""
    return HEADER.pack(Kind.LEAVE, 0, stream) + _FEED.pack(feed)


def encode_sample(
    feed: int,
    lane: Lane,
    payload: memoryview,
    *,
    binary: bool,
    is_last: bool,
    to: int | None = None,
    gap: int | None = None,
) -> bytes:
    """Return a `SAMPLE` frame.

    Args:
        to: stream of the only receiver; None for all members. Only of the first part.
        gap: position of the gap; None without one. Only of the first part.
    """
    flags = lane | (_BINARY if binary else 0) | (_LAST if is_last else 0)
    head = b""
    if to is not None:
        flags |= _FOR_ONE
        head = _FEED.pack(to)
    if gap is not None:
        flags |= _GAPPED
        head += _GAP.pack(gap)
    return b"".join((HEADER.pack(Kind.SAMPLE, flags, feed), head, payload))


def split_first_part(part: SamplePart) -> tuple[int | None, int | None, memoryview]:
    """Return the only receiver of a sample, the position of its gap, and the rest of its first part.

    Raises:
        BadFrame: the part is shorter than its flags say.
    """
    payload, to, gap = part.payload, None, None
    try:
        if part.flags & _FOR_ONE:
            (to,) = _FEED.unpack_from(payload)
            payload = payload[_FEED.size :]
        if part.flags & _GAPPED:
            (gap,) = _GAP.unpack_from(payload)
            payload = payload[_GAP.size :]
    except StructError:
        raise BadFrame("SAMPLE: too short for its flags") from None
    return to, gap, payload


def encode_drops(drops: Drops) -> bytes:
    """Return a `DROPS` frame."""
    return HEADER.pack(Kind.DROPS, 0, drops.stream) + _DROPS.pack(drops.feed, drops.cause, drops.samples)


def encode_ack(received: int) -> bytes:
    """Return an `ACK` frame."""
    return HEADER.pack(Kind.ACK, 0, 0) + _ACK.pack(received)


def encode_ping(payload: bytes = b"", *, is_answer: bool = False) -> bytes:
    """Return a `PING` frame, or the `PONG` that answers one."""
    return HEADER.pack(Kind.PONG if is_answer else Kind.PING, 0, 0) + payload


def encode_hello(hello: Hello) -> bytes:
    """Return a `HELLO` frame."""
    return HEADER.pack(Kind.HELLO, 0, 0) + msgspec.json.encode(hello)


def decode_frame(data: bytes) -> UplinkFrame:
    """Return a frame; raises BadFrame."""
    if not HEADER.size <= len(data) <= MAX_FRAME_BYTES:
        raise BadFrame(f"a frame of {len(data)} bytes: expected {HEADER.size} to {MAX_FRAME_BYTES}")
    kind, flags, stream = HEADER.unpack_from(data)
    payload = memoryview(data)[HEADER.size :]
    if kind == Kind.DATA:
        lane = _LANES.get(flags & _LANE)
        if lane is None:
            raise BadFrame(f"no lane {flags & _LANE}")
        return Data(stream, lane, bool(flags & _BINARY), bool(flags & _LAST), payload)
    if kind == Kind.SAMPLE:
        lane = _LANES.get(flags & _LANE)
        if lane not in (Lane.SMALL, Lane.LARGE):
            raise BadFrame(f"a sample in lane {flags & _LANE}")
        return SamplePart(stream, lane, bool(flags & _BINARY), bool(flags & _LAST), flags, payload)
    if kind == Kind.ACK:
        return Ack(int(_number(_ACK, payload, "ACK")))
    if kind == Kind.CREDIT:
        return Credit(stream, int(_number(_CREDIT, payload, "CREDIT")))
    if kind == Kind.OPEN:
        return Open(stream, bytes(payload))
    if kind == Kind.END:
        return _end(stream, payload)
    if kind in (Kind.PING, Kind.PONG):
        return Ping(bytes(payload), kind == Kind.PONG)
    if kind == Kind.ACCEPT:
        return Accepted(stream)
    if kind == Kind.LEAVE:
        return Left(stream, int(_number(_FEED, payload, "LEAVE")))
    if kind == Kind.DROPS:
        return _drops(stream, payload)
    try:
        if kind == Kind.FEED:
            return FeedBegun(stream, _feed_head.decode(payload))
        if kind == Kind.JOIN:
            return Joined(stream, _join.decode(payload))
        if kind == Kind.REFUSE:
            return Refused(stream, _refusal.decode(payload))
        return _hello.decode(payload) if kind == Kind.HELLO else Skipped(kind)
    except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
        raise BadFrame(f"{Kind(kind).name}: {error}") from None


def _number(form: Struct, payload: memoryview, name: str) -> int:
    if len(payload) != form.size:
        raise BadFrame(f"{name}: expected {form.size} bytes, got {len(payload)}")
    (value,) = form.unpack(payload)
    return int(value)


def _drops(stream: int, payload: memoryview) -> Drops:
    if len(payload) != _DROPS.size:
        raise BadFrame(f"DROPS: expected {_DROPS.size} bytes, got {len(payload)}")
    feed, cause, count = _DROPS.unpack(payload)
    if not 1 <= count <= MAX_DROPS or cause not in _CAUSES:
        raise BadFrame(f"DROPS: {count} samples for reason {cause}")
    return Drops(stream, feed, DropCause(cause), count)


def _end(stream: int, payload: memoryview) -> End:
    if not _END.size <= len(payload) <= _END.size + MAX_REASON_BYTES:
        raise BadFrame(f"END: expected {_END.size} to {_END.size + MAX_REASON_BYTES} bytes")
    try:
        return End(stream, _END.unpack_from(payload)[0], str(payload[_END.size :], "utf-8"))
    except UnicodeDecodeError:
        raise BadFrame("END: the reason is not UTF-8") from None
