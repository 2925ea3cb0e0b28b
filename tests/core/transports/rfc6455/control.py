"""Pings, pongs and fragmentation (RFC 6455 sections 5.4 and 5.5)."""

from __future__ import annotations

from tests.core.transports.rfc6455.case import Case, Chapter, echo
from tests.core.transports.rfc6455.frames import (
    BINARY,
    CLOSE,
    CONTINUATION,
    FIN,
    PING,
    PONG,
    TEXT,
    ReadFrame,
    close,
    fragments,
    frame,
    text,
)


def _pong(payload: bytes = b"") -> ReadFrame:
    return FIN | PONG, payload


FLOOD = 5_000
"""Pings in one write."""


def _pings() -> tuple[Case, ...]:
    ten = [b"payload-%d" % at for at in range(10)]
    flood = [b"%d" % at for at in range(FLOOD)]
    return (
        Case("a ping without content", frame(PING), (_pong(),)),
        Case("a ping with text", frame(PING, b"Hello, robot"), (_pong(b"Hello, robot"),)),
        Case("a ping with bytes", frame(PING, b"\x00\xff\xfe\xfd\xfc\xfb\x00\xff"),
             (_pong(b"\x00\xff\xfe\xfd\xfc\xfb\x00\xff"),)),
        Case("a ping of 125 bytes", frame(PING, b"\xfe" * 125), (_pong(b"\xfe" * 125),)),
        Case("a ping of 126 bytes", text("a") + frame(PING, b"\xfe" * 126), (echo("a"),), fails=1002),
        Case("a ping of 65,536 bytes", frame(PING, b"\xfe" * 65536), fails=1002),
        Case("a ping in two fragments", frame(PING, b"a", fin=False) + frame(CONTINUATION, b"b"), fails=1002),
        Case("a pong nobody asked for", frame(PONG)),
        Case("a pong with content nobody asked for", frame(PONG, b"unsolicited")),
        Case("a pong of 126 bytes", frame(PONG, b"x" * 126), fails=1002),
        Case("a pong that is begun", frame(PONG, b"x", fin=False), fails=1002),
        Case("a pong, then a ping", frame(PONG, b"unsolicited") + frame(PING, b"asked"), (_pong(b"asked"),)),
        Case("ten pings at once", b"".join(frame(PING, each) for each in ten), tuple(map(_pong, ten))),
        Case(f"{FLOOD:,} pings at once", b"".join(frame(PING, each) for each in flood),
             tuple(map(_pong, flood))),
        Case("pings between messages", (text("m") + frame(PING, b"p")) * 50, (echo("m"), _pong(b"p")) * 50),
        Case("a ping after the close", close(1000) + frame(PING), ((FIN | CLOSE, b"\x03\xe8"),), closes=True),
    )  # fmt: skip


def _good_fragments() -> tuple[Case, ...]:
    between = frame(TEXT, b"a", fin=False) + frame(PING, b"1") + frame(CONTINUATION, b"b", fin=False)
    return (
        Case("text in two fragments", fragments(TEXT, b"fragment1", b"fragment2"),
             (echo("fragment1fragment2"),)),
        Case("binary in three", fragments(BINARY, b"\x00", b"\xff", b"\x00"),
             (echo(b"\x00\xff\x00", BINARY),)),
        Case("every fragment empty", fragments(TEXT, b"", b"", b""), (echo(""),)),
        Case("only the middle one has content", fragments(TEXT, b"", b"middle", b""), (echo("middle"),)),
        Case("fragments around the boundaries of length", fragments(BINARY, b"a" * 126, b"b" * 65536, b"c"),
             (echo(b"a" * 126 + b"b" * 65536 + b"c", BINARY),)),
        Case("a ping between fragments", frame(TEXT, b"fragment1", fin=False) + frame(PING, b"ping")
             + frame(CONTINUATION, b"fragment2"), (_pong(b"ping"), echo("fragment1fragment2"))),
        Case("pings and pongs between many fragments", between + frame(PING, b"2") + frame(PONG, b"x")
             + frame(CONTINUATION, b"c") + frame(PING, b"3"),
             (_pong(b"1"), _pong(b"2"), echo("abc"), _pong(b"3"))),
        Case("a close between fragments", frame(TEXT, b"a", fin=False) + close(1000)
             + frame(CONTINUATION, b"b"), ((FIN | CLOSE, b"\x03\xe8"),), closes=True),
        Case("a whole message after a fragmented one", fragments(TEXT, b"a", b"b") + text("c"),
             (echo("ab"), echo("c"))),
        Case("two fragmented messages of different kinds", fragments(TEXT, b"a", b"b")
             + fragments(BINARY, b"c", b"d"), (echo("ab"), echo("cd", BINARY))),
    )  # fmt: skip


def _bad_fragments() -> tuple[Case, ...]:
    begun = frame(TEXT, b"fragment1", fin=False)
    cases = [
        Case(f"a continuation of nothing, {'last' if fin else 'not last'}, {where}",
             before + frame(CONTINUATION, b"non-continuation", fin=fin) + text("after"), answers, fails=1002)
        for fin in (True, False)
        for where, before, answers in (
            ("at the beginning", b"", ()),
            ("after a whole message", text("a"), (echo("a"),)),
            ("after a fragmented message", fragments(TEXT, b"a", b"b"), (echo("ab"),)),
            ("after a ping", frame(PING, b"p"), (_pong(b"p"),)),
        )
    ]  # fmt: skip
    cases += [
        Case(f"a new message of opcode {opcode} before the last fragment, {'whole' if fin else 'begun'}",
             begun + frame(opcode, b"fragment2", fin=fin), fails=1002)
        for opcode in (TEXT, BINARY)
        for fin in (True, False)
    ]  # fmt: skip
    return tuple(cases)


CHAPTERS = (
    Chapter("Pings and pongs", "5.5.2, 5.5.3", "0 to 126 bytes, fragmented, unasked for, 5,000 at once",
            _pings()),
    Chapter("Fragments", "5.4", "empty ones, all lengths, control frames between them", _good_fragments()),
    Chapter("Fragments that are wrong", "5.4", "a continuation of nothing, a message inside another",
            _bad_fragments()),
)  # fmt: skip
