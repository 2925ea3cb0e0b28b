"""Outgoing messages: frames, and bursts of frames that share their bytes between receivers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

Buffer = bytes | memoryview


class Frame:
    """Outgoing message: text (UTF-8 JSON) or binary. Immutable and shared by all its connections.

    It consists of `parts`, so that payloads are spliced in without a copy. A wire joins header and parts
    once; :meth:`framed` keeps the result for the next connection.
    """

    __slots__ = ("_framed", "_pieces", "binary", "parts", "size")

    def __init__(self, *parts: Buffer, binary: bool = False) -> None:
        self.parts = parts
        self.binary = binary
        # A loop: for the one to three parts of a frame it is faster than sum() and map().
        size = 0
        for part in parts:
            size += len(part)
        self.size = size
        # By identity: connections share the function of their kind of wire.
        self._framed: dict[Callable[[Frame], bytes], bytes] = {}
        self._pieces: dict[int, Sequence[Frame]] | None = None

    @property
    def data(self) -> bytes:
        """Message as one piece."""
        return b"".join(self.parts)

    def framed(self, framing: Callable[[Frame], bytes]) -> bytes:
        """Return the frame's bytes on a wire whose `framing` depends on the frame only; cached."""
        framed = self._framed.get(framing)
        if framed is None:
            framed = self._framed[framing] = framing(self)
        return framed

    def filled(self, own: bytes) -> Frame:
        """Return the message with a receiver's own bytes in its gap: itself, since there is none."""
        return self

    def pieces(self, size: int, cut: Callable[[Frame, int], Sequence[Frame]]) -> Sequence[Frame]:
        """Return the fragments made by `cut`; cached for each `size`."""
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
    """Message with a gap that each receiver's own bytes fill; :meth:`filled` returns what is sent.

    Args:
        after: bytes behind the gap; large parts are shared by all receivers.
    """

    __slots__ = ("_filled",)

    SMALL = 4096
    """Maximum bytes of a message that are copied for each receiver, which costs less than passing parts."""

    def __init__(self, before: bytes, gap: int, *after: Buffer, binary: bool = False) -> None:
        super().__init__(before, *after, binary=binary)
        self.size += gap
        self._filled: dict[bytes, Frame] = {}

    def filled(self, own: bytes) -> Frame:
        """Return the message with these bytes in its gap, shared by all receivers with the same bytes."""
        frame = self._filled.get(own)
        if frame is None:
            before, *after = self.parts
            if self.size <= GapFrame.SMALL:
                frame = Frame(b"".join((before, own, *after)), binary=self.binary)
            else:
                frame = Frame(b"".join((before, own)), *after, binary=self.binary)
            self._filled[own] = frame
        return frame


@dataclass(frozen=True, slots=True)
class Framing:
    """Conversion of frames to the bytes of a wire. It depends only on the frame, so that connections share
    bytes.

    Attributes:
        whole: returns a frame as one piece.
        pieces: returns the same bytes in several pieces; the large ones are the frame's own parts, uncopied.
        shared: False if the bytes depend on what was sent before on the connection: each frame is then framed
            exactly once each time it is sent, in the order of sending.
        joined: returns several frames as one piece, faster than joining the results of `whole`; None if it
            cannot.
        apart: returns the pieces between the gaps of several frames (:class:`GapFrame`), one more than there
            are frames; None if it cannot.
    """

    whole: Callable[[Frame], bytes]
    pieces: Callable[[Frame], tuple[Buffer, ...]]
    shared: bool = True
    joined: Callable[[Sequence[Frame]], bytes] | None = None
    apart: Callable[[Sequence[Frame]], Sequence[bytes]] | None = None


class Burst:
    """Frames of one stream that leave together.

    All receivers' queues hold the same object, so adding a frame costs the same for one receiver and a
    thousand. It accepts frames until its bytes are requested, usually at the end of the event loop's turn, or
    until it is large.

    Attributes:
        members: called once it is sealed, with the number and total size of the frames after its first.
    """

    __slots__ = ("_apart", "_filled", "_first", "_framed", "frames", "is_sealed", "members", "size")

    LARGE = 8 * 1024
    """Maximum bytes of a burst, which a queue may hold without counting them yet."""

    def __init__(self, frame: Frame) -> None:
        self.frames = [frame]
        self._first = self.size = frame.size
        self.members: list[Callable[[int, int], None]] = []
        self.is_sealed = False
        # By identity of framings' functions, which connections share.
        self._framed: dict[object, bytes] = {}
        self._apart: dict[object, Sequence[bytes]] = {}
        self._filled: dict[bytes, Burst] = {}

    def add(self, frame: Frame) -> bool:
        """Add a frame. Returns False, without adding it, if the burst is sealed or would become too large."""
        size = self.size + frame.size
        if self.is_sealed or size > Burst.LARGE:
            return False
        self.frames.append(frame)
        self.size = size
        return True

    def seal(self) -> None:
        """Accept no more frames."""
        if self.is_sealed:
            return
        self.is_sealed = True
        # Each member is called once: a queue counts the first frame itself, and here the others.
        members, self.members = self.members, []
        added = len(self.frames) - 1
        if added:
            size = self.size - self._first
            for member in members:
                member(added, size)

    def filled(self, own: bytes) -> Burst:
        """Return the burst with these bytes in its frames' gaps, shared by receivers with equal bytes."""
        burst = self._filled.get(own)
        if burst is None:
            burst = self._filled[own] = FilledBurst(self, own)
        return burst

    def framed(self, framing: Framing) -> bytes:
        """Return the bytes of all frames on a wire with that `framing`; cached. Seals the burst."""
        framed = self._framed.get(framing.whole)
        if framed is None:
            # Sealed first, because the bytes are shared: a later frame would be missing in them.
            self.seal()
            framed = self._framed[framing.whole] = self._join(framing)
        return framed

    def _join(self, framing: Framing) -> bytes:
        frames = self.frames
        return frames[0].framed(framing.whole) if len(frames) == 1 else _joined(frames, framing)

    def join_filled(self, own: bytes, framing: Framing) -> bytes:
        """Same as :meth:`framed`, with a receiver's own bytes in the gaps."""
        if framing.apart is None:
            return _joined([frame.filled(own) for frame in self.frames], framing)
        apart = self._apart.get(framing.apart)
        if apart is None:
            apart = self._apart[framing.apart] = framing.apart(self.frames)
        return own.join(apart)


def _joined(frames: Sequence[Frame], framing: Framing) -> bytes:
    if framing.joined is not None:
        return framing.joined(frames)
    return b"".join([frame.framed(framing.whole) for frame in frames])


class FilledBurst(Burst):
    """Burst with the bytes of one receiver, or of several that share them; grows with the common burst."""

    __slots__ = ("_all", "_own")

    def __init__(self, of_all: Burst, own: bytes) -> None:
        # Without the constructor of Burst: frames, members and the seal are those of the common burst.
        self._all = of_all
        self._own = own
        self._framed: dict[object, bytes] = {}

    @property
    def size(self) -> int:  # type: ignore[override]  # an attribute of Burst, read from the common burst here
        """Bytes of its frames."""
        return self._all.size

    @property
    def members(self) -> list[Callable[[int, int], None]]:  # type: ignore[override]  # an attribute of Burst, read from the common burst here
        """Members of the common burst in any form."""
        return self._all.members

    def add(self, frame: Frame) -> bool:
        """Add a frame for all receivers."""
        return self._all.add(frame)

    def seal(self) -> None:
        """Accept no more frames for any receiver."""
        self._all.seal()

    def filled(self, own: bytes) -> Burst:
        """Return the burst for another receiver."""
        return self._all.filled(own)

    def _join(self, framing: Framing) -> bytes:
        return self._all.join_filled(self._own, framing)
