"""Streams of one robot over one connection at a time, by priority, within a window; without I/O."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable
from typing import Final, NamedTuple

from rwt.extensions.hub.uplink.feeds import Feeds
from rwt.extensions.hub.uplink.frames import (
    HEADER,
    Accepted,
    Ack,
    BadFrame,
    Credit,
    Data,
    Drops,
    End,
    FeedBegun,
    FeedFrame,
    Joined,
    Kind,
    Lane,
    Left,
    Open,
    Ping,
    Refused,
    SamplePart,
    decode_frame,
    encode_ack,
    encode_end,
    encode_ping,
    is_sequenced,
)
from rwt.extensions.hub.uplink.streams import ALL_LANES, Stream
from rwt.extensions.hub.uplink.window import Window
from rwt_protocol.states import StateEnum
from rwt_transports.background import ignore
from rwt_transports.limits import Limits
from rwt_transports.websocket.close_codes import ABNORMAL, GOING_AWAY, POLICY
from rwt_transports.wires.receive_buffer import ReceiveBufferPool

RESUME_SECONDS: Final = 2.0
"""Seconds for which the streams of a lost connection wait for another one."""

MIN_PART_BYTES: Final = 2048
"""Maximum payload of a frame on a slow link, in bytes."""
MAX_PART_BYTES: Final = 64 * 1024
_PART_SECONDS: Final = 0.004
"""Time that a larger payload may take, at the measured rate."""

BULK_SHARE: Final = 10
"""The lane `BULK` gets at least one of so many bytes, if it has any to send."""

_NO_FRAMES: Final[deque[bytes]] = deque(maxlen=0)
"""Shared by all uplinks, because a robot without clients should take little memory."""

MAX_ORDERS: Final = 16_384
"""Maximum number of answers that wait for a side that acknowledges nothing."""

WATCHED_PING_SECONDS: Final = 0.5
"""Silence after which a connection with streams is probed."""
IDLE_PING_SECONDS: Final = 8.0
"""The same for one without."""
PONG_SECONDS: Final = 2.0
"""Further silence after which a probed connection counts as lost."""


_OF_MESSAGES: Final = frozenset({Kind.OPEN, Kind.DATA})


class _UplinkState(StateEnum):
    CUT = "CARRIED", "OVER"
    CARRIED = "CUT", "OVER"
    OVER = ()


class _Retained(NamedTuple):
    """Sent frame that the other side may not have received.

    Attributes:
        end: sequenced bytes sent up to its end.
    """

    end: int
    frame: bytes

    @property
    def stream(self) -> int:
        """Number of its stream."""
        return int(HEADER.unpack_from(self.frame)[2])


class Uplink:
    """Streams between a robot and a hub, which outlive the loss of a connection for `RESUME_SECONDS`.

    Life cycle::

        CUT <── lost(), carried() ──> CARRIED
         └────────── end() ──> OVER <───┘

    * **CUT**: no connection. Streams stay; nothing is sent.
    * **CARRIED**: frames pass.
    * **OVER**: every stream has ended.

    A resumed connection begins with the frames that the other side has not received. A robot sends all of
    them again, since they are its samples and answers. A hub never sends a message of a client twice: it ends
    the streams of the messages that may be lost, and its clients learn that their outcome is unknown.

    Attributes by purpose:

    * ``limits``, ``buffers``: bounds of each stream, and of what all connections share.
    * ``streams``: streams by number; ``closing``: those that wait for their last messages to be sent.
    * ``feeds``: samples for several clients; None at a hub. ``_fed`` (takes the frames about them; None at a
      robot).
    * ``session``: id of the session.
    * Connection: ``_state``, ``_wake`` (asks the carrier to call :meth:`take`), ``carrier_bytes`` (received
      by it), ``_window``, ``_since`` (monotonic time of the loss), ``_heard``, ``_probed``
      (monotonic time of an unanswered ping; None without one).
    * Sequence: ``_sent``, ``_retained``, ``_again`` (frames to send once more), ``received``, ``_acked``
      (the part of ``received`` that the other side knows).
    * Order of sending: ``_urgent`` (frames of the uplink itself), ``_orders`` (the same, sequenced),
      ``_ready`` (streams by lane, in the order of their turns), ``_is_ready``, ``_bulk_owed`` (bytes of other
      lanes since the last of `BULK`).

    Args:
        repeats: True if frames of messages may be sent again after a loss: at the robot.
        opened: called with each stream that the other side opens, and its opening; None: it may not.
        closed: called once with each stream that has ended.
        wake: called when there may be something to take.
        fed: at a hub, called with the frames about feeds; raises BadFrame.
    """

    def __init__(
        self,
        session: str,
        limits: Limits,
        buffers: ReceiveBufferPool,
        wake: Callable[[], None],
        *,
        repeats: bool,
        opened: Callable[[Stream, bytes], None] | None = None,
        closed: Callable[[Stream], None] = ignore,
        fed: Callable[[FeedFrame], None] | None = None,
        now: float = 0.0,
    ) -> None:
        self.session = session
        self.limits = limits
        self.buffers = buffers
        self.streams: dict[int, Stream] = {}
        self.closing: dict[int, Stream] = {}
        self.feeds = Feeds(self) if repeats else None
        self._fed = fed
        self._wake = wake
        self._repeats = repeats
        self._opened = opened
        self._closed = closed
        self._state = _UplinkState.CUT
        self._since = now
        self._count = 0
        self.carrier_bytes = 0
        self._window = Window(now)
        self._heard = now
        self._probed: float | None = None
        self._sent = self._base = 0
        self._retained: deque[_Retained] = deque()
        self._again = _NO_FRAMES
        self.received = self._acked = 0
        self._urgent: list[bytes] = []
        self._orders: deque[bytes] = deque()
        self._ready: dict[Lane, deque[Stream | Feeds]] = {}
        self._is_ready: set[tuple[Lane, int]] = set()
        self._bulk_owed = 0

    @property
    def is_carried(self) -> bool:
        """True if there is a connection."""
        return self._state is _UplinkState.CARRIED

    @property
    def round_trip(self) -> float:
        """Seconds of the last round trip; 0.0 before the first."""
        return self._window.round_trip

    @property
    def rate(self) -> float:
        """Bytes per second that arrived at the other side lately."""
        return self._window.rate

    @property
    def waiting_orders(self) -> int:
        """Number of sequenced frames of the uplink itself that wait."""
        return len(self._orders)

    # -- streams ---------------------------------------------------------------------------------------------

    def open(self, opening: bytes, address: str) -> Stream:
        """Open a stream for a client of that address. Its endpoint follows by :meth:`Stream.begin`."""
        self._count += 1
        stream = self.streams[self._count] = Stream(self, self._count, address, opening)
        self.ready(stream, Lane.REPLIES)
        return stream

    def ready(self, stream: Stream | Feeds, lane: Lane) -> None:
        """Note that a stream may have something to send."""
        self._queue(stream, lane)
        self._wake()

    def _queue(self, stream: Stream | Feeds, lane: Lane) -> None:
        key = (lane, stream.number)
        if key not in self._is_ready:
            self._is_ready.add(key)
            self._ready.setdefault(lane, deque()).append(stream)

    def order(self, frame: bytes) -> None:
        """Send a sequenced frame ahead of messages."""
        self._orders.append(frame)
        self._wake()

    def forget(self, stream: Stream) -> None:
        """Remove a stream from which nothing more arrives."""
        if self.streams.get(stream.number) is stream:
            del self.streams[stream.number]
        self.closing.pop(stream.number, None)

    def over(self, stream: Stream) -> None:
        """Remove a stream that has ended."""
        self.forget(stream)
        self._closed(stream)

    # -- connections -----------------------------------------------------------------------------------------

    def carried(self, received: int, now: float) -> bool:
        """Begin a connection of the session.

        Args:
            received: sequenced bytes that the other side has received.

        Returns:
            False if it cannot have received so many: the session cannot be resumed.
        """
        first = self._retained[0] if self._retained else None
        start = self._sent if first is None else first.end - len(first.frame)
        if received != start and all(received != each.end for each in self._retained):
            return False
        if self._state is _UplinkState.CUT:
            self._state = self._state.become(_UplinkState.CARRIED)
        self._release(received)
        lost, self._retained = self._retained, deque()
        self._sent = self._base = received
        self._window = Window(now)
        self._heard, self._probed = now, None
        self._urgent.clear()
        self._acked = self.received
        # They precede those that a former loss has left.
        again = [each.frame for each in lost if self._repeats or each.frame[0] not in _OF_MESSAGES]
        if again:
            self._again = deque((*again, *self._again))
        if not self._repeats:
            for number in {each.stream for each in lost if each.frame[0] in _OF_MESSAGES}:
                self._abandon(number, "a message was lost with the connection: its outcome is unknown")
        self._wake()
        return True

    def _abandon(self, number: int, reason: str) -> None:
        """End a stream whose message may be lost, at both sides."""
        stream = self.streams.get(number)
        if stream is not None:
            self._orders.append(encode_end(number, GOING_AWAY, reason))
            stream.ended(ABNORMAL, reason)

    @property
    def heard_at(self) -> float:
        """Monotonic time at which the last frame arrived: a silent connection is given up seconds later."""
        return self._heard

    def lost(self, now: float) -> None:
        """End the connection; another one may follow within `RESUME_SECONDS`."""
        if self._state is not _UplinkState.CARRIED:
            return
        self._state = self._state.become(_UplinkState.CUT)
        self._since = now
        if not self._repeats:
            for stream in tuple(self.streams.values()):
                if stream.has_unsent:
                    self._abandon(stream.number, "the robot is unreachable: a message was not delivered")

    def end(self, code: int, reason: str) -> None:
        """End every stream."""
        if self._state is _UplinkState.OVER:
            return
        self._state = self._state.become(_UplinkState.OVER)
        for stream in tuple(self.streams.values()):
            stream.ended(code, reason)
        self.streams.clear()
        self.closing.clear()
        self._again = _NO_FRAMES
        for waiting in (self._orders, self._urgent, self._retained, self._ready, self._is_ready):
            waiting.clear()

    def tick(self, now: float) -> bool:
        """Check the timeouts. Returns False if the connection, or the chance of another one, is lost."""
        for stream in tuple(self.closing.values()):
            stream.tick(now)
        if self._state is not _UplinkState.CARRIED:
            return self._state is _UplinkState.CUT and now - self._since < RESUME_SECONDS
        if self._probed is not None:
            return now - self._probed < PONG_SECONDS
        if now - self._heard >= (WATCHED_PING_SECONDS if self.streams else IDLE_PING_SECONDS):
            self._probed = now
            self._urgent.append(encode_ping())
            self._wake()
        return True

    # -- sending ---------------------------------------------------------------------------------------------

    def take(self, most: int, now: float) -> list[bytes]:
        """Return the next frames, of about `most` bytes together, as far as the window permits."""
        if self._state is not _UplinkState.CARRIED:
            return []
        if self._acked != self.received:
            self._acked = self.received
            self._urgent.append(encode_ack(self.received))
        frames = list(self._urgent)
        self._urgent.clear()
        part = min(max(int(self._window.rate * _PART_SECONDS), MIN_PART_BYTES), MAX_PART_BYTES)
        served: dict[int, Stream | Feeds] = {}
        while most > 0:
            frame = self._next_frame(part, served)
            if frame is None:
                break
            size = len(frame)
            most -= size
            self._sent += size
            self._retained.append(_Retained(self._sent, frame))
            self._window.sent(size, now)
            frames.append(frame)
        for stream in served.values():
            stream.taken()
        return frames

    @property
    def has_more(self) -> bool:
        """True if :meth:`take` may return something now."""
        if self._state is not _UplinkState.CARRIED:
            return False
        return bool(self._urgent) or self._acked != self.received or (
            self._window.room > 0 and bool(self._again or self._orders or self._is_ready)
        )  # fmt: skip

    def _next_frame(self, part: int, served: dict[int, Stream | Feeds]) -> bytes | None:
        # The emergency stop needs no room in the window.
        frame = self._from_lane(Lane.STOP, part, served)
        if frame is not None or self._window.room <= 0:
            return frame
        if self._again:
            return self._again.popleft()
        if self._orders:
            return self._orders.popleft()
        if self._bulk_owed >= (BULK_SHARE - 1) * part:
            frame = self._from_lane(Lane.BULK, part, served)
            self._bulk_owed = 0
        for lane in ALL_LANES if frame is None else ():
            frame = self._from_lane(lane, part, served)
            if frame is not None:
                self._bulk_owed = 0 if lane is Lane.BULK else self._bulk_owed + len(frame)
                break
        return frame

    def _from_lane(self, lane: Lane, part: int, served: dict[int, Stream | Feeds]) -> bytes | None:
        """Return the next frame of a lane: one of each stream in turn."""
        while ready := self._ready.get(lane):
            stream = ready.popleft()
            if not ready:
                del self._ready[lane]
            # Before it is asked, which may make it ready anew.
            self._is_ready.discard((lane, stream.number))
            frame = stream.take(lane, part)
            served[stream.number] = stream
            if frame is not None:
                self._queue(stream, lane)
                return frame
        return None

    def _release(self, received: int) -> None:
        while self._retained and self._retained[0].end <= received:
            self._retained.popleft()

    # -- receiving -------------------------------------------------------------------------------------------

    def receive(self, data: bytes, now: float) -> None:
        """Process a frame.

        Raises:
            BadFrame: the other side breaks the rules; its connection must be closed.
        """
        self._heard, self._probed = now, None
        if len(self._orders) > MAX_ORDERS:
            raise BadFrame(f"more than {MAX_ORDERS} answers wait: frames are not acknowledged")
        frame = decode_frame(data)
        if is_sequenced(data):
            self.received += len(data)
            self._wake()
        if isinstance(frame, Data):
            stream = self.streams.get(frame.stream)
            if stream is not None and not stream.feed(frame):
                raise BadFrame(f"stream {frame.stream} exceeds its credit")
        elif isinstance(frame, Ack):
            self._acknowledged(frame.received, now)
        elif isinstance(frame, Open):
            self._open(frame)
        elif isinstance(frame, End):
            stream = self.streams.get(frame.stream)
            if stream is not None:
                stream.ended(frame.code, frame.reason)
        elif isinstance(frame, SamplePart | FeedBegun | Joined | Left):
            if self._fed is None:
                raise BadFrame("only a robot has feeds")
            self._fed(frame)
        elif isinstance(frame, Drops):
            if self.feeds is None:
                raise BadFrame("only a hub reports drops")
            self.feeds.dropped(frame)
        elif isinstance(frame, Credit | Accepted | Refused):
            stream = self.streams.get(frame.stream)
            if stream is not None:
                self._control(stream, frame)
        elif isinstance(frame, Ping) and not frame.is_answer:
            # One answer for any number of pings: a flood of them queues nothing.
            self._urgent = [each for each in self._urgent if each[0] != Kind.PONG]
            self._urgent.append(encode_ping(frame.payload, is_answer=True))
            self._wake()

    def _control(self, stream: Stream, frame: Credit | Accepted | Refused) -> None:
        if isinstance(frame, Credit):
            stream.credited(frame.size)
        elif self._opened is not None:
            raise BadFrame("only a robot admits clients")
        elif isinstance(frame, Accepted):
            stream.on_admission(None)
        else:
            stream.on_admission(frame.refusal)
            stream.ended(POLICY, frame.refusal.reason)

    def _acknowledged(self, received: int, now: float) -> None:
        if not self._window.acknowledged(received - self._base, now):
            raise BadFrame(f"ACK of {received} bytes, and {self._sent} were sent")
        self._release(received)
        self._wake()

    def _open(self, frame: Open) -> None:
        if self._opened is None:
            raise BadFrame("only a hub opens streams")
        if frame.stream <= self._count:
            raise BadFrame(f"stream {frame.stream} is opened after stream {self._count}")
        self._count = frame.stream
        stream = self.streams[frame.stream] = Stream(self, frame.stream)
        self._opened(stream, frame.opening)
