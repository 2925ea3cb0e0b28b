"""What an encoding does: a frame to raw members, an op to a frame."""

from __future__ import annotations

from collections.abc import Callable, Generator, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar, runtime_checkable

from rwt_protocol.frames import Frame
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Op
from rwt_protocol.payloads import Encodable, Sample

T = TypeVar("T")
Steps = Generator[None, None, T]
"""Work in steps of about a millisecond at most, between which others may be served."""

PublishEncoder = Callable[[Sample], Frame]
"""From a sample of one topic to its `publish` message, a frame that all subscribers share.

One that takes long has a method ``steps(sample) -> Iterator[None]``, too, after which the call is quick.
"""

Members = dict[str, object]
"""The members of one message, nothing validated: scalars decoded, payloads as `msgspec.Raw`, `RawJson` or
`Decoded`."""


@dataclass(frozen=True, slots=True)
class DecodeFailure:
    """Something in a frame that is not a message.

    Attributes:
        reason: what is wrong, in words for the sender.
        members: what could be read of it, to address the answer.
    """

    reason: str
    members: Members = field(default_factory=dict)


class Codec(Protocol):
    """The envelope in one encoding. Stateless; one instance serves every session."""

    def split(self, data: bytes, limits: WireLimits) -> Sequence[Members | DecodeFailure]:
        """The messages in one frame, in order. Never raises."""

    def encode(self, op: Op) -> Frame:
        """One op as a frame. A payload is spliced in where the encoding of both is the same.

        Raises:
            MalformedPayload: its payload came from another peer, and is not JSON.
        """

    def response(self, service: str, values: Encodable, id: str | int | None = None) -> Frame:
        """The reply to a call that succeeded: what :meth:`encode` makes of it, sooner (SRV-01)."""

    def call(self, service: str, args: Encodable, id: str | int) -> Frame:
        """A call to a provider: what :meth:`encode` makes of it, sooner (SVP-01, SVP-02)."""

    def publish_encoder(self, topic: str) -> PublishEncoder:
        """An encoder for the samples of `topic`; what is the same in all of them is computed here, once."""


@runtime_checkable
class SplitsInSteps(Protocol):
    """A codec that takes large frames apart in steps, between which others may be served."""

    def split_in_steps(self, data: bytes, limits: WireLimits) -> Steps[Sequence[Members | DecodeFailure]]:
        """As :meth:`Codec.split`, in steps of about a millisecond at most."""


def finished(steps: Steps[T]) -> T:
    """What work in steps comes to, all of them at once."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result
