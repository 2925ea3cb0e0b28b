"""Messages in pieces: joining those that arrive, cutting those that leave (FRG)."""

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
"""Frames that one message is cut into at most, however small the pieces that a client asks for."""

_encode: Final = msgspec.json.Encoder().encode
_numbers: Final = itertools.count(1)

_OVERHEAD: Final = 200
"""Bytes that an open piece is counted as, beside its text: what it costs to keep it."""


@dataclass(slots=True)
class _Pieces:
    """The pieces of one message so far."""

    total: int
    touched: float
    size: int = 0
    texts: dict[int, bytes] = field(default_factory=dict)


class Reassembly:
    """The messages of one peer that are still in pieces (FRG-08)."""

    __slots__ = ("_limits", "_open", "_size")

    def __init__(self, limits: WireLimits) -> None:
        self._limits = limits
        self._open: dict[str | int, _Pieces] = {}
        self._size = 0

    def add(self, fragment: Fragment, now: float) -> bytes | None:
        """Take one piece.

        Returns:
            The message in UTF-8 if this was its last piece, joined by `num` (FRG-01); until
            :meth:`forget` is called its id stays taken (FRG-10).

        Raises:
            Refused: the piece does not fit; what has arrived of the message stays (FRG-04).
        """
        if fragment.num >= fragment.total:
            raise Refused(f"fragment.num: expected less than the total, {fragment.total}, got {fragment.num}")
        pieces = self._pieces_for(fragment, now)
        if fragment.total != pieces.total:
            raise Refused(f"fragment.total: expected {pieces.total} as before, got {fragment.total}")
        if fragment.num in pieces.texts:
            raise Refused(f"fragment.num: piece {fragment.num} has already arrived")
        self._keep(fragment, pieces)
        pieces.touched = now
        if len(pieces.texts) < pieces.total:
            return None
        return b"".join([pieces.texts[num] for num in range(pieces.total)])

    def forget(self, id: str | int) -> None:  # as on the wire
        """Drop what has arrived of one message."""
        pieces = self._open.pop(id, None)
        if pieces is not None:
            self._size -= pieces.size

    def _pieces_for(self, fragment: Fragment, now: float) -> _Pieces:
        """The message that a piece belongs to. A late piece still finds its own message (FRG-06, FRG-07)."""
        pieces = self._open.get(fragment.id)
        if pieces is not None:
            return pieces
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
        if self._size + size > most or fragment.total * _OVERHEAD > most:
            self.forget(fragment.id)
            raise Refused(
                f"fragment: the pieces take more than {most} characters; the message was dropped"
                " (limits.fragment_characters)"
            )
        pieces.texts[fragment.num] = fragment.data.encode()
        pieces.size += size
        self._size += size


def cut(frame: Frame, size: int, id: str = "") -> Sequence[Frame]:  # as on the wire
    """A frame as fragments of at most `size` characters of its text, if it is longer (FRG-21).

    A binary frame is never cut (FRG-27), and a size below one asks for no cutting. A message that would take
    more than 1,000 pieces is cut into that many, larger ones.

    Args:
        frame: the whole message.
        size: the most characters in one piece.
        id: what the pieces are known by; clients need a string that is not empty, so an empty one stands for
            a new one that no other message has (FRG-24).
    """
    if frame.binary or size < 1 or frame.size <= size:
        return (frame,)
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
