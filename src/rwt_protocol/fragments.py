"""Fragmentation: reassembles incoming fragments and cuts outgoing messages (FRG)."""

from __future__ import annotations

import itertools
import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Final

import msgspec

from rwt_protocol.errors import Refused
from rwt_protocol.frames import Frame
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Fragment

MOST_PIECES: Final = 1_000
"""Maximum number of fragments of a message; fragments are longer than requested if necessary."""

_encode: Final = msgspec.json.Encoder().encode
_numbers: Final = itertools.count(1)

_OVERHEAD: Final = 200
"""Bytes that a pending fragment counts in addition to its text."""


@dataclass(slots=True)
class _Pieces:
    total: int
    touched: float
    size: int = 0
    texts: dict[int, bytes] = field(default_factory=dict)


class MessageReassembly:
    """Fragmented messages of one peer that are still incomplete (FRG-08)."""

    __slots__ = ("_limits", "_open", "_size")

    def __init__(self, limits: WireLimits) -> None:
        self._limits = limits
        self._open: dict[str | int, _Pieces] = {}
        self._size = 0

    def add(self, fragment: Fragment, now: float) -> bytes | None:
        """Add a fragment.

        Returns:
            The message in UTF-8 if this was its last fragment, joined by `num` (FRG-01). Its id stays
            reserved until :meth:`forget` is called (FRG-10).

        Raises:
            Refused: the fragment does not fit; earlier fragments of the message are kept (FRG-04).
        """
        if fragment.num >= fragment.total:
            raise Refused(f"fragment.num: expected less than the total, {fragment.total}, got {fragment.num}")
        pieces = self._pieces_for(fragment, now)
        if fragment.total != pieces.total:
            raise Refused(f"fragment.total: expected {pieces.total} as before, got {fragment.total}")
        if fragment.num in pieces.texts:
            raise Refused(f"fragment.num: piece {fragment.num} has already arrived")
        # Charged before it counts as arrived: a piece that exceeds the limit drops its whole message.
        self._keep(fragment, pieces)
        pieces.touched = now
        if len(pieces.texts) < pieces.total:
            return None
        return b"".join([pieces.texts[num] for num in range(pieces.total)])

    def forget(self, id: str | int) -> None:  # as on the wire
        """Drop the received fragments of a message."""
        pieces = self._open.pop(id, None)
        if pieces is not None:
            self._size -= pieces.size

    def _pieces_for(self, fragment: Fragment, now: float) -> _Pieces:
        """Return the message of a fragment. Late fragments still find their message (FRG-06, FRG-07)."""
        pieces = self._open.get(fragment.id)
        if pieces is not None:
            return pieces
        # Expired messages are dropped only here, when a new one begins, so that no timer is needed.
        for late in [
            mark for mark, held in self._open.items() if now - held.touched > self._limits.fragment_seconds
        ]:
            self.forget(late)
        if len(self._open) >= self._limits.fragmented_messages:
            most = self._limits.fragmented_messages
            raise Refused(
                f"fragment: {most} messages are in pieces already; complete one first"
                " (limits.fragmented_messages)"
            )
        pieces = self._open[fragment.id] = _Pieces(fragment.total, now)
        return pieces

    def _keep(self, fragment: Fragment, pieces: _Pieces) -> None:
        size = len(fragment.data) + _OVERHEAD
        most = self._limits.fragment_characters
        # A peer could announce a huge total and send small pieces, so the total is charged, too.
        if self._size + size > most or fragment.total * _OVERHEAD > most:
            self.forget(fragment.id)
            raise Refused(
                f"fragment: the pieces take more than {most} characters; the message was dropped"
                " (limits.fragment_characters)"
            )
        # As bytes: text beyond ASCII takes up to four bytes per character in a str.
        pieces.texts[fragment.num] = fragment.data.encode()
        pieces.size += size
        self._size += size


def cut(frame: Frame, size: int, id: str = "") -> Sequence[Frame]:  # as on the wire
    """Cut a frame into fragments of at most `size` characters, if it is longer (FRG-21).

    Binary frames are never cut (FRG-27), and sizes below one request no cutting. A message of more than 1,000
    fragments is cut into 1,000 longer ones.

    Args:
        frame: the whole message.
        size: maximum characters of a fragment.
        id: id of the fragments. Clients need a non-empty string, so a new unique one replaces the empty
            string (FRG-24).
    """
    if frame.binary or size < 1 or frame.size <= size:
        return (frame,)
    # The limit counts characters, so a frame of more bytes may still fit.
    text = frame.data.decode()
    if len(text) <= size:
        return (frame,)
    size = max(size, math.ceil(len(text) / MOST_PIECES))
    total = math.ceil(len(text) / size)
    head = b'{"op":"fragment","id":' + _encode(id or f"fragment:{next(_numbers)}") + b',"data":'
    return tuple(
        Frame(
            head + _encode(text[num * size : (num + 1) * size]) + f',"num":{num},"total":{total}}}'.encode()
        )
        for num in range(total)
    )
