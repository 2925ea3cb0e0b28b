"""One message of one type in whichever forms exist so far."""

from __future__ import annotations

import time
from collections.abc import Callable
from typing import TYPE_CHECKING

import msgspec

from rwt_interfaces.serialise.json import REJECTIONS, parse
from rwt_interfaces.serialise.long_strings import RawText

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

#: ROS time in nanoseconds.
Now = Callable[[], int]


class Payload:
    """One message of one type. Each form is made at most once, when it is first asked for, and shared.

    A message that arrived as JSON exactly as this project would send it keeps its bytes and nothing else: a
    server that only relays never builds an object from it. Make payloads with the ``from_…`` class methods.

    Attributes:
        type: the message's type.
    """

    __slots__ = ("_binary", "_json", "_message", "type")

    def __init__(
        self, message_type: MessageType, json: RawText | None, message: msgspec.Struct | None
    ) -> None:
        self.type = message_type
        self._json = json
        self._message = message
        self._binary: dict[str, bytes] | None = None

    def __repr__(self) -> str:
        return f"<Payload {self.type.name}>"

    @classmethod
    def from_json(cls, message_type: MessageType, raw: RawText, now: Now | None = None) -> Payload:
        """Take a message as it came in JSON.

        Args:
            message_type: what the message should be.
            raw: the JSON text; kept as it is if it may be passed on untouched, and then not copied.
            now: ROS time in nanoseconds for headers without a stamp and for "now"; the wall clock by default.

        Raises:
            InvalidMessage: it does not fit, and where and why; no other exception, whatever the bytes.
        """
        try:
            message_type.json.check(raw)
        except REJECTIONS:
            return cls(
                message_type,
                None,
                message_type.decode_leniently(message_type.json.parse(raw), now or time.time_ns),
            )
        return cls(message_type, raw, None)

    @classmethod
    def from_args(cls, message_type: MessageType, raw: RawText | None, now: Now | None = None) -> Payload:
        """Take a service's arguments: an object by name, a list by position, anything else is no arguments
        (SRV-02).

        Raises:
            InvalidMessage: as :meth:`from_json`.
        """
        if raw is None:
            return cls.from_value(message_type, {}, now)
        if bytes(raw[:1]) == b"{":
            return cls.from_json(message_type, raw, now)
        parsed = parse(raw)
        return cls.from_value(message_type, parsed if isinstance(parsed, (dict, list)) else {}, now)

    @classmethod
    def from_value(cls, message_type: MessageType, value: object, now: Now | None = None) -> Payload:
        """Take a message from Python: a Struct, a mapping, or a list of values by position (SRV-02).

        Checked and copied at once, so that what the caller does to `value` afterwards changes nothing.
        Numeric arrays may be numpy arrays, octets may be bytes. Missing fields of a mapping are completed as
        those of JSON are, headers stamped; a Struct always has all its fields, so its header keeps the stamp
        it has, zero or not.

        Raises:
            InvalidMessage: it does not fit, and where and why.
        """
        if isinstance(value, (list, tuple)):
            names = (slot.name for slot in message_type.slots)
            value = dict(zip(names, value, strict=False))
        try:
            return cls(message_type, None, message_type.json.convert(value))
        except REJECTIONS:
            return cls(message_type, None, message_type.decode_leniently(value, now or time.time_ns))

    @classmethod
    def deserialised(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Take a message in the serialisation of its type's distribution.

        Raises:
            InvalidMessage: it does not fit; no other exception, whatever the bytes.
        """
        return cls(message_type, None, message_type.deserialise(data))

    @classmethod
    def from_cdr(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Take a message as it came in CDR, with its encapsulation header.

        Raises:
            InvalidMessage: it does not fit; no other exception, whatever the bytes.
        """
        return cls(message_type, None, message_type.from_cdr(data))

    @classmethod
    def relayed_cdr(cls, message_type: MessageType, data: bytes) -> Payload:
        """Take a message as it came in CDR without a look at it, so that one without readers costs nothing.

        If it does not fit its type, the first call of a method other than :meth:`cdr` raises
        :exc:`InvalidMessage`.
        """
        payload = cls(message_type, None, None)
        payload._binary = {"cdr": data}
        return payload

    @classmethod
    def from_ros1(cls, message_type: MessageType, data: bytes | memoryview) -> Payload:
        """Take a message as it came in ROS 1's own form, without a length prefix.

        Raises:
            InvalidMessage: it does not fit; no other exception, whatever the bytes.
        """
        return cls(message_type, None, message_type.from_ros1(data))

    def json(self) -> RawText:
        """The message in JSON: the very bytes that came, if they came fit to be passed on."""
        if self._json is None:
            self._json = self.type.json.encode(self._known())
        return self._json

    def cbor(self) -> bytes:
        """The message in CBOR, without any envelope (CBR-02 to CBR-07)."""
        return self._made("cbor", self.type.to_cbor)

    def serialised(self) -> bytes:
        """The message in the serialisation of its type's distribution: CDR, or ROS 1's own form."""
        return self._made(self.type.registry.distro.serialisation, self.type.serialise)

    def cdr(self) -> bytes:
        """The message in CDR, with its encapsulation header."""
        return self._made("cdr", self.type.to_cdr)

    def plain(self) -> object:
        """The message as dicts, lists and scalars, octets as bytes."""
        return msgspec.to_builtins(self.value(), builtin_types=(bytes,), enc_hook=_plain_array)

    @property
    def size(self) -> int:
        """Bytes of the message in JSON."""
        return len(self.json())

    def _made(self, form: str, encode: Callable[[msgspec.Struct], bytes]) -> bytes:
        if self._binary is None:
            self._binary = {}
        made = self._binary.get(form)
        if made is None:
            made = self._binary[form] = encode(self.value())
        return made

    def value(self) -> msgspec.Struct:
        """The message as its type's Struct. It is shared: treat it as read-only.

        Raises:
            InvalidMessage: the message was relayed as CDR, and does not fit.
        """
        message = self._message
        if message is None:
            message = self._message = self._decoded()
        elif message.__class__ is not self.type.struct:
            message = self._message = self._own_struct(message)
        return message

    @property
    def kept_size(self) -> int:
        """About how many bytes the message takes to be kept, in the form that it has now."""
        if self._json is not None:
            return len(self._json)
        if self._binary:
            return max(map(len, self._binary.values()))
        return _size_of(self._message)

    def detach(self) -> Payload:
        """The same message without a view of the buffer it was received in, for keeping."""
        if isinstance(self._json, memoryview):
            return Payload(self.type, bytes(self._json), self._message)
        return self

    def _own_struct(self, message: msgspec.Struct) -> msgspec.Struct:
        try:
            return msgspec.convert(message, self.type.struct, from_attributes=True)
        except msgspec.ValidationError:
            # It has a None for a float, which the lenient decoder makes NaN.
            own: msgspec.Struct = self.type.decode_leniently(message, time.time_ns)
            return own

    def _known(self) -> msgspec.Struct:
        return self._message if self._message is not None else self.value()

    def _decoded(self) -> msgspec.Struct:
        if self._json is not None:
            return self.type.json.decode(self._json)
        assert self._binary is not None  # A payload has its text, its message or its CDR from the start.
        return self.type.from_cdr(self._binary["cdr"])


def _plain_array(array: object) -> object:
    """A numpy array as a list: the only thing in a message that is not plain."""
    to_list: Callable[[], object] = array.tolist  # type: ignore[attr-defined]  # numpy is not imported here
    return to_list()


def _size_of(value: object) -> int:
    """About how many bytes a message takes: its text and octets, and eight for each number."""
    if isinstance(value, (bytes, str)):
        return len(value)
    if isinstance(value, msgspec.Struct):
        return sum(_size_of(getattr(value, name)) for name in value.__struct_fields__)
    if isinstance(value, list):
        return 8 * len(value) if value and isinstance(value[0], (int, float)) else sum(map(_size_of, value))
    nbytes = getattr(value, "nbytes", 8)
    return nbytes if isinstance(nbytes, int) else 8
