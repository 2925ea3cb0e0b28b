"""What an encoding does: a frame to raw members, an op to a frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Protocol

from rwt_protocol.ops import Op
from rwt_protocol.transport import Frame

Members = dict[str, object]
"""The members of one message, nothing validated: scalars decoded, payloads as `msgspec.Raw`, `RawJson` or
`Decoded`."""


@dataclass(frozen=True, slots=True)
class Fault:
    """Something in a frame that is not a message.

    Attributes:
        reason: what is wrong, in words for the sender.
        members: what could be read of it, to address the answer.
    """

    reason: str
    members: Members = field(default_factory=dict)


class Codec(Protocol):
    """The envelope in one encoding. Stateless; one instance serves every session."""

    @property
    def name(self) -> str:
        """The encoding's name, as `compression` and settings write it."""

    def split(self, data: bytes, max_depth: int) -> Sequence[Members | Fault]:
        """The messages in one frame, in order. Never raises.

        Args:
            data: the frame.
            max_depth: objects and arrays that may be open at once; the message itself is the first.
        """

    def encode(self, op: Op) -> Frame:
        """One op as a frame.

        Raises:
            MalformedPayload: its payload came from another peer, and is not JSON.
        """
