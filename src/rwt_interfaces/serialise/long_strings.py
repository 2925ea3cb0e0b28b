"""Large JSON texts whose size is one long string: an image's base64, or a text. Checked in two parts, five to
ten times as fast as msgspec checks the whole."""

from __future__ import annotations

from collections.abc import Callable

import msgspec
import pybase64

#: A JSON text, perhaps a view of the buffer that a whole frame was received in.
RawText = bytes | memoryview

#: From this many bytes on a text is large: more than twice the margin.
LARGE = 4096
#: How far from either end of a large text its long string begins and ends at most.
MARGIN = 1024
#: How much of a long string is checked at a time.
PIECE = 1 << 16
_BACKSLASH = 0x5C


def without_long_string(raw: RawText, is_content: Callable[[memoryview], bool]) -> bytes | None:
    """The text with its one long string emptied, or None if it has no such string from near its start to near
    its end.

    Why the rest may stand for the whole: `is_content` sees to it that what is cut is valid between two quotes
    and holds no quote itself. If the quote found is where a string begins, then emptying that string changes
    no other token. If it is where a string ends, the emptied text has two strings side by side, which is no
    JSON. A quote after a backslash is left alone. Only where a length would be checked could the empty string
    pass in place of the long one, so types with such fields do not come here.
    """
    head = bytes(raw[:MARGIN])
    tail_start = len(raw) - MARGIN
    begin = head.rfind(b'"') + 1
    end = tail_start + bytes(raw[tail_start:]).find(b'"')
    if begin < 2 or end < tail_start or head[begin - 2] == _BACKSLASH:
        return None
    with memoryview(raw) as view:
        if not is_content(view[begin:end]):
            return None
    return head[:begin] + bytes(raw[end:])


def is_base64(content: memoryview) -> bool:
    """Whether the bytes are padded base64 without white space."""
    try:
        pybase64.b64decode(content, validate=True)
    except ValueError:
        return False
    return True


def is_string_content(content: memoryview) -> bool:
    """Whether the bytes are valid between two quotes. False where a piece happens to end inside an escape or
    a letter: then the whole text is checked the slow way. In pieces, because large allocations cost more than
    the check.
    """
    # Imported here because only large texts need it.
    from pydantic_core import from_json

    try:
        for start in range(0, len(content), PIECE):
            from_json(b'"%b"' % bytes(content[start : start + PIECE]))
    except ValueError:
        return False
    return True


def parse_long_strings(raw: RawText) -> object:
    """Any JSON text as plain objects, by the parser that is quickest with long strings."""
    # Imported here because only large texts need it.
    from pydantic_core import from_json

    try:
        return from_json(raw if isinstance(raw, bytes) else bytes(raw), allow_inf_nan=False)
    except ValueError:
        raise msgspec.DecodeError from None
