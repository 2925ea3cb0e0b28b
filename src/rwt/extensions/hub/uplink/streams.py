"""Stream of an uplink: the messages of one client or page, as a sink of the transports."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Hashable, Sequence
from time import time_ns
from typing import TYPE_CHECKING, Final

from rwt.extensions.hub.uplink.assembly import Assembly
from rwt.extensions.hub.uplink.feeds import FeedMember
from rwt.extensions.hub.uplink.frames import (
    SMALL_BYTES,
    Data,
    Lane,
    Refusal,
    encode_accept,
    encode_credit,
    encode_data,
    encode_end,
    encode_open,
    encode_refuse,
)
from rwt_protocol.frames import Burst, Frame
from rwt_protocol.states import StateEnum
from rwt_transports.api import FlowControlled, HoldingWire, OversizeAware
from rwt_transports.background import ignore
from rwt_transports.data_lane import DataLane, TopicQueue
from rwt_transports.endpoint import AS_MANY_AS_FIT, DropReason, Endpoint, FlowRules, Traffic
from rwt_transports.errors import log_exception
from rwt_transports.http.addresses import holder_of
from rwt_transports.shared_pool import Holder
from rwt_transports.websocket.close_codes import INTERNAL_ERROR, POLICY, TOO_BIG

if TYPE_CHECKING:
    from rwt.extensions.hub.uplink.uplink import Uplink

CREDIT_BYTES: Final = 256 * 1024
"""Bytes of a stream that may arrive before its endpoint has taken the earlier ones."""

STOP_BYTES: Final = 4096
"""Maximum size of a message on the lane `STOP`."""

ALL_LANES: Final = tuple(Lane)


class _StreamState(StateEnum):
    OPEN = "CLOSING", "OVER"
    CLOSING = "OVER"
    OVER = ()


class _Begun:
    """Message of which a part was sent."""

    __slots__ = ("at", "binary", "data", "queue")

    def __init__(self, frame: Frame, queue: TopicQueue | None = None) -> None:
        self.data = memoryview(frame.data)
        self.binary = frame.binary
        self.queue = queue
        self.at = 0


class _StreamFlow:
    """Flow of one topic through a stream, or through a feed of the uplink.

    Implements :class:`rwt_transports.endpoint.Flow` and :class:`rwt_transports.endpoint.FeedFlow`.
    """

    __slots__ = ("_member", "_queue", "_stream", "_topic")

    def __init__(self, stream: Stream, topic: str, queue: TopicQueue) -> None:
        self._stream = stream
        self._topic = topic
        self._queue = queue
        self._member: FeedMember | None = None

    def enter(self, key: Hashable, gap: bytes = b"") -> FeedMember | None:
        queue = self._queue
        self._member = self._stream.enter(self._topic, key, gap, queue)
        return self._member

    def send(self, frame: Frame) -> None:
        self.send_message((frame,))

    def join(self, burst: Burst) -> bool:
        return False

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        if self._member is None:
            self._stream.send_sample(self._queue, pieces, expires_ns)
        else:
            self._member.send(pieces, expires_ns)

    def configure(self, rules: FlowRules) -> None:
        self._stream.configure(self._queue, rules)
        if self._member is not None:
            self._member.configure(rules)

    def close(self) -> None:
        self._queue.on_drop = None
        if self._member is not None:
            self._member.on_drop = None


class Stream:
    """One client or page on an uplink.

    Implements :class:`rwt_transports.endpoint.Sink`, :class:`rwt_transports.api.FlowControl` and
    :class:`rwt_transports.wires.receive_buffer.Incomplete`.

    Life cycle::

        OPEN ── close() ──> CLOSING ── END sent ──> OVER
         └──────────── END received, uplink lost ─────^

    * **OPEN**: messages pass both ways.
    * **CLOSING**: nothing more is accepted; the control lane is sent, then an `END`. Samples are dropped.
    * **OVER**: the endpoint was told; nothing refers to it.

    Attributes by purpose:

    * Wiring: ``number``, ``address`` (of the client), ``on_admission`` (called at the hub with the robot's
      answer: None, or why the client is refused), ``_holder`` (client that it
      counts to), ``_uplink``, ``_endpoint``, ``_state``.
    * Sending: ``_opening`` (not sent yet; empty afterwards), ``_stops``, ``_control``, ``_control_bytes``,
      ``_data``, ``_begun`` (by lane), ``_may_send`` (bytes that the other side still takes), ``_ending``
      (code and reason of the `END`), ``_on_empty``, ``_deadline`` (monotonic time to end without the rest).
    * Receiving: ``_arriving`` (by lane), ``_is_paused``, ``_held`` (messages for a paused endpoint that wants
      none), ``_held_end`` (the end behind them), ``_holds``, ``_taken`` (bytes for which no credit was given
      yet), ``_may_receive``.
    * Counters: ``memberships`` (in feeds), ``changes`` (of them, which wait to be sent), ``messages``,
      ``sent_bytes``.
    """

    __slots__ = (
        "_arriving",
        "_begun",
        "_control",
        "_control_bytes",
        "_data",
        "_deadline",
        "_ending",
        "_endpoint",
        "_held",
        "_held_end",
        "_holder",
        "_holds",
        "_is_paused",
        "_may_receive",
        "_may_send",
        "_on_empty",
        "_opening",
        "_state",
        "_stops",
        "_taken",
        "_uplink",
        "address",
        "changes",
        "memberships",
        "messages",
        "number",
        "on_admission",
        "sent_bytes",
    )  # fmt: skip

    def __init__(self, uplink: Uplink, number: int, address: str = "", opening: bytes = b"") -> None:
        self.number = number
        self.address = address
        self._holder = holder_of(address)
        self.on_admission: Callable[[Refusal | None], None] = ignore
        self._uplink = uplink
        self._endpoint: Endpoint | None = None
        self._state = _StreamState.OPEN
        self._opening = opening
        self._stops: deque[Frame] = deque()
        self._control: deque[Frame] = deque()
        self._control_bytes = 0
        self._data = DataLane(uplink.limits)
        self._begun: dict[Lane, _Begun] = {}
        self._may_send = CREDIT_BYTES
        self._ending: tuple[int, str] | None = None
        self._on_empty: Callable[[], None] | None = None
        self._deadline: float | None = None
        self._arriving = Assembly(uplink.limits.message_bytes)
        self._is_paused = self._holds = False
        self._held: deque[tuple[bytes, bool]] = deque()
        self._held_end: tuple[int, str] | None = None
        self._taken = 0
        self._may_receive = CREDIT_BYTES
        self.memberships = self.changes = 0
        self.messages = 0
        self.sent_bytes = 0

    # -- the endpoint's side: sink ---------------------------------------------------------------------------

    def begin(self, endpoint: Endpoint) -> None:
        """Deliver messages to `endpoint`, the first of the stream."""
        self._endpoint = endpoint
        self._holds = isinstance(endpoint, HoldingWire)
        if isinstance(endpoint, FlowControlled):
            endpoint.set_flow_control(self)

    def admit(self) -> None:
        """Report that the client is admitted."""
        self._uplink.order(encode_accept(self.number))

    def refuse(self, refusal: Refusal) -> None:
        """Report that the client is not admitted, and end."""
        self._uplink.order(encode_refuse(self.number, refusal))
        self._over(POLICY, refusal.reason)

    def hand_over(self, endpoint: Endpoint) -> None:
        """See :class:`~rwt_transports.endpoint.Sink`."""
        if self._endpoint is None:
            endpoint.closed(*(self._ending or (1000, "")))
        else:
            self.begin(endpoint)

    def count_for(self, holder: Holder) -> None:
        """See :class:`~rwt_transports.endpoint.Sink`."""
        self._holder = holder

    def send(self, frame: Frame) -> None:
        """See :class:`~rwt_transports.endpoint.Sink`."""
        if self._state is not _StreamState.OPEN:
            return
        limits = self._uplink.limits
        if self._control_bytes >= limits.control_bytes or len(self._control) >= limits.control_frames:
            self._control.clear()
            self._control_bytes = 0
            self.close(
                POLICY,
                f"more than {limits.control_frames} replies (limits.control_frames) or {limits.control_bytes}"
                " bytes of them (limits.control_bytes) wait unread",
            )
            return
        self._control.append(frame)
        self._control_bytes += frame.size
        self._uplink.ready(self, Lane.REPLIES if frame.size <= SMALL_BYTES else Lane.BULK)

    def send_stop(self, frame: Frame) -> None:
        """Send a message of at most `STOP_BYTES` ahead of all others, without credit."""
        if self._state is _StreamState.OPEN:
            self._stops.append(frame)
            self._uplink.ready(self, Lane.STOP)

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time_ns,
    ) -> _StreamFlow:
        """See :class:`~rwt_transports.endpoint.Sink`."""
        return _StreamFlow(self, topic, TopicQueue(rules, on_drop, time_ns))

    def enter(self, topic: str, key: Hashable, gap: bytes, queue: TopicQueue) -> FeedMember | None:
        """Return a new membership in a feed; None if there is no place for it, or at a hub."""
        feeds = self._uplink.feeds
        if feeds is None or self._state is not _StreamState.OPEN:
            return None
        return feeds.enter(self, topic, key, gap, queue.rules, queue.on_drop, queue.time_ns)

    def send_sample(self, queue: TopicQueue, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        """Queue a sample of one topic."""
        if self._state is not _StreamState.OPEN:
            return
        if any(frame.size > self._uplink.limits.outgoing_bytes for frame in pieces):
            self._data.count_drop(queue, DropReason.SIZE)
            return
        self._data.add(queue, pieces, expires_ns)
        self._uplink.ready(self, Lane.SMALL if queue.next_size() <= SMALL_BYTES else Lane.LARGE)

    def configure(self, queue: TopicQueue, rules: FlowRules) -> None:
        """Change the rules of a topic's queue."""
        queue.rules = rules
        if rules.depth is not None:
            self._data.cut(queue, max(rules.depth, 1))

    def close(self, code: int = 1000, reason: str = "") -> None:
        """See :class:`~rwt_transports.endpoint.Sink`."""
        if self._state is _StreamState.OPEN:
            self._state = self._state.become(_StreamState.CLOSING)
            self._uplink.closing[self.number] = self
            self._ending = (code, reason)
            self._data.clear()
            for lane in (Lane.SMALL, Lane.LARGE):
                self._begun.pop(lane, None)
            self._uplink.ready(self, Lane.REPLIES)

    def give_up(self, reason: str) -> None:
        """End the stream, whose incomplete message takes too much of what all share."""
        self._arriving.clear()
        self.close(POLICY, reason)

    @property
    def received(self) -> int:
        """Bytes that the uplink has received; identifies the read of a message."""
        return self._uplink.carrier_bytes

    @property
    def backlog(self) -> int:
        """Bytes that wait."""
        begun = sum(len(begun.data) - begun.at for begun in self._begun.values())
        return begun + self._control_bytes + self._data.size + sum(frame.size for frame in self._stops)

    @property
    def traffic(self) -> Traffic:
        """Counts since the stream began. Bytes received are those of the uplink."""
        waiting = len(self._stops) + len(self._control) + self._data.messages + len(self._begun)
        dropped = dict(self._data.dropped)
        return Traffic(self.messages, self.sent_bytes, waiting, self.backlog, dropped, self.received)

    # -- the endpoint's side: flow control -------------------------------------------------------------------

    def pause(self) -> None:
        """Give no more credit."""
        self._is_paused = True

    def resume(self) -> None:
        """Deliver what was held back, and give credit again."""
        self._is_paused = False
        while self._held and not self._is_paused:
            message, binary = self._held.popleft()
            self._deliver(message, binary)
        if self._held_end is not None and not self._held:
            self._over(*self._held_end)
        elif not self._is_paused:
            self._give_credit()

    def when_empty(self, callback: Callable[[], None]) -> None:
        """See :class:`~rwt_transports.api.FlowControl`."""
        if self._state is _StreamState.OPEN:
            self._on_empty = callback
            self._uplink.ready(self, Lane.REPLIES)

    # -- the uplink's side: sending --------------------------------------------------------------------------

    @property
    def is_over(self) -> bool:
        """True if the endpoint was told of the end."""
        return self._state is _StreamState.OVER

    @property
    def has_unsent(self) -> bool:
        """True if a message of the control lane waits, or a part of one."""
        return bool(self._control or self._stops or self._begun.keys() & {Lane.REPLIES, Lane.BULK})

    def take(self, lane: Lane, most: int) -> bytes | None:
        """Return the next frame of a lane, with at most `most` bytes of payload; None if there is none."""
        if self._state is _StreamState.OVER:
            return None
        if self._opening and (self._state is _StreamState.OPEN or self.has_unsent):
            opening, self._opening = self._opening, b""
            return encode_open(self.number, opening)
        begun = self._begun.get(lane) or self._next(lane)
        if begun is None:
            return self._end_frame() if lane is Lane.REPLIES else None
        if lane is Lane.STOP:
            most = STOP_BYTES
        else:
            most = min(most, self._may_send)
            if most <= 0 and len(begun.data):
                self._begun[lane] = begun
                return None  # Until the other side gives credit.
        part = begun.data[begun.at : begun.at + most]
        begun.at += len(part)
        is_last = begun.at >= len(begun.data)
        if is_last:
            self._begun.pop(lane, None)
            self.messages += 1
            if self._state is _StreamState.CLOSING:
                self._uplink.ready(self, Lane.REPLIES)  # For the `END`.
        else:
            self._begun[lane] = begun
        if lane is not Lane.STOP:
            self._may_send -= len(part)
        self.sent_bytes += len(part)
        return encode_data(self.number, lane, part, binary=begun.binary, is_last=is_last)

    def _next(self, lane: Lane) -> _Begun | None:
        if lane is Lane.STOP:
            return _Begun(self._stops.popleft()) if self._stops else None
        if lane in (Lane.SMALL, Lane.LARGE):
            return self._next_sample(lane)
        other = Lane.BULK if lane is Lane.REPLIES else Lane.REPLIES
        # One first-in, first-out order for both: a small reply does not overtake a large one.
        if not self._control or other in self._begun:
            return None
        if (self._control[0].size <= SMALL_BYTES) is not (lane is Lane.REPLIES):
            self._uplink.ready(self, other)
            return None
        frame = self._control.popleft()
        self._control_bytes -= frame.size
        return _Begun(frame)

    def _next_sample(self, lane: Lane) -> _Begun | None:
        begun = self._begun.get(Lane.LARGE if lane is Lane.SMALL else Lane.SMALL)
        busy = None if begun is None else begun.queue
        found = self._data.next_within(SMALL_BYTES if lane is Lane.SMALL else None, busy)
        if found is None:
            if lane is Lane.SMALL and self._data.messages:
                self._uplink.ready(self, Lane.LARGE)  # Behind a small one in its queue.
            return None
        queue, frame = found
        if lane is Lane.LARGE and frame.size <= SMALL_BYTES:
            self._uplink.ready(self, Lane.SMALL)
        return _Begun(frame, queue)

    def _end_frame(self) -> bytes | None:
        """Return the `END` of a closing stream whose messages are sent."""
        if self._ending is None or self.has_unsent:
            return None
        code, reason = self._ending
        announced = not self._opening
        self._over(code, reason)
        return encode_end(self.number, code, reason) if announced else None

    def credited(self, count: int) -> None:
        """Send that many bytes more."""
        self._may_send += count
        for lane in ALL_LANES:
            self._uplink.ready(self, lane)

    def taken(self) -> None:
        """Call the callback of :meth:`when_empty`, if everything was taken."""
        if self._on_empty is not None and not self.backlog:
            # Cleared first: the callback may set another, or close the stream.
            callback, self._on_empty = self._on_empty, None
            callback()

    def tick(self, now: float) -> None:
        """End a closing stream after `limits.close_seconds`."""
        if self._deadline is None:
            self._deadline = now + self._uplink.limits.close_seconds
        elif now >= self._deadline:
            self._control.clear()
            self._stops.clear()
            self._control_bytes = 0
            self._begun.clear()
            self._uplink.ready(self, Lane.REPLIES)

    # -- the uplink's side: receiving ------------------------------------------------------------------------

    def feed(self, data: Data) -> bool:
        """Process a part of a message. Returns False if the other side exceeds its credit."""
        size = len(data.payload)
        if data.lane is Lane.STOP:
            if size > STOP_BYTES or not data.is_last:
                return False
        else:
            self._may_receive -= size
            if self._may_receive < 0:
                return False
            self._taken += size
        if self._state is _StreamState.OPEN:
            self._collect(data)
        if not self._is_paused:
            self._give_credit()
        return True

    def _collect(self, data: Data) -> None:
        whole = self._arriving.add(data.lane, data.payload, is_last=data.is_last)
        self._arriving.hold(self._uplink.buffers, self, self._holder)
        if whole is None:
            return
        if whole.is_complete:
            self._deliver(whole.data, data.binary, urgent=data.lane is Lane.STOP)
        else:
            self._oversized(whole.size, whole.data)

    def _oversized(self, size: int, head: bytes) -> None:
        most = self._uplink.limits.message_bytes
        endpoint: object = self._endpoint
        if isinstance(endpoint, OversizeAware):
            endpoint.oversized(size, most, head)
        else:
            self.close(TOO_BIG, f"a message of {size} bytes; the limit is {most} (message_bytes)")

    def _deliver(self, message: bytes, binary: bool, *, urgent: bool = False) -> None:
        if self._endpoint is None:
            return
        if self._is_paused and self._holds and not urgent:
            self._held.append((message, binary))
            return
        try:
            self._endpoint.receive(message, binary)
        except Exception:
            log_exception("an endpoint failed; ending stream %d", self.number)
            self.close(INTERNAL_ERROR, "internal error")

    def _give_credit(self) -> None:
        if self._taken >= CREDIT_BYTES // 2 and self._state is _StreamState.OPEN:
            self._may_receive += self._taken
            self._uplink.order(encode_credit(self.number, self._taken))
            self._taken = 0

    def ended(self, code: int, reason: str) -> None:
        """Process the end of the stream at the other side, behind the messages that are held back."""
        if self._held:
            self._held_end = code, reason
            self._uplink.forget(self)
        else:
            self._over(code, reason)

    def _over(self, code: int, reason: str) -> None:
        if self._state is _StreamState.OVER:
            return
        self._state = self._state.become(_StreamState.OVER)
        self._ending = self._ending or (code, reason)
        self._on_empty = None
        self._control.clear()
        self._stops.clear()
        self._held.clear()
        self._data.clear()
        self._begun.clear()
        self._arriving.clear()
        self._uplink.buffers.release(self)
        self._uplink.over(self)
        endpoint, self._endpoint = self._endpoint, None
        if endpoint is not None:
            endpoint.closed(*self._ending)
