"""Closing, and messages over the limit (RFC 6455 sections 5.5.1, 7 and 10.4)."""

from __future__ import annotations

import struct

from tests.core.transports.rfc6455.case import Case, Chapter, echo
from tests.core.transports.rfc6455.frames import (
    BINARY,
    CLOSE,
    CONTINUATION,
    FIN,
    KEY,
    PING,
    TEXT,
    ReadFrame,
    close,
    close_body,
    fragments,
    frame,
    text,
)
from tests.core.transports.rfc6455.utf8 import INVALID

LIMIT = 1 << 20
"""Largest message of the listeners under test, in bytes; of `untold` it is a quarter of that."""

GOOD_CODES = (1000, 1001, 1002, 1003, 1007, 1008, 1009, 1010, 1011, 1012, 1013, 1014, 3000, 3999, 4000, 4999)
BAD_CODES = (0, 1, 999, 1004, 1005, 1006, 1015, 1016, 1100, 2000, 2999, 5000, 32768, 65535)


def _reply(code: int, reason: bytes = b"") -> ReadFrame:
    return FIN | CLOSE, close_body(code, reason)


def _good() -> tuple[Case, ...]:
    long = b"*" * 123
    return (
        Case("without a code", close(), ((FIN | CLOSE, b""),), closes=True),
        *(Case(f"code {code}", close(code), (_reply(code),), closes=True) for code in GOOD_CODES),
        Case("with a reason", close(1000, "bye, Wörld".encode()), (_reply(1000, "bye, Wörld".encode()),),
             closes=True),
        Case("with a reason of 123 bytes", close(1000, long), (_reply(1000, long),), closes=True),
        Case("twice", close(1000) + close(1001), (_reply(1000),), closes=True),
        Case("then a message", close(1000) + text("late"), (_reply(1000),), closes=True),
        Case("then nonsense", close(1000) + b"\xff" * 100, (_reply(1000),), closes=True),
        Case("after a message", text("m") + close(1000), (echo("m"), _reply(1000)), closes=True),
        Case("inside a message", frame(TEXT, b"a", fin=False) + close(1000), (_reply(1000),), closes=True),
    )  # fmt: skip


def _bad() -> tuple[Case, ...]:
    reasons = {name: data for name, data in INVALID.items() if len(data) <= 123}
    return (
        Case("one byte", frame(CLOSE, b"\x03"), fails=1002),
        Case("126 bytes", frame(CLOSE, close_body(1000, b"*" * 124)), fails=1002),
        Case("begun", frame(CLOSE, b"", fin=False), fails=1002),
        *(Case(f"code {code}", text("m") + close(code), (echo("m"),), fails=1002) for code in BAD_CODES),
        *(Case(f"reason: {name}", close(1000, data), fails=1007) for name, data in reasons.items()),
    )


def _limits() -> tuple[Case, ...]:
    small = LIMIT // 4
    told = echo(f"skipped more than {LIMIT}")
    untold = frame(BINARY, b"x" * small)
    return (
        Case("as large as allowed", frame(BINARY, bytes(LIMIT)), (echo(bytes(LIMIT), BINARY),)),
        Case("one byte more is skipped", frame(BINARY, bytes(LIMIT + 1)) + text("after"),
             (told, echo("after"))),
        Case("so it is in fragments", fragments(BINARY, bytes(LIMIT), b"x", b"", b"y") + text("after"),
             (told, echo("after"))),
        Case("a ping in what is skipped", frame(TEXT, bytes(LIMIT + 1), fin=False) + frame(PING, b"p")
             + frame(CONTINUATION, b"end"), (told, (0x8A, b"p"))),
        Case("a close in what is skipped", frame(TEXT, bytes(LIMIT + 1), fin=False) + close(1000),
             (told, _reply(1000)), closes=True),
        Case("a broken frame in what is skipped", frame(TEXT, bytes(LIMIT + 1), fin=False) + text("x"),
             (told,), fails=1002),
        Case("as large as allowed, for an endpoint that cannot be told", untold,
             (echo(b"x" * small, BINARY),), site="untold"),
        Case("one byte more ends the connection", text("a") + frame(BINARY, bytes(small + 1)), (echo("a"),),
             fails=1009, site="untold"),
        Case("so it does in fragments", fragments(BINARY, bytes(small), b"x"), fails=1009, site="untold"),
        Case("1 GiB, known from the header alone", struct.pack("!BBQ", FIN | BINARY, 0xFF, 1 << 30) + KEY,
             fails=1009, site="untold"),
    )  # fmt: skip


CHAPTERS = (
    Chapter("Closing", "5.5.1, 7.1, 7.4", "every code that may travel, reasons, what follows the close",
            _good()),
    Chapter("Closing that is wrong", "5.5.1, 7.4", "one byte, codes that may not travel, reasons not UTF-8",
            _bad()),
    Chapter("Limits", "7.4.1, 10.4", "too large a message: skipped and answered, or 1009", _limits()),
)  # fmt: skip
