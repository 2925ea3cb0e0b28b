"""Order of what an SCTP association sends: turns of channels, shared packets, and acknowledgements."""

from __future__ import annotations

import asyncio
from collections import deque
from collections.abc import Callable, Iterable
from typing import Final, Generic, TypeVar

from aiortc.rtcsctptransport import SCTP_COMMON_HEADER_LENGTH, SCTP_MAX_PACKET_LENGTH, Chunk

FRESH_TURNS: Final = 8
"""Messages of channels without retransmission in a row, after which one of the others has a turn."""
SACK_PACKETS: Final = 2
"""Packets with data that one SACK chunk acknowledges (RFC 9260 section 6.2)."""
SACK_SECONDS: Final = 0.02
"""Maximum delay of a SACK chunk, in which it can join data of this side. RFC 9260 allows 0.2 s, which would
reach the retransmission timeout on links of 50 ms each way.
"""
GAP_BLOCKS: Final = 256
"""Gap blocks of a SACK chunk, which fits a datagram with them."""
PACKET_BYTES: Final = SCTP_MAX_PACKET_LENGTH - SCTP_COMMON_HEADER_LENGTH
"""Maximum size of the chunks of a packet."""


class Bundle(Chunk):
    """Chunks that leave in one packet (RFC 9260 section 6.10)."""

    def __init__(self) -> None:
        super().__init__()
        self._chunks: list[Chunk] = []
        self._size = 0

    def __bool__(self) -> bool:
        return bool(self._chunks)

    def __bytes__(self) -> bytes:
        return b"".join(map(bytes, self._chunks))

    def has_room(self, size: int) -> bool:
        return self._size + size <= PACKET_BYTES

    def append(self, chunk: Chunk, size: int) -> None:
        """Append a chunk of at most some size."""
        self._chunks.append(chunk)
        self._size += size


class Acknowledgement:
    """Decision when received data is acknowledged.

    Attributes:
        packets: packets with data since the last SACK chunk.
        at_once: True if the next SACK chunk must not wait for data or for the timer.
    """

    def __init__(self) -> None:
        self.packets = 0
        self.at_once = False
        self._timer: asyncio.TimerHandle | None = None

    def received(self, on_due: Callable[[], None]) -> bool:
        """Count a packet with data. Returns True if a SACK chunk is due now; `on_due` is called later."""
        self.packets += 1
        if self.at_once or self.packets >= SACK_PACKETS:
            return True
        if self._timer is None:
            self._timer = asyncio.get_running_loop().call_later(SACK_SECONDS, self._is_due, on_due)
        return False

    def _is_due(self, on_due: Callable[[], None]) -> None:
        # A SACK chunk does not cancel the timer: what came since then is acknowledged sooner.
        self._timer = None
        if self.packets:
            on_due()

    def sent(self) -> None:
        self.packets = 0
        self.at_once = False

    def cancel(self) -> None:
        if self._timer is not None:
            self._timer.cancel()
            self._timer = None


_T = TypeVar("_T")


class ChannelTurns(Generic[_T]):
    """Turns of the channels that have messages to send: those without retransmission (fresh) first."""

    def __init__(self) -> None:
        self._fresh: deque[_T] = deque()
        self._others: deque[_T] = deque()
        self._in_a_row = 0

    def __bool__(self) -> bool:
        return bool(self._fresh or self._others)

    def add(self, channel: _T, *, is_fresh: bool) -> None:
        """Append a channel, unless it waits already."""
        waiting = self._fresh if is_fresh else self._others
        if channel not in waiting:
            waiting.append(channel)

    def remove(self, channel: _T) -> None:
        for waiting in (self._fresh, self._others):
            if channel in waiting:
                waiting.remove(channel)

    def next(self) -> _T | None:
        """Remove and return the channel whose turn it is; None if none waits."""
        if self._fresh and (self._in_a_row < FRESH_TURNS or not self._others):
            self._in_a_row += 1
            return self._fresh.popleft()
        self._in_a_row = 0
        return self._others.popleft() if self._others else None


def gap_blocks(last: int, misordered: Iterable[int]) -> list[tuple[int, int]]:
    """Return the gap blocks of a SACK chunk, which fits a datagram with them.

    Args:
        last: number of the last fragment without a gap before it.
        misordered: numbers of those that were received after a gap.
    """
    blocks: list[tuple[int, int]] = []
    for offset in sorted((tsn - last) % 2**32 for tsn in misordered):
        if blocks and offset == blocks[-1][1] + 1:
            blocks[-1] = (blocks[-1][0], offset)
        elif len(blocks) == GAP_BLOCKS:
            break
        else:
            blocks.append((offset, offset))
    return blocks
