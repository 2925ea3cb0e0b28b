"""Decoding of messages: JSON text or decoded CBOR in, a typed message out."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import Any

import msgspec

from rwt_client.wire.arrays import ArrayKind, octets_of, to_numpy
from rwt_client.wire.cbor import TypedArray
from rwt_interfaces import Payload
from rwt_interfaces.structs import MessageType
from rwt_participant.errors import InvalidMessage
from rwt_participant.messages import Message
from rwt_protocol.errors import MalformedPayload
from rwt_protocol.payloads import Decoded, Encodable, RawJson

SplitFrame = tuple[bytes, bytes]
"""Presumed JSON text of a message in a frame, and the frame, which is parsed if decoding the text fails.
A tuple for speed: nearly every message arrives this way."""

UnparsedMessage = SplitFrame | Encodable | dict[str, object]
"""Received message: JSON text, or the value of a CBOR map."""

REJECTIONS = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError, InvalidMessage)


class MessageReader:
    """Reader for messages of one type.

    Args:
        trusted: True if times are certainly spelled as in the type's distribution. Otherwise both spellings
            are accepted, which is slower.
    """

    __slots__ = ("_decode", "_finish", "_numpy", "_octets", "_trusted", "type")

    def __init__(
        self, message_type: MessageType, arrays: ArrayKind = "list", *, trusted: bool = True
    ) -> None:
        self.type = message_type
        self._decode: Callable[[bytes | memoryview], msgspec.Struct] = message_type.json.decode
        self._numpy = arrays == "numpy"
        self._finish = to_numpy(message_type) if self._numpy else None
        self._trusted = trusted
        self._octets = octets_of(message_type) if self._numpy else ()

    def read(self, arrived: UnparsedMessage) -> Message:
        """Decode a message.

        Raises:
            InvalidMessage: it does not fit the type.
        """
        if isinstance(arrived, tuple):
            try:
                message = self._decode(arrived[0]) if self._trusted else self._leniently(_proven(arrived))
            except REJECTIONS:
                message = self._leniently(_proven(arrived))
        elif isinstance(arrived, dict):
            message = self._from_plain(arrived)
        elif isinstance(arrived, Decoded):
            message = Payload.from_value(self.type, arrived.value).value()
        else:
            message = self._from_text(arrived)
        return self.finish(message)

    def finish(self, message: msgspec.Struct) -> Message:
        """Return a decoded message with its arrays as requested."""
        return message if self._finish is None else self._finish(message)

    def _from_text(self, arrived: Encodable) -> msgspec.Struct:
        if self._trusted:
            try:
                return self._decode(arrived.data if isinstance(arrived, RawJson) else arrived.json())
            except REJECTIONS:
                return self._leniently(arrived)
        return self._leniently(arrived)

    def _leniently(self, arrived: Encodable) -> msgspec.Struct:
        try:
            return Payload.from_json(self.type, arrived.json(), is_trusted=True).value()
        except MalformedPayload as error:
            raise InvalidMessage("", f"not {self.type.name}: {error}") from None

    def _from_plain(self, plain: dict[str, object]) -> msgspec.Struct:
        # An image's pixels are excluded from the check and the copy.
        views = {
            attribute: plain.pop(name)
            for name, attribute in self._octets
            if isinstance(plain.get(name), memoryview)
        }
        found: msgspec.Struct = self.type.decode_leniently(_with_arrays(plain, self._numpy), time.time_ns)
        for attribute, view in views.items():
            setattr(found, attribute, view)
        return found


def request_of(message_type: MessageType, args: Encodable) -> Message:
    """Return the arguments of a call or goal: an object by name, a list by position, or none (SRV-02).

    Raises:
        InvalidMessage: they do not fit.
        MalformedPayload: they are not JSON.
    """
    if isinstance(args, Decoded):
        given = args.value if isinstance(args.value, dict | list) else {}
        return Payload.from_value(message_type, given).value()
    return Payload.from_args(message_type, args.json()).value()


class PublishEnvelope(msgspec.Struct, gc=False):
    """Op of a published message, which is left undecoded."""

    op: str = ""
    topic: str = ""
    msg: msgspec.Raw = msgspec.Raw(b"")


read_envelope = msgspec.json.Decoder(PublishEnvelope).decode


def _proven(cut: SplitFrame) -> RawJson:
    """Return the message that parsing the whole frame finds; the cut text if it finds none."""
    try:
        return RawJson(bytes(read_envelope(cut[1]).msg) or b"{}")
    except REJECTIONS:
        return RawJson(cut[0])


def _with_arrays(value: Any, numpy: bool) -> Any:
    if isinstance(value, TypedArray):
        return value.numpy() if numpy and value.format != "<B" else value.plain()
    if isinstance(value, dict):
        return {key: _with_arrays(item, numpy) for key, item in value.items()}
    if isinstance(value, list) and value and isinstance(value[0], (dict, TypedArray)):
        return [_with_arrays(item, numpy) for item in value]
    return value
