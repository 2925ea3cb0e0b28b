"""Bytes that one case sends, and the expected response."""

from __future__ import annotations

from dataclasses import dataclass, field

from tests.core.transports.rfc6455.frames import FIN, TEXT, ReadFrame

SMALL = 2_000
"""Cases up to this size are sent byte by byte, too."""


@dataclass(frozen=True, slots=True)
class Case:
    """One exchange after the handshake. The endpoint under test sends every message back.

    Attributes:
        name: what is special about it.
        sent: raw bytes of the client.
        answers: the frames that must come back, in order; the whole of it, but for `fails`.
        fails: the code with which the server must end the connection, after `answers`; None: it does not.
        closes: the last of `answers` is the reply to the client's close, and the server ends the connection.
        site: which listener, see :mod:`tests.core.transports.rfc6455.sites`.
    """

    name: str
    sent: bytes
    answers: tuple[ReadFrame, ...] = ()
    fails: int | None = None
    closes: bool = False
    site: str = "default"

    @property
    def cuts(self) -> tuple[int, ...]:
        """Sizes of pieces in which it is sent, beside the whole."""
        return (1, 7, 997) if len(self.sent) <= SMALL else (997, 65_536)

    @property
    def lives(self) -> bool:
        """True if the connection is still good afterwards."""
        return self.fails is None and not self.closes


@dataclass(frozen=True, slots=True)
class Chapter:
    """Cases about one thing.

    Attributes:
        title: what it is.
        sections: of RFC 6455.
        covers: what the cases do, for the table in the documentation.
    """

    title: str
    sections: str
    covers: str
    cases: tuple[Case, ...] = field(repr=False)


def echo(payload: bytes | str, opcode: int = TEXT) -> ReadFrame:
    """The frame that answers a message."""
    return FIN | opcode, payload.encode() if isinstance(payload, str) else payload
