"""Large JSON texts that are mostly one long string, such as an image's base64.

The string is validated once, in pieces, and stays in place; the rest is parsed with a short token instead.
"""

from __future__ import annotations

import re
import secrets
from collections.abc import Callable
from functools import cache
from typing import NamedTuple

import msgspec
import pybase64

from rwt_interfaces.steps import Steps

#: JSON text, possibly a view of the receive buffer.
RawText = bytes | memoryview
#: Bytes of an encoded message, in parts.
Parts = tuple[RawText, ...]

#: Minimum bytes of a separate part; shorter ones are joined.
LONG_PART_BYTES = 1 << 18
#: Maximum distance in bytes of the long string from either end of the text, and at most a quarter of it.
MARGIN_BYTES = 8192
#: Bytes of base64 that are checked at a time: large allocations cost more than the check.
BASE64_PIECE_BYTES = 1 << 16
#: Bytes of text that are checked at a time, as a quoted piece.
TEXT_PIECE_BYTES = 1 << 16
#: Token for a long string, or its beginning. Random, so that clients can neither know nor guess it.
_TOKEN = pybase64.b64encode(secrets.token_bytes(48))
_SHORTEST_TOKEN = 32
#: Token for other content.
TOKEN = _TOKEN.decode()
#: Maximum bytes of an object that is checked in place: 0.1 ms of ASCII, 3 ms of what only begins so.
AT_ONCE_BYTES = 1 << 20
_SAMPLE_BYTES = 4096
_PADDING = ord("=")
_QUOTE = ord('"')
_BACKSLASH = ord("\\")
_decode = msgspec.json.Decoder(str).decode
#: Bytes of the longest escape, half a surrogate pair.
_ESCAPE = 6
#: Offset within which the long string of most texts begins.
_NEAR = 512
#: Up to the quote that begins the first string without an end. Each turn of the outer loop is atomic: Python
#: before 3.11.5 does not go back from one that fails halfway.
_HEAD = re.compile(rb'(?>[^"]*+"[^"\\]*+(?:\\.[^"\\]*+)*+")*+[^"]*+"', re.DOTALL)
_HIGH_SURROGATE = re.compile(rb"\\u[dD][89abAB][0-9a-fA-F]{2}")


class JoinedParts:
    """List of parts that joins adjacent short ones."""

    def __init__(self) -> None:
        self._parts: list[RawText] = []
        self._short: list[RawText] = []
        self._size = 0

    def append(self, part: RawText) -> None:
        """Add a part."""
        if len(part) >= LONG_PART_BYTES:
            self._join()
            self._parts.append(part)
            return
        self._short.append(part)
        self._size += len(part)
        if self._size >= LONG_PART_BYTES:
            self._join()

    def _join(self) -> None:
        if self._short:
            self._parts.append(b"".join(self._short))
            self._short, self._size = [], 0

    def all(self) -> Parts:
        """Return the parts."""
        self._join()
        return tuple(self._parts)


class CutText(NamedTuple):
    """Large JSON text in two parts.

    Attributes:
        raw: the whole JSON text.
        short: the JSON text with a token in place of its long string.
        token: letters of the token.
        content: validated content of the string, as between its quotes.
        is_base64: True if content and token are base64, with the same padding.
        unescaped: decoded content in pieces, if it has escapes; empty if it is the string's UTF-8.
        begin: offset of the content in the whole text.
    """

    raw: RawText
    short: bytes
    token: bytes
    content: RawText
    is_base64: bool
    unescaped: tuple[str, ...]
    begin: int

    def moved(self, raw: bytes) -> CutText:
        """Return the same parts for a copy of the text."""
        end = self.begin + len(self.content)
        return self._replace(raw=raw, content=memoryview(raw)[self.begin : end])


def token_for_text(length: int) -> bytes:
    """Return a token for a string of `length` bytes that is not base64, and that is not base64 itself.

    Both lengths are equal modulo 8, to keep CDR's alignment.
    """
    return b"-" + _TOKEN[1 : _SHORTEST_TOKEN + length % 32]


def token_for_base64(length: int, padding: int) -> bytes:
    """Return a base64 token for `length` letters with `padding` equals signs.

    The lengths of letters and octets are equal modulo 8, to keep CDR's alignment.
    """
    token = _TOKEN[: _SHORTEST_TOKEN + length % 32]
    return token[: -padding - 1] + b"A==="[: padding + 1] if padding else token


def cut_long_string(raw: RawText, octets: bool, texts: bool) -> Steps[CutText | None]:
    """Return the text with its long string cut out; None if it has none from near its start to near its end.

    Proof: if the text is JSON, the first quote begins a string, since all earlier strings have ended. The cut
    content is valid in a string, so the second quote ends it. So the text is JSON if and only if it is with
    the token, and means the same but for that string. Only a length check could confuse the two, so types
    with such fields are excluded.
    """
    margin = min(MARGIN_BYTES, len(raw) // 4)
    begin = _begin(bytes(raw[:margin]))
    end = _first_quote(bytes(raw[-margin:]), len(raw) - margin)
    if not 0 < begin <= end:
        return None
    content = memoryview(raw)[begin:end]
    is_base64 = octets and _is_base64(content)
    unescaped: tuple[str, ...] | None = () if is_base64 else None
    if texts and not is_base64:
        unescaped = () if _is_plain(content) else (yield from _unescaped(content))
    if unescaped is None:
        return None
    if is_base64:
        token = token_for_base64(end - begin, bytes(content[-2:]).count(b"="))
    else:
        token = token_for_text(end - begin)
    short = b"".join((raw[:begin], token, raw[end:]))
    return CutText(raw, short, token, content, is_base64, unescaped, begin)


def _begin(head: bytes) -> int:
    """Return the offset of the first string without an end in the text's head; 0 if there is none.

    A quote is searched for first, because the regular expression takes five nanoseconds per byte.
    """
    found = _HEAD.match(head, 0, _NEAR)
    if found is None or b'"' in head[found.end() :]:
        found = _HEAD.match(head)
    return 0 if found is None else found.end()


def _first_quote(tail: bytes, offset: int) -> int:
    """Return the offset of the first unescaped quote of the text's tail; -1 if there is none."""
    place = tail.find(b'"')
    while place >= 0 and (place - len(tail[:place].rstrip(b"\\"))) % 2:
        place = tail.find(b'"', place + 1)
    return place if place < 0 else offset + place


def _is_base64(content: memoryview) -> bool:
    """Return True if the bytes are padded base64 without white space."""
    try:
        for start in range(0, len(content), BASE64_PIECE_BYTES):
            piece = content[start : start + BASE64_PIECE_BYTES]
            pybase64.b64decode(piece, validate=True)
            if piece[-1] == _PADDING and start + BASE64_PIECE_BYTES < len(content):
                return False
    except ValueError:
        return False
    return True


def _is_plain(content: memoryview) -> bool:
    """Return True if most of a JSON object's text is this quoted string, in ASCII and without escapes.

    Quotes at both ends of the content are the nearest ones to the middle of the object, and belong to one
    string. A check of the whole object in place takes three quarters of the time of checking pieces.
    """
    whole = content.obj
    if not isinstance(whole, bytes) or not len(whole) <= min(2 * len(content), AT_ONCE_BYTES):
        return False
    begin, end = whole.rfind(b'"', 0, len(whole) // 2) + 1, whole.find(b'"', len(whole) // 2)
    if end - begin != len(content) or whole.find(b"\\", begin, end) >= 0:
        return False
    # Other text takes longer than its pieces.
    if not whole[begin : begin + _SAMPLE_BYTES].isascii():
        return False
    try:
        _json_validator()(whole)
    except ValueError:
        return False
    return True


@cache
def _json_validator() -> Callable[[bytes], object]:
    """Return a check that bytes are a JSON object, which makes no objects."""
    # Imported here because only large texts need it.
    from pydantic_core import SchemaValidator, core_schema

    return SchemaValidator(core_schema.typed_dict_schema({}, extra_behavior="ignore")).validate_json


def _unescaped(content: memoryview) -> Steps[tuple[str, ...] | None]:
    """Return quoted text without escapes, in pieces; None if it is invalid or pieces cannot tell."""
    # Imported here because only large texts need it.
    from pydantic_core import from_json

    pieces: list[str] = []
    start = 0
    quoted = bytearray(min(TEXT_PIECE_BYTES, len(content)) + 2)
    quoted[0] = quoted[-1] = _QUOTE
    between = memoryview(quoted)[1:-1]
    try:
        while start < len(content):
            stop = start + len(between)
            if stop <= len(content):
                between[:] = content[start:stop]
                if not pieces and quoted[-2] < 0x80 and _BACKSLASH not in quoted:
                    from_json(quoted)
                    start = stop
                    continue
            piece = bytes(content[start:stop])
            if stop > len(content) and not pieces and b"\\" not in piece:
                from_json(b'"%b"' % piece)
                break
            piece = _whole_letters(piece)
            # Faster if there are escapes.
            text = _decode(b'"%b"' % piece)
            if pieces:
                pieces.append(text)
            elif b"\\" in piece:
                # Preceding text has no escapes, so it is the string's UTF-8.
                pieces = [str(content[:start], "utf-8"), text]
            start += len(piece)
            yield
    except ValueError:
        return None
    return tuple(pieces)


def _whole_letters(piece: bytes) -> bytes:
    """Return the piece without a partial escape, letter or surrogate pair at its end; never empty."""
    end = len(piece)
    while end > len(piece) - 4 and piece[end - 1 : end] >= b"\x80":
        end -= 1
        if piece[end] >= 0xC0:
            break
    escape = piece.rfind(b"\\", max(end - _ESCAPE, 0), end)
    if escape >= 0:
        end = len(piece[: escape + 1].rstrip(b"\\"))
        if _HIGH_SURROGATE.fullmatch(piece, max(end - _ESCAPE, 0), end):
            end -= _ESCAPE
    return piece[:end] if end > 0 else piece


def substituted(value: object, token: str, text: str) -> object:
    """Return plain objects with the token replaced by its content."""
    match value:
        case str():
            return text if value == token else value
        case dict():
            return {
                substituted(key, token, text): substituted(each, token, text) for key, each in value.items()
            }
        case list():
            return [substituted(each, token, text) for each in value]
        case _:
            return value


def string_of(content: RawText, unescaped: tuple[str, ...]) -> str:
    """Return the string of a validated content."""
    return "".join(unescaped) if unescaped else str(content, "utf-8")
