"""Queue of outgoing frames of one connection: two bounded lanes in front of a short queue of bytes.

While the network keeps up, a frame goes straight to the *ready* bytes. When those are full, frames wait in a
lane:

- control: first in, first out, before data, never dropped; the connection ends if there is too much of it;
- data: samples, in one queue per topic; see :mod:`rwt_transports.data_lane`.

Order holds within the control lane and within a topic. Nothing here blocks or starts a task.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from time import time_ns
from typing import Final, cast

from rwt_protocol.frames import Buffer, Burst, Frame, Framing
from rwt_protocol.states import StateEnum
from rwt_transports.background import ignore
from rwt_transports.data_lane import DataLane, TopicQueue
from rwt_transports.endpoint import AS_MANY_AS_FIT, DropReason, FlowRules, Traffic
from rwt_transports.limits import Limits

TAKE_BYTES = 256 * 1024
"""Bytes of large pieces that a driver takes at once unless it asks for another number: the rest of a larger
piece stays shared and uncopied for a slow peer."""
ALONE_BYTES = 32 * 1024
"""Pieces of this size are not joined with others: copying them would cost more than another write."""
PIECES_BYTES = 256 * 1024
"""Frames from this size on are not joined with their own header."""


class _OutboxFlow:
    """Flow of one topic through an outbox; implements :class:`rwt_transports.endpoint.Flow`."""

    __slots__ = ("_outbox", "_queue")

    def __init__(self, outbox: Outbox, queue: TopicQueue) -> None:
        self._outbox = outbox
        self._queue = queue

    def send(self, frame: Frame) -> None:
        outbox = self._outbox
        room = outbox.room
        if room > 0 and frame.size < outbox.small:
            # As in send_at_once(), written out: this runs for each sample and each subscriber.
            ready = outbox.ready
            if not ready:
                outbox.wake()
            ready.append(frame.framed(outbox.whole))
            outbox.room = room - frame.size
            outbox.messages += 1
        elif outbox.is_too_large(self._queue, frame):
            return
        elif room <= 0:
            outbox.send_later(self._queue, (frame,))
        else:
            outbox.send_at_once(frame)

    def join(self, burst: Burst) -> bool:
        outbox = self._outbox
        room = outbox.room
        size = burst.size
        if room <= 0 or size >= outbox.burst_bytes:
            return False
        ready = outbox.ready
        if not ready:
            outbox.wake()
        ready.append(burst)
        outbox.bursts = True
        outbox.room = room - size
        outbox.messages += 1
        # The burst reports its growth once, when it is sealed: frames join it without a call per client.
        burst.members.append(outbox.sealed)
        return True

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        outbox = self._outbox
        # All or none: a receiver could not reassemble the rest of a fragmented message.
        if any(outbox.is_too_large(self._queue, frame) for frame in pieces):
            return
        if outbox.room <= 0:
            outbox.send_later(self._queue, pieces, expires_ns)
            return
        sent = 0
        while sent < len(pieces) and outbox.room > 0:
            outbox.send_at_once(pieces[sent])
            sent += 1
        if sent < len(pieces):
            outbox.send_rest_later(self._queue, pieces[sent:])

    def configure(self, rules: FlowRules) -> None:
        self._outbox.configure(self._queue, rules)

    def close(self) -> None:
        self._queue.on_drop = None


class _OutboxState(StateEnum):
    OPEN = "STOPPED"
    STOPPED = "LOST"
    LOST = ()


_OPEN: Final = _OutboxState.OPEN


class Outbox:
    """Sending side of one connection.

    Life cycle::

        OPEN ── finish(), stop_sending() ──> STOPPED ── discard() ──> LOST

    * **OPEN**: frames are accepted.
    * **STOPPED**: further frames are dropped, the lanes stay empty and ``room`` is 0. The ready bytes still
      go out, and the protocol's own, which :meth:`push` adds.
    * **LOST**: nothing is queued; the connection is gone.

    A frame passes three queues: a lane (``_control`` or ``_data``), the ``ready`` bytes, and ``_begun`` (the
    rest of pieces that were written in part). Invariants:

    * ``room`` > 0 only if the lanes and ``_begun`` are empty: frames then bypass the lanes.
    * The data lane waits for the control lane, and both wait for ``ready`` and ``_begun``.

    Attributes by purpose:

    * Lanes: ``_control``, ``_control_bytes``, ``_data``, ``_limits``, ``_overflow``.
    * Ready: ``ready``, ``bursts``, ``room``, ``_large`` (pieces of at least `ALONE_BYTES` among them, which
      are not joined), ``_begun``.
    * Framing: ``_framing``, ``whole``, ``small``, ``burst_bytes``.
    * Wake-up: ``wake``, ``_on_empty`` (called once when everything is taken).
    * Counters: ``messages``, ``received``, ``taken``.

    Args:
        wake: called when there is something to take and there was nothing before.
        overflow: called with a reason when the control lane is full.

    Attributes:
        ready: bytes to write next, and bursts, some of which may still grow.
        room: bytes that may still be added to them.
        messages: number of frames made ready so far.
        received: bytes received by the connection, which counts them here.
        taken: bytes accepted by the network so far.
        small: frames of fewer bytes are one piece that all connections share.
        burst_bytes: frames of fewer bytes may begin a burst.
        whole: builds that piece.
    """

    __slots__ = (
        "_begun", "_control", "_control_bytes", "_data", "_framing", "_large", "_limits",
        "_on_empty", "_overflow", "_state", "burst_bytes", "bursts", "messages", "ready",
        "received", "room", "small", "taken", "wake", "whole",
    )  # fmt: skip

    def __init__(
        self,
        framing: Framing,
        limits: Limits,
        wake: Callable[[], None],
        overflow: Callable[[str], None],
    ) -> None:
        self._state = _OPEN
        self._limits = limits
        self._framing = framing
        self.whole = framing.whole
        # One comparison on the hot path stands for two: small enough to join, and within the size limit.
        self.small = min(ALONE_BYTES, limits.outgoing_bytes + 1) if framing.shared else 0
        # Frames that are added to a burst later are not checked.
        self.burst_bytes = self.small if self.small > Burst.LARGE else 0
        self.wake = wake
        self._overflow = overflow
        self.ready: list[Buffer | Burst] = []
        self.bursts = False
        self._large = 0
        self.room = limits.ready_bytes
        self._begun: deque[memoryview] = deque()
        self._control: deque[Frame] = deque()
        self._control_bytes = 0
        self._data = DataLane(limits)
        self.messages = 0
        self.received = 0
        self.taken = 0
        self._on_empty: Callable[[], None] | None = None

    # -- the endpoint's side -------------------------------------------------------------------------------

    def send(self, frame: Frame) -> None:
        if self.room > 0:
            self.send_at_once(frame)
        elif self._state is _OPEN:
            self._queue_control(frame)

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time_ns,
    ) -> _OutboxFlow:
        return _OutboxFlow(self, TopicQueue(rules, on_drop, time_ns))

    def send_at_once(self, frame: Frame) -> None:
        """Add a frame to the ready bytes, even if there is no room."""
        ready = self.ready
        if not ready:
            self.wake()
        # `framed` is cached in the frame: the first receiver joins header and payload for all others.
        if frame.size < self.small:
            ready.append(frame.framed(self.whole))
        else:
            self._ready_large(frame)
        self.room -= frame.size
        self.messages += 1

    def sealed(self, frames: int, size: int) -> None:
        """Count the growth of a ready burst."""
        self.messages += frames
        self.room -= size

    def is_too_large(self, queue: TopicQueue, frame: Frame) -> bool:
        """Return True if a frame of the data lane is too large to be sent, and count and report the drop."""
        # Only the data lane has this limit: a reply that is too large still answers its request.
        if frame.size <= self._limits.outgoing_bytes:
            return False
        self._data.count_drop(queue, DropReason.SIZE)
        return True

    def send_later(self, queue: TopicQueue, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        """Queue a message in the data lane."""
        if self._state is _OPEN:
            self._data.add(queue, pieces, expires_ns)

    def send_rest_later(self, queue: TopicQueue, pieces: Sequence[Frame]) -> None:
        """Queue the rest of a message whose first frame is ready."""
        if self._state is _OPEN:
            self._data.add_begun(queue, pieces)

    def configure(self, queue: TopicQueue, rules: FlowRules) -> None:
        """Change the rules of a queue of the data lane."""
        queue.rules = rules
        if rules.depth is not None:
            self._data.cut(queue, max(rules.depth, 1))

    @property
    def backlog(self) -> int:
        begun = sum(map(len, self._begun))
        ready = sum(piece.size if isinstance(piece, Burst) else len(piece) for piece in self.ready)
        return begun + ready + self._control_bytes + self._data.size

    @property
    def traffic(self) -> Traffic:
        waiting = len(self._control) + self._data.messages
        return Traffic(
            self.messages, self.taken, waiting, self.backlog, dict(self._data.dropped), self.received
        )

    @property
    def is_waited_for(self) -> bool:
        """True if bytes are queued, or a callback waits until everything is taken."""
        return self._on_empty is not None or bool(self.ready) or bool(self._begun)

    def _ready_frame(self, frame: Frame) -> None:
        self.messages += 1
        if frame.size < self.small:
            self.ready.append(frame.framed(self.whole))
        else:
            self._ready_large(frame)

    def _ready_large(self, frame: Frame) -> None:
        if not self._framing.shared:
            pieces = self._framing.pieces(frame)  # Never cached: these bytes differ each time.
        elif frame.size < PIECES_BYTES:
            pieces = (frame.framed(self.whole),)
        else:
            pieces = self._framing.pieces(frame)
        self.ready.extend(pieces)
        self._large += sum(len(piece) >= ALONE_BYTES for piece in pieces)

    def _queue_control(self, frame: Frame) -> None:
        limits = self._limits
        if self._control_bytes >= limits.control_bytes or len(self._control) >= limits.control_frames:
            self._overflow(
                f"{len(self._control)} replies ({self._control_bytes} bytes) wait unread; "
                f"the limits are {limits.control_frames} (limits.control_frames) and {limits.control_bytes} "
                "bytes (limits.control_bytes)"
            )
            return
        self._control.append(frame)
        self._control_bytes += frame.size

    # -- the connection's side -----------------------------------------------------------------------------

    def push(self, data: Buffer) -> None:
        """Queue bytes of the protocol itself, in front of the lanes: a handshake, a page."""
        # `room` is negative by the bytes that were pushed without room.
        if self.room < -self._limits.control_bytes:
            self._overflow(
                f"answers wait unread; the limit is {self._limits.control_bytes} (limits.control_bytes)"
            )
            return
        if not self.ready:
            self.wake()
        self.ready.append(data)
        self._large += len(data) >= ALONE_BYTES
        self.room -= len(data)

    def push_if_read(self, data: bytes) -> None:
        """Queue bytes of the protocol itself, unless the peer does not read."""
        if self.room > -self._limits.ready_bytes and self._state is _OPEN:
            self.push(data)

    def finish(self, last: bytes) -> None:
        """Queue `last` after the control lane, drop queued data, and accept no further frames."""
        for frame in self._control:
            self._ready_frame(frame)
        if last:
            self.push(last)
        self.stop_sending()
        self.wake()

    def stop_sending(self) -> None:
        """Drop both lanes, and accept no further frames."""
        self._control.clear()
        self._control_bytes = 0
        self._data.clear()
        self._settle_bursts()
        if self._state is _OPEN:
            self._state = self._state.become(_OutboxState.STOPPED)
        self.room = 0

    def discard(self) -> None:
        """Drop everything: the connection is lost."""
        self.stop_sending()
        self._state = self._state.become(_OutboxState.LOST)
        self.ready.clear()
        self._large = 0
        self._begun.clear()
        self._on_empty = None
        self._overflow = ignore  # Break the cycle: the connection refers to this outbox.

    def when_empty(self, callback: Callable[[], None]) -> None:
        self._on_empty = callback
        self.wake()

    # -- the driver's side ---------------------------------------------------------------------------------

    def take(self, limit: int = TAKE_BYTES) -> tuple[Sequence[Buffer], bool]:
        if not self.ready and not self._begun:
            self._refill()
            if not self.ready:
                self._empty()
                return (), False
        pieces: Sequence[Buffer]
        if self._large or self._begun:
            pieces = self._gather(limit)
        else:
            pieces = (self._take_small(),)
            self.taken += len(pieces[0])
        # There is room as long as nothing waits: then the driver is spared a call that returns nothing.
        return pieces, self.room <= 0 or self._on_empty is not None

    def _take_small(self) -> Buffer:
        ready = self.ready
        if len(ready) == 1:
            piece = ready[0]
            data = piece.framed(self._framing) if isinstance(piece, Burst) else piece
        else:
            data = b"".join(self._settle_bursts())
        ready.clear()
        self.bursts = False
        self._make_room()
        return data

    def _settle_bursts(self) -> list[Buffer]:
        ready = self.ready
        if self.bursts:
            self.bursts = False
            for at, piece in enumerate(ready):
                if isinstance(piece, Burst):
                    ready[at] = piece.framed(self._framing)
        return cast("list[Buffer]", ready)

    def _gather(self, limit: int) -> Sequence[Buffer]:
        pieces: list[Buffer] = []
        left = limit
        while left > 0:
            if self._begun:
                pieces.append(self._slice(self._begun.popleft(), left))
            elif self._large:
                pieces.append(self._take_mixed(self._settle_bursts(), left))
            else:
                break
            left -= len(pieces[-1])
        self.taken += limit - left
        if self.ready and not self._large and not self._begun:
            # The end of the last large message, and the small ones after it.
            pieces.append(self._take_small())
            self.taken += len(pieces[-1])
        return pieces

    def put_back(self, pieces: Sequence[Buffer]) -> None:
        # In reverse, since each goes to the front: they were taken first, and must leave first.
        for piece in filter(len, reversed(pieces)):
            self._begun.appendleft(memoryview(piece))
            self.taken -= len(piece)
        self._make_room()

    def _take_mixed(self, ready: list[Buffer], most: int) -> Buffer:
        """Take the small pieces before the first large one, joined, or a slice of that one."""
        small = next(at for at, piece in enumerate(ready) if len(piece) >= ALONE_BYTES)
        if small:
            data = b"".join(ready[:small])
            del ready[:small]
            self.room = 0
            return data
        self._large -= 1
        return self._slice(memoryview(ready.pop(0)), most)

    def _slice(self, data: memoryview, most: int) -> memoryview:
        if len(data) > most:
            self._begun.appendleft(data[most:])
            self.room = 0
            return data[:most]
        self._make_room()
        return data

    def _make_room(self) -> None:
        # Frames may bypass the lanes only while nothing waits in them, or they would overtake older ones.
        waiting = self.ready or self._begun or self._control or self._data.schedule
        self.room = 0 if waiting or self._state is not _OPEN else self._limits.ready_bytes

    def _empty(self) -> None:
        self._make_room()
        # Cleared first: the callback may set another, or close the connection.
        callback, self._on_empty = self._on_empty, None
        if callback is not None:
            callback()

    def _refill(self) -> None:
        """Move frames from the lanes to the ready bytes, up to the size of one write."""
        room = self._limits.ready_bytes
        control = self._control
        # Replies before samples, and no more than one write: what comes meanwhile can still go first.
        while control and room > 0:
            frame = control.popleft()
            self._control_bytes -= frame.size
            self._ready_frame(frame)
            room -= frame.size
        while room > 0 and (next_frame := self._data.next()) is not None:
            room -= next_frame.size
            self._ready_frame(next_frame)
