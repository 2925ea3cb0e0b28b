"""How deeply JSON text is nested, found without a parse."""

from __future__ import annotations

import re
from typing import Final

_SAME_KIND: Final = bytes.maketrans(b"[]", b"{}")
_NOT_STRUCTURE: Final = bytes(byte for byte in range(256) if byte not in b'{}[]"\\')
_NOT_BRACKETS: Final = bytes(byte for byte in range(256) if byte not in b"{}[]")
_STRING: Final = re.compile(rb'"(?:[^"\\]|\\.)*+"', re.DOTALL)


def deeper_than(data: bytes, limit: int) -> bool:
    """Whether more than `limit` objects and arrays of `data`, which is valid JSON, are open at once.

    Every level costs two brackets, so for a text with few brackets it is enough to count them. Otherwise the
    innermost pairs are removed, all at once, as often as the limit allows: each round is one level.
    """
    if len(data) <= 2 * limit or len(data.translate(None, _NOT_BRACKETS)) <= 2 * limit:
        return False
    brackets = _brackets(data)
    for _ in range(limit):
        if not brackets:
            return False
        brackets = brackets.replace(b"{}", b"")
    return bool(brackets)


def _brackets(data: bytes) -> bytes:
    """The brackets of `data` that are not inside a string, all written as braces.

    With only brackets and quotes kept, and no backslash among them, a string without brackets is an adjacent
    pair of quotes. If a bracket stands inside a string, the run of quotes before it is odd, and a quote is
    left over when all pairs are gone; only then are the strings looked for one by one.
    """
    kept = data.translate(_SAME_KIND, _NOT_STRUCTURE)
    if b"\\" not in kept:
        kept = kept.replace(b'""', b"")
        if b'"' not in kept:
            return kept
    return _STRING.sub(b"", data).translate(_SAME_KIND, _NOT_BRACKETS)
