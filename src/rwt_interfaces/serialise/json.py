"""Messages in JSON (JSN-01 to JSN-33).

Two ways in. The strict one is a Struct compiled so that msgspec accepts exactly the texts that this project
itself would send, spacing and order of fields aside; what it accepts may be passed on untouched. Everything
else is decoded to plain objects for :mod:`rwt_interfaces.completion`. In the strict Struct every field is
required, floats may be null, octets are base64, times are spelled as the distribution spells them.

Large texts are checked in two parts, accepting the same texts: the one long string of an image or a text is
cut out (:func:`_without_long_string`) and checked by what is quickest for it, five to ten times as fast as
msgspec.
"""

from __future__ import annotations

import json
from collections.abc import Callable, Iterable
from contextlib import suppress
from functools import lru_cache
from typing import TYPE_CHECKING, Annotated, Any

import msgspec
import pybase64

from rwt_interfaces import shapes
from rwt_interfaces.errors import PayloadError
from rwt_interfaces.misfit import has_lone_surrogate
from rwt_interfaces.numbers import float_annotation, int_annotation
from rwt_interfaces.shapes import Shape

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

#: A JSON text, perhaps a view of the buffer that a whole frame was received in.
RawText = bytes | memoryview

#: Tells whether a value of some shape has a flaw that no msgspec annotation expresses.
_Flaw = Callable[[Any], bool]

#: From this many bytes on a text is large.
LARGE = 4096
#: How far from either end of a large text the long base64 string begins and ends at most.
_MARGIN = 1024
#: How much of a long string is checked at a time.
_PIECE = 1 << 16
_BACKSLASH = 0x5C
#: Octets shorter than this are left to msgspec, whose base64 is slower but needs no copy of the message.
_FEW_OCTETS = 512

#: What the strict checks raise, and nothing else.
REJECTIONS = (msgspec.MsgspecError, UnicodeDecodeError, RecursionError)
#: Subscripted at run time, which a checker cannot follow.
_LIST: Any = list
_UINT64_MAX = (1 << 64) - 1
_parse = msgspec.json.Decoder().decode


class JsonCodec:
    """One message type in JSON.

    Attributes:
        strict: the Struct that accepts only what may be passed on; immutable.
    """

    __slots__ = (
        "_check_large",
        "_check_small",
        "_complete",
        "_decode",
        "_has_long_strings",
        "_kinds",
        "_pack",
        "_unsendable",
        "strict",
    )

    def __init__(self, message: MessageType) -> None:
        self.strict = _strict_struct(message)
        self._kinds = frozenset(_kinds(message))
        self._unsendable = _flaw_in(message, _unsendable)
        self._decode: Callable[[RawText], msgspec.Struct] = msgspec.json.Decoder(message.struct).decode
        self._complete: Callable[[object, Callable[[], int]], msgspec.Struct] = message.completer
        self._pack = _packer(message)
        self._check_small = _bounded(msgspec.json.Decoder(self.strict).decode, _flaw_in(message, _too_large))
        self._check_large = self._large_check()
        self._has_long_strings = self._check_large != self._check_small

    def check(self, raw: RawText) -> None:
        """Accept a text that may be passed on untouched, or raise one of :data:`REJECTIONS`."""
        if len(raw) < LARGE:
            self._check_small(raw)
        else:
            self._check_large(raw)

    def parse(self, raw: RawText) -> object:
        """A text that the check refused, as plain objects; raises PayloadError as :func:`parse` does."""
        if len(raw) >= LARGE and self._has_long_strings:
            with suppress(msgspec.DecodeError):
                return _parse_long_strings(raw)
        return parse(raw)

    def convert(self, value: object) -> msgspec.Struct:
        """Copy a mapping or object into a `strict` Struct, or raise one of :data:`REJECTIONS`."""
        message = msgspec.convert(value, self.strict, from_attributes=True)
        if self._unsendable is not None and self._unsendable(message):
            raise msgspec.ValidationError
        return message

    def decode(self, raw: RawText) -> msgspec.Struct:
        """A text that passed the check, as the message's own Struct."""
        if len(raw) >= LARGE and self._has_long_strings:
            return self._complete(_parse_long_strings(raw), _no_clock)
        try:
            return self._decode(raw)
        except msgspec.ValidationError:
            # It has a null, which the completer makes NaN.
            return self._complete(parse(raw), _no_clock)

    def encode(self, value: msgspec.Struct) -> bytes:
        """The message as compact JSON: every field, in order, NaN and infinities as null (JSN-04, JSN-08)."""
        return _ENCODER.encode(value if self._pack is None else self._pack(value))

    def _large_check(self) -> Callable[[RawText], object]:
        if self._kinds & {"fixed octets", "bounded string"}:
            return self._check_small
        if "octets" in self._kinds:
            return self._check_around_base64
        if "string" in self._kinds and not self._kinds & {"float", "array"}:
            return self._check_around_text
        return self._check_small

    def _check_around_base64(self, raw: RawText) -> None:
        self._check_around(raw, _is_base64)

    def _check_around_text(self, raw: RawText) -> None:
        self._check_around(raw, _is_string_content)

    def _check_around(self, raw: RawText, is_content: Callable[[memoryview], bool]) -> None:
        shortened = _without_long_string(raw, is_content)
        if shortened is not None:
            try:
                self._check_small(shortened)
            except REJECTIONS:
                # Perhaps what was cut out was no string after all; the whole text decides.
                shortened = None
        if shortened is None:
            self._check_small(raw)


def _bounded(decode: Callable[[RawText], object], too_large: _Flaw | None) -> Callable[[RawText], object]:
    """The check of a small text: to decode it, and to look at integers that msgspec cannot bound."""
    if too_large is None:
        return decode

    def check(raw: RawText) -> None:
        if too_large(decode(raw)):
            raise msgspec.ValidationError

    return check


def _no_clock() -> int:
    return 0


def _parse_long_strings(raw: RawText) -> object:
    """Any JSON text as plain objects, by the parser that is quickest with long strings."""
    # Imported here because only large texts need it.
    from pydantic_core import from_json

    try:
        return from_json(raw if isinstance(raw, bytes) else bytes(raw), allow_inf_nan=False)
    except ValueError:
        raise msgspec.DecodeError from None


def parse(raw: RawText) -> object:
    """Any JSON text as plain objects, with the tokens NaN and Infinity that Python's programs send (JSN-33).

    Raises:
        PayloadError: not JSON, not UTF-8, or nested too deeply.
    """
    try:
        return _parse(raw)
    except RecursionError:
        raise PayloadError("", "nested too deeply") from None
    except (msgspec.MsgspecError, UnicodeDecodeError):
        return _parse_leniently(raw)


def _parse_leniently(raw: RawText) -> object:
    try:
        return json.loads(str(raw, "utf-8"))
    except RecursionError:
        raise PayloadError("", "nested too deeply") from None
    except UnicodeDecodeError:
        raise PayloadError("", "not valid UTF-8") from None
    except ValueError:
        raise PayloadError("", "not valid JSON") from None


def _without_long_string(raw: RawText, is_content: Callable[[memoryview], bool]) -> bytes | None:
    """The text with its one long string emptied, or None if it has no such string from near its start to near
    its end.

    Why the rest may stand for the whole: `is_content` sees to it that what is cut is valid between two quotes
    and holds no quote itself. If the quote found is where a string begins, then emptying that string changes
    no other token. If it is where a string ends, the emptied text has two strings side by side, which is no
    JSON. A quote after a backslash is left alone. Only where a length would be checked could the empty string
    pass in place of the long one, so types with such fields do not come here.
    """
    head = bytes(raw[:_MARGIN])
    tail_start = len(raw) - _MARGIN
    begin = head.rfind(b'"') + 1
    end = tail_start + bytes(raw[tail_start:]).find(b'"')
    if begin < 2 or end < tail_start or head[begin - 2] == _BACKSLASH:
        return None
    with memoryview(raw) as view:
        if not is_content(view[begin:end]):
            return None
    return head[:begin] + bytes(raw[end:])


def _is_base64(content: memoryview) -> bool:
    try:
        pybase64.b64decode(content, validate=True)
    except ValueError:
        return False
    return True


def _is_string_content(content: memoryview) -> bool:
    """Whether the bytes are valid between two quotes. False where a piece happens to end inside an escape or
    a letter: then the whole text is checked the slow way. In pieces, because large allocations cost more than
    the check.
    """
    # Imported here because only large texts need it.
    from pydantic_core import from_json

    try:
        for start in range(0, len(content), _PIECE):
            from_json(b'"%b"' % bytes(content[start : start + _PIECE]))
    except ValueError:
        return False
    return True


def _strict_struct(message: MessageType) -> type[msgspec.Struct]:
    name = message.name.partition("/")[2]
    if message.time is not None:
        return _strict_time(message.time)
    return _define(name, [(slot.attribute, slot.name, _strict(slot.shape)) for slot in message.slots])


@lru_cache(maxsize=8)
def _strict_time(shape: shapes.Time) -> type[msgspec.Struct]:
    halves = zip(shape.keys, (shape.seconds, shape.nanoseconds), strict=True)
    return _define("Time", [(key, key, int_annotation(half)) for key, half in halves])


def _define(name: str, fields: list[tuple[str, str, Any]]) -> type[msgspec.Struct]:
    # Without the garbage collector's tracking decoding is a quarter faster; an immutable tree has no cycles.
    return msgspec.defstruct(
        name,
        [(attribute, annotation) for attribute, _, annotation in fields],
        rename={attribute: encoded for attribute, encoded, _ in fields if attribute != encoded} or None,
        forbid_unknown_fields=True,
        frozen=True,
        gc=False,
    )


def _strict(shape: Shape) -> Any:
    match shape:
        case shapes.Bool():
            return bool
        case shapes.Int():
            return int_annotation(shape)
        case shapes.Float():
            return float_annotation(shape)
        case shapes.String():
            return str if shape.bound is None else Annotated[str, msgspec.Meta(max_length=shape.bound)]
        case shapes.Time():
            return _strict_time(shape)
        case shapes.Octets():
            return _sized(bytes, shape.length, None)
        case shapes.Message():
            return shape.type.json.strict
        case shapes.Array():
            return _sized(_LIST[_strict(shape.element)], shape.length, shape.bound)


def _sized(kind: Any, length: int | None, bound: int | None) -> Any:
    if length is not None:
        return Annotated[kind, msgspec.Meta(min_length=length, max_length=length)]
    return kind if bound is None else Annotated[kind, msgspec.Meta(max_length=bound)]


def _kinds(message: MessageType) -> Iterable[str]:
    """What occurs anywhere in a message, as far as a large text's check depends on it."""
    for slot in message.slots:
        shape = slot.shape
        if isinstance(shape, shapes.Array):
            yield "array"
            shape = shape.element
        match shape:
            case shapes.Message():
                yield from shape.type.json._kinds
            case shapes.Octets():
                yield "octets" if shape.length is None else "fixed octets"
            case shapes.String():
                yield "string" if shape.bound is None else "bounded string"
            case shapes.Float():
                yield "float"


def _too_large(shape: Shape) -> _Flaw | None:
    """The flaw of a uint64 above its range: msgspec's bounds end at int64's."""
    if isinstance(shape, shapes.Int) and shape.high == _UINT64_MAX:
        return lambda value: bool(value > _UINT64_MAX)
    return None


def _unsendable(shape: Shape) -> _Flaw | None:
    """The flaws of Python's own values: lone surrogates too, which no JSON text brings."""
    if isinstance(shape, shapes.String):
        return lambda text: not text.isascii() and has_lone_surrogate(text)
    return _too_large(shape)


def _flaw_in(message: MessageType, leaf: Callable[[Shape], _Flaw | None]) -> _Flaw | None:
    """Looks for flaws anywhere in a message; None if nothing in it can have one."""
    flaws = [(slot.attribute, flaw) for slot in message.slots if (flaw := _shape_flaw(slot.shape, leaf))]
    if not flaws:
        return None
    return lambda value: any(flaw(getattr(value, attribute)) for attribute, flaw in flaws)


def _shape_flaw(shape: Shape, leaf: Callable[[Shape], _Flaw | None]) -> _Flaw | None:
    match shape:
        case shapes.Message():
            return _flaw_in(shape.type, leaf)
        case shapes.Array():
            flaw = _shape_flaw(shape.element, leaf)
            return None if flaw is None else lambda items: any(map(flaw, items))
        case _:
            return leaf(shape)


def _plain(value: object) -> object:
    """What msgspec does not know itself: a numpy array becomes a list."""
    tolist = getattr(value, "tolist", None)
    if tolist is None:
        raise PayloadError("", f"{type(value).__name__} has no form in JSON")
    return tolist()


_ENCODER = msgspec.json.Encoder(enc_hook=_plain)


def _packer(message: MessageType) -> Callable[[Any], Any] | None:
    """A function that copies a message with its long octets as finished base64 text; None if it has no
    octets."""
    packers = {
        slot.attribute: packed for slot in message.slots if (packed := _pack_shape(slot.shape)) is not None
    }
    if not packers:
        return None
    attributes = [slot.attribute for slot in message.slots]

    def pack(value: Any) -> Any:
        fields = ((getattr(value, name), packers.get(name)) for name in attributes)
        return type(value)(*[field if packer is None else packer(field) for field, packer in fields])

    return pack


def _pack_shape(shape: Shape) -> Callable[[Any], Any] | None:
    match shape:
        case shapes.Octets():
            return _base64_text
        case shapes.Message():
            return _packer(shape.type)
        case shapes.Array():
            pack = _pack_shape(shape.element)
            return None if pack is None else lambda items: [pack(item) for item in items]
        case _:
            return None


def _base64_text(octets: bytes) -> object:
    if len(octets) < _FEW_OCTETS:
        return octets
    return msgspec.Raw(b'"%b"' % pybase64.b64encode(octets))
