"""Large JSON texts of which most is long arrays, of numbers or of messages.

Each array is proven in pieces, and completed where it has to be; the rest is read with the arrays empty. So
no step takes longer than a piece, and what may be passed on stays as it came.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Generator, Iterable, Iterator
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import msgspec

from rwt_interfaces import field_types
from rwt_interfaces.errors import InvalidMessage
from rwt_interfaces.serialise.array_regions import LONG_ITEM, Pieces, Region, regions
from rwt_interfaces.serialise.long_strings import (
    FEW,
    LARGE,
    TOKEN,
    Chunks,
    ItemApart,
    JoinedParts,
    Parts,
    RawText,
    Steps,
    chunks_of,
    finished,
)
from rwt_interfaces.serialise.splice import put
from rwt_interfaces.serialise.strict import array_reader
from rwt_interfaces.struct_fields import annotation
from rwt_interfaces.validation.lenient_decoder import Completion, compile_field
from rwt_interfaces.validation.mismatch import under
from rwt_interfaces.validation.numbers import number_list

if TYPE_CHECKING:
    from rwt_interfaces.structs import MessageType

PIECE: Final = 1 << 15
"""Bytes of an array that are looked at in one step; a little more, up to the end of an item."""
SLOW_PIECE: Final = 1 << 12
"""The same of messages that have to be completed."""
_FEW_NUMBERS: Final = 1 << 20
"""Bytes of a text whose numbers are kept, for encodings that will need them."""
MOST_GROWTH: Final = 1_000_000
"""Bytes that the messages of an array may grow before the fields that they lack are counted."""
MOST_VALUES: Final = 1 << 18
"""Values of a text that is decoded at once, reckoned by its commas and objects: what holds more has to be
taken in pieces."""
MOST_LENIENT: Final = 1 << 15
"""The same of a text that is no message as it stands, and has to be completed value by value."""
SEQUENCE: Final = re.compile(rb'\s*\{\s*"header"\s*:\s*\{\s*"seq"\s*:\s*(\d+)')
"""A message in JSON up to its `header.seq`, where it is as most write it."""
_QUOTED_TOKEN = b'"%b"' % TOKEN.encode()

_WHOLE: Final = 1 << 18
"""Bytes of a piece from which its values are counted before it is decoded."""

#: Subscripted at run time, which a checker cannot follow.
_LIST: Any = list
_Path = tuple[str, ...]
_Order = tuple[int, ...]
"""Where a field stands in its message: its number, and for one in a nested message those around it."""


class _Items:
    """The items of the arrays of one field.

    Attributes:
        are_octets: whether the field holds octets, which go out as base64.
        are_numbers: whether what :meth:`take` returns is what the field holds.
        message: the type of items that are messages; None where they are not.
        bound: how many there may be at most, if that is bounded.
        encode: encodes a list of items as JSON.
    """

    def __init__(self, type: field_types.Array | field_types.Octets, path: _Path) -> None:
        from rwt_interfaces.serialise.json import items_encoder

        self.are_octets = isinstance(type, field_types.Octets)
        element = field_types.UINT8 if isinstance(type, field_types.Octets) else type.element
        self.are_numbers = isinstance(element, field_types.Int | field_types.Float)
        self.message = element.type if isinstance(element, field_types.Message) else None
        self.bound = None if isinstance(type, field_types.Octets) else type.bound
        self._element = element
        self.name = ".".join(path)
        self._decode_leniently = compile_field(element)
        self.encode = items_encoder(element)
        self._decode_own: Callable[[bytes], list[Any]] = msgspec.json.Decoder(
            _LIST[annotation(element)]
        ).decode
        self._read = array_reader(field_types.Array(element, None, None))

    def take(self, text: bytes) -> tuple[list[Any], bool] | None:
        """The items of a JSON array, whether its text may be passed on; None if they must be completed."""
        from rwt_interfaces.serialise.json import REJECTIONS

        try:
            return self._read(text)
        except REJECTIONS:
            return None

    def values(self, text: bytes) -> list[Any]:
        """The items of a JSON array that may be passed on, as the field holds them."""
        if self.are_numbers:
            return self._read(text)[0]
        try:
            return self._decode_own(text)
        except msgspec.ValidationError:
            from rwt_interfaces.serialise.json import parse

            # There is a null, which is NaN.
            return self._completed(parse(text), 0, Completion(lambda: 0))

    def complete(
        self, text: bytes, offset: int, completion: Completion, room: int
    ) -> tuple[list[Any], bytes, bool]:
        """The items, their JSON, and whether that was quick.

        Args:
            text: a JSON array.
            offset: the number of its first item.
            completion: completes messages.
            room: bytes that messages may grow without a count of the fields that they lack.

        Raises:
            InvalidMessage: an item does not fit.
        """
        from rwt_interfaces.serialise.json import REJECTIONS, parse

        if isinstance(self._element, field_types.Message) and room > 0:
            try:
                items: list[Any] = self._element.type.complete_quickly.items(text, completion)
            except REJECTIONS:
                pass
            else:
                encoded = self.encode(items)
                if len(encoded) - len(text) <= room:
                    return items, encoded, True
        items = self._completed(parse(text), offset, completion)
        return items, self.encode(items), self.are_numbers

    def of_values(self, values: list[object], offset: int, completion: Completion) -> list[Any]:
        """The items that plain values stand for; the first has the number `offset`.

        Raises:
            InvalidMessage: an item does not fit.
        """
        from rwt_interfaces.serialise.json import REJECTIONS

        if self.message is not None:
            try:
                exact = [self.message.json.convert(value) for value in values]
                own: list[Any] = msgspec.convert(
                    exact, _LIST[annotation(self._element)], from_attributes=True
                )
            except REJECTIONS:
                pass
            else:
                return own
        return self._completed(values, offset, completion)

    def _completed(self, values: Any, offset: int, completion: Completion) -> list[Any]:
        if isinstance(self._element, field_types.Int | field_types.Float):
            try:
                return number_list(values, self._element)
            except InvalidMessage as error:
                number, _, rest = error.path.removeprefix("[").partition("]")
                raise InvalidMessage(f"{self.name}[{offset + int(number)}]{rest}", error.reason) from None
        items = []
        for index, value in enumerate(values, offset):
            try:
                items.append(self._decode_leniently(value, completion))
            except InvalidMessage as error:
                raise under(f"{self.name}[{index}]", error) from None
        return items


_Located = tuple[_Order, _Path, _Items, Region]
"""A long array: its place and path in the message, what takes its items, and where it is in the text."""


class TakenArray(NamedTuple):
    """One long array of a message that was taken from JSON.

    Attributes:
        path: the attributes that lead to it.
        parts: its JSON; octets are one part of base64.
        is_exact: whether that is how it came.
        values: what the field holds; None for an array of messages.
    """

    path: _Path
    parts: Parts
    is_exact: bool
    values: list[Any] | bytes | None


class TakenMessage(NamedTuple):
    """A message apart from its long arrays.

    Attributes:
        is_exact: whether the whole may be passed on as it came.
        short: the complete message, its long arrays empty; None if it is exact.
        arrays: the long arrays in the order of the fields.
    """

    is_exact: bool
    short: msgspec.Struct | None
    arrays: tuple[TakenArray, ...]

    def json_parts(self, encode: Callable[[Any], bytes]) -> Parts:
        """The parts of the message in JSON."""
        message = self.short
        assert message is not None  # Else it is passed on as it came.
        for array in self.arrays:
            message = put(message, array.path, TOKEN)
        first, *others = encode(message).split(_QUOTED_TOKEN)
        parts: list[RawText] = [first]
        for array, other in zip(self.arrays, others, strict=True):
            parts += (*array.parts, other)
        return tuple(parts)

    def value(self) -> msgspec.Struct | None:
        """The whole message; None if one of its arrays is known as text alone."""
        message = self.short
        for array in self.arrays:
            if array.values is None or message is None:
                return None
            message = put(message, array.path, array.values)
        return message


_NOT_EXACT: Final = TakenMessage(False, None, ())


class LongArrays:
    """Takes messages of one type apart from their long arrays."""

    __slots__ = ("_members", "_message", "_slots", "_taken")

    def __init__(self, message: MessageType) -> None:
        self._message = message
        self._slots = {slot.attribute: (number, slot) for number, slot in enumerate(message.slots)}
        self._members = msgspec.json.Decoder(
            msgspec.defstruct(
                "Members",
                [(slot.attribute, msgspec.Raw | msgspec.UnsetType, msgspec.UNSET) for slot in message.slots],
                rename={slot.attribute: slot.name for slot in message.slots},
                forbid_unknown_fields=True,
            )
        ).decode
        self._taken: dict[_Path, _Items] = {}

    def take(
        self, raw: RawText, now: Callable[[], int], *, completes: bool = True
    ) -> Steps[TakenMessage | None]:
        """The message that a text holds, in steps; None if it has no long arrays that can be told apart.

        Args:
            raw: the text.
            now: ROS time in nanoseconds.
            completes: whether to complete what may not be passed on; else nothing is returned of it.

        Raises:
            InvalidMessage: it does not fit; found before or after other faults as the fields have it.
        """
        completion = Completion(now) if completes else None
        keep = len(raw) <= _FEW_NUMBERS
        return (yield from self._take(bytes(raw), completion, keep, heads=self._message.has_sequence))

    def _take(
        self, data: bytes, completion: Completion | None, keep: bool, *, heads: bool = False
    ) -> Steps[TakenMessage | None]:
        from rwt_interfaces.serialise.json import REJECTIONS, parse

        places = yield from self._regions(data)
        if places is None:
            return None
        yield
        text = _with(data, [place[3] for place in places], [b"[]"] * len(places))
        short: msgspec.Struct | None = None
        wrong: InvalidMessage | None = None
        try:
            self._message.json.check(text)
        except REJECTIONS:
            if completion is None:
                return _NOT_EXACT
            yield
            try:
                short = self._message.decode_leniently(parse(text), completion)
            except InvalidMessage as error:
                wrong = error
        is_exact = short is None and wrong is None
        if is_exact and heads and len(data) >= LARGE and not SEQUENCE.match(text):
            # Publishers write their count there: the header goes first, where that costs nothing.
            yield
            is_exact, short = False, self._message.json.decode(text)
        yield
        arrays = []
        for order, path, items, region in sorted(places, key=lambda place: place[0]):
            if wrong is not None and self._order_of(wrong.path) < order:
                break
            array = yield from _taken(data, region, path, items, completion, keep)
            if array is None:
                return None
            if completion is None and not array.is_exact:
                return _NOT_EXACT
            arrays.append(array)
        if wrong is not None:
            raise wrong
        if is_exact and not all(array.is_exact for array in arrays):
            is_exact, short = False, self._message.json.decode(text)
        return TakenMessage(is_exact, short, tuple(arrays))

    def apart(self, raw: RawText) -> Steps[tuple[msgspec.Struct, Chunks] | None]:
        """The message of a text that may be passed on, with its long arrays empty, and what they hold, to be
        decoded in pieces; None if they cannot be told apart."""
        data = bytes(raw)
        places = yield from self._regions(data)
        if places is None:
            return None
        found = [place[3] for place in places]
        message = self._message.json.decode(_with(data, found, [b"[]"] * len(found)))
        return message, {".".join(path): _chunks(data, region, items) for _, path, items, region in places}

    def _regions(self, data: bytes) -> Steps[list[_Located] | None]:
        """The long arrays of a text in the order of the text; None if it has none that can be told apart."""
        found = yield from regions(data, SLOW_PIECE)
        yield
        return self._places(data, found) if found else None

    def of_value(self, value: dict[str, object], now: Callable[[], int]) -> Steps[msgspec.Struct | None]:
        """The message that plain objects hold, in steps; None if they have no long lists.

        Raises:
            InvalidMessage: it does not fit; found before or after other faults as the fields have it.
        """
        short = value
        lists: list[tuple[_Path, _Items, list[object]]] = []
        for path, items in self._long_fields((), ()):
            found = _value_at(value, path)
            if isinstance(found, list) and len(found) > FEW and items.bound is None:
                short = _without(short, path)
                lists.append((path, items, found))
        if not lists:
            return None
        completion = Completion(now)
        message: msgspec.Struct = self._message.decode_leniently(short, completion)
        for path, items, found in lists:
            taken: list[Any] = []
            for chunk in chunks_of(found, items.are_numbers):
                yield
                taken += items.of_values(chunk, len(taken), completion)
            message = put(message, path, taken)
        return message

    def json(self, message: msgspec.Struct) -> Steps[Parts | None]:
        """A message in JSON, in steps; None if it has no long lists."""
        short = message
        lists: list[Parts] = []
        for path, items in self._long_fields((), ()):
            values: Any = _at(message, path)
            if isinstance(values, bytes) or len(values) <= FEW:
                continue
            short = put(short, path, TOKEN)
            parts = JoinedParts()
            before = b"["
            for chunk in chunks_of(values, items.are_numbers):
                parts.append(before + items.encode(chunk)[1:-1])
                before = b","
                yield
            parts.append(b"]")
            lists.append(parts.all())
        if not lists:
            return None
        first, *others = self._message.json.encode(short).split(_QUOTED_TOKEN)
        found: list[RawText] = [first]
        for parts_of_list, other in zip(lists, others, strict=True):
            found += (*parts_of_list, other)
        return tuple(found)

    def _long_fields(self, order: _Order, path: _Path) -> Iterator[tuple[_Path, _Items]]:
        """The fields that may hold long lists."""
        for attribute, (number, slot) in self._slots.items():
            place = (*path, attribute)
            if isinstance(slot.type, field_types.Message) and slot.type.type.time is None:
                yield from slot.type.type.json.long_arrays._long_fields((*order, number), place)
            elif isinstance(slot.type, field_types.Array) and (items := self._items(slot.type, place)):
                yield place, items

    def _order_of(self, path: str) -> _Order:
        """Where a fault is; one of a message as a whole is behind its fields."""
        name, _, rest = path.partition(".")
        for number, slot in self._slots.values():
            if slot.name == name.partition("[")[0]:
                if isinstance(slot.type, field_types.Message) and slot.type.type.time is None:
                    return (number, *slot.type.type.json.long_arrays._order_of(rest))
                return (number,)
        return (1 << 30,)

    def _places(self, data: bytes, found: list[Region]) -> list[_Located] | None:
        """The field of each region; None if not each of them is the value of one.

        A token stands in the place of each array. No client can know it: where a member is a token, an array
        was the whole of its value.
        """
        tokens = [b'"%b%d"' % (TOKEN.encode(), number) for number in range(len(found))]
        located = dict(self._located(_with(data, found, tokens), (), ()))
        if located.keys() != set(tokens):
            return None
        return [(*located[token], region) for token, region in zip(tokens, found, strict=True)]

    def _located(
        self, text: RawText, order: _Order, path: _Path
    ) -> Iterator[tuple[bytes, tuple[_Order, _Path, _Items]]]:
        """The tokens in the text of a message, and where they are."""
        try:
            given = self._members(text)
        except (msgspec.MsgspecError, UnicodeDecodeError, RecursionError):
            return
        for attribute, (number, slot) in self._slots.items():
            raw = getattr(given, attribute)
            member = b"" if raw is msgspec.UNSET else bytes(raw)
            if TOKEN.encode() not in member:
                continue
            place = (*order, number), (*path, attribute)
            if isinstance(slot.type, field_types.Message) and slot.type.type.time is None:
                yield from slot.type.type.json.long_arrays._located(member, *place)
            elif (items := self._items(slot.type, place[1])) is not None:
                yield member, (*place, items)

    def _items(self, type: field_types.FieldType, path: _Path) -> _Items | None:
        items = self._taken.get(path)
        if items is None and isinstance(type, field_types.Array | field_types.Octets) and _is_long(type):
            items = self._taken[path] = _Items(type, path)
        return items


def _at(message: Any, path: _Path) -> Any:
    for attribute in path:
        message = getattr(message, attribute)
    return message


def _value_at(value: object, path: _Path) -> object:
    """What a path leads to in plain objects; None where there is nothing, or another name for it."""
    for name in path:
        value = value.get(name) if isinstance(value, dict) else None
    return value


def _without(value: Any, path: _Path) -> Any:
    """A copy of plain objects with an empty list at the end of a path; what is beside the path is shared."""
    first, *rest = path
    return {**value, first: _without(value[first], tuple(rest)) if rest else []}


def _is_long(type: field_types.Array | field_types.Octets) -> bool:
    """Whether a field may hold a long array that is taken in pieces."""
    if type.length is not None:
        return False
    if isinstance(type, field_types.Octets):
        return True
    element = type.element
    if isinstance(element, field_types.Message):
        return element.type.time is None
    return isinstance(element, field_types.Bool | field_types.Int | field_types.Float | field_types.String)


def _with(data: bytes, found: list[Region], texts: list[bytes]) -> bytes:
    """The text with others in the places of the arrays."""
    parts: list[RawText] = []
    begin = 0
    for region, text in zip(found, texts, strict=True):
        parts += (data[begin : region.begin], text)
        begin = region.end
    return b"".join((*parts, data[begin:]))


class _Rewritten:
    """A text of which pieces are replaced, and what is between them is passed on as it is.

    Attributes:
        is_exact: whether nothing was replaced.
    """

    __slots__ = ("_begin", "_parts", "_view", "is_exact")

    def __init__(self, data: bytes, begin: int) -> None:
        self._view = memoryview(data)
        self._parts = JoinedParts()
        self._begin = begin
        self.is_exact = True

    def replace(self, start: int, stop: int, parts: Iterable[RawText]) -> None:
        """Have these parts in the place of a piece, which is behind all that were replaced before."""
        self.is_exact = False
        self._parts.append(self._view[self._begin : start])
        for part in parts:
            self._parts.append(part)
        self._begin = stop

    def until(self, end: int) -> tuple[RawText, ...]:
        """All of it, up to there."""
        self._parts.append(self._view[self._begin : end])
        return self._parts.all()


def _taken(
    data: bytes, region: Region, path: _Path, items: _Items, completion: Completion | None, keep: bool
) -> Steps[TakenArray | None]:
    """One array; None if it is not one, or if its pieces cannot be told apart.

    Args:
        data: the text that it is in.
        region: where it is there.
        path: the attributes that lead to its field.
        items: takes what is in it.
        completion: completes messages in it; None to stop at the first that needs it.
        keep: whether its numbers will be asked for.
    """
    rewritten = _Rewritten(data, region.begin)
    octets: list[bytes] = []
    values: list[Any] = []
    cutting = Pieces(data, region, PIECE if items.are_numbers else SLOW_PIECE)
    count = 0
    room = MOST_GROWTH
    for piece in cutting:
        yield
        if piece is None:
            continue
        start, stop = piece
        if items.message is not None and stop - start > LONG_ITEM * SLOW_PIECE:
            item = yield from _taken_item(data[start:stop], items, count, completion)
            if item is not None:
                if not item.is_exact and completion is None:
                    return TakenArray(path, (), False, None)
                if not item.is_exact:
                    rewritten.replace(start, stop, item.json_parts(items.message.json.encode))
                count += 1
                continue
        text = b"[%b]" % data[start:stop]
        if len(text) > _WHOLE and has_many_values(text):
            return None
        found = items.take(text)
        if found is not None:
            taken, may_pass = found
            encoded = b"" if may_pass or items.are_octets else items.encode(taken)
            is_quick = True
        elif completion is None:
            return TakenArray(path, (), False, None)
        else:
            try:
                taken, encoded, is_quick = items.complete(text, count, completion, room)
            except InvalidMessage as error:
                if not error.path:
                    return None
                raise
            may_pass = False
            room -= len(encoded) - len(text)
        if not taken:
            return None
        count += len(taken)
        if items.are_octets:
            octets.append(bytes(taken))
        elif not may_pass:
            rewritten.replace(start, stop, (encoded[1:-1],))
        if keep and items.are_numbers:
            values += taken
        cutting.size = PIECE if is_quick else SLOW_PIECE
    if items.are_octets:
        return _octets(path, b"".join(octets))
    if items.bound is not None and count > items.bound:
        return None
    numbers = values if keep and items.are_numbers else None
    return TakenArray(path, rewritten.until(region.end), rewritten.is_exact, numbers)


def _taken_item(
    text: bytes, items: _Items, number: int, completion: Completion | None
) -> Steps[TakenMessage | None]:
    """One long message of an array; None if it has to be looked at as a whole."""
    assert items.message is not None  # Only messages are long.
    try:
        return (yield from items.message.json.long_arrays._take(text, completion, keep=False))
    except InvalidMessage as error:
        if not error.path:
            return None
        raise under(f"{items.name}[{number}]", error) from None


def has_many_values(data: RawText, most: int = MOST_VALUES) -> bool:
    """Whether a text may hold so many values that it may not be decoded at once."""
    return finished(has_many_values_in_steps(data, most))


def has_many_values_in_steps(data: RawText, most: int = MOST_VALUES) -> Steps[bool]:
    """As :func:`has_many_values`, in steps."""
    text = bytes(data)
    if len(text) <= most:
        return False
    found = 0
    for start in range(0, len(text), _WHOLE):
        if start:
            yield
        found += text.count(b",", start, start + _WHOLE) + text.count(b"{", start, start + _WHOLE)
        if found > most:
            return True
    return False


def _chunks(data: bytes, region: Region, items: _Items) -> Iterator[list[Any]]:
    for piece in Pieces(data, region, PIECE if items.are_numbers else SLOW_PIECE):
        if piece is None:
            yield []
            continue
        start, stop = piece
        if items.message is not None and stop - start > LONG_ITEM * SLOW_PIECE:
            item = yield from _item_apart(data[start:stop], items.message)
            if item is not None:
                yield [item]
                continue
        yield items.values(b"[%b]" % data[start:stop])


def _item_apart(text: bytes, message: MessageType) -> Generator[list[Any], None, ItemApart | None]:
    steps = message.json.long_arrays.apart(text)
    while True:
        try:
            next(steps)
        except StopIteration as end:
            return None if end.value is None else ItemApart(*end.value)
        yield []


def _octets(path: _Path, octets: bytes) -> TakenArray:
    import pybase64

    return TakenArray(path, (b'"%b"' % pybase64.b64encode(octets),), False, octets)
