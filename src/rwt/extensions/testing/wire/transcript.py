"""Readable transcript of the wire, bounded to the newest lines."""

from __future__ import annotations

from collections import deque
from collections.abc import Callable

from rwt_protocol.frames import Buffer, Frame

#: Maximum number of lines, and of characters per message.
KEPT_LINES = 1000
KEPT_CHARACTERS = 300


class Transcript:
    """Transcript with one line per message, connection and fault.

    ``←`` goes to the client, ``→`` comes from it. Times are of the robot's clock, from the start.
    """

    def __init__(self, monotonic: Callable[[], float]) -> None:
        self._monotonic = monotonic
        self._began = monotonic()
        self._lines: deque[str] = deque(maxlen=KEPT_LINES)
        self._count = 0

    def note(self, client: int, text: str) -> None:
        """Add a line about one client; 0 for a refused one."""
        who = f"client {client}" if client else "a client"
        self._lines.append(f"{self._monotonic() - self._began:9.3f} s  {who} {text}")
        self._count += 1

    def message(self, client: int, arrow: str, shown: str, remark: str = "") -> None:
        """Add a message."""
        self.note(client, f"{arrow} {remark + ' ' if remark else ''}{shown}")

    def lines(self) -> list[str]:
        """Return all lines, oldest first. Thread-safe."""
        return list(self._lines)

    def text(self, most: int = 100) -> str:
        """Return the last `most` lines."""
        lines = self.lines()
        shown = lines[-most:] if most > 0 else []
        left_out = self._count - len(shown)
        return "\n".join([*([f"… {left_out} earlier lines"] if left_out else []), *shown])

    def clear(self) -> None:
        """Remove all lines; times continue."""
        self._lines.clear()
        self._count = 0

    def __str__(self) -> str:
        return self.text()


def shown_frame(frame: Frame) -> str:
    """Return the beginning of an outgoing message."""
    if frame.binary:
        return f"<{frame.size} bytes>"
    head = bytearray()
    for part in frame.parts:
        # A UTF-8 character has up to four bytes.
        head += part[: 4 * KEPT_CHARACTERS - len(head)]
    return _cut(bytes(head), frame.size)


def shown_bytes(data: Buffer, binary: bool) -> str:
    """Return the beginning of a received message."""
    if binary and bytes(data[:1]) != b"{":
        return f"<{len(data)} bytes>"
    return _cut(bytes(data[: 4 * KEPT_CHARACTERS]), len(data))


def _cut(head: bytes, size: int) -> str:
    text = head.decode(errors="replace")
    cut = text[:KEPT_CHARACTERS]
    one_line = cut.replace("\r", "\\r").replace("\n", "\\n")
    return one_line if len(cut.encode(errors="replace")) >= size else f"{one_line}… ({size} bytes)"
