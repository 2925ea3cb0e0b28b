"""Wire format of TCPROS: connection headers and length-prefixed frames. Without I/O."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Final

from rwt_graph.errors import WireError

#: Maximum bytes of a connection header, which contains the definition of a message.
HEADER_BYTES: Final = 512 * 1024

#: Maximum number of fields of a connection header.
_MOST_FIELDS: Final = 64

#: Maximum bytes of a message, request or response.
MESSAGE_BYTES: Final = 256 * 1024 * 1024


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
        fields[name.decode(errors="replace")] = value.decode(errors="replace")
    return fields


class Frames:
    """Splitter of a stream into frames: a 4-byte little-endian length, then that many bytes.

    Attributes:
        most: maximum bytes of a frame.
        has_status: True if one byte before the length tells success, as in responses of services.
        is_success: status of the frame that was yielded last.
        missing: bytes that the current frame lacks; 0 between frames.
        held: bytes of the current frame.
    """

    def __init__(self, most: int = HEADER_BYTES) -> None:
        self.most = most
        self.has_status = False
        self.is_success = True
        self.missing = 0
        self.held = 0
        self._chunks: list[bytes] = []
        self._head = b""

    def feed(self, data: bytes) -> Iterator[bytes]:
        """Yield the frames that these bytes complete. Attributes may be set between two frames.

        Raises:
            WireError: a frame is larger than `most`.
        """
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
            chunk = data[at : at + self.missing]
            at += len(chunk)
            self.missing -= len(chunk)
            if self.missing:
                self._chunks.append(chunk)
                self.held += len(chunk)
                return
            if self._chunks:
                self._chunks.append(chunk)
                chunk = b"".join(self._chunks)
                self._chunks, self.held = [], 0
            yield chunk
