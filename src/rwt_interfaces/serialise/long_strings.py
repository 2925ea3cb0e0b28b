"""Large JSON texts whose size is one long string: an image's base64, or a text. The string is proven once, in
pieces, and stays where it is; the rest is read with a short token in its place."""

from __future__ import annotations

import re
import secrets
from typing import NamedTuple

import pybase64

#: A JSON text, perhaps a view of the buffer that a whole frame was received in.
RawText = bytes | memoryview
#: The bytes of one encoded message, to be joined.
Parts = tuple[RawText, ...]

#: From this many bytes on a text is large.
LARGE = 4096
#: How far from either end of a large text its long string begins and ends at most, and within a quarter.
MARGIN = 8192
#: How much base64 is checked at a time: large allocations cost more than the check.
BASE64_PIECE = 1 << 16
#: How much text is checked at a time. Each piece is copied twice.
TEXT_PIECE = 1 << 14
#: What stands for a long string, or the beginning of it. No client can know it, nor write it by accident.
_TOKEN = pybase64.b64encode(secrets.token_bytes(48))
_SHORTEST_TOKEN = 32
#: What stands for anything else.
TOKEN = _TOKEN.decode()
#: What follows a string in JSON.
_AFTER_STRING = b":,]}"
_BACKSLASH = 0x5C
_PADDING = ord("=")
#: Bytes of the longest escape, as of a half of a pair of surrogates.
_ESCAPE = 6
_HIGH_SURROGATE = re.compile(rb"\\u[dD][89abAB][0-9a-fA-F]{2}")


class LongString(NamedTuple):
    """A large JSON text in two parts.

    Attributes:
        text: the JSON text with a token in the place of its one long string.
        token: the token's letters.
        content: what the token stands for, as it is between its quotes: proven valid.
        is_base64: whether the content is padded base64, and the token too, with the same padding.
        escaped: whether there are escapes in the content, so that it is not the string's UTF-8.
        begin: where the content begins in the whole text.
    """

    text: bytes
    token: bytes
    content: RawText
    is_base64: bool
    escaped: bool
    begin: int

    def moved(self, raw: bytes) -> LongString:
        """The same two parts of a copy of the text."""
        end = self.begin + len(self.content)
        return self._replace(content=memoryview(raw)[self.begin : end])


def token_for_text(length: int) -> bytes:
    """Letters to stand for a string of `length` bytes that is not base64; they are not either.

    Both lengths are the same modulo 8: what follows them in CDR is aligned alike.
    """
    return b"-" + _TOKEN[1 : _SHORTEST_TOKEN + length % 32]


def token_for_base64(length: int, padding: int) -> bytes:
    """Base64 to stand for `length` letters of it that end with `padding` equals signs.

    Both lengths are the same modulo 8, and so are those of the octets: what follows them in CDR is aligned
    alike.
    """
    token = _TOKEN[: _SHORTEST_TOKEN + length % 32]
    return token[: -padding - 1] + b"A==="[: padding + 1] if padding else token


def cut_long_string(raw: RawText, octets: bool, texts: bool) -> LongString | None:
    """The text apart from its one long string, or None if it has none from near its start to near its end.

    Why the parts stand for the whole: what is cut is valid between two quotes and holds no quote itself. If
    the text is JSON, the first quote begins a string or ends one; it does not end one, since what follows it
    cannot follow a string. So the text is JSON if and only if it is with the token, and means the same but
    for that string. A quote after a backslash is left alone. Only where a length is checked could the token
    pass in place of the long string, so types with such fields do not come here.

    Args:
        raw: the JSON text.
        octets: look for base64.
        texts: look for any text.
    """
    margin = min(MARGIN, len(raw) // 4)
    head = bytes(raw[:margin])
    tail_start = len(raw) - margin
    begin = head.rfind(b'"') + 1
    end = tail_start + bytes(raw[tail_start:]).find(b'"')
    if begin < 2 or end < tail_start or head[begin - 2] == _BACKSLASH:
        return None
    if head[begin:].lstrip(b" \t\r\n")[:1] in _AFTER_STRING:
        return None
    content = memoryview(raw)[begin:end]
    is_base64 = octets and _is_base64(content)
    escaped = False if is_base64 else _has_escapes(content) if texts else None
    if escaped is None:
        return None
    if is_base64:
        token = token_for_base64(end - begin, bytes(content[-2:]).count(b"="))
    else:
        token = token_for_text(end - begin)
    return LongString(b"".join((head[:begin], token, raw[end:])), token, content, is_base64, escaped, begin)


def _is_base64(content: memoryview) -> bool:
    """Whether the bytes are padded base64 without white space."""
    try:
        for start in range(0, len(content), BASE64_PIECE):
            piece = content[start : start + BASE64_PIECE]
            pybase64.b64decode(piece, validate=True)
            if piece[-1] == _PADDING and start + BASE64_PIECE < len(content):
                return False
    except ValueError:
        return False
    return True


def _has_escapes(content: memoryview) -> bool | None:
    """Whether there are escapes in what is valid between two quotes; None if it is not valid, or if pieces do
    not show whether it is."""
    # Imported here because only large texts need it.
    from pydantic_core import from_json

    escaped = False
    start = 0
    try:
        while start < len(content):
            piece = _whole_letters(bytes(content[start : start + TEXT_PIECE]))
            from_json(b'"%b"' % piece)
            escaped = escaped or b"\\" in piece
            start += len(piece)
    except ValueError:
        return None
    return escaped


def _whole_letters(piece: bytes) -> bytes:
    """The piece without what may be the first half of an escape, a letter or a pair of surrogates at its end;
    where that leaves nothing, the piece."""
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
    """Plain objects, parsed from a text with a token in it, with what the token stands for."""
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


def string_of(content: RawText) -> str:
    """What the content of a proven string stands for."""
    # Imported here because only large texts need it.
    from pydantic_core import from_json

    text: str = from_json(b"".join((b'"', content, b'"')))
    return text
