"""What one connection still has to send: two bounded lanes in front of a short queue of bytes.

A frame goes straight to the *ready* bytes while the network keeps up. When those are full, frames wait in
their lane:

- control: first in, first out, goes before data, never dropped; too much of it ends the connection;
- data: one flow per topic, served in turns by bytes (deficit round robin), so that a small topic waits for
  one frame of a fat one and not for its queue. Over the bound the oldest frame of the same topic goes; a
  topic that has nothing queued takes the place of the flow that holds most, and every topic keeps its
  newest frame.

Order holds within the control lane and within a topic. Nothing here blocks, and nothing allocates a task.
"""

from __future__ import annotations

from collections import deque
from collections.abc import Callable, Mapping

from rwt_protocol.frames import Buffer, Frame, Lane

from .api import Framing
from .limits import Limits

READY_BYTES = 128 * 1024
"""Bytes that may wait in front of the lanes: what one write joins, and the most that dropping cannot
reach."""
SLICE_BYTES = 256 * 1024
"""A larger piece is handed over in slices of this size, so that a slow peer's rest stays shared and
uncopied."""
ALONE_BYTES = 32 * 1024
"""A piece of this size is not joined with others: copying it would cost more than one more write."""
PIECES_BYTES = 256 * 1024
"""A frame of this size is not joined even with its own header."""
QUANTUM_BYTES = 64 * 1024
"""What each topic may send per turn when several wait."""


class _Flow:
    """The frames of one topic that wait, oldest first."""

    __slots__ = ("credit", "frames", "size", "topic")

    def __init__(self, topic: str) -> None:
        self.topic = topic
        self.frames: deque[Frame] = deque()
        self.size = 0
        self.credit = 0


class Outbox:
    """The sending side of one connection; satisfies :class:`rwt_protocol.frames.Sink`.

    Args:
        framing: how a frame becomes bytes.
        limits: the bounds of the two lanes.
        wake: called when there is something to take and there was nothing before.
        overflow: called once with a reason when the control lane is full.
        hang_up: what :meth:`close` asks the connection to do.
    """

    __slots__ = (
        "_closed", "_control", "_control_bytes", "_current", "_data_bytes", "_data_frames", "_dropped",
        "_flows", "_framing", "_hang_up", "_large", "_limits", "_on_empty", "_overflow", "_ready", "_room",
        "_turns", "_wake", "_whole",
    )  # fmt: skip

    def __init__(
        self,
        framing: Framing,
        limits: Limits,
        wake: Callable[[], None],
        overflow: Callable[[str], None],
        hang_up: Callable[[int, str], None],
    ) -> None:
        self._framing = framing
        self._whole = framing.whole
        self._limits = limits
        self._wake = wake
        self._overflow = overflow
        self._hang_up = hang_up
        self._ready: list[Buffer] = []
        self._large = 0  # how many of them are not to be joined
        self._room = READY_BYTES
        self._current: memoryview | None = None
        self._control: deque[Frame] = deque()
        self._control_bytes = 0
        self._flows: dict[str, _Flow] = {}
        self._turns: deque[_Flow] = deque()
        self._data_bytes = 0
        self._data_frames = 0
        self._dropped: dict[str, int] = {}
        self._on_empty: Callable[[], None] | None = None
        self._closed = False

    # -- the endpoint's side -------------------------------------------------------------------------------

    def send(self, frame: Frame, lane: Lane = Lane.CONTROL, topic: str = "") -> None:
        """Queue one frame; see :meth:`rwt_protocol.frames.Sink.send`."""
        if self._room > 0:
            ready = self._ready
            if not ready:
                self._wake()
            if frame.size < ALONE_BYTES:
                ready.append(frame.framed(self._whole))
            else:
                self._ready_large(frame)
            self._room -= frame.size
        elif self._closed:
            return
        elif lane is Lane.CONTROL:
            self._queue_control(frame)
        else:
            self._queue_data(frame, topic)

    def close(self, code: int = 1000, reason: str = "") -> None:
        """Close the connection after what is queued in the control lane; data still queued is not sent."""
        self._hang_up(code, reason)

    @property
    def backlog(self) -> int:
        """Bytes queued and not yet handed to the network."""
        current = 0 if self._current is None else len(self._current)
        return current + sum(map(len, self._ready)) + self._control_bytes + self._data_bytes

    @property
    def dropped(self) -> Mapping[str, int]:
        """Frames dropped so far, by topic."""
        return self._dropped

    def _ready_frame(self, frame: Frame) -> None:
        if frame.size < ALONE_BYTES:
            self._ready.append(frame.framed(self._whole))
        else:
            self._ready_large(frame)

    def _ready_large(self, frame: Frame) -> None:
        pieces = (frame.framed(self._whole),) if frame.size < PIECES_BYTES else self._framing.pieces(frame)
        self._ready.extend(pieces)
        self._large += sum(len(piece) >= ALONE_BYTES for piece in pieces)

    def _queue_control(self, frame: Frame) -> None:
        limits = self._limits
        if self._control_bytes >= limits.control_bytes or len(self._control) >= limits.control_frames:
            self._overflow(
                f"{len(self._control)} replies ({self._control_bytes} bytes) wait unread; "
                f"the limits are {limits.control_frames} (control_frames) and {limits.control_bytes} "
                "bytes (control_bytes)"
            )
            return
        self._control.append(frame)
        self._control_bytes += frame.size

    def _queue_data(self, frame: Frame, topic: str) -> None:
        flow = self._flows.get(topic)
        if flow is None:
            flow = self._flows[topic] = _Flow(topic)
            self._turns.append(flow)
        limits = self._limits
        if self._data_bytes >= limits.data_bytes or self._data_frames >= limits.data_frames:
            self._make_place(flow, frame.size)
        flow.frames.append(frame)
        flow.size += frame.size
        self._data_bytes += frame.size
        self._data_frames += 1

    def _make_place(self, flow: _Flow, size: int) -> None:
        """Drop old frames worth `size` bytes: the topic's own, or the fattest topic's where it has none."""
        victim, keep = (flow, 0) if flow.frames else (self._fattest(), 1)
        freed = 0
        while victim is not None and len(victim.frames) > keep and freed < max(size, 1):
            freed += victim.frames[0].size
            self._drop_oldest(victim)

    def _fattest(self) -> _Flow | None:
        """The flow that holds most bytes among those that have more than their newest frame."""
        rich = [flow for flow in self._turns if len(flow.frames) > 1]
        return max(rich, key=lambda flow: flow.size, default=None)

    def _drop_oldest(self, flow: _Flow) -> None:
        frame = flow.frames.popleft()
        self._forget(flow, frame)
        self._dropped[flow.topic] = self._dropped.get(flow.topic, 0) + 1

    def _forget(self, flow: _Flow, frame: Frame) -> None:
        flow.size -= frame.size
        self._data_bytes -= frame.size
        self._data_frames -= 1

    # -- the connection's side -----------------------------------------------------------------------------

    def push(self, data: bytes) -> None:
        """Queue bytes of the protocol itself, in front of the lanes: a handshake, a page."""
        if self._room < -self._limits.control_bytes:
            self._overflow(f"answers wait unread; the limit is {self._limits.control_bytes} (control_bytes)")
            return
        if not self._ready:
            self._wake()
        self._ready.append(data)
        self._large += len(data) >= ALONE_BYTES
        self._room -= len(data)

    def push_if_read(self, data: bytes) -> None:
        """The same for what may be left out while the peer does not read."""
        if self._room > -READY_BYTES and not self._closed:
            self.push(data)

    def mark(self) -> int:
        """A place in front of what will be sent next; valid until the driver takes."""
        return len(self._ready)

    def insert(self, mark: int, data: bytes) -> None:
        """Put `data` in front of what was sent since :meth:`mark`."""
        self._ready.insert(mark, data)
        self._wake()

    def roll_back(self, mark: int) -> None:
        """Forget what was sent since :meth:`mark`."""
        self._discard_lanes()
        del self._ready[mark:]
        self._large = sum(len(piece) >= ALONE_BYTES for piece in self._ready)
        self._closed = False
        self._room = READY_BYTES

    def finish(self, last: bytes) -> None:
        """Queue `last` after the control lane and let nothing follow: data still queued is thrown away."""
        for frame in self._control:
            self._ready_frame(frame)
        if last:
            self.push(last)
        self.seal()
        self._wake()

    def seal(self) -> None:
        """Let nothing follow what is ready: the lanes are thrown away."""
        self._discard_lanes()
        self._closed = True
        self._room = 0

    def abandon(self) -> None:
        """The peer is gone: free everything, and let nothing follow."""
        self.seal()
        self._ready.clear()
        self._large = 0
        self._current = None
        self._on_empty = None

    def _discard_lanes(self) -> None:
        self._control.clear()
        self._control_bytes = 0
        self._flows.clear()
        self._turns.clear()
        self._data_bytes = 0
        self._data_frames = 0

    def when_empty(self, callback: Callable[[], None]) -> None:
        """Call `callback` once, when everything has been taken."""
        self._on_empty = callback
        self._wake()

    # -- the driver's side ---------------------------------------------------------------------------------

    def take(self) -> Buffer | None:
        """The next bytes to write, None when there are none."""
        if self._current is not None:
            return self._slice(self._current)
        ready = self._ready
        if not ready:
            self._refill()
            if not ready:
                self._empty()
                return None
        if self._large:
            return self._take_mixed(ready)
        data = ready[0] if len(ready) == 1 else b"".join(ready)
        ready.clear()
        self._make_room()
        return data

    def _take_mixed(self, ready: list[Buffer]) -> Buffer:
        """The small pieces up to the first large one, joined; or that one, by itself and in slices."""
        small = next(at for at, piece in enumerate(ready) if len(piece) >= ALONE_BYTES)
        if small:
            data = b"".join(ready[:small])
            del ready[:small]
            self._room = 0
            return data
        self._large -= 1
        return self._slice(memoryview(ready.pop(0)))

    def _slice(self, data: memoryview) -> memoryview:
        if len(data) > SLICE_BYTES:
            self._current = data[SLICE_BYTES:]
            self._room = 0
            return data[:SLICE_BYTES]
        self._current = None
        self._make_room()
        return data

    def _make_room(self) -> None:
        waiting = self._ready or self._control or self._data_frames
        self._room = 0 if waiting or self._closed else READY_BYTES

    def _empty(self) -> None:
        callback, self._on_empty = self._on_empty, None
        if callback is not None:
            callback()

    def _refill(self) -> None:
        """Move frames from the lanes to the ready bytes, as much as one write may join."""
        room = READY_BYTES
        control = self._control
        while control and room > 0:
            frame = control.popleft()
            self._control_bytes -= frame.size
            self._ready_frame(frame)
            room -= frame.size
        while self._data_frames and room > 0:
            room -= self._serve(self._turns[0])

    def _serve(self, flow: _Flow) -> int:
        """Move what the first flow in turn may send, and give the turn away. Returns the bytes moved."""
        frames = flow.frames
        alone = len(self._turns) == 1
        flow.credit += QUANTUM_BYTES
        moved = 0
        while frames and (alone or frames[0].size <= flow.credit):
            frame = frames.popleft()
            self._forget(flow, frame)
            flow.credit -= frame.size
            moved += frame.size
            self._ready_frame(frame)
            if moved >= QUANTUM_BYTES:
                break
        self._turns.popleft()
        if frames:
            self._turns.append(flow)
        else:
            del self._flows[flow.topic]
        if alone or not frames:
            flow.credit = 0
        return moved
