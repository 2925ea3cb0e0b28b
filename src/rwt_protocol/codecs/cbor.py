"""The CBOR encoding (CBR): one map a binary frame.

On the way out the message that is published is CBOR already, and is spliced in. On the way in the frame is
decoded once, envelope and payload together: a payload is handed on as the plain objects it was decoded to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Final

from rwt_protocol.codecs.base import DecodeFailure, Members, PublishEncoder, Steps, finished
from rwt_protocol.codecs.cbor_decoder import (
    BYTES_OF_A_HEAD,
    LargeFrame,
    TooMuchStructure,
    head_of,
    new_decoder,
)
from rwt_protocol.codecs.object_codec import ObjectCodec, members_of
from rwt_protocol.frames import Buffer, Frame
from rwt_protocol.limits import WireLimits
from rwt_protocol.payloads import FEW_BYTES, Sample

MAPS: Final = bytes(range(0xA0, 0xC0))
"""The first bytes of a map."""

_KIND: Final = (
    "an integer",
    "an integer",
    "bytes",
    "a string",
    "an array",
    "a map",
    "a tag",
    "a simple value",
)

_NOT_CBOR: Final = (
    "not CBOR: malformed, nested too deeply, with a key that is no string, or a tag that ROS has not"
)


class CborCodec(ObjectCodec):
    """The CBOR encoding; see :class:`rwt_protocol.codecs.base.Codec`."""

    def split(self, data: bytes, limits: WireLimits) -> Sequence[Members | DecodeFailure]:
        """The message in one binary frame. Never raises."""
        return finished(self.split_in_steps(data, limits))

    def split_in_steps(self, data: bytes, limits: WireLimits) -> Steps[Sequence[Members | DecodeFailure]]:
        """The same, in steps of about a millisecond at most."""
        import cbor2  # only for those who use it

        frame = LargeFrame(data, limits) if len(data) > FEW_BYTES else None
        stream = frame.stream if frame is not None else BytesIO(data)
        try:
            found = (
                (yield from frame.value(limits.max_depth))
                if frame is not None
                else new_decoder(stream, limits.max_depth).decode()
            )
        except TooMuchStructure:
            most = limits.structure_bytes
            return (
                DecodeFailure(
                    f"more than {most} bytes beside long strings and typed arrays, or more than"
                    f" {most // BYTES_OF_A_HEAD} arrays and maps (limits.structure_bytes)"
                ),
            )
        except cbor2.CBORError:
            return (DecodeFailure(_NOT_CBOR),)
        if stream.tell() != len(data):
            return (DecodeFailure("not CBOR: more than one value in the frame"),)
        if not isinstance(found, dict):
            return (DecodeFailure(f"expected a map, got {_KIND[data[0] >> 5]}"),)
        return (members_of(found, len(data)),)

    def frame(self, message: Mapping[str, object]) -> Frame:
        """A message as one map."""
        import cbor2  # only for those who use it

        return Frame(cbor2.dumps(message), binary=True)

    def publish_encoder(self, topic: str) -> PublishEncoder:
        """An encoder for the samples of `topic`; the message is CBOR already, and is spliced in."""
        prefix = publish_prefix(topic)

        def encode(sample: Sample) -> Frame:
            return Frame(prefix, *sample.payload.cbor_parts(), binary=True)

        return encode


def raw_publish_encoder(topic: str) -> PublishEncoder:
    """An encoder for the samples of `topic` as their robot serialises them (CBR-10 to CBR-12)."""
    prefix = publish_prefix(topic)

    def encode(sample: Sample) -> Frame:
        return raw_publish_frame(prefix, sample.payload.serialised_parts(), sample.stamp_ns)

    return encode


def publish_prefix(topic: str) -> bytes:
    """The bytes before the payload in every message of `topic` (CBR-01)."""
    return b"\xa3\x62op\x67publish\x65topic" + _text(topic) + b"\x63msg"


def publish_frame(prefix: bytes, payload: Buffer) -> Frame:
    """One message of the topic of `prefix`; `payload` is CBOR, and is spliced in."""
    return Frame(prefix, payload, binary=True)


def raw_publish_frame(prefix: bytes, data: Sequence[Buffer], stamp_ns: int) -> Frame:
    """One message of the topic of `prefix` as its robot serialises it (CBR-10).

    Args:
        prefix: what :func:`publish_prefix` made.
        data: the serialised message, in parts; spliced in.
        stamp_ns: ROS time, nanoseconds since the epoch. The keys are secs and nsecs in both ROS versions.
    """
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    stamp = b"\xa3\x64secs" + head_of(0, seconds) + b"\x65nsecs" + head_of(0, nanoseconds)
    return Frame(prefix + stamp + b"\x65bytes" + head_of(2, sum(map(len, data))), *data, binary=True)


def _text(text: str) -> bytes:
    """A CBOR text string of definite length (RFC 8949 section 3.1)."""
    data = text.encode()
    return head_of(3, len(data)) + data
