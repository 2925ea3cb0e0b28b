"""Large messages in JSON: check, decode and complete them in steps.

Most of a large message is long arrays, of numbers or of messages. The text is split into its members, and
the long arrays into chunks, at commas between two items. Each chunk is decoded in a step of its own, and the
rest of the text as a short message in which the arrays are empty.

Why the chunks stand for the whole: :func:`_walk` finds all names and separators, and where each value begins
and ends, up to the end of the text. Every value is decoded later. A chunk begins with an item and is a valid
list by itself, so the comma behind it separates two items.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from functools import lru_cache, partial, reduce
from typing import Any, Final, NamedTuple

import msgspec

from rwt_interfaces import field_types
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.field_types import Slot
from rwt_interfaces.serialise.json import (
    MAX_LENIENT_VALUES,
    REJECTIONS,
    SEQUENCE,
    WINDOW_BYTES,
    Unsplittable,
    has_many_values,
    items_encoder,
    parse,
)
from rwt_interfaces.serialise.long_lists import CHUNK_ITEMS, Chunks, chunks_of, holds_long_lists, is_long_list
from rwt_interfaces.serialise.long_strings import TOKEN, JoinedParts, Parts, RawText
from rwt_interfaces.serialise.splice import put
from rwt_interfaces.serialise.strict import array_reader, strict_annotation
from rwt_interfaces.steps import Steps
from rwt_interfaces.struct_fields import annotation
from rwt_interfaces.structs import MessageType
from rwt_interfaces.validation.lenient_decoder import Completion, compile_field
from rwt_interfaces.validation.mismatch import check_length, under
from rwt_interfaces.validation.numbers import LIST

CHUNK_BYTES: Final = 1 << 16
"""Bytes of an array that are decoded in one step. Longer arrays are decoded in chunks."""
SLOW_CHUNK_BYTES: Final = 1 << 12
"""Bytes of an array that are decoded in one step where values are completed one by one."""
MAX_GROWTH_BYTES: Final = 1_000_000
"""Bytes that the messages of an array may grow before the fields that they lack are counted."""
_MAX_MEMBERS: Final = 256
"""Members of an object that are looked at one by one in a step."""
_MAX_DEPTH: Final = 16
_MAX_TRIES: Final = 16
_QUOTED_TOKEN: Final = b'"%b"' % TOKEN.encode()

_MAX_SPACE: Final = 1 << 16
"""White space between two tokens, at most. A text with more, which no robot writes, is decoded unsplit:
msgspec skips it several times faster than a regular expression, which would hold the event loop for tens of
milliseconds."""
_SPACE: Final = rb"[ \t\r\n]{0,%d}+" % _MAX_SPACE
_NAME: Final = re.compile(_SPACE + rb'"([^"\\\x00-\x1f]*+)"' + _SPACE + rb":" + _SPACE)
_EMPTY: Final = re.compile(_SPACE + rb"\}")
_AFTER_VALUE: Final = re.compile(_SPACE + rb"([,}\]]|\Z)")
_NUMBERS: Final = re.compile(rb"\[" + _SPACE + rb"[-0-9NInatf]")
_BETWEEN: Final = re.compile(rb"\}" + _SPACE + rb"(,)" + _SPACE + rb"\{")
# Each turn of the outer loop is atomic: Python before 3.11.5 does not go back from one that fails halfway.
_STRINGS: Final = re.compile(
    rb'(?>"[^"\\]*+(?:\\.[^"\\]*+)*+"' + _SPACE + rb"," + _SPACE + rb")++", re.DOTALL
)
_FIRST: Final = re.compile(_SPACE + rb"([^ \t\r\n])")
_TRAILING: Final = re.compile(r"trailing characters \(byte (\d+)\)")

_skip: Final = msgspec.json.Decoder(msgspec.Raw).decode
_Path = tuple[Slot, ...]


class _Span(NamedTuple):
    """Place of one value in a text, with the members of an object; `end` is behind its last byte."""

    begin: int
    end: int
    members: dict[str, _Span] | None = None


class _Array(NamedTuple):
    """One long array of a text: slots that lead to its field, its items, and its place."""

    path: _Path
    items: _Items
    span: _Span


class LargeMessages:
    """Large messages of one type, which are split, completed and encoded in steps."""

    def __init__(self, message: MessageType) -> None:
        self.split: Callable[[RawText], Steps[LargeJson | None]] = partial(LargeJson.split, message)
        self.complete_values = partial(_complete_values, message)
        self.encode = partial(_encode, message)


class LargeJson:
    """JSON text of one message, split into its long arrays and the rest. Make it with :meth:`split`."""

    def __init__(self, message: MessageType, data: bytes, arrays: list[_Array]) -> None:
        self._message = message
        self._data = data
        self._arrays = arrays

    @classmethod
    def split(cls, message: MessageType, raw: RawText) -> Steps[LargeJson | None]:
        """Return the split text; None if it has no long arrays, or cannot be split."""
        data = bytes(raw)
        begin = _FIRST.match(data)
        if begin is None or begin[1] != b"{":
            return None
        yield
        try:
            root = yield from _walk(data, begin.start(1), 0)
        except (Unsplittable, UnicodeDecodeError):
            return None
        arrays = list(_long_arrays(message, data, root, ()))
        after = _AFTER_VALUE.match(data, root.end)
        return cls(message, data, arrays) if arrays and after and not after[1] else None

    def is_exact(self) -> Steps[bool]:
        """Check, in steps, that the text may be passed on untouched.

        Raises:
            Unsplittable: the rest of the text is large itself.
        """
        return (yield from self.is_exact_around()) and (yield from self.has_exact_arrays())

    def is_exact_around(self) -> Steps[bool]:
        """Check the text without its long arrays; raises Unsplittable if that is large itself."""
        short = self._without_arrays()
        if (yield from has_many_values(short)):
            raise Unsplittable
        yield
        try:
            self._message.json.check(short)
        except REJECTIONS:
            return False
        return True

    def has_exact_arrays(self) -> Steps[bool]:
        """Check, in steps, that all long arrays may be passed on untouched."""
        for _, items, span in self._arrays:
            if items.are_octets or not (yield from items.are_exact(self._data, span)):
                return False
        return True

    @property
    def has_sequence_first(self) -> bool:
        """False if publishers number such messages, and not where :data:`SEQUENCE` finds it."""
        return not self._message.has_sequence or SEQUENCE.match(self._data) is not None

    def around_arrays(self, now: Callable[[], int]) -> Steps[Parts]:
        """Complete the message around exact arrays, whose text stays where it is.

        A list of the items would take many times the memory of their text, for each message in progress.

        Raises:
            InvalidMessage: the message does not fit.
            Unsplittable: the rest of the text is large itself, or not JSON.
        """
        short = self._message.decode_leniently((yield from self._parsed()), now)
        for path, _, _ in self._arrays:
            # The token is random text, so its quoted form occurs in the encoded message once per array.
            short = put(short, field_types.attributes(path), TOKEN)
        data = memoryview(self._data)
        return _spliced(self._message, short, [(data[span.begin : span.end],) for _, _, span in self._arrays])

    def apart(self) -> Steps[tuple[msgspec.Struct, Chunks]]:
        """Return the message of an exact text with empty long arrays, and their items in chunks.

        No more than a chunk is held at a time, because to free a large tree of objects takes too long.
        """
        yield
        lists = {
            ".".join(field_types.attributes(path)): items.chunks(self._data, span)
            for path, items, span in self._arrays
        }
        return self._message.json.decode(self._without_arrays()), lists

    def complete(self, completion: Completion) -> Steps[msgspec.Struct]:
        """Complete the message in steps, as the lenient decoder does.

        Raises:
            InvalidMessage: the message does not fit.
            Unsplittable: the text is not JSON, or large itself outside the arrays.
        """
        value = yield from self._parsed()
        lists = [(path, items.complete(self._data, span, completion)) for path, items, span in self._arrays]
        try:
            return (yield from _complete(self._message, value, lists, completion))
        except InvalidMessage:
            yield
            # A text that is not JSON is rejected for that, and not for the first field that does not fit.
            try:
                str(self._data, "utf-8")
            except UnicodeDecodeError:
                raise Unsplittable from None
            raise

    def _parsed(self) -> Steps[object]:
        text = self._without_arrays()
        if (yield from has_many_values(text, MAX_LENIENT_VALUES)):
            raise Unsplittable
        yield
        return _parsed(text)

    def _without_arrays(self) -> bytes:
        parts: list[bytes] = []
        begin = 0
        for span in sorted(array.span for array in self._arrays):
            parts += (self._data[begin : span.begin], b"[]")
            begin = span.end
        return b"".join((*parts, self._data[begin:]))


class _Items:
    """Decoders for the items of arrays of one element type.

    Attributes:
        are_octets: True for octets, which may be written as a list of numbers.
    """

    def __init__(self, array: field_types.Array | field_types.Octets) -> None:
        self._array = array
        element = field_types.UINT8 if isinstance(array, field_types.Octets) else array.element
        self._element = element
        self.are_octets = isinstance(array, field_types.Octets)
        self._bound = None if isinstance(array, field_types.Octets) else array.bound
        self._message = element.type if isinstance(element, field_types.Message) else None
        self.are_numbers = isinstance(element, field_types.Int | field_types.Float)
        self._decode_list = compile_field(field_types.Array(element))
        self._read = array_reader(field_types.Array(element))
        self._decode_sendable: Callable[[bytes], list[Any]] = msgspec.json.Decoder(
            LIST[strict_annotation(element, has_nulls=False)]
        ).decode
        self.encode = items_encoder(element)

    def are_exact(self, data: bytes, span: _Span) -> Steps[bool]:
        """Check, in steps, that an array may be passed on untouched."""
        count = 0
        try:
            # Most inexact arrays are inexact at the beginning.
            for start, stop in _chunks(data, span, CHUNK_BYTES, SLOW_CHUNK_BYTES):
                yield
                item = yield from self._long_item(data, start, stop)
                if item is not None:
                    if not (yield from item.is_exact()):
                        return False
                    count += 1
                    continue
                text = _text(data, start, stop)
                if (yield from _is_unusual(text)):
                    raise Unsplittable
                taken, may_pass = self._read(text)
                if not may_pass or not taken:
                    return False
                count += len(taken)
        except REJECTIONS:
            return False
        return self._bound is None or count <= self._bound

    def chunks(self, data: bytes, span: _Span) -> Iterator[list[Any] | None]:
        """Yield the items of an exact array, some at a time; None is a step without any."""
        for start, stop in _chunks(data, span, CHUNK_BYTES if self.are_numbers else SLOW_CHUNK_BYTES):
            item = yield from self._long_item(data, start, stop)
            if item is not None:
                yield [(yield from _whole(item))]
                continue
            text = _text(data, start, stop)
            if self.are_numbers:
                yield self._read(text)[0]
                continue
            try:
                yield self._decode_sendable(text)
            except msgspec.ValidationError:
                # It holds a null, which is NaN.
                yield self._decode_list(_parsed(text), lambda: 0)

    def complete(self, data: bytes, span: _Span, completion: Completion) -> Steps[Any]:
        """Complete the items of an array in steps; raises InvalidMessage or Unsplittable."""
        taken: Any = bytearray() if self.are_octets else []
        growth_left = MAX_GROWTH_BYTES
        for start, stop in _chunks(data, span, CHUNK_BYTES if self.are_numbers else SLOW_CHUNK_BYTES):
            yield
            item = yield from self._long_item(data, start, stop)
            if item is not None and self._message is not None:
                try:
                    taken.append((yield from item.complete(completion)))
                except InvalidMessage as error:
                    raise under(f"[{len(taken)}]", error) from None
                continue
            text = _text(data, start, stop)
            if (yield from _is_unusual(text)):
                raise Unsplittable
            # `{}` may stand for a large message: beyond this growth, the lenient decoder counts added fields.
            items = self._completed_quickly(text, completion) if growth_left > 0 else None
            if items is not None and self._message is not None:
                yield  # To encode what was added takes as long as to add it.
                growth_left -= len(self.encode(items)) - len(text)
                if growth_left < 0:
                    items = None
            if items is None:
                items = []
                for values in chunks_of(_parsed(text), self.are_numbers):
                    # A few bytes of a message can leave out forty fields.
                    items += self._of_values(values, len(taken) + len(items), completion)
                    yield
            if not items:
                raise Unsplittable
            if not self.are_octets:
                completion.take_items(len(items))
            taken.extend(items)
        return self._held(taken)

    def complete_values(self, values: list[object], completion: Completion) -> Steps[Any]:
        """Complete the items of a list of plain values in steps; raises InvalidMessage."""
        taken: list[Any] = []
        for chunk in chunks_of(values, self.are_numbers):
            yield
            taken += self._converted(chunk) or self._of_values(chunk, len(taken), completion)
        return self._held(taken)

    def _of_values(self, values: list[object], offset: int, completion: Completion) -> list[Any]:
        """Complete values of a list, the first of which has the number `offset`; raises InvalidMessage."""
        try:
            items: list[Any] = self._decode_list(values, completion)
        except InvalidMessage as error:
            number, _, rest = error.path.removeprefix("[").partition("]")
            raise InvalidMessage(f"[{offset + int(number)}]{rest}", error.reason) from None
        return items

    def _completed_quickly(self, text: bytes, completion: Completion) -> list[Any] | None:
        try:
            if self._message is not None:
                return self._own(self._message.complete_quickly.items(text, completion))
            return self._read(text)[0]
        except REJECTIONS:
            return None

    def _converted(self, values: list[object]) -> list[Any] | None:
        if self._message is None:
            return None
        try:
            return self._own([self._message.json.convert(value) for value in values])
        except REJECTIONS:
            return None

    def _own(self, items: list[msgspec.Struct]) -> list[Any]:
        own: list[Any] = msgspec.convert(items, LIST[annotation(self._element)], from_attributes=True)
        return own

    def _long_item(self, data: bytes, start: int, stop: int) -> Steps[LargeJson | None]:
        """Return one long message of an array, split; None if it is short or has no long arrays."""
        if self._message is None or stop - start <= CHUNK_BYTES:
            return None
        return (yield from LargeJson.split(self._message, data[start:stop]))

    def _held(self, items: list[Any] | bytearray) -> Any:
        check_length(len(items), self._array.length, self._bound)
        return bytes(items) if self.are_octets else items


_items_of: Final = lru_cache(maxsize=256)(_Items)


def _parsed(text: bytes) -> Any:
    try:
        return parse(text)
    except InvalidMessage:
        raise Unsplittable from None


def _text(data: bytes, start: int, stop: int) -> bytes:
    return b"[%b]" % data[start:stop]


def _whole(text: LargeJson) -> Steps[msgspec.Struct]:
    """Decode an exact text in steps."""
    message, lists = yield from text.apart()
    for path, chunks in lists.items():
        taken: list[Any] = []
        for chunk in chunks:
            taken += chunk or ()
            yield
        message = put(message, tuple(path.split(".")), taken)
    return message


def _complete(
    message: MessageType, value: object, lists: Iterable[tuple[_Path, Steps[Any]]], completion: Completion
) -> Steps[msgspec.Struct]:
    """Complete a message and the lists left out of it; raises InvalidMessage for the first field."""
    errors: list[InvalidMessage] = []
    short: msgspec.Struct | None = None
    try:
        short = message.decode_leniently(value, completion)
    except InvalidMessage as error:
        errors.append(error)
    completed: list[tuple[_Path, Any]] = []
    for path, steps in lists:
        try:
            completed.append((path, (yield from steps)))
        except InvalidMessage as error:
            errors.append(reduce(lambda inner, slot: under(slot.name, inner), reversed(path), error))
    if short is None or errors:
        try:
            raise min(errors, key=lambda error: _place(message, error.path)) from None
        finally:
            errors.clear()  # Otherwise errors, their tracebacks and this frame would form a cycle.
    for path, items in completed:
        short = put(short, field_types.attributes(path), items)
    return short


def _place(message: MessageType, path: str) -> list[float]:
    """Return a sort key of errors, the order in which fields are decoded; unknown fields are found last."""
    name, _, rest = path.partition(".")
    for index, slot in enumerate(message.slots):
        if slot.name == name.partition("[")[0]:
            nested = slot.type.type if isinstance(slot.type, field_types.Message) else None
            return [index, *(_place(nested, rest) if nested else ())]
    return [math.inf]


def _complete_values(
    message: MessageType, value: Mapping[str, object], now: Callable[[], int]
) -> Steps[msgspec.Struct | None]:
    """Complete a message of plain values, its long lists in steps; None if it has none.

    Raises:
        InvalidMessage: the message does not fit.
    """
    long = list(_long_lists(message, value, ()))
    if not long:
        return None
    completion = Completion(now)
    short = value
    lists: list[tuple[_Path, Steps[Any]]] = []
    for path, items, values in long:
        short = _with_empty_list(short, path)
        lists.append((path, items.complete_values(values, completion)))
    return (yield from _complete(message, short, lists, completion))


def _long_lists(
    message: MessageType, value: Mapping[str, object], path: _Path
) -> Iterator[tuple[_Path, _Items, list[object]]]:
    """Yield the long lists in a message of plain values: the slots that lead there, decoders, and values."""
    for slot in message.slots:
        here, held = (*path, slot), value.get(slot.name)
        match slot.type:
            case field_types.Message() if isinstance(held, dict):
                yield from _long_lists(slot.type.type, held, here)
            case field_types.Array(length=None) if isinstance(held, list) and len(held) > CHUNK_ITEMS:
                yield here, _items_of(slot.type), held


def _with_empty_list(value: Mapping[str, Any], path: _Path) -> dict[str, Any]:
    """Return a copy of a message of plain values with an empty list at a path; all else is shared."""
    slot, *rest = path
    return {**value, slot.name: _with_empty_list(value[slot.name], tuple(rest)) if rest else []}


def _encode(message: MessageType, value: msgspec.Struct) -> Steps[Parts | None]:
    """Encode a message as JSON in steps; return None if neither it nor an item of its lists has long ones."""
    short = value
    lists: list[Parts] = []
    for path, field_type in field_types.leaves(message):
        if not isinstance(field_type, field_types.Array) or field_type.length is not None:
            continue
        items = _items_of(field_type)
        found: Any = value
        for slot in path:
            found = getattr(found, slot.attribute)
        if not is_long_list(field_type, found):
            continue
        short = put(short, field_types.attributes(path), TOKEN)
        parts = JoinedParts()
        before = b"["
        for chunk in chunks_of(found, items.are_numbers):
            if isinstance(field_type.element, field_types.Message) and holds_long_lists(field_type, chunk):
                for item in chunk:
                    encoded = yield from _encode(field_type.element.type, item)
                    for part in (before, *(encoded or (items.encode([item])[1:-1],))):
                        parts.append(part)
                    before = b","
            else:
                parts.append(before + items.encode(chunk)[1:-1])
                before = b","
            yield
        parts.append(b"]")
        lists.append(parts.all())
    return _spliced(message, short, lists) if lists else None


def _spliced(message: MessageType, short: msgspec.Struct, lists: list[Parts]) -> Parts:
    """Encode a message as JSON, with the texts of its lists in place of tokens."""
    first, *others = message.json.encode(short).split(_QUOTED_TOKEN)
    joined: list[RawText] = [first]
    for parts, other in zip(lists, others, strict=True):
        joined += (*parts, other)
    return tuple(joined)


def _is_unusual(chunk: bytes) -> Steps[bool]:
    """Return True if a chunk, which is one item then, may not be decoded at once."""
    return len(chunk) > WINDOW_BYTES and (yield from has_many_values(chunk))


def _long_arrays(message: MessageType, data: bytes, span: _Span, path: _Path) -> Iterator[_Array]:
    for slot in message.slots:
        value = (span.members or {}).get(slot.name)
        if value is None or value.end - value.begin <= SLOW_CHUNK_BYTES:
            continue
        here = (*path, slot)
        if isinstance(slot.type, field_types.Message):
            yield from _long_arrays(slot.type.type, data, value, here)
        elif data[value.begin] == ord("["):
            match slot.type:
                case field_types.Array(length=None) | field_types.Octets(length=None):
                    yield _Array(here, _items_of(slot.type), value)


def _walk(data: bytes, begin: int, depth: int) -> Steps[_Span]:
    """Return the span of the value that begins there; of an object, also those of its members.

    Raises:
        Unsplittable: it is not JSON, has too many members, or two of the same name.
        UnicodeDecodeError: a name is not UTF-8.
    """
    if data[begin : begin + 1] != b"{" or depth == _MAX_DEPTH:
        # An array of numbers ends at the first bracket. To find that is much faster than to skip numbers.
        end = data.find(b"]", begin) + 1 if _NUMBERS.match(data, begin) else _end(data, begin, len(data))
        if not end:
            raise Unsplittable
        if end - begin > CHUNK_BYTES:
            yield
        return _Span(begin, end)
    members: dict[str, _Span] = {}
    empty = _EMPTY.match(data, begin + 1)
    if empty is not None:
        return _Span(begin, empty.end(), members)
    at = begin + 1
    for _ in range(_MAX_MEMBERS):
        name = _NAME.match(data, at)
        if name is None:
            raise Unsplittable
        value = yield from _walk(data, name.end(), depth + 1)
        key = str(name[1], "utf-8")
        # Of equal keys the last one wins in a whole text; decoders of parts could not tell.
        if key in members:
            raise Unsplittable
        members[key] = value
        after = _AFTER_VALUE.match(data, value.end)
        if after is None or after[1] not in (b",", b"}"):
            raise Unsplittable
        at = after.end()
        if after[1] == b"}":
            return _Span(begin, at, members)
    raise Unsplittable


def _end(data: bytes, begin: int, last: int) -> int:
    """Return the end of the value at `begin`, at most `last`; raises Unsplittable if it is not JSON."""
    try:
        _skip(memoryview(data)[begin:last])
    except msgspec.DecodeError as error:
        # msgspec skips the value and names the first byte behind it: much faster than to search its end here.
        trailing = _TRAILING.search(str(error))
        if trailing is None:
            raise Unsplittable from None
        end = begin + int(trailing[1]) - 1  # Behind the space that follows the value.
        if data[end - 1] > 32:
            return end
        before = max(begin, end - _MAX_SPACE)
        value = data[before:end].rstrip(b" \t\r\n")
        if not value:
            raise Unsplittable from None
        return before + len(value)
    except RecursionError:
        raise Unsplittable from None
    return last


def _chunks(data: bytes, span: _Span, size: int, first: int = 0) -> Iterator[tuple[int, int]]:
    """Yield the offsets of chunks of about `size` bytes, or a single item; the first of `first`, if given."""
    start, last = span.begin + 1, span.end - 1
    near = start + (first or size)
    while True:
        stop = last if last <= near else _cut(data, start, near, last)
        yield start, stop
        if stop == last:
            return
        start = stop + 1
        near = start + size


def _cut(data: bytes, start: int, near: int, last: int) -> int:
    """Return the offset of a comma between two items near an offset; `last` if there is none behind it."""
    first = _FIRST.match(data, start, last)
    if first is None:
        return last
    begin = first.start(1)
    if first[1] == b'"':
        strings = _STRINGS.match(data, begin, near)
        if strings is not None:
            return data.rindex(b",", begin, strings.end())
    elif first[1] == b"{":
        comma = _cut_before(data, begin, near)
        if comma:
            return comma
    elif first[1] != b"[":
        comma = data.find(b",", near, last)
        return comma if comma >= 0 else last
    end = _end(data, begin, last)
    after = _AFTER_VALUE.match(data, end)
    if after is None:
        raise Unsplittable
    return min(after.start(1), last)


def _cut_before(data: bytes, begin: int, near: int) -> int:
    """Return the offset of the last comma between two objects of a list before `near`; 0 if none is found."""
    stop = near
    for _ in range(_MAX_TRIES):
        comma = _last_between(data, begin, stop)
        if not comma:
            return 0
        if data.count(b"[", begin, comma) != data.count(b"]", begin, comma):
            stop = data.rfind(b"[", begin, comma)  # It may be within an array of the item.
            continue
        # The comma may be inside a string, or between objects of a nested list: then this is not a list.
        try:
            _skip(_text(data, begin, comma))
        except (msgspec.DecodeError, RecursionError):
            stop = comma
        else:
            return comma
    return 0


def _last_between(data: bytes, begin: int, stop: int) -> int:
    for _ in range(4 * _MAX_TRIES):
        stop = data.rfind(b"}", begin, stop)
        if stop < 0:
            return 0
        between = _BETWEEN.match(data, stop)
        if between is not None:
            return between.start(1)
    return 0
