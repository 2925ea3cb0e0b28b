"""Base of codecs such as CBOR and BSON that decode and encode a frame as a whole."""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Mapping

from pydantic import BaseModel

from rwt_protocol.codecs.base import DecodeFailure, Members, PublishEncoder
from rwt_protocol.codecs.envelope import PAYLOADS, RELIED_ON, UNDECODED
from rwt_protocol.frames import Frame
from rwt_protocol.ops import CallService, Op, ServiceResponse
from rwt_protocol.payloads import Decoded, Encodable, PublishedMessage


def members_of(found: Mapping[object, object] | Mapping[str, object], size: int) -> Members:
    """Return the members with string names of a decoded message of `size` bytes."""
    return {
        name: Decoded(value, size) if name in UNDECODED else value
        for name, value in found.items()
        if isinstance(name, str)
    }


def members_within(
    found: Mapping[object, object] | Mapping[str, object], size: int, max_depth: int, smallest_level: int = 1
) -> Members | DecodeFailure:
    """Return the members as :func:`members_of` does, or a failure if the message is nested too deeply.

    Codecs need it whose library has no limit of its own.

    Args:
        found: decoded message.
        size: bytes of the encoded message.
        max_depth: maximum number of objects and arrays within each other, including the message.
        smallest_level: minimum bytes of an encoded object or array.
    """
    members = members_of(found, size)
    # Every level takes bytes, so only a message of some size can be too deep and has to be walked.
    can_be_too_deep = size > smallest_level * max_depth
    if can_be_too_deep and _is_deeper_than(found, max_depth):
        return DecodeFailure.too_deep(max_depth, members)
    return members


def _is_deeper_than(message: object, limit: int) -> bool:
    """Return True if more than `limit` objects and arrays are within each other, including the message."""
    # Level by level and without recursion, because the message comes from a peer.
    containers = [message]
    for _ in range(limit):
        inner: list[object] = []
        for each in containers:
            children = each.values() if isinstance(each, dict) else each if isinstance(each, list) else ()
            inner += [child for child in children if isinstance(child, dict | list)]
        if not inner:
            return False
        containers = inner
    return True


class ObjectCodec(ABC):
    """Encoder for a codec that encodes whole messages; see :class:`rwt_protocol.codecs.base.Codec`."""

    @abstractmethod
    def frame(self, message: Mapping[str, object]) -> Frame:
        """Encode a message as a binary frame."""

    def encode(self, op: Op) -> Frame:
        """Encode an op as a binary frame, its members in the order of the model.

        Raises:
            MalformedPayload: the payload came from another peer and is not JSON.
        """
        message: dict[str, object] = {"op": op.op}
        payloads = PAYLOADS[op.op]
        for name, value in op:
            # A failure is a string where the values would be (SRV-05).
            if name in payloads and not isinstance(value, str):
                message[name] = value.plain()
            elif (name in op.model_fields_set or name in RELIED_ON) and value is not None:
                message[name] = value.model_dump(exclude_none=True) if isinstance(value, BaseModel) else value
        return self.frame(message)

    def response(self, service: str, values: Encodable, id: str | int | None = None) -> Frame:
        """Encode the response to a successful call (SRV-01)."""
        return self.encode(ServiceResponse(service=service, values=values, result=True, id=id))

    def call(self, service: str, args: Encodable, id: str | int) -> Frame:
        """Encode a call to a provider (SVP-01, SVP-02)."""
        return self.encode(CallService(service=service, args=args, id=id))

    def publish_encoder(self, topic: str) -> PublishEncoder:
        """Return an encoder for the samples of `topic`."""

        def encode(sample: PublishedMessage) -> Frame:
            return self.frame({"op": "publish", "topic": topic, "msg": sample.payload.plain()})

        return encode
