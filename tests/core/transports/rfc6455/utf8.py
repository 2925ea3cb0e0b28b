"""Text and UTF-8 (RFC 6455 sections 5.6 and 8.1), with and without ``strict_utf8``."""

from __future__ import annotations

from tests.core.transports.rfc6455.case import Case, Chapter, echo
from tests.core.transports.rfc6455.frames import BINARY, CONTINUATION, PING, TEXT, fragments, frame, text

GREEK = "Hello-µ@ßöäüàá-UTF-8!! κόσμε".encode()

VALID = {
    "Greek": "κόσμε".encode(),
    "the first of one byte": b"\x00",
    "the first of two bytes": "\u0080".encode(),
    "the first of three bytes": "\u0800".encode(),
    "the first of four bytes": "\U00010000".encode(),
    "the last of one byte": b"\x7f",
    "the last of two bytes": "\u07ff".encode(),
    "the last of three bytes": "\uffff".encode(),
    "the last of four bytes": "\U0010ffff".encode(),
    "below the surrogates": "\ud7ff".encode(),
    "above the surrogates": "\ue000".encode(),
    "the replacement character": "\ufffd".encode(),
    "non-characters": "\ufffe\uffff\U0001fffe\U0010fffe".encode(),
    "emoji": "🤖🦾".encode(),
}

INVALID = {
    "a continuation byte alone": b"\x80",
    "seven continuation bytes": b"\x80\xbf\x80\xbf\x80\xbf\x80",
    "all continuation bytes": bytes(range(0x80, 0xC0)),
    "starts of two, each with a space": b"".join(bytes((byte, 0x20)) for byte in range(0xC0, 0xE0)),
    "starts of three, each with a space": b"".join(bytes((byte, 0x20)) for byte in range(0xE0, 0xF0)),
    "starts of four, each with a space": b"".join(bytes((byte, 0x20)) for byte in range(0xF0, 0xF8)),
    "two bytes without the last": b"\xc3",
    "three bytes without the last": b"\xe2\x82",
    "four bytes without the last": b"\xf0\x9f\xa4",
    "a cut character in the middle": b"a\xe2\x82b",
    "0xfe": b"\xfe",
    "0xff": b"\xff",
    "five bytes": b"\xf8\x88\x80\x80\x80",
    "six bytes": b"\xfc\x84\x80\x80\x80\x80",
    "overlong /": b"\xc0\xaf",
    "overlong / in three": b"\xe0\x80\xaf",
    "overlong / in four": b"\xf0\x80\x80\xaf",
    "overlong 0": b"\xc0\x80",
    "the largest overlong of two": b"\xc1\xbf",
    "the largest overlong of three": b"\xe0\x9f\xbf",
    "the largest overlong of four": b"\xf0\x8f\xbf\xbf",
    "beyond U+10FFFF": b"\xf4\x90\x80\x80",
    "the first high surrogate": b"\xed\xa0\x80",
    "the last high surrogate": b"\xed\xaf\xbf",
    "the first low surrogate": b"\xed\xb0\x80",
    "a pair of surrogates": b"\xed\xa0\xbd\xed\xb8\x80",
}


def _valid() -> tuple[Case, ...]:
    cases = [
        Case(f"{name}, {site}", text(data), (echo(data),), site=site)
        for name, data in VALID.items()
        for site in ("strict", "default")
    ]
    cases += [
        Case(f"{name}, a fragment for each byte", fragments(TEXT, *(bytes((byte,)) for byte in data)),
             (echo(data),), site="strict")
        for name, data in VALID.items() if len(data) > 1
    ]  # fmt: skip
    cases.append(
        Case("a character split by a ping",
             frame(TEXT, GREEK[:7], fin=False) + frame(PING) + frame(CONTINUATION, GREEK[7:]),
             ((0x8A, b""), echo(GREEK)), site="strict")
    )  # fmt: skip
    cases.append(Case("bytes are not text", frame(BINARY, b"\xff\xfe"), (echo(b"\xff\xfe", BINARY),),
                      site="strict"))  # fmt: skip
    return tuple(cases)


def _refused() -> tuple[Case, ...]:
    whole = [
        Case(name, text("before") + text(data) + text("after"), (echo("before"),), fails=1007, site="strict")
        for name, data in INVALID.items()
    ]
    split = [
        Case(f"{name}, a fragment for each byte", fragments(TEXT, *(bytes((byte,)) for byte in data)),
             fails=1007, site="strict")
        for name, data in INVALID.items()
    ]  # fmt: skip
    late = [
        Case(f"{name}, after 1,000 good bytes in another fragment", fragments(TEXT, b"x" * 1000, data),
             fails=1007, site="strict")
        for name, data in INVALID.items()
    ]  # fmt: skip
    return (*whole, *split, *late)


def _handed_over() -> tuple[Case, ...]:
    whole = [Case(name, text(data) + text("after"), (echo(data), echo("after")))
             for name, data in INVALID.items()]  # fmt: skip
    split = [
        Case(f"{name}, a fragment for each byte", fragments(TEXT, *(bytes((byte,)) for byte in data)),
             (echo(data),))
        for name, data in INVALID.items()
    ]  # fmt: skip
    return (*whole, *split)


CHAPTERS = (
    Chapter("UTF-8 that is valid", "5.6, 8.1", "boundaries of each length, split inside characters",
            _valid()),
    Chapter("UTF-8 that is not, with `strict_utf8`", "8.1",
            "overlong, surrogates, cut, out of range; whole and in fragments: 1007", _refused()),
    Chapter("UTF-8 that is not, by default", "(8.1)",
            "the same: the endpoint gets the bytes and answers, the connection lives", _handed_over()),
)  # fmt: skip
