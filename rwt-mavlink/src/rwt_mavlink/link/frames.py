"""Frames of MAVLink 1 and 2, by pymavlink; no I/O."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Final, TypeAlias

from pymavlink.dialects.v20 import ardupilotmega

dialect: Final[Any] = ardupilotmega
"""Messages and enumerations of MAVLink's common set, and those of ArduPilot; pymavlink has no types."""

MavlinkMessage: TypeAlias = Any
"""Message of pymavlink: its fields are attributes."""

Encode: TypeAlias = Callable[[MavlinkMessage], bytes]

AUTOPILOT: Final = 1
"""Component id of autopilots."""


class FrameWriter:
    """Encoder of one sender's frames, which it numbers.

    Args:
        system: system id of the sender.
        component: its component id.
    """

    def __init__(self, system: int, component: int) -> None:
        self._mavlink = dialect.MAVLink(None, srcSystem=system, srcComponent=component)

    def encode(self, message: MavlinkMessage) -> bytes:
        """Return the frame of a message, in MAVLink 2."""
        frame = bytes(message.pack(self._mavlink))
        self._mavlink.seq = (self._mavlink.seq + 1) % 256
        return frame


class FrameReader:
    """Decoder of a stream of bytes. Bytes that are no frame of the dialect are skipped and counted.

    Attributes:
        skipped: number of pieces that were skipped.
    """

    def __init__(self) -> None:
        self._mavlink = dialect.MAVLink(None)
        self._mavlink.robust_parsing = True
        self.skipped = 0

    def decode(self, data: bytes) -> list[MavlinkMessage]:
        """Return the messages that are complete with these bytes."""
        messages: list[MavlinkMessage] = []
        for message in self._mavlink.parse_buffer(data) or ():
            # Messages that the dialect does not define have the type UNKNOWN_… and no fields.
            if message.get_type() == "BAD_DATA" or message.get_type().startswith("UNKNOWN_"):
                self.skipped += 1
            else:
                messages.append(message)
        return messages


def text_of(value: str | bytes) -> str:
    """Return the text of a field of characters, without the padding."""
    text = value.decode("utf-8", "replace") if isinstance(value, bytes) else value
    return text.partition("\0")[0]
