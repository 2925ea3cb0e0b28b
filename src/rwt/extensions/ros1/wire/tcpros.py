"""Wire format of TCPROS: connection headers and length-prefixed frames. Without I/O."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Mapping
from typing import Final

from rwt_graph.errors import WireError

#: Maximum bytes of a connection header, which contains the definition of a message.
HEADER_BYTES: Final = 512 * 1024

#: Maximum number of fields of a connection header.
_MOST_FIELDS: Final = 64

#: Maximum bytes of a value that is neither a definition nor an error.
_VALUE_BYTES: Final = 4096

#: Maximum bytes of a message, request or response.
MESSAGE_BYTES: Final = 128 * 1024 * 1024

#: Minimum bytes of a frame that is yielded as a view of its receive buffer.
LARGE_BYTES: Final = 64 * 1024

#: Receive buffers of large frames: bytes at first, and added at once; maximum number, and bytes of each, that
#: are kept.
_FIRST_BYTES: Final = 256 * 1024
_GROWTH_BYTES: Final = 1024 * 1024
_MOST_BUFFERS: Final = 8
_KEPT_BYTES: Final = 8 * 1024 * 1024


def length_prefix(length: int) -> bytes:
    """Return the prefix of a frame of that many bytes."""
    return length.to_bytes(4, "little")


def encode_header(fields: Mapping[str, str]) -> bytes:
    """Return a connection header as a frame."""
    lines = [f"{name}={value}".encode() for name, value in fields.items()]
    body = b"".join(length_prefix(len(line)) + line for line in lines)
    return length_prefix(len(body)) + body


def decode_header(body: bytes) -> dict[str, str]:
    """Return the fields of a connection header, given without its length.

    Raises:
        WireError: it is not a connection header.
    """
    fields: dict[str, str] = {}
    at = 0
    while at < len(body):
        start = at + 4
        at = start + int.from_bytes(body[at:start], "little")
        name, equals, value = body[start:at].partition(b"=")
        if at > len(body) or not equals or len(fields) >= _MOST_FIELDS:
            raise WireError("a connection header of ROS 1 is malformed")
        if len(value) > _VALUE_BYTES and name not in (b"message_definition", b"error"):
            raise WireError("a value in a connection header of ROS 1 is too long")
        fields[name.decode(errors="replace")] = value.decode(errors="replace")
    return fields


class ReceiveBuffers:
    """Receive buffers of large frames, reused when no view of them is left.

    Each new megabyte costs page faults, which are more expensive than the copy from the kernel.
    """

    def __init__(self) -> None:
        self._kept: deque[bytearray] = deque(maxlen=_MOST_BUFFERS)

    def take(self, size: int) -> bytearray:
        """Return a buffer for a frame of `size` bytes. A new one for a large frame is smaller: it grows."""
        if size < LARGE_BYTES:
            return bytearray(size)
        for index, buffer in enumerate(self._kept):
            # Not much larger: who keeps a view of a frame keeps the whole buffer.
            if min(size, _KEPT_BYTES) <= len(buffer) <= 4 * size and _is_free(buffer):
                del self._kept[index]
                return buffer
        return bytearray(_FIRST_BYTES)

    def give(self, buffer: bytearray) -> None:
        """Keep a buffer, of which views may exist."""
        if LARGE_BYTES <= len(buffer) <= _KEPT_BYTES:
            self._kept.append(buffer)


def _is_free(buffer: bytearray) -> bool:
    """Return True if no view of a buffer exists: only then, its size may change."""
    try:
        buffer.append(0)
    except BufferError:
        return False
    buffer.pop()
    return True


class Frames:
    """Splitter of a stream into frames: a 4-byte little-endian length, then that many bytes.

    Bytes of large frames may be received directly into :meth:`space`.

    Attributes:
        most: maximum bytes of a frame.
        has_status: True if one byte before the length tells success, as in responses of services.
        is_success: status of the frame that was yielded last.
        missing: bytes that the current frame lacks; 0 between frames.
        held: bytes of the current frame.
        memory: bytes of memory for it.
    """

    def __init__(self, most: int = HEADER_BYTES, buffers: ReceiveBuffers | None = None) -> None:
        self.most = most
        self.has_status = False
        self.is_success = True
        self.missing = 0
        self.held = 0
        self._buffers = buffers or ReceiveBuffers()
        self._buffer = bytearray()
        self._head = b""

    def feed(self, data: bytes) -> Iterator[bytes | memoryview]:
        """Yield the frames that these bytes complete. Attributes may be set between two frames.

        Large frames are views: their memory is reused when the last view is gone.

        Raises:
            WireError: a frame is larger than `most`.
        """
        if self._head:
            data, self._head = self._head + data, b""
        at, end = 0, len(data)
        while at < end:
            if not self.missing:
                start = at + (5 if self.has_status else 4)
                if start > end:
                    self._head = data[at:]
                    return
                self.missing = int.from_bytes(data[start - 4 : start], "little")
                if self.missing > self.most:
                    raise WireError(
                        f"a frame of {self.missing} bytes was announced, {self.most} is the limit"
                    )
                if self.has_status:
                    self.is_success = data[at] == 1
                at = start
                if self.missing <= end - at:
                    after = at + self.missing
                    self.missing = 0
                    yield data[at:after]
                    at = after
                    continue
            if at < end:
                at += self._keep(data[at:])
                if not self.missing:
                    yield self._complete()

    def _keep(self, data: bytes) -> int:
        """Add bytes to the current frame; returns their number."""
        count = min(len(data), self.missing)
        left = memoryview(data)[:count]
        while left:
            space = self.space()
            size = min(len(space), len(left))
            space[:size] = left[:size]
            space.release()
            left = left[size:]
            self._count(size)
        return count

    def space(self) -> memoryview:
        """Return memory for the next bytes of the current frame, see :meth:`filled`; release it after use."""
        size = self.held + self.missing
        if not self._buffer:
            self._buffer = self._buffers.take(size)
        if self.held == len(self._buffer):
            # So that memory stays in proportion to what was received.
            self._buffer.extend(bytes(min(self.held, self.missing, _GROWTH_BYTES)))
        return memoryview(self._buffer)[self.held : size]

    def filled(self, count: int) -> bytes | memoryview | None:
        """Count bytes in :meth:`space`; returns the frame that they complete."""
        self._count(count)
        return None if self.missing else self._complete()

    @property
    def memory(self) -> int:
        return len(self._buffer)

    def forget(self) -> None:
        """Free the memory of the current frame, of which no more comes."""
        self._buffer = bytearray()

    def _count(self, count: int) -> None:
        self.held += count
        self.missing -= count

    def _complete(self) -> bytes | memoryview:
        buffer, size = self._buffer, self.held
        self._buffer, self.held = bytearray(), 0
        if size < LARGE_BYTES:
            return bytes(buffer)
        self._buffers.give(buffer)
        return memoryview(buffer)[:size].toreadonly()
