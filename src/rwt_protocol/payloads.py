"""Payloads of ops: undecoded or unchecked as they arrive, and their substitutes in outgoing ops."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Any, Final, Literal, Protocol, Self, TypeGuard

import msgspec
from pydantic import GetCoreSchemaHandler
from pydantic_core import CoreSchema, core_schema

from rwt_protocol.errors import MalformedPayload
from rwt_protocol.frames import Buffer

JsonKind = Literal["object", "array", "string", "number", "boolean", "null"]

_KIND_BY_FIRST_BYTE: Final[Mapping[int, JsonKind]] = {
    ord("{"): "object",
    ord("["): "array",
    ord('"'): "string",
    ord("t"): "boolean",
    ord("f"): "boolean",
    ord("n"): "null",
}
_KIND_BY_TYPE: Final[Mapping[type, JsonKind]] = {
    dict: "object",
    list: "array",
    str: "string",
    bool: "boolean",
    type(None): "null",
}

FEW_BYTES: Final = 64 * 1024
"""Maximum bytes of a frame that is decoded without limits, arrays to lists: its cost is small."""

_TRUE, _FALSE, _NAN = object(), object(), object()


class Encodable(Protocol):
    """Payload that every codec can write into an op, such as `RawJson` and `Decoded`.

    Messages of known types also qualify: each encoding is made once, however many ops it goes into.
    """

    @property
    def size(self) -> int:
        """Bytes of the payload, as counted for limits."""

    def json(self) -> Buffer:
        """Return the payload as one JSON value in UTF-8.

        Raises:
            MalformedPayload: it is text of another peer and is not JSON.
        """

    def plain(self) -> object:
        """Return the payload as dict, list, str, bytes, int, float, bool or None. NaN is kept.

        Raises:
            MalformedPayload: it is text of another peer and is not JSON.
        """


def _plain(value: object) -> object:
    # Models made by `model_construct` are unvalidated.
    plain: Callable[[], object] | None = getattr(value, "plain", None)
    return value if plain is None else plain()


def _as_json(value: object) -> object:
    """Encode as JSON: bytes as base64, NaN and infinities as null."""
    return msgspec.json.decode(Decoded(value).json())


AS_PLAIN_VALUES: Final = core_schema.plain_serializer_function_ser_schema(
    _plain,
    return_schema=core_schema.any_schema(
        serialization=core_schema.plain_serializer_function_ser_schema(_as_json, when_used="json")
    ),
)
"""Serializer of payloads for pydantic: plain values in Python, the protocol's form in JSON."""


class RawJson(msgspec.Struct, frozen=True, gc=False, eq=False):
    """Bytes of one JSON value, undecoded.

    Attributes:
        data: the bytes. A `memoryview` is a slice of the received frame, and keeps that frame alive.
        validate: None if the bytes are known to be one JSON value in UTF-8. Large messages are not validated
            on arrival (see :mod:`rwt_protocol.codecs.head_tail_split`): strict decoders of message types
            validate them by decoding, and all other readers call :meth:`validated` or :meth:`json`.
        dense: reason why the bytes must not be decoded as plain values: too many objects and arrays; empty if
            they may. Decoders that do not make an object of each may still read them.
    """

    data: Buffer
    validate: Callable[[], bytes] | None = None
    dense: str = ""

    @property
    def size(self) -> int:
        """Number of bytes."""
        return len(self.data)

    @property
    def is_validated(self) -> bool:
        """True if the bytes are known to be one JSON value in UTF-8."""
        return self.validate is None

    @property
    def kind(self) -> JsonKind:
        """Kind of the JSON value, by its first byte."""
        return _KIND_BY_FIRST_BYTE.get(self.data[0], "number")

    def validated(self) -> RawJson:
        """Return the payload with validated bytes: self if they already are.

        Call it before passing bytes on without a type check, and after a strict decoder rejected unvalidated
        bytes. The whole message is parsed, with the tokens ``NaN`` and ``Infinity`` turned into null.

        Raises:
            MalformedPayload: the message is not JSON, not UTF-8, or :attr:`dense`.
        """
        # Not cached, because instances are immutable: callers keep the result.
        return self if self.validate is None else RawJson(self.validate())

    def json(self) -> Buffer:
        """Return the validated bytes.

        Raises:
            MalformedPayload: the message is not JSON, not UTF-8, or :attr:`dense`.
        """
        return self.data if self.validate is None else self.validate()

    def plain(self) -> object:
        """Return the value as plain objects.

        Raises:
            MalformedPayload: the message is not JSON, or not UTF-8.
        """
        try:
            return msgspec.json.decode(self.json())
        except (msgspec.DecodeError, UnicodeDecodeError, RecursionError) as error:
            raise MalformedPayload(f"not JSON that can be read: {error}") from None

    def __eq__(self, other: object) -> bool:
        if isinstance(other, RawJson) and self.data == other.data:
            return True
        return _equal(self, other) if isinstance(other, RawJson | Decoded) else NotImplemented

    def __hash__(self) -> int:
        return hash(comparable(self.plain()))

    # A memoryview cannot be pickled.
    def __reduce__(self) -> tuple[type[RawJson], tuple[bytes, Callable[[], bytes] | None, str]]:
        return RawJson, (bytes(self.data), self.validate, self.dense)

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: object) -> Self:
        return self  # immutable

    def __repr__(self) -> str:
        head = bytes(self.data[:60]).decode("utf-8", "replace")
        return f"RawJson({head}{'…' if len(self.data) > 60 else ''})"

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.is_instance_schema(cls, serialization=AS_PLAIN_VALUES)


EMPTY: Final = RawJson(b"{}")
"""Meaning of an absent payload: an empty object (PUB-04, SRV-02, ACT-11)."""


def _as_list(value: object) -> object:
    if not _is_array(value):
        raise TypeError(f"{type(value).__name__} is not of JSON")
    return value.tolist()


_encode: Final = msgspec.json.Encoder(enc_hook=_as_list).encode


class Decoded(msgspec.Struct, frozen=True, eq=False):
    """Payload of an encoding that decodes whole frames (CBOR, BSON): plain objects of unchecked type.

    Attributes:
        value: dict, list, str, bytes, int, float, bool or None. Octets are bytes, other typed arrays are
            lists, long ones read-only numpy arrays; NaN is kept. Other values (dates, keys that are not
            strings) are left for the check against a message type to reject.
        size: bytes of its message, including the envelope; ignored in comparisons.
    """

    value: object
    size: int = 0

    def __eq__(self, other: object) -> bool:
        return _equal(self, other) if isinstance(other, RawJson | Decoded) else NotImplemented

    def __hash__(self) -> int:
        return hash(comparable(self.value))

    def __repr__(self) -> str:
        return f"Decoded({self.value!r})"

    @property
    def kind(self) -> JsonKind:
        """Kind of the value, in JSON's terms."""
        return "array" if _is_array(self.value) else _KIND_BY_TYPE.get(type(self.value), "number")

    def json(self) -> bytes:
        """Return the value as JSON: bytes in base64, NaN and infinities as null.

        Raises:
            MalformedPayload: it holds a value that JSON does not support, such as an integer beyond 64 bits.
        """
        try:
            return _encode(self.value)
        except (TypeError, ValueError, OverflowError, RecursionError, msgspec.MsgspecError) as error:
            raise MalformedPayload(f"not a value that JSON has: {error}") from None

    def plain(self) -> object:
        """Return the value, its numpy arrays as lists."""
        # Decoders make arrays of numpy only in frames above this size.
        return self.value if self.size <= FEW_BYTES else _listed(self.value)


def _is_array(value: object) -> TypeGuard[Any]:
    # If numpy is not loaded, no value can be an array, so it need not be imported here.
    array = getattr(sys.modules.get("numpy"), "ndarray", None)
    return array is not None and isinstance(value, array)


def _listed(value: object) -> object:
    if isinstance(value, dict):
        return {name: _listed(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_listed(each) for each in value]
    return _as_list(value) if _is_array(value) else value


RawPayload = RawJson | Decoded
"""Payload as it arrives: undecoded text or unchecked values."""


def plain_copy(value: object) -> object:
    """Return a copy of a program's payload in plain objects: tuples as lists, other octets as bytes.

    Raises:
        ValueError: it holds a value that no encoding supports: an integer beyond 64 bits, a lone surrogate, a
            key that is not a string, or an object of another class.
    """
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, str):
        # Raises for a lone surrogate; `str` turns an instance of a subclass, such as an enum, into text.
        value.encode()
        return str(value)
    if isinstance(value, int):
        if not -(2**63) <= value < 2**64:
            raise ValueError("an integer beyond 64 bits")
        return int(value)
    if isinstance(value, float):
        return float(value)
    if isinstance(value, bytes | bytearray | memoryview):
        return bytes(value)
    if isinstance(value, Mapping):
        return {_name(name): plain_copy(each) for name, each in value.items()}
    if isinstance(value, list | tuple):
        return [plain_copy(each) for each in value]
    raise ValueError(f"{type(value).__name__} is not of JSON")


def _name(name: object) -> str:
    if not isinstance(name, str):
        raise ValueError(f"a name of type {type(name).__name__}")
    name.encode()
    return str(name)


def comparable(value: object) -> object:
    """Return a hashable object that is equal for equal values: 1 is 1.0 but not true, and NaN is NaN."""
    if isinstance(value, dict):
        return frozenset((name, comparable(each)) for name, each in value.items())
    if isinstance(value, list):
        return tuple(comparable(each) for each in value)
    if _is_array(value):
        return comparable(_as_list(value))
    # Before numbers: True == 1 in Python, but not in JSON.
    if isinstance(value, bool):
        return _TRUE if value else _FALSE
    if isinstance(value, float) and math.isnan(value):
        return _NAN
    return value if value is None or isinstance(value, str | bytes | int | float) else repr(value)


def _equal(one: RawPayload, other: RawPayload) -> bool:
    """Return True if two payloads hold the same value; False if one is invalid JSON.

    For the latter, :meth:`RawJson.__eq__` compares the bytes before.
    """
    try:
        return comparable(one.plain()) == comparable(other.plain())
    except MalformedPayload:
        return False


class TypedMessage(Encodable, Protocol):
    """Message of a known type, in any encoding."""

    def json_parts(self) -> Sequence[Buffer]:
        """Return the bytes of :meth:`json` in parts, to be joined with the surrounding bytes."""

    def cbor_parts(self) -> Sequence[Buffer]:
        """Return the message in CBOR (CBR-02 to CBR-07), in parts."""

    def plain_in_steps(self) -> Generator[None, None, object]:
        """Same as :meth:`plain`, in steps of about a millisecond at most; short messages take none."""

    def serialised_parts(self) -> Sequence[Buffer]:
        """Return the message in the robot's serialisation, ROS 1 or CDR (CBR-10, CBR-11), in parts."""


class PublishedMessage(Protocol):
    """Published message with its time."""

    @property
    def payload(self) -> TypedMessage:
        """The message."""

    @property
    def stamp_ns(self) -> int:
        """Server's ROS time at publication, nanoseconds since the epoch (CBR-12)."""
