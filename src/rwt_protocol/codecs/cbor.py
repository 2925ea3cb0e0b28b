"""CBOR encoding (CBR): one map per binary frame.

Published messages are CBOR already and are spliced in. Incoming frames are decoded as a whole; payloads
become plain objects.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from io import BytesIO
from typing import Final

from rwt_protocol.codecs.base import (
    DecodeFailure,
    Members,
    PublishEncoder,
    SteppedCodec,
    Steps,
    TooMuchStructure,
)
from rwt_protocol.codecs.cbor_decoder import (
    BYTES_OF_A_HEAD,
    LargeFrame,
    head_of,
    new_decoder,
)
from rwt_protocol.codecs.object_codec import ObjectCodec, members_of
from rwt_protocol.frames import Buffer, Frame
from rwt_protocol.limits import WireLimits
from rwt_protocol.payloads import FEW_BYTES, PublishedMessage

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


class CborCodec(SteppedCodec, ObjectCodec):
    """CBOR encoding; see :class:`rwt_protocol.codecs.base.Codec`."""

    def split_in_steps(self, data: bytes, limits: WireLimits) -> Steps[Sequence[Members | DecodeFailure]]:
        """Return the message of a binary frame, in steps of about a millisecond at most. Never raises."""
        import cbor2  # optional import: slow to load

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
        # cbor2 stops behind the first value and ignores the rest.
        if stream.tell() != len(data):
            return (DecodeFailure("not CBOR: more than one value in the frame"),)
        if not isinstance(found, dict):
            return (DecodeFailure(f"expected a map, got {_KIND[data[0] >> 5]}"),)
        return (members_of(found, len(data)),)

    def frame(self, message: Mapping[str, object]) -> Frame:
        """Encode a message as one map."""
        import cbor2  # optional import: slow to load

        return Frame(cbor2.dumps(message), binary=True)

    def publish_encoder(self, topic: str) -> PublishEncoder:
        """Return an encoder for the samples of `topic`, which splices in their CBOR."""
        prefix = publish_prefix(topic)

        def encode(sample: PublishedMessage) -> Frame:
            return Frame(prefix, *sample.payload.cbor_parts(), binary=True)

        return encode


def raw_publish_encoder(topic: str) -> PublishEncoder:
    """Return an encoder for samples in the robot's serialisation (CBR-10 to CBR-12)."""
    prefix = publish_prefix(topic)

    def encode(sample: PublishedMessage) -> Frame:
        return raw_publish_frame(prefix, sample.payload.serialised_parts(), sample.stamp_ns)

    return encode


def publish_prefix(topic: str) -> bytes:
    """Return the bytes before the payload in all messages of `topic` (CBR-01)."""
    return b"\xa3\x62op\x67publish\x65topic" + _text(topic) + b"\x63msg"


def publish_frame(prefix: bytes, payload: Buffer) -> Frame:
    """Return a message of the prefix's topic; `payload` is CBOR and is spliced in."""
    return Frame(prefix, payload, binary=True)


def raw_publish_frame(prefix: bytes, data: Sequence[Buffer], stamp_ns: int) -> Frame:
    """Return a message of the prefix's topic in the robot's serialisation (CBR-10).

    Args:
        stamp_ns: ROS time, nanoseconds since the epoch. The keys are secs and nsecs in both ROS versions.
    """
    seconds, nanoseconds = divmod(stamp_ns, 1_000_000_000)
    # A map of three members; its last one, `bytes`, continues with the data behind this prefix.
    stamp = b"\xa3\x64secs" + head_of(0, seconds) + b"\x65nsecs" + head_of(0, nanoseconds)
    return Frame(prefix + stamp + b"\x65bytes" + head_of(2, sum(map(len, data))), *data, binary=True)


def _text(text: str) -> bytes:
    """Encode a text string of definite length (RFC 8949 section 3.1)."""
    data = text.encode()
    return head_of(3, len(data)) + data
