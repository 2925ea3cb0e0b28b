"""What one connection still has to send: two bounded lanes in front of a short queue of bytes.

A frame goes straight to the *ready* bytes while the network keeps up. When those are full, frames wait in
their lane:

- control: first in, first out, goes before data, never dropped; too much of it ends the connection;
- data: samples, each topic by itself; see :mod:`rwt_transports.data_lane`.

Order holds within the control lane and within a topic. Nothing here blocks, and nothing allocates a task.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Sequence
from time import time_ns
from typing import cast

from rwt_protocol.frames import Buffer, Burst, Frame
from rwt_transports.api import Framing
from rwt_transports.data_lane import DataLane, Queue
from rwt_transports.endpoint import AS_MANY_AS_FIT, DropReason, FlowRules, Traffic
from rwt_transports.limits import Limits

SLICE_BYTES = 256 * 1024
"""A larger piece is handed over in slices of this size, so that a slow peer's rest stays shared and
uncopied."""
ALONE_BYTES = 32 * 1024
"""A piece of this size is not joined with others: copying it would cost more than one more write."""
GATHER_BYTES = 1024 * 1024
"""What one call of the system is given at once, where it takes several pieces."""
PIECES_BYTES = 256 * 1024
"""A frame of this size is not even joined with its own header."""


class OutboxFlow:
    """One topic's way through an outbox; satisfies :class:`rwt_transports.endpoint.Flow`."""

    __slots__ = ("_outbox", "_queue")

    def __init__(self, outbox: Outbox, queue: Queue) -> None:
        self._outbox = outbox
        self._queue = queue

    def send(self, frame: Frame) -> None:
        """Queue one message of one frame."""
        outbox = self._outbox
        room = outbox.room
        if room > 0 and frame.size < outbox.small:
            # The same as send_at_once, written out: this runs for each sample and each subscriber.
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
        """Let a burst go out with the ready bytes, if there is room for them."""
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
        burst.members.append(outbox)
        return True

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        """Queue one message in one or more frames."""
        outbox = self._outbox
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
        """Follow these rules from now on."""
        self._outbox.configure(self._queue, rules)

    def close(self) -> None:
        """Report no further drops."""
        self._queue.on_drop = None


class Outbox:
    """The sending side of one connection.

    Args:
        framing: how a frame becomes bytes.
        limits: the bounds of the two lanes.
        wake: called when there is something to take and there was nothing before.
        overflow: called once with a reason when the control lane is full.

    Attributes:
        ready: bytes that go out next, and bursts of which some may still grow.
        bursts: whether some of them are bursts.
        room: bytes that may still join them; none while anything waits in a lane.
        messages: frames that have been made ready so far.
        received: bytes that came the other way; the connection counts them here, beside what it sends.
        small: frames below this many bytes are one piece that every connection shares.
        burst_bytes: frames below this many bytes may begin a burst.
        whole: makes that piece.
    """

    __slots__ = (
        "_begun", "_closed", "_control", "_control_bytes", "_data", "_framing", "_large", "_limits",
        "_on_empty", "_overflow", "_taken", "burst_bytes", "bursts", "messages", "ready",
        "received", "room", "small", "wake", "whole",
    )  # fmt: skip

    def __init__(
        self,
        framing: Framing,
        limits: Limits,
        wake: Callable[[], None],
        overflow: Callable[[str], None],
    ) -> None:
        self._limits = limits
        self._framing = framing
        self.whole = framing.whole
        self.small = min(ALONE_BYTES, limits.outgoing_bytes + 1) if framing.shared else 0
        # What is added to a burst is not looked at here.
        self.burst_bytes = self.small if self.small > Burst.LARGE else 0
        self.wake = wake
        self._overflow = overflow
        self.ready: list[Buffer | Burst] = []
        self.bursts = False
        self._large = 0  # how many of them are not to be joined
        self.room = limits.ready_bytes
        self._begun: deque[memoryview] = deque()  # the rest of what went out in part
        self._control: deque[Frame] = deque()
        self._control_bytes = 0
        self._data = DataLane(limits)
        self.messages = 0
        self.received = 0
        self._taken = 0
        self._on_empty: Callable[[], None] | None = None
        self._closed = False

    # -- the endpoint's side -------------------------------------------------------------------------------

    def send(self, frame: Frame) -> None:
        """Queue one frame in the control lane; see :meth:`rwt_transports.endpoint.Sink.send`."""
        if self.room > 0:
            self.send_at_once(frame)
        elif not self._closed:
            self._queue_control(frame)

    def flow(
        self,
        topic: str,
        rules: FlowRules = AS_MANY_AS_FIT,
        *,
        on_drop: Callable[[DropReason], None] | None = None,
        time_ns: Callable[[], int] = time_ns,
    ) -> OutboxFlow:
        """A way for samples, in the data lane; see :meth:`rwt_transports.endpoint.Sink.flow`."""
        return OutboxFlow(self, Queue(topic, rules, on_drop, time_ns))

    def send_at_once(self, frame: Frame) -> None:
        """Put a frame to the ready bytes, whether there is room or not."""
        ready = self.ready
        if not ready:
            self.wake()
        if frame.size < self.small:
            ready.append(frame.framed(self.whole))
        else:
            self._ready_large(frame)
        self.room -= frame.size
        self.messages += 1

    def sealed(self, frames: int, size: int) -> None:
        """A burst among the ready bytes has grown since it was put there; satisfies
        :class:`rwt_protocol.frames.BurstMember`."""
        self.messages += frames
        self.room -= size

    def is_too_large(self, queue: Queue, frame: Frame) -> bool:
        """Whether a frame of the data lane is too large to be sent; if so, that is counted and reported."""
        if frame.size <= self._limits.outgoing_bytes:
            return False
        self._data.leave_out(queue, DropReason.SIZE)
        return True

    def send_later(self, queue: Queue, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        """Let a message of the data lane wait for its turn."""
        if not self._closed:
            self._data.add(queue, pieces, expires_ns)

    def send_rest_later(self, queue: Queue, pieces: Sequence[Frame]) -> None:
        """Let the rest of a message wait that has begun to go out."""
        if not self._closed:
            self._data.add_begun(queue, pieces)

    def configure(self, queue: Queue, rules: FlowRules) -> None:
        """Give a queue of the data lane other rules."""
        queue.rules = rules
        if rules.depth is not None:
            self._data.cut(queue, max(rules.depth, 1))

    @property
    def backlog(self) -> int:
        """Bytes queued and not yet handed to the network."""
        begun = sum(map(len, self._begun))
        ready = sum(piece.size if isinstance(piece, Burst) else len(piece) for piece in self.ready)
        return begun + ready + self._control_bytes + self._data.size

    @property
    def traffic(self) -> Traffic:
        """Counts since the connection began."""
        waiting = len(self._control) + self._data.messages
        return Traffic(
            self.messages, self._taken, waiting, self.backlog, dict(self._data.dropped), self.received
        )

    @property
    def taken(self) -> int:
        """Bytes handed to the network so far."""
        return self._taken

    @property
    def is_waited_for(self) -> bool:
        """Whether something is to happen once everything has been taken by the network, or bytes wait."""
        return self._on_empty is not None or bool(self.ready) or bool(self._begun)

    def _ready_frame(self, frame: Frame) -> None:
        self.messages += 1
        if frame.size < self.small:
            self.ready.append(frame.framed(self.whole))
        else:
            self._ready_large(frame)

    def _ready_large(self, frame: Frame) -> None:
        if not self._framing.shared:
            pieces = self._framing.pieces(frame)  # never from what was kept: each time is another
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
        """Queue bytes of the protocol itself that may be left out while the peer does not read."""
        if self.room > -self._limits.ready_bytes and not self._closed:
            self.push(data)

    def finish(self, last: bytes) -> None:
        """Queue `last` after the control lane and let nothing follow: data still queued is dropped."""
        for frame in self._control:
            self._ready_frame(frame)
        if last:
            self.push(last)
        self.stop_sending()
        self.wake()

    def stop_sending(self) -> None:
        """Let nothing follow what is ready: the lanes are emptied."""
        self._discard_lanes()
        self._settle_bursts()
        self._closed = True
        self.room = 0

    def discard(self) -> None:
        """The peer is gone: free everything, and let nothing follow."""
        self.stop_sending()
        self.ready.clear()
        self._large = 0
        self._begun.clear()
        self._on_empty = None
        self._overflow = _unheard  # Its connection refers to this.

    def _discard_lanes(self) -> None:
        self._control.clear()
        self._control_bytes = 0
        self._data.clear()

    def when_empty(self, callback: Callable[[], None]) -> None:
        """Call `callback` once, when everything has been taken."""
        self._on_empty = callback
        self.wake()

    # -- the driver's side ---------------------------------------------------------------------------------

    def take(self) -> Buffer | None:
        """The next bytes to write, None when there are none."""
        if self._begun:
            data: Buffer = self._slice(self._begun.popleft(), SLICE_BYTES)
        else:
            ready = self.ready
            if not ready:
                self._refill()
                if not ready:
                    self._empty()
                    return None
            data = self._take_mixed(self._settle_bursts(), SLICE_BYTES) if self._large else self._take_small()
        self._taken += len(data)
        return data

    def _take_small(self) -> Buffer:
        """Take all ready bytes as one piece; none of them is large."""
        ready = self.ready
        if len(ready) == 1:
            piece, framing = ready[0], self._framing
            data = (
                piece.framed(self.whole, framing.joined, framing.apart) if isinstance(piece, Burst) else piece
            )
        else:
            data = b"".join(self._settle_bursts())
        ready.clear()
        self.bursts = False
        self._make_room()
        return data

    def _settle_bursts(self) -> list[Buffer]:
        """The ready bytes, with the bytes of each burst in its place; the same list."""
        ready = self.ready
        if self.bursts:
            self.bursts = False
            framing = self._framing
            for at, piece in enumerate(ready):
                if isinstance(piece, Burst):
                    ready[at] = piece.framed(self.whole, framing.joined, framing.apart)
        return cast("list[Buffer]", ready)

    def take_pieces(self) -> tuple[Sequence[Buffer], bool]:
        """Return the next pieces to write, and True if the caller must come again once they are written.

        Small pieces are joined, large ones uncopied. There are no pieces if nothing is queued.
        """
        if not self.ready and not self._begun:
            self._refill()
            if not self.ready:
                self._empty()
                return (), False
        pieces: Sequence[Buffer]
        if self._large or self._begun:
            pieces = self._gather()
        else:
            pieces = (self._take_small(),)
            self._taken += len(pieces[0])
        # There is room as long as nothing waits.
        return pieces, self.room <= 0 or self._on_empty is not None

    def _gather(self) -> Sequence[Buffer]:
        """Take large pieces and what is in front of them, up to what one call of the system gets."""
        pieces: list[Buffer] = []
        left = GATHER_BYTES
        while left > 0:
            if self._begun:
                pieces.append(self._slice(self._begun.popleft(), left))
            elif self._large:
                pieces.append(self._take_mixed(self._settle_bursts(), left))
            else:
                break
            left -= len(pieces[-1])
        self._taken += GATHER_BYTES - left
        if self.ready and not self._large and not self._begun:
            # The end of the last large message, and what is small behind it.
            pieces.append(self._take_small())
            self._taken += len(pieces[-1])
        return pieces

    def put_back(self, pieces: Sequence[Buffer]) -> None:
        """Let the last of the pieces that were taken go first next time: the network has not taken them."""
        for piece in filter(len, reversed(pieces)):
            self._begun.appendleft(memoryview(piece))
            self._taken -= len(piece)
        self._make_room()

    def _take_mixed(self, ready: list[Buffer], most: int) -> Buffer:
        """The small pieces up to the first large one, joined; or that one, by itself and in slices."""
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
        waiting = self.ready or self._begun or self._control or self._data.schedule
        self.room = 0 if waiting or self._closed else self._limits.ready_bytes

    def _empty(self) -> None:
        self._make_room()
        callback, self._on_empty = self._on_empty, None
        if callback is not None:
            callback()

    def _refill(self) -> None:
        """Move frames from the lanes to the ready bytes, as much as one write may join."""
        room = self._limits.ready_bytes
        control = self._control
        while control and room > 0:
            frame = control.popleft()
            self._control_bytes -= frame.size
            self._ready_frame(frame)
            room -= frame.size
        while room > 0 and (next_frame := self._data.next()) is not None:
            room -= next_frame.size
            self._ready_frame(next_frame)


def _unheard(_reason: str) -> None:
    """Takes what would be said to a connection that has ended."""
