"""Messages in CBOR (RFC 8949) with typed arrays (RFC 8746), by the CBR rules.

Only the message itself: the envelope around it is another package's. A message is a map of definite length
with its fields in order. Integers are minimal, floats 64 bits wide with NaN and infinities kept (CBR-05).
Arrays of numbers are little-endian typed arrays (CBR-02), octets plain byte strings (CBR-03), all else arrays
(CBR-04), fixed and bounded ones included (CBR-07). In ROS 2 a byte is an octet, so that its arrays are tagged
64, not 72, which would make 200 of it -56.

How it is fast: a message is flattened to its leaves. One :func:`operator.attrgetter` fetches all of them, and
they are joined with the constant bytes (map heads and keys) between them.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Iterator
from functools import partial
from io import BytesIO
from operator import attrgetter
from typing import TYPE_CHECKING, Any

from rwt_interfaces import field_types
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.field_types import FieldType
from rwt_interfaces.serialise.long_lists import Chunks, long_chunks, long_items
from rwt_interfaces.serialise.long_strings import JoinedParts, Parts
from rwt_interfaces.steps import Steps
from rwt_interfaces.validation.numbers import little_endian

if TYPE_CHECKING:
    import msgspec

    from rwt_interfaces.structs import MessageType

#: Encodes one field's value.
_Encode = Callable[[Any], bytes]
#: A leaf of a message: the constant bytes before it, its attributes from the root, its encoder and its type.
_Leaf = tuple[bytes, str, _Encode, FieldType | None]

_UNSIGNED, _NEGATIVE, _BYTES, _TEXT, _ARRAY, _MAP, _TAG = range(7)

#: Typed array tags by letter of :mod:`struct`; all little-endian.
_TAGS = {"B": 64, "H": 69, "I": 70, "Q": 71, "b": 72, "h": 77, "i": 78, "q": 79, "f": 85, "d": 86}
_CODES = {tag: code for code, tag in _TAGS.items()}
_float64 = struct.Struct(">Bd").pack


def head(major: int, argument: int) -> bytes:
    """Return the shortest head of a data item (RFC 8949, section 3)."""
    major <<= 5
    if argument < 24:
        return bytes((major | argument,))
    if argument < 1 << 8:
        return bytes((major | 24, argument))
    if argument < 1 << 16:
        return struct.pack(">BH", major | 25, argument)
    if argument < 1 << 32:
        return struct.pack(">BI", major | 26, argument)
    return struct.pack(">BQ", major | 27, argument)


_SMALL = [head(_UNSIGNED, number) for number in range(256)]


def _int(number: int) -> bytes:
    if 0 <= number < 256:
        return _SMALL[number]
    return head(_UNSIGNED, number) if number > 0 else head(_NEGATIVE, -1 - number)


def _text(text: str) -> bytes:
    octets = text.encode()
    return head(_TEXT, len(octets)) + octets


def _octets(octets: bytes) -> bytes:
    return head(_BYTES, len(octets)) + octets


def length_head(length: int, is_text: bool) -> bytes:
    """Return the head of a string or octets of that many bytes."""
    return head(_TEXT if is_text else _BYTES, length)


def compile_encoder(message: MessageType) -> Callable[[msgspec.Struct], bytes]:
    """Return an encoder for a message type's own Struct and `MessageJson.sendable`."""
    leaves = list(_leaves(message, "", b""))
    tail = b""
    if leaves and not leaves[-1][1]:
        tail = leaves.pop()[0]
    if not leaves:
        return lambda value: tail
    template: list[bytes] = []
    for constant, *_ in leaves:
        template += (constant, b"")
    template.append(tail)
    encoders = [encode for _, _, encode, _ in leaves]
    fetch = attrgetter(*[path for _, path, _, _ in leaves])
    several = len(leaves) > 1

    def encode(value: msgspec.Struct) -> bytes:
        values = fetch(value) if several else (fetch(value),)
        parts = template.copy()
        parts[1:-1:2] = [encode_leaf(leaf) for encode_leaf, leaf in zip(encoders, values, strict=True)]
        return b"".join(parts)

    return encode


def compile_steps(message: MessageType) -> Callable[[msgspec.Struct, Chunks], Steps[Parts]]:
    """Return an encoder in steps, some list items each; separately passed lists replace the message's."""
    leaves = [
        (constant, path, attrgetter(path) if path else None, encode, field_type)
        for constant, path, encode, field_type in _leaves(message, "", b"")
    ]

    def encode_in_steps(value: msgspec.Struct, apart: Chunks) -> Steps[Parts]:
        parts = JoinedParts()
        for constant, path, fetch, encode, field_type in leaves:
            parts.append(constant)
            if fetch is None:
                continue
            leaf = fetch(value)
            chunks = long_chunks(field_type, leaf, apart.get(path))
            if chunks is None:
                parts.append(encode(leaf))
            else:
                assert isinstance(field_type, field_types.Array)  # No other field has chunks.
                yield from _long_array(parts, chunks, field_type.element)
        return parts.all()

    return encode_in_steps


def _long_array(parts: JoinedParts, chunks: Iterator[Any], element: FieldType) -> Steps[None]:
    items = JoinedParts()
    count = 0
    encode = _encoder(element)
    is_long = long_items(element)
    for chunk in chunks:
        if chunk is None:
            yield
            continue
        count += len(chunk)
        if isinstance(element, field_types.Int | field_types.Float):
            items.append(little_endian(chunk, element.code))
        elif is_long is None or not isinstance(element, field_types.Message):
            items.append(b"".join([encode(item) for item in chunk]))
        else:
            for item in chunk:
                if is_long(item):
                    for part in (yield from element.type.step_encoder("cbor")(item, {})):
                        items.append(part)
                else:
                    items.append(encode(item))
        yield
    if isinstance(element, field_types.Int | field_types.Float):
        if element.name not in ("uint8", "char"):
            parts.append(head(_TAG, _TAGS[element.code]))
        parts.append(head(_BYTES, count * struct.calcsize(element.code)))
    else:
        parts.append(head(_ARRAY, count))
    for part in items.all():
        parts.append(part)


def _leaves(message: MessageType, prefix: str, before: bytes) -> Iterator[_Leaf]:
    """Yield the leaves of a message in order; trailing bytes come as one without attributes."""
    before += head(_MAP, len(message.slots))
    for slot in message.slots:
        attribute, field_type = slot.attribute, slot.type
        before += _text(slot.name)
        if isinstance(field_type, field_types.Message):
            nested = list(_leaves(field_type.type, f"{prefix}{attribute}.", before))
            before = nested.pop()[0]
            yield from nested
        else:
            yield before, prefix + attribute, _encoder(field_type), field_type
            before = b""
    yield before, "", bytes, None


def _encoder(field_type: FieldType) -> _Encode:
    match field_type:
        case field_types.Bool():
            return _bool
        case field_types.Int():
            return _int
        case field_types.Float():
            return partial(_float64, 0xFB)
        case field_types.String():
            return _text
        case field_types.Time():
            return _time(field_type)
        case field_types.Octets():
            return _octets
        case field_types.Message():
            return field_type.type.to_cbor
        case field_types.Array():
            return _array(field_type)


def _bool(value: bool) -> bytes:
    return b"\xf5" if value else b"\xf4"


def _time(field_type: field_types.Time) -> _Encode:
    """Encode a map with the distribution's field names (CBR-06)."""
    first, second = (_text(key) for key in field_type.keys)
    fetch = attrgetter(*field_type.keys)

    def encode(value: object) -> bytes:
        seconds, nanoseconds = fetch(value)
        return b"\xa2" + first + _int(seconds) + second + _int(nanoseconds)

    return encode


def _array(field_type: field_types.Array) -> _Encode:
    element = field_type.element
    if isinstance(element, field_types.Int) and element.name in ("uint8", "char"):
        return lambda items: _octets(bytes(items))
    if isinstance(element, (field_types.Int, field_types.Float)):
        code = element.code
        tag = head(_TAG, _TAGS[code])
        return lambda items: tag + _octets(little_endian(items, code))
    each = _encoder(element)
    return lambda items: head(_ARRAY, len(items)) + b"".join([each(item) for item in items])


def decode(data: bytes | memoryview) -> object:
    """Return the value of one item, as :func:`compile_encoder` writes it.

    Only for bytes of a trusted program: :func:`rwt_protocol.parse` reads those of others within limits.

    Raises:
        InvalidMessage: it is not CBOR, or has tags other than those of typed arrays.
    """
    import cbor2  # slow to load, rarely needed

    stream = BytesIO(data)
    try:
        value: object = cbor2.CBORDecoder(stream, tag_hook=_typed_array).decode()
    except (cbor2.CBORError, struct.error, KeyError, TypeError) as error:
        raise InvalidMessage("", f"not CBOR with typed arrays: {error}") from None
    if stream.tell() != len(data):
        raise InvalidMessage("", "more than one value in CBOR")
    return value


def _typed_array(tag: Any, immutable: bool) -> object:
    code = _CODES[tag.tag]
    if code == "B":
        return bytes(tag.value)
    return list(struct.unpack(f"<{len(tag.value) // struct.calcsize(code)}{code}", tag.value))
