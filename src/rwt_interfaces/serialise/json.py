"""Messages in JSON (JSN-01 to JSN-33).

Texts that the strict Struct accepts may be passed on untouched. Others are decoded to plain objects for
:mod:`rwt_interfaces.validation.lenient_decoder`, and encoded again.
"""

from __future__ import annotations

import json
import re
from collections.abc import Callable, Iterable
from typing import TYPE_CHECKING, Any, Final, cast

import msgspec
import pybase64

from rwt_interfaces import field_types
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.field_types import FieldType
from rwt_interfaces.serialise.long_strings import CutText, RawText, cut_long_string
from rwt_interfaces.serialise.strict import Flaw, flaw_in, inexact, strict_struct, unsendable
from rwt_interfaces.steps import Steps

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from rwt_interfaces.structs import MessageType

#: Minimum octets for this module's base64; msgspec's is slower, but needs no copy of the message.
_FEW_OCTETS = 512

#: Exceptions of the strict checks.
REJECTIONS = (msgspec.MsgspecError, UnicodeError, RecursionError)
#: Numbers of an array that are encoded at a time.
_MANY_NUMBERS = 1 << 16
_Check = Callable[[RawText], msgspec.Struct]
_parse = msgspec.json.Decoder().decode
_skip = msgspec.json.Decoder(msgspec.Raw).decode
#: Maximum bytes of a rejected text that is searched for a better error text.
_BEGINNING = 1 << 19


class MessageJson:
    """One message type in JSON.

    Attributes:
        strict: the Struct that accepts only what may be passed on; immutable.
        has_arrays: True if a field of the message is an array.
        has_lists: True if a field may be written as a list: an array, or octets.
        check: returns a text that may be passed on untouched as a :attr:`strict` Struct, or raises one of
            :data:`REJECTIONS`.
    """

    def __init__(self, message: MessageType) -> None:
        self.strict = strict_struct(message)
        self._sendable: type[msgspec.Struct] | None = None
        self._kinds = frozenset(_kinds(message))
        self._unsendable = flaw_in(message, unsendable)
        self._decode: Callable[[RawText], msgspec.Struct] = msgspec.json.Decoder(message.struct).decode
        self._complete: Callable[[object, Callable[[], int]], msgspec.Struct] = message.decode_leniently
        self._pack = _packer(message)
        self.check = _bounded(
            cast("_Check", msgspec.json.Decoder(self.strict).decode), flaw_in(message, inexact)
        )
        # Where a length is checked a short string cannot stand for a long one.
        sized = self._kinds & {"fixed octets", "bounded string"}
        self._message = message
        self.has_arrays = any(isinstance(leaf, field_types.Array) for _, leaf in field_types.leaves(message))
        self.has_lists = self.has_arrays or bool(self._kinds & {"octets", "fixed octets"})
        self._octets = not sized and "octets" in self._kinds
        self._texts = not sized and "string" in self._kinds

    def cut(self, raw: RawText) -> Steps[CutText | None]:
        """Return a large text in two parts, one short with a token; None without a dominant long string."""
        if self._octets or self._texts:
            return (yield from cut_long_string(raw, self._octets, self._texts))
        return None

    @property
    def sendable(self) -> type[msgspec.Struct]:
        """Struct of messages from programs: like `strict`, but a float is never null, for all encoders."""
        if self._sendable is None:
            self._sendable = strict_struct(self._message, has_nulls=False)
        return self._sendable

    def convert(self, value: object) -> msgspec.Struct:
        """Copy a mapping or object into a :attr:`sendable` Struct, or raise one of :data:`REJECTIONS`."""
        message = msgspec.convert(value, self._sendable or self.sendable, from_attributes=True)
        if self._unsendable is not None and self._unsendable(message):
            raise msgspec.ValidationError
        return message

    def decode(self, raw: RawText) -> msgspec.Struct:
        """Return a text that passed the check, as the message's own Struct."""
        try:
            return self._decode(raw)
        except msgspec.ValidationError:
            # A null becomes NaN in the lenient decoder.
            return self._complete(parse(raw), lambda: 0)

    def encode(self, value: msgspec.Struct) -> bytes:
        """Return the message as compact JSON: all fields, NaN and infinities as null (JSN-04, JSN-08)."""
        return _ENCODER.encode(value if self._pack is None else self._pack(value))


MAX_VALUES: Final = 1 << 18
"""Maximum number of values of a text that is decoded at once, estimated by its commas and braces."""
MAX_LENIENT_VALUES: Final = 1 << 15
"""The same for a text that has to be completed value by value."""
WINDOW_BYTES: Final = 1 << 18
SEQUENCE: Final = re.compile(rb'\s*\{\s*"header"\s*:\s*\{\s*"seq"\s*:\s*(\d+)')
"""A message in JSON up to its `header.seq`, in the usual place."""


class Unsplittable(Exception):
    """The text cannot be split into chunks: it is not JSON, or holds many values in an unusual place."""


def has_many_values(data: RawText, most: int = MAX_VALUES) -> Steps[bool]:
    """Return True, in steps, if a text may hold so many values that it may not be decoded at once."""
    if len(data) <= most:
        return False
    text = bytes(data)
    found = 0
    for start in range(0, len(text), WINDOW_BYTES):
        if start:
            yield
        stop = start + WINDOW_BYTES
        found += text.count(b",", start, stop) + text.count(b"{", start, stop)
        if found > most:
            return True
    return False


MOST_SLOW_NUMBERS: Final = 1000
"""Maximum number of three-digit exponents in a peer's text. msgspec takes 10 microseconds for each number
near the limits of a float, hundreds of times as long as for others."""

_SLOW_NUMBER: Final = re.compile(rb"[eE][+-]?[0-9]{3}")
_EXPONENT: Final = bytes.maketrans(b"E123456789", b"e000000000")
_SCANNED: Final = 1 << 18
_OVERLAP: Final = 8


def require_quick_numbers(raw: RawText) -> Steps[None]:
    """Check, in steps, that a text has few slow numbers; raises InvalidMessage."""
    found = 0
    for start in range(0, len(raw), _SCANNED):
        if start:
            yield
        piece = bytes(raw[start : start + _SCANNED + _OVERLAP])
        # Most texts have no exponents, and counting two characters is far faster than searching for numbers.
        if found + piece.count(b"e") + piece.count(b"E") <= MOST_SLOW_NUMBERS:
            continue
        # Takes a quarter of the regular expression's time, and finds a superset.
        if found + piece.translate(_EXPONENT, b"+-").count(b"e000") > MOST_SLOW_NUMBERS:
            found += len(_SLOW_NUMBER.findall(piece))
        if found > MOST_SLOW_NUMBERS:
            raise InvalidMessage(
                "",
                f"more than {MOST_SLOW_NUMBERS} numbers have exponents of three digits, as 1e300: send zeros"
                " or less of them, or the message in CBOR",
            )


def _bounded(decode: _Check, inexact: Flaw | None) -> _Check:
    """Return the check of a small text: to decode it, and to look at numbers that msgspec cannot judge."""
    if inexact is None:
        return decode

    def check(raw: RawText) -> msgspec.Struct:
        message = decode(raw)
        if inexact(message):
            raise msgspec.ValidationError
        return message

    return check


def parse(raw: RawText) -> object:
    """Return JSON as plain objects; the tokens NaN and Infinity are accepted (JSN-33).

    Raises:
        InvalidMessage: not JSON, not UTF-8, or nested too deeply.
    """
    try:
        return _parse(raw)
    except RecursionError:
        raise InvalidMessage("", "nested too deeply") from None
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return _parse_leniently(raw)


def begins_too_deep(raw: RawText) -> bool:
    """Return True if the beginning of a rejected text is nested too deeply, which its error then states.

    The rest is not parsed, to save time; the cut itself counts as valid.
    """
    try:
        _skip(memoryview(raw)[:_BEGINNING])
    except RecursionError:
        return True
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return False
    return False


def _parse_leniently(raw: RawText) -> object:
    try:
        return json.loads(str(raw, "utf-8"))
    except RecursionError:
        raise InvalidMessage("", "nested too deeply") from None
    except UnicodeDecodeError:
        raise InvalidMessage("", "not valid UTF-8") from None
    except ValueError:
        raise InvalidMessage("", "not valid JSON") from None


def _kinds(message: MessageType) -> Iterable[str]:
    """Yield the kinds of strings and octets anywhere in a message."""
    for _, leaf in field_types.leaves(message):
        field_type = leaf.element if isinstance(leaf, field_types.Array) else leaf
        match field_type:
            case field_types.Message():
                yield from field_type.type.json._kinds
            case field_types.Octets():
                yield "octets" if field_type.length is None else "fixed octets"
            case field_types.String():
                yield "string" if field_type.bound is None else "bounded string"


def _plain(value: object) -> object:
    """Convert a numpy array, which msgspec does not know, to a list."""
    if not hasattr(value, "tolist"):
        raise InvalidMessage("", f"{type(value).__name__} has no form in JSON")
    array: NDArray[np.generic] = cast("NDArray[np.generic]", value)
    if len(array) <= _MANY_NUMBERS:
        return array.tolist()
    # A list of all numbers would take eight times the memory of a float32 array.
    parts = (array[start : start + _MANY_NUMBERS] for start in range(0, len(array), _MANY_NUMBERS))
    return msgspec.Raw(b"[%b]" % b",".join(_ENCODER.encode(part.tolist())[1:-1] for part in parts))


_ENCODER = msgspec.json.Encoder(enc_hook=_plain)


def items_encoder(element: FieldType) -> Callable[[list[Any]], bytes]:
    """Return an encoder of lists of such values as compact JSON."""
    pack = _pack_field(element)
    encode = _ENCODER.encode
    return encode if pack is None else lambda items: encode([pack(item) for item in items])


def _packer(message: MessageType) -> Callable[[Any], Any] | None:
    """Return a function that copies a message with long octets as base64 text; None without octets."""
    packers = {
        slot.attribute: packed for slot in message.slots if (packed := _pack_field(slot.type)) is not None
    }
    if not packers:
        return None
    attributes = [slot.attribute for slot in message.slots]

    def pack(value: Any) -> Any:
        fields = ((getattr(value, name), packers.get(name)) for name in attributes)
        return type(value)(*[field if packer is None else packer(field) for field, packer in fields])

    return pack


def _pack_field(field_type: FieldType) -> Callable[[Any], Any] | None:
    match field_type:
        case field_types.Octets():
            return _base64_text
        case field_types.Message():
            return _packer(field_type.type)
        case field_types.Array():
            pack = _pack_field(field_type.element)
            # A token may stand for a long array.
            return (
                None
                if pack is None
                else lambda items: items if isinstance(items, str) else [pack(item) for item in items]
            )
        case _:
            return None


def _base64_text(octets: bytes) -> object:
    if len(octets) < _FEW_OCTETS:
        return octets
    return msgspec.Raw(b'"%b"' % pybase64.b64encode(octets))
