"""Contract of the codecs: decode frames to raw members, encode ops as frames."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable, Generator, Iterator, Sequence
from dataclasses import dataclass, field
from typing import Protocol, TypeVar

from rwt_protocol.frames import Frame
from rwt_protocol.limits import WireLimits
from rwt_protocol.ops import Op
from rwt_protocol.payloads import Encodable, PublishedMessage

T = TypeVar("T")
Steps = Generator[None, None, T]
"""Work in steps of about a millisecond at most; other work may run between them."""

PublishEncoder = Callable[[PublishedMessage], Frame]
"""Encoder of a topic's samples to `publish` frames, which all subscribers share.

Slow encoders also have a method ``steps(sample) -> Iterator[None]``; once it is exhausted, the call is fast.
"""

Members = dict[str, object]
"""Unvalidated members of one message: scalars decoded, payloads as `msgspec.Raw`, `RawJson` or `Decoded`."""


@dataclass(frozen=True, slots=True)
class DecodeFailure:
    """Part of a frame that is not a message, with the members that were readable, for the answer."""

    reason: str
    members: Members = field(default_factory=dict)

    @classmethod
    def too_deep(cls, max_depth: int, members: Members | None = None) -> DecodeFailure:
        """Return the failure of a message that is nested too deeply."""
        return cls(f"nested more than {max_depth} levels deep (limits.max_depth)", members or {})


class TooMuchStructure(Exception):
    """The frame exceeds the limit of items and short strings, which cost much memory per byte."""


class Codec(Protocol):
    """Envelope in one encoding. Stateless; one instance serves all sessions."""

    def split(self, data: bytes, limits: WireLimits) -> Sequence[Members | DecodeFailure]:
        """Return the messages of a frame, in order. Never raises."""

    def encode(self, op: Op) -> Frame:
        """Encode an op. A payload in the same encoding is spliced in.

        Raises:
            MalformedPayload: the payload came from another peer and is not JSON.
        """

    def response(self, service: str, values: Encodable, id: str | int | None = None) -> Frame:
        """Encode the response to a successful call: a fast path of :meth:`encode` (SRV-01)."""

    def call(self, service: str, args: Encodable, id: str | int) -> Frame:
        """Encode a call to a provider: a fast path of :meth:`encode` (SVP-01, SVP-02)."""

    def publish_encoder(self, topic: str) -> PublishEncoder:
        """Return an encoder for the samples of `topic`; constant parts are computed here, once."""


def finished(steps: Steps[T]) -> T:
    """Run all steps and return the result."""
    while True:
        try:
            next(steps)
        except StopIteration as end:
            result: T = end.value
            return result


class SteppedCodec(ABC):
    """Codec whose check of large frames runs in steps."""

    @abstractmethod
    def split_in_steps(self, data: bytes, limits: WireLimits) -> Steps[Sequence[Members | DecodeFailure]]:
        """Same as :meth:`split`, in steps."""

    def split(self, data: bytes, limits: WireLimits) -> Sequence[Members | DecodeFailure]:
        """Return the message of a frame. Never raises."""
        return finished(self.split_in_steps(data, limits))


class SteppedEncoder(ABC):
    """Encoder of a topic's samples that can work in steps; see :data:`PublishEncoder`."""

    def __init__(self) -> None:
        self._ready: tuple[PublishedMessage, Frame] | None = None

    @abstractmethod
    def encode_in_steps(self, sample: PublishedMessage) -> Steps[Frame]:
        """Encode a sample in steps."""

    def __call__(self, sample: PublishedMessage) -> Frame:
        """Return the frame of a sample, which subscribers share."""
        ready, self._ready = self._ready, None
        if ready is not None and ready[0] is sample:
            return ready[1]
        return finished(self.encode_in_steps(sample))

    def steps(self, sample: PublishedMessage) -> Iterator[None]:
        """Encode a sample in steps and keep the frame for the next call with that sample."""
        # Compared by identity in the call: another sample may be encoded between these steps and the call.
        self._ready = (sample, (yield from self.encode_in_steps(sample)))
