"""Reader of messages in JSON, which chooses the cheapest way for each text.

:func:`read_json` makes these attempts, in this order. Each returns a message, raises InvalidMessage, or
leaves the text to the next one. So exact messages pay for no other attempt.

| attempt | texts | result |
|---|---|---|
| cut out the long string | 4 KiB or more, mostly one string | the text if exact, else completed around it |
| check as a whole | up to `WHOLE_BYTES` | the text if exact |
| split at the long arrays | above `SLOW_BYTES` | the text if exact, else completed |
| check as a whole | above `WHOLE_BYTES`, of few values | the text if exact |
| complete | others, of even fewer values | a decoded message |

A text is *exact* if every field is there and written as ROS writes it, so that it may be passed on untouched.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import TYPE_CHECKING, Final, NamedTuple

import msgspec

from rwt_interfaces.errors import InvalidMessage, NotExact, TooManyValues
from rwt_interfaces.serialise.forms import CutText, Source, SplicedMessage, SplitText
from rwt_interfaces.serialise.json import (
    MAX_LENIENT_VALUES,
    MAX_VALUES,
    REJECTIONS,
    Unsplittable,
    begins_too_deep,
    has_many_values,
    parse,
    require_quick_numbers,
)
from rwt_interfaces.serialise.long_strings import RawText, string_of, substituted
from rwt_interfaces.serialise.splice import LONG_TEXT_CHARS
from rwt_interfaces.steps import Steps
from rwt_interfaces.validation.lenient_decoder import Completion

if TYPE_CHECKING:
    from rwt_interfaces.serialise.large_json import LargeJson
    from rwt_interfaces.structs import MessageType

LONG_STRING_BYTES: Final = 4096
"""Minimum size of a JSON text whose long string is kept separate."""
LARGE_BYTES: Final = 64 * 1024
"""Minimum size of a JSON text that should be read in steps."""
WHOLE_BYTES: Final = 384 * 1024
"""Maximum size of a JSON text that is checked at once, to be passed on untouched.

Checking 1 MB takes, in ms on the benchmark machine: LaserScan 6.2, OccupancyGrid 5.5, String with escapes
4.0, Path 1.7, Image and PointCloud2 0.5, String 0.2. So 384 KiB take at most 2.5 ms, or 10 ms on a board four
times slower.
"""
SLOW_BYTES: Final = 64 * 1024
"""Maximum size of a JSON text that is completed at once; 1 MB takes up to 40 ms."""
LONG_FORMS_BYTES: Final = 128 * 1024
"""Minimum size of a message with arrays whose other forms are made in steps."""
_CHECKED_BYTES: Final = 32 * 1024
"""Maximum size of a JSON text whose checked Struct is kept for other forms: numbers take up to 16 times as
much memory."""

Now = Callable[[], int]
"""ROS time in nanoseconds."""


class ReadMessage(NamedTuple):
    """Result of reading a text, with the attributes of :class:`rwt_interfaces.Payload`."""

    source: Source
    is_long: bool = False
    checked: msgspec.Struct | None = None


def read_json(
    type: MessageType, raw: RawText, now: Now, *, is_trusted: bool = False, is_dense: bool = False
) -> Steps[ReadMessage]:
    """Read a message in steps, by the attempts that this module lists.

    Args:
        type: expected type.
        raw: JSON text.
        now: ROS time in nanoseconds.
        is_trusted: True to accept any number of slow numbers.
        is_dense: True if the text holds too many objects to be parsed. It is accepted only if it is exact, or
            if nearly all of it is one long string.

    Raises:
        NotExact: the text is dense and not exact.
        InvalidMessage: the message does not fit, or has too many slow numbers.
    """
    cut = yield from type.json.cut(raw)
    if cut is not None and is_dense and len(cut.short) >= LONG_STRING_BYTES:
        cut = None
    # Before any decoder reads a number: a text of slow ones would block the event loop for seconds.
    if not is_trusted:
        yield from require_quick_numbers(raw if cut is None else cut.short)
    if cut is not None:
        return _around_string(type, cut, now)
    is_large = len(raw) > WHOLE_BYTES
    found = None if is_large else _exact(type, raw)
    if found is None and len(raw) > SLOW_BYTES and type.json.has_lists and (is_large or not is_dense):
        large = yield from type.large_json.split(raw)
        if large is not None:
            with suppress(Unsplittable):
                found = yield from _around_arrays(type, raw, large, now, is_dense=is_dense)
    if found is None and is_large:
        if (yield from has_many_values(raw)):
            if is_dense:
                raise NotExact
            raise TooManyValues(
                "", f"more than {MAX_VALUES} values: so many are taken only as items of long lists"
            )
        yield
        found = _exact(type, raw)
    if found is None:
        if is_dense:
            raise NotExact
        found = ReadMessage((yield from complete(type, raw, now)), _is_long(type, raw))
    return found


def complete(type: MessageType, raw: RawText, now: Now) -> Steps[msgspec.Struct]:
    """Complete a message as a whole: by msgspec, then value by value. Each attempt is a step."""
    yield
    with suppress(*REJECTIONS):
        return type.complete_quickly(raw, now)
    if (yield from has_many_values(raw, MAX_LENIENT_VALUES)):
        if begins_too_deep(raw):
            raise InvalidMessage("", "nested too deeply")
        raise TooManyValues(
            "",
            f"more than {MAX_LENIENT_VALUES} values, and not as ROS writes it:"
            " so many are taken only as items of long lists",
        )
    yield
    parsed = parse(raw)
    yield
    message: msgspec.Struct = type.decode_leniently(parsed, now)
    return message


def _is_long(type: MessageType, raw: RawText) -> bool:
    return type.json.has_arrays and len(raw) >= LONG_FORMS_BYTES


def _exact(type: MessageType, raw: RawText) -> ReadMessage | None:
    try:
        checked = type.json.check(raw)
    except REJECTIONS:
        return None
    is_kept = type.json.has_arrays and len(raw) <= _CHECKED_BYTES
    return ReadMessage(raw, _is_long(type, raw), checked if is_kept else None)


def _around_string(type: MessageType, cut: CutText, now: Now) -> ReadMessage:
    """Check a message around its long string, or complete it there; the string itself is valid."""
    with suppress(*REJECTIONS):
        type.json.check(cut.short)
        return ReadMessage(cut, bool(cut.unescaped) and len(cut.content) >= LONG_TEXT_CHARS)
    parsed = parse(cut.short)
    with suppress(InvalidMessage):
        spliced = SplicedMessage.from_cut(type, type.decode_leniently(parsed, now), cut)
        if spliced is not None:
            return ReadMessage(spliced)
    # The error may lie in the long string, or quote it.
    whole = substituted(parsed, cut.token.decode(), string_of(cut.content, cut.unescaped))
    return ReadMessage(type.decode_leniently(whole, now))


def _around_arrays(
    type: MessageType, raw: RawText, large: LargeJson, now: Now, *, is_dense: bool
) -> Steps[ReadMessage]:
    """Check a message in chunks of its long arrays, or complete it there; raises Unsplittable."""
    is_large, is_long = len(raw) > WHOLE_BYTES, len(raw) >= LONG_FORMS_BYTES
    # The check of a smaller message has failed, so if its arrays are exact, what is around them is not.
    is_exact_around = is_large and (yield from large.is_exact_around())
    if (is_exact_around or not is_dense) and (yield from large.has_exact_arrays()):
        if is_exact_around and large.has_sequence_first:
            return ReadMessage(raw, is_long)
        # In the first part, a publisher can replace `header.seq` without a copy of the rest.
        return ReadMessage(SplitText((yield from large.around_arrays(now))), is_long)
    if is_dense:
        raise NotExact
    if not is_large:
        yield
        with suppress(*REJECTIONS):
            return ReadMessage(type.complete_quickly(raw, now), is_long)
    return ReadMessage((yield from large.complete(Completion(now))), is_long)
