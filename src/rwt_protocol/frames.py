"""Outgoing messages: frames, and bursts of frames that share their bytes between receivers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Protocol

Buffer = bytes | memoryview


class Frame:
    """One outgoing message: text (UTF-8 JSON) or binary. Immutable; shared by every connection it goes to.

    It is kept as `parts`, so that a payload is spliced into its envelope without a copy; a wire joins header
    and parts once, and :meth:`framed` keeps the outcome for the next connection.
    """

    __slots__ = ("_framed", "_framing", "_others", "_pieces", "binary", "parts", "size")

    def __init__(self, *parts: Buffer, binary: bool = False) -> None:
        self.parts = parts
        self.binary = binary
        size = 0
        for part in parts:
            size += len(part)
        self.size = size
        self._framing: object = None
        self._framed = b""
        self._others: dict[object, bytes] | None = None
        self._pieces: dict[int, Sequence[Frame]] | None = None

    @property
    def data(self) -> bytes:
        """The whole message as one piece."""
        return b"".join(self.parts)

    def framed(self, framing: Callable[[Frame], bytes]) -> bytes:
        """The bytes of this frame on a wire whose `framing` needs nothing but the frame; computed once.

        Most frames meet one kind of wire. Those that meet more, as where some peers compress, keep each.
        """
        if self._framing is framing:
            return self._framed
        if self._framing is None:
            self._framing = framing
            self._framed = framing(self)
            return self._framed
        if self._others is None:
            self._others = {}
        framed = self._others.get(framing)
        if framed is None:
            framed = self._others[framing] = framing(self)
        return framed

    def filled(self, own: bytes) -> Frame:
        """The message for the receiver that these bytes are the own ones of: itself, since it has no gap."""
        return self

    def pieces(self, size: int, cut: Callable[[Frame, int], Sequence[Frame]]) -> Sequence[Frame]:
        """The frames into which `cut` cuts this message; done once for each `size`, for all receivers."""
        if self._pieces is None:
            self._pieces = {}
        pieces = self._pieces.get(size)
        if pieces is None:
            pieces = self._pieces[size] = cut(self, size)
        return pieces

    def __repr__(self) -> str:
        kind = "binary" if self.binary else "text"
        return f"<Frame {kind} {self.size} bytes>"


class GapFrame(Frame):
    """A message that is the same for all receivers but for a gap, in which each gets bytes of its own. What
    is sent is what :meth:`filled` returns.

    Args:
        before: what goes before the gap.
        gap: how many bytes each receiver's own have.
        after: what goes behind it; large parts of it are shared by all.
    """

    __slots__ = ("_filled",)

    SMALL = 4096
    """Bytes of a message that are copied for each receiver, since that costs less than to hand over parts."""

    def __init__(self, before: bytes, gap: int, *after: Buffer, binary: bool = False) -> None:
        super().__init__(before, *after, binary=binary)
        self.size += gap
        self._filled: dict[bytes, Frame] = {}

    def filled(self, own: bytes) -> Frame:
        """The message with these bytes in its gap; the same one for all that have them in common."""
        frame = self._filled.get(own)
        if frame is None:
            before, *after = self.parts
            if self.size <= GapFrame.SMALL:
                frame = Frame(b"".join((before, own, *after)), binary=self.binary)
            else:
                frame = Frame(b"".join((before, own)), *after, binary=self.binary)
            self._filled[own] = frame
        return frame


class BurstMember(Protocol):
    """A queue that took in a burst."""

    def sealed(self, frames: int, size: int) -> None:
        """The burst takes no more: beside its first frame it has so many, of that size together."""


class Burst:
    """The frames of one stream that leave together: every receiver's queue holds the same object, so that a
    frame that is added costs the same for one receiver and for a thousand.

    It takes frames until somebody asks for its bytes, usually at the end of the event loop's turn, or until
    it is large.

    Attributes:
        frames: its frames; read-only.
        is_sealed: True if it takes no more frames.
        size: bytes of its frames.
        members: the queues that hold it; they are told what was added once it is sealed.
    """

    __slots__ = (
        "_apart", "_apart_by", "_filled", "_first", "_framed", "_framing", "_others", "frames", "is_sealed",
        "members", "size",
    )  # fmt: skip

    LARGE = 8 * 1024
    """Bytes after which a burst takes no more: what a queue may hold that it does not count yet."""

    def __init__(self, frame: Frame) -> None:
        self.frames = [frame]
        self._first = self.size = frame.size
        self.members: list[BurstMember] = []
        self.is_sealed = False
        self._framing: object = None
        self._framed = b""
        self._others: dict[object, bytes] | None = None
        self._filled: dict[bytes, Burst] = {}
        self._apart: Sequence[bytes] = ()
        self._apart_by: object = None

    def add(self, frame: Frame) -> bool:
        """Take one more frame; False, and nothing is taken, when it is sealed or would be too large."""
        size = self.size + frame.size
        if self.is_sealed or size > Burst.LARGE:
            return False
        self.frames.append(frame)
        self.size = size
        return True

    def seal(self) -> None:
        """Take no more."""
        if self.is_sealed:
            return
        self.is_sealed = True
        members, self.members = self.members, []
        added = len(self.frames) - 1
        if added:
            size = self.size - self._first
            for member in members:
                member.sealed(added, size)

    def filled(self, own: bytes) -> Burst:
        """The same burst with these bytes in the gaps of its frames, each of which is a :class:`GapFrame`;
        the same one for all that have them in common."""
        burst = self._filled.get(own)
        if burst is None:
            burst = self._filled[own] = FilledBurst(self, own)
        return burst

    def framed(
        self,
        framing: Callable[[Frame], bytes],
        joined: Callable[[Sequence[Frame]], bytes] | None = None,
        apart: Callable[[Sequence[Frame]], Sequence[bytes]] | None = None,
    ) -> bytes:
        """The bytes of all frames on a wire with that `framing`; joined once for all that ask. Seals it.

        Args:
            framing: makes the bytes of one frame.
            joined: makes the same bytes of several, sooner.
            apart: makes what stands between the gaps of several that have one each, for all receivers.
        """
        if self._framing is framing:
            return self._framed
        self.seal()
        if self._framing is None:
            self._framing = framing
            self._framed = self._join(framing, joined, apart)
            return self._framed
        if self._others is None:
            self._others = {}
        framed = self._others.get(framing)
        if framed is None:
            framed = self._others[framing] = self._join(framing, joined, apart)
        return framed

    def _join(
        self,
        framing: Callable[[Frame], bytes],
        joined: Callable[[Sequence[Frame]], bytes] | None,
        apart: Callable[[Sequence[Frame]], Sequence[bytes]] | None,
    ) -> bytes:
        frames = self.frames
        return frames[0].framed(framing) if len(frames) == 1 else _joined(frames, framing, joined)

    def join_filled(
        self,
        own: bytes,
        framing: Callable[[Frame], bytes],
        joined: Callable[[Sequence[Frame]], bytes] | None,
        apart: Callable[[Sequence[Frame]], Sequence[bytes]] | None,
    ) -> bytes:
        """As :meth:`framed`, with a receiver's own bytes in the gaps."""
        if apart is None:
            return _joined([frame.filled(own) for frame in self.frames], framing, joined)
        if self._apart_by is not apart:
            self._apart = apart(self.frames)
            self._apart_by = apart
        return own.join(self._apart)


def _joined(
    frames: Sequence[Frame],
    framing: Callable[[Frame], bytes],
    joined: Callable[[Sequence[Frame]], bytes] | None,
) -> bytes:
    if joined is not None:
        return joined(frames)
    return b"".join([frame.framed(framing) for frame in frames])


class FilledBurst(Burst):
    """A burst as one receiver gets it, or some that have their own bytes in common; it grows with the one of
    all."""

    __slots__ = ("_all", "_own")

    def __init__(self, of_all: Burst, own: bytes) -> None:
        self._all = of_all
        self._own = own
        self._framing: object = None
        self._framed = b""
        self._others: dict[object, bytes] | None = None

    @property
    def size(self) -> int:  # type: ignore[override]  # a burst's own is counted, this one is looked up
        """Bytes of its frames."""
        return self._all.size

    @property
    def members(self) -> list[BurstMember]:  # type: ignore[override]  # as above
        """The queues that hold the burst of all, in whichever way."""
        return self._all.members

    def add(self, frame: Frame) -> bool:
        """Take one more frame for all receivers."""
        return self._all.add(frame)

    def seal(self) -> None:
        """Take no more, for any receiver."""
        self._all.seal()

    def filled(self, own: bytes) -> Burst:
        """The burst for another receiver."""
        return self._all.filled(own)

    def _join(
        self,
        framing: Callable[[Frame], bytes],
        joined: Callable[[Sequence[Frame]], bytes] | None,
        apart: Callable[[Sequence[Frame]], Sequence[bytes]] | None,
    ) -> bytes:
        return self._all.join_filled(self._own, framing, joined, apart)
