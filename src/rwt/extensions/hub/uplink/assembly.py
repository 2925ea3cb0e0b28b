"""Messages of which parts have arrived."""

from __future__ import annotations

from typing import NamedTuple

from rwt.extensions.hub.uplink.frames import Lane
from rwt_transports.api import HEAD_BYTES
from rwt_transports.shared_pool import Holder
from rwt_transports.wires.receive_buffer import Incomplete, ReceiveBufferPool


class Whole(NamedTuple):
    """Message that has arrived.

    Attributes:
        data: the message; of one that is too large, its first bytes.
        size: its size.
        is_complete: False if it is too large.
    """

    data: bytes
    size: int
    is_complete: bool


class _Arriving:
    """Message of which a part has arrived.

    Attributes:
        size: bytes that have arrived, including those that were not kept.
    """

    __slots__ = ("data", "size")

    def __init__(self) -> None:
        self.data = bytearray()
        self.size = 0


class Assembly:
    """Incomplete messages of one sender, at most one in each lane.

    Args:
        most: maximum size of a message. Of a larger one, only the first bytes are kept.
    """

    __slots__ = ("_arriving", "_is_held", "_most")

    def __init__(self, most: int) -> None:
        self._most = most
        self._arriving: dict[Lane, _Arriving] = {}
        self._is_held = False

    def has_begun(self, lane: Lane) -> bool:
        """Return True if a part of a message has arrived in a lane, and its last one has not."""
        return lane in self._arriving

    def add(self, lane: Lane, payload: memoryview, *, is_last: bool) -> Whole | None:
        """Add a part. Returns the message that it completes."""
        arriving = self._arriving.get(lane)
        if arriving is None and is_last and len(payload) <= self._most:
            return Whole(bytes(payload), len(payload), True)
        if arriving is None:
            arriving = self._arriving[lane] = _Arriving()
        arriving.size += len(payload)
        if arriving.size <= self._most:
            arriving.data += payload
        elif len(arriving.data) > HEAD_BYTES:
            del arriving.data[HEAD_BYTES:]
        if not is_last:
            return None
        del self._arriving[lane]
        is_complete = arriving.size <= self._most
        kept = arriving.data if is_complete else arriving.data[:HEAD_BYTES]
        return Whole(bytes(kept), arriving.size, is_complete)

    def hold(self, buffers: ReceiveBufferPool, owner: Incomplete, holder: Holder) -> None:
        """Count the incomplete messages in what all connections share."""
        size = sum(len(arriving.data) for arriving in self._arriving.values())
        if size:
            self._is_held = True
            buffers.hold(owner, size, holder)
        elif self._is_held:
            self._is_held = False
            buffers.release(owner)

    def give_up(self) -> None:
        """Drop the incomplete messages; what follows of them is skipped."""
        for arriving in self._arriving.values():
            arriving.size += self._most + 1
            arriving.data.clear()

    def clear(self) -> None:
        """Forget everything."""
        self._arriving.clear()
