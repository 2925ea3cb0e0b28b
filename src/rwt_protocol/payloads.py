"""Payloads of ops: undecoded or unchecked as they arrive, and what may take their place on the way out."""

from __future__ import annotations

import math
import sys
from collections.abc import Callable, Generator, Mapping, Sequence
from typing import Final, Literal, Protocol, Self

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
"""Frames of no more bytes than this are decoded whatever they hold, arrays in them to lists: what they can
cost is little."""

_TRUE, _FALSE, _NAN = object(), object(), object()


class Encodable(Protocol):
    """A payload that every codec can write into an op. `RawJson` and `Decoded` are two.

    A message of a known type is another, whatever class it has: its bytes are spliced into the op, and are
    encoded once however many ops they go into.
    """

    @property
    def size(self) -> int:
        """Bytes of the payload, as far as they are counted."""

    def json(self) -> Buffer:
        """The payload as one JSON value in UTF-8.

        Raises:
            MalformedPayload: it is text of another peer, and is not JSON.
        """

    def plain(self) -> object:
        """The payload as dict, list, str, bytes, int, float, bool or None. NaN is kept.

        Raises:
            MalformedPayload: it is text of another peer, and is not JSON.
        """


def _plain(value: object) -> object:
    # A model that was made by `model_construct`, unvalidated, holds what it was given.
    plain: Callable[[], object] | None = getattr(value, "plain", None)
    return value if plain is None else plain()


def _as_json(value: object) -> object:
    """The value as JSON writes it: bytes in base64, NaN and infinities as null."""
    return msgspec.json.decode(Decoded(value).json())


AS_PLAIN_VALUES: Final = core_schema.plain_serializer_function_ser_schema(
    _plain,
    return_schema=core_schema.any_schema(
        serialization=core_schema.plain_serializer_function_ser_schema(_as_json, when_used="json")
    ),
)
"""How pydantic dumps a payload: as plain values in Python, and in JSON as the protocol writes it."""


class RawJson(msgspec.Struct, frozen=True, gc=False, eq=False):
    """The bytes of one JSON value, kept undecoded.

    Attributes:
        data: the bytes. A `memoryview` is a slice of the frame that they came in, and keeps that frame alive.
        validate: None when the bytes are known to be one JSON value in UTF-8. In a large message they are not
            looked at on arrival (see :mod:`rwt_protocol.codecs.head_tail_split`): a strict decoder of a
            message type validates them by decoding, and all other readers call :meth:`validated` or
            :meth:`json`.
        dense: why the bytes may not be decoded as plain values, where they hold too many objects and arrays
            for that; empty where they may. A decoder that makes no object of each may still read them.
    """

    data: Buffer
    validate: Callable[[], bytes] | None = None
    dense: str = ""

    @property
    def size(self) -> int:
        """The number of bytes."""
        return len(self.data)

    @property
    def is_validated(self) -> bool:
        """Whether the bytes are known to be one JSON value in UTF-8."""
        return self.validate is None

    @property
    def kind(self) -> JsonKind:
        """The kind of JSON value, by its first byte."""
        return _KIND_BY_FIRST_BYTE.get(self.data[0], "number")

    def validated(self) -> RawJson:
        """The same payload with its bytes checked: self if they already are.

        Call it before the bytes are passed on without a type check, and when a strict decoder has refused
        bytes that are not yet validated: the whole message is then parsed, and the outcome is exactly what a
        full parse would have found, with the tokens ``NaN`` and ``Infinity`` turned into null.

        Raises:
            MalformedPayload: the message is not JSON, not UTF-8, or :attr:`dense`.
        """
        return self if self.validate is None else RawJson(self.validate())

    def json(self) -> Buffer:
        """The bytes, checked (see :meth:`validated`).

        Raises:
            MalformedPayload: the message is not JSON, not UTF-8, or :attr:`dense`.
        """
        return self.data if self.validate is None else self.validate()

    def plain(self) -> object:
        """The value as plain objects.

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

    def __reduce__(self) -> tuple[type[RawJson], tuple[bytes, Callable[[], bytes] | None, str]]:
        return RawJson, (bytes(self.data), self.validate, self.dense)

    def __copy__(self) -> Self:
        return self

    def __deepcopy__(self, memo: object) -> Self:
        return self  # neither it nor its bytes change

    def __repr__(self) -> str:
        head = bytes(self.data[:60]).decode("utf-8", "replace")
        return f"RawJson({head}{'…' if len(self.data) > 60 else ''})"

    @classmethod
    def __get_pydantic_core_schema__(cls, source: object, handler: GetCoreSchemaHandler) -> CoreSchema:
        return core_schema.is_instance_schema(cls, serialization=AS_PLAIN_VALUES)


EMPTY: Final = RawJson(b"{}")
"""What an absent payload means: an object without members (PUB-04, SRV-02, ACT-11)."""


def _as_list(value: object) -> object:
    """A numpy array as a list."""
    if not _is_array(value):
        raise TypeError(f"{type(value).__name__} is not of JSON")
    to_list: Callable[[], object] = value.tolist  # type: ignore[attr-defined]  # numpy is not imported here
    return to_list()


_encode: Final = msgspec.json.Encoder(enc_hook=_as_list).encode


class Decoded(msgspec.Struct, frozen=True, eq=False):
    """A payload of an encoding whose frames are decoded as a whole (CBOR, BSON): objects of no checked type.

    Attributes:
        value: dict, list, str, bytes, int, float, bool or None; octets are bytes, other typed arrays are
            lists, long ones numpy arrays that cannot be written to, and NaN is kept. What else a sender put
            there (a date, a key that is no text) is left as the library read it, for the check against a
            message type to refuse.
        size: bytes of the message that it came in, envelope included, for those who count; not compared.
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
        """The kind of value, in JSON's words."""
        return "array" if _is_array(self.value) else _KIND_BY_TYPE.get(type(self.value), "number")

    def json(self) -> bytes:
        """The value as JSON: bytes in base64, NaN and infinities as null.

        Raises:
            MalformedPayload: the sender put something there that JSON has not, as an integer beyond 64 bits.
        """
        try:
            return _encode(self.value)
        except (TypeError, ValueError, OverflowError, RecursionError, msgspec.MsgspecError) as error:
            raise MalformedPayload(f"not a value that JSON has: {error}") from None

    def plain(self) -> object:
        """The value, its numpy arrays as lists."""
        return self.value if self.size <= FEW_BYTES else _listed(self.value)


def _is_array(value: object) -> bool:
    array = getattr(sys.modules.get("numpy"), "ndarray", None)
    return array is not None and isinstance(value, array)


def _listed(value: object) -> object:
    if isinstance(value, dict):
        return {name: _listed(each) for name, each in value.items()}
    if isinstance(value, list):
        return [_listed(each) for each in value]
    return _as_list(value) if _is_array(value) else value


RawPayload = RawJson | Decoded
"""A payload as it arrives: text that is not decoded, or values that are not checked."""


def plain_copy(value: object) -> object:
    """A copy of a payload that a program wrote, in plain objects: tuples as lists, other octets as bytes.

    Raises:
        ValueError: it holds something that no encoding has: an integer beyond 64 bits, half of a character, a
            name that is no string, or an object of another kind.
    """
    if value is None or isinstance(value, bool):
        return value
    if isinstance(value, str):
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
    """A hashable object that is equal for equal values: 1 is 1.0 but not true, and NaN is NaN."""
    if isinstance(value, dict):
        return frozenset((name, comparable(each)) for name, each in value.items())
    if isinstance(value, list):
        return tuple(comparable(each) for each in value)
    if _is_array(value):
        return comparable(_as_list(value))
    if isinstance(value, bool):
        return _TRUE if value else _FALSE
    if isinstance(value, float) and math.isnan(value):
        return _NAN
    return value if value is None or isinstance(value, str | bytes | int | float) else repr(value)


def _equal(one: RawPayload, other: RawPayload) -> bool:
    """Whether two payloads hold the same value; what is not JSON is equal to its own bytes alone."""
    try:
        return comparable(one.plain()) == comparable(other.plain())
    except MalformedPayload:
        return False


class TypedMessage(Encodable, Protocol):
    """A message of a known type, in whichever encoding a subscriber asks for."""

    def json_parts(self) -> Sequence[Buffer]:
        """The bytes of :meth:`json` in parts, to be joined with what stands around them."""

    def cbor_parts(self) -> Sequence[Buffer]:
        """The message in CBOR (CBR-02 to CBR-07), in parts."""

    def plain_in_steps(self) -> Generator[None, None, object]:
        """What :meth:`plain` returns, in steps of about a millisecond at most; what is short takes none."""

    def serialised_parts(self) -> Sequence[Buffer]:
        """The message as its robot serialises it, ROS 1's own form or CDR (CBR-10, CBR-11), in parts."""


class Sample(Protocol):
    """One published message, and when that was."""

    @property
    def payload(self) -> TypedMessage:
        """The message."""

    @property
    def stamp_ns(self) -> int:
        """The server's ROS time when it was published, nanoseconds since the epoch (CBR-12)."""
