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
    """Same as :func:`members_of`, with a check of the depth for libraries that have none.

    Args:
        max_depth: maximum number of open objects and arrays, including the message.
        smallest_level: minimum bytes of a nested object.
    """
    members = members_of(found, size)
    if size > smallest_level * max_depth and _deeper_than(found, max_depth):
        return DecodeFailure.too_deep(max_depth, members)
    return members


def _deeper_than(found: object, limit: int) -> bool:
    """Return True if more than `limit` documents and arrays are open at once, including `found`."""
    level = [found]
    for _ in range(limit):
        level = [
            child
            for each in level
            for child in (each.values() if isinstance(each, dict) else each if isinstance(each, list) else ())
            if isinstance(child, dict | list)
        ]
        if not level:
            return False
    return True


class ObjectCodec(ABC):
    """Encoder of such an encoding; see :class:`rwt_protocol.codecs.base.Codec`."""

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
