"""Full parse of a JSON frame into its messages."""

from __future__ import annotations

import math
import re
from collections.abc import Sequence
from contextlib import suppress
from typing import Final

import msgspec

from rwt_protocol.codecs.base import DecodeFailure, Members
from rwt_protocol.codecs.envelope import DECODER, RAW_DECODER, UNDECODED
from rwt_protocol.limits import has_more_brackets

MOST_MESSAGES: Final = 1000
"""Maximum number of messages and faults per frame; the rest is one more fault."""

MOST_MEMBER: Final = 64 * 1024
"""Maximum bytes of JSON of a member other than payloads and :data:`_LONG_TEXT`."""

_LONG_TEXT: Final = "data"
"""Member with a fragment of a message (FRG-01) or an image (PNG-01)."""

_MOST_TEXTS: Final = 200_000
"""Maximum number of strings in a frame with NaN or Infinity, which are searched for between strings."""

_MOST_LOOKED_AT: Final = 1 << 20
"""Maximum bytes of an invalid frame that is searched for NaN, Infinity and preceding valid messages."""

_ROUNDS: Final = 8
"""Levels that are removed one by one before the remaining depth is counted."""

_CHUNK: Final = 1 << 16
"""Brackets that are counted at a time."""

_decode_small: Final = DECODER.decode
_decode_no_member: Final = RAW_DECODER.decode
_decode_raw: Final = msgspec.json.Decoder(msgspec.Raw).decode

_TRAILING: Final = re.compile(r"trailing characters \(byte (\d+)\)")
_PLACE: Final = re.compile(r"\(byte (\d+)\)")
_SURROGATE: Final = re.compile(rb"\\u[dD][89a-fA-F]")
_KIND: Final = {
    ord("["): "an array",
    ord('"'): "a string",
    ord("n"): "null",
    ord("t"): "true",
    ord("f"): "false",
}
_SAME_KIND: Final = bytes.maketrans(b"[]", b"{}")
_NOT_STRUCTURE: Final = bytes(byte for byte in range(256) if byte not in b'{}[]"')
_NOT_BRACKETS: Final = bytes(byte for byte in range(256) if byte not in b"{}[]")
_STRING_APART: Final = re.compile(rb'("(?:[^"\\]|\\.)*+")', re.DOTALL)


_ADDRESS: Final = ("op", "id", "service", "action")
"""Members that address the response."""

_QUICK: Final = 1024
"""Bytes of a text that may hold any numbers."""

_MOST_SLOW: Final = 200
"""Maximum number of slow numbers outside of payloads. A frame may be decoded twice before it is refused."""
_SLOW_NUMBER: Final = re.compile(rb"[eE][+-]?[0-9]{3}")


def _is_slow(data: bytes) -> bool:
    """Return True if a text has many numbers such as 1e308; msgspec takes 10 microseconds for each."""
    if len(data) <= _QUICK or data[:1] == b'"' or data.count(b"e") + data.count(b"E") <= _MOST_SLOW:
        return False
    return len(_SLOW_NUMBER.findall(data)) > _MOST_SLOW


def _slow_in(piece: bytes) -> int:
    """Count the slow numbers that are decoded of one object."""
    try:
        members = _decode_no_member(piece)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return len(_SLOW_NUMBER.findall(piece))
    views = (
        memoryview(raw)
        for name, raw in members.items()
        if name not in UNDECODED and isinstance(raw, msgspec.Raw)
    )
    return sum(len(_SLOW_NUMBER.findall(view)) for view in views if view[0] != ord('"'))


class _MemberTooLarge(Exception):
    """A member has too many bytes or too many slow numbers."""

    def __init__(self, name: str, size: int) -> None:
        self.name = name
        self.size = size


def _decode(data: bytes) -> Members:
    """Return the members of the object `data`.

    Raises:
        msgspec.DecodeError, RecursionError: `data` is not one readable object.
        _MemberTooLarge: a decoded member exceeds :data:`MOST_MEMBER`.
    """
    if len(data) <= MOST_MEMBER and not _is_slow(data):
        return _decode_small(data)
    members = _decode_no_member(data)
    for name, raw in members.items():
        if name not in UNDECODED:
            assert isinstance(raw, msgspec.Raw)
            view = memoryview(raw)
            if len(view) > MOST_MEMBER and not (name == _LONG_TEXT and view[0] == ord('"')):
                raise _MemberTooLarge(name, len(view))
            if _is_slow(bytes(view)):
                raise _MemberTooLarge(name, len(view))
            members[name] = msgspec.json.decode(raw)
    return members


def split_whole(data: bytes, max_depth: int) -> Sequence[Members | DecodeFailure]:
    """Return the messages of a frame, in order. Never raises.

    A frame of one object takes one pass; others are read by :func:`_split_several`.
    """
    try:
        if not data.isascii():
            str(data, "utf-8")
        members = _decode(data)
    except UnicodeDecodeError as error:
        return (DecodeFailure(f"not UTF-8, at byte {error.start}"),)
    except (msgspec.DecodeError, RecursionError) as error:
        # A search for further messages in a large invalid frame would hold the event loop.
        if (
            len(data) > _MOST_LOOKED_AT
            and isinstance(error, msgspec.DecodeError)
            and not _TRAILING.search(str(error))
        ):
            return (_broken(error, data),)
        return _split_several(data, max_depth)
    except _MemberTooLarge as error:
        return (_too_large(data, error),)
    if len(data) > 2 * max_depth and deeper_than(data, max_depth):
        return (DecodeFailure.too_deep(max_depth, members),)
    return (members,)


def _too_large(data: bytes, error: _MemberTooLarge) -> DecodeFailure:
    readable, _ = _readable(data)
    where = f"{readable['op']}.{error.name}" if "op" in readable else error.name
    what = f"{error.size} bytes; a member beside the payload may have {MOST_MEMBER}"
    if error.size <= MOST_MEMBER:
        what = f"more than {_MOST_SLOW} numbers have exponents of three digits, as 1e300"
    return DecodeFailure(f"{where}: {what}", readable)


def _too_slow(piece: bytes) -> DecodeFailure:
    """Return the failure of an object with too many slow numbers, with its address."""
    what = f"more than {_MOST_SLOW} numbers in one frame have exponents of three digits, as 1e300"
    readable: Members = {}
    with suppress(msgspec.DecodeError, UnicodeDecodeError):
        for name, raw in _decode_no_member(piece).items():
            assert isinstance(raw, msgspec.Raw)
            if name in _ADDRESS and memoryview(raw)[0] == ord('"'):
                readable[name] = msgspec.json.decode(raw)
    return DecodeFailure(f"{what}; the rest was dropped", readable)


def _split_several(data: bytes, max_depth: int) -> list[Members | DecodeFailure]:
    """Split a frame that is not one plain object: several, garbage, or Python's JSON dialect.

    Objects are read in order, each on its own (ENV-10). Text between them that cannot begin an object or
    array is skipped up to the next brace and rejected; the objects around it still run. A truncated or
    invalid object or array ends the frame: its contents are never read as messages, and nothing is kept for
    the next frame (ENV-09).
    """
    found: list[Members | DecodeFailure] = []
    rest = data.strip(b" \t\r\n")
    if not rest:
        return [DecodeFailure("the message is empty")]
    position, cleaned = 0, False
    left = _MOST_SLOW if _is_slow(rest) else math.inf  # budget of slow numbers
    while position < len(rest):
        if len(found) >= MOST_MESSAGES:
            found.append(
                DecodeFailure(f"more than {MOST_MESSAGES} messages in one frame; the rest was dropped")
            )
            break
        try:
            end = position + _end_of_value(memoryview(rest)[position:])
        except RecursionError:
            found.append(DecodeFailure.too_deep(max_depth))
            break
        except msgspec.DecodeError as error:
            # Once per frame: the constants are replaced in all of the rest, so a second try finds none.
            if not cleaned and len(rest) - position <= _MOST_LOOKED_AT:
                rest, position, cleaned = _without_constants(rest[position:]), 0, True
                continue
            # Never resumed inside a broken object: its text could contain what looks like a message.
            if rest[position] in b"{[":
                found.append(_broken(error, rest[position:]))
                break
            found.append(DecodeFailure("not JSON: expected an object that starts with {"))
            end = rest.find(b"{", position + 1)
            if end < 0:
                break
        else:
            piece = rest[position:end]
            if left < math.inf:
                left -= _slow_in(piece)
            if left < 0:
                found.append(_too_slow(piece))
                break
            found.append(_read_value(piece, max_depth))
        position = end
        while position < len(rest) and rest[position] in b" \t\r\n":
            position += 1
    return found


def _end_of_value(view: memoryview) -> int:
    """Return the end of the JSON value at the start of `view`; raises DecodeError or RecursionError."""
    try:
        _decode_raw(view)
    except msgspec.DecodeError as error:
        trailing = _TRAILING.search(str(error))
        if trailing is None:
            raise
        return int(trailing[1]) - 1
    return len(view)


def _broken(error: msgspec.DecodeError, text: bytes) -> DecodeFailure:
    if len(text) > _MOST_LOOKED_AT:
        place = _PLACE.search(str(error))
        around = text[max(0, int(place[1]) - 32) :][:64] if place else b""
        if b"NaN" in around or b"Infinity" in around:
            most = f"{_MOST_LOOKED_AT} bytes"
            return DecodeFailure(
                f"not JSON: NaN or Infinity, in more than {most} that are no list of numbers"
            )
    else:
        around = text
    if _SURROGATE.search(around):
        return DecodeFailure("not JSON: malformed, or text that is not Unicode")
    if "truncated" in str(error):
        return DecodeFailure(f"not JSON: cut short after {len(text)} bytes")
    return DecodeFailure("not JSON: an object or array is malformed")


def _without_constants(text: bytes) -> bytes:
    """Return `text` with the tokens NaN and Infinity, which Python writes, replaced by null (X16)."""
    if (b"NaN" not in text and b"Infinity" not in text) or text.count(b'"') > 2 * _MOST_TEXTS:
        return text
    parts = _STRING_APART.split(text)
    # Joined, so that three replacements serve all texts between strings. JSON has no zero bytes.
    between = b"\0".join(parts[::2])
    for constant in (b"-Infinity", b"Infinity", b"NaN"):
        between = between.replace(constant, b"null")
    apart = between.split(b"\0")
    if len(apart) == len(parts[::2]):  # else it has zero bytes of its own, which JSON has not
        parts[::2] = apart
    return b"".join(parts)


def _read_value(piece: bytes, max_depth: int) -> Members | DecodeFailure:
    if piece[:1] != b"{":
        return DecodeFailure(f"expected an object, got {_KIND.get(piece[0], 'a number')}")
    try:
        members = _decode(piece)
    except _MemberTooLarge as error:
        return _too_large(piece, error)
    except (msgspec.DecodeError, UnicodeDecodeError):
        return _unreadable(piece)
    return DecodeFailure.too_deep(max_depth, members) if deeper_than(piece, max_depth) else members


def _unreadable(piece: bytes) -> DecodeFailure:
    """Return the failure of an object with an unreadable member, with its address."""
    members, wrong = _readable(piece)
    where = f".{wrong}" if wrong else ""
    reason = f"{members.get('op', 'it')}{where}: holds a number too large, or text that is not Unicode"
    return DecodeFailure(reason, members)


def _readable(piece: bytes) -> tuple[Members, str]:
    """Return the readable members that address the response, and the name of the first unreadable member."""
    members: Members = {}
    wrong = ""
    for name, raw in _decode_no_member(piece).items():
        assert isinstance(raw, msgspec.Raw)
        # For the answer only, so what is costly to decode is left out.
        if name in UNDECODED or len(memoryview(raw)) > MOST_MEMBER or _is_slow(bytes(raw)):
            continue
        try:
            value: object = msgspec.json.decode(raw)
        except (msgspec.DecodeError, UnicodeDecodeError):
            wrong = wrong or name
            continue
        if name in _ADDRESS and isinstance(value, str | int):
            members[name] = value
    return members, wrong


def deeper_than(data: bytes, limit: int) -> bool:
    """Return True if the valid JSON `data` nests more than `limit` objects and arrays.

    Each level needs two brackets, so few brackets need no further check. Otherwise the innermost pairs are
    removed, one level per round; beyond the usual depth, levels are counted.
    """
    if not has_more_brackets(data, limit) or len(data.translate(None, _NOT_BRACKETS)) <= 2 * limit:
        return False
    brackets = _brackets(data)
    rounds = limit if len(brackets) <= _CHUNK else min(limit, _ROUNDS)
    for _ in range(rounds):
        if not brackets:
            return False
        brackets = brackets.replace(b"{}", b"")
    return bool(brackets) if rounds == limit else _depth_of(brackets) > limit - rounds


def _depth_of(brackets: bytes) -> int:
    """Return the maximum number of open braces in `brackets`."""
    import numpy as np  # slow import, rarely needed

    deepest = opened = 0
    steps = ord("{") + 1 - np.frombuffer(brackets, np.uint8).astype(np.int8)
    for start in range(0, len(steps), _CHUNK):
        heights = np.cumsum(steps[start : start + _CHUNK], dtype=np.int32)
        deepest = max(deepest, opened + int(heights.max()))
        opened += int(heights[-1])
    return deepest


def _brackets(data: bytes) -> bytes:
    """Return the brackets of `data` outside strings, all as braces.

    With only brackets and quotes kept and escapes removed, a string without brackets is a pair of adjacent
    quotes. A bracket within a string follows an odd run of quotes, so a quote remains after all pairs are
    removed. Only then are the quotes before each bracket counted.
    """
    if b"\\" in data:
        # Escaped backslashes first: in `\\"` the quote is not escaped.
        data = data.replace(b"\\\\", b"").replace(b'\\"', b"")
    kept = data.translate(_SAME_KIND, _NOT_STRUCTURE).replace(b'""', b"")
    if b'"' not in kept:
        return kept
    if len(kept) <= _CHUNK:
        return b"".join(kept.split(b'"')[::2])
    import numpy as np  # slow import, rarely needed

    each = np.frombuffer(kept, np.uint8)
    quotes = each == ord('"')
    # The count may overflow: only whether it is odd matters.
    inside = np.cumsum(quotes, dtype=np.uint8) & 1 == 1
    outside: bytes = each[~(quotes | inside)].tobytes()
    return outside
