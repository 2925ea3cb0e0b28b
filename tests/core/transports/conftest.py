"""Fakes of what surrounds a wire."""

from __future__ import annotations

from collections.abc import Callable
from typing import Generic, TypeVar

from rwt_transports.api import HoldableWire, WireEvents
from rwt_transports.shared_pool import Holder
from rwt_transports.websocket.wire import WebSocketWire
from rwt_transports.wires.stream import StreamWire

W = TypeVar("W", bound=WebSocketWire | StreamWire)


class Heard(Generic[W]):
    """A wire, with its messages and events.

    Args:
        skip: True to skip messages that are too large; otherwise they end the connection.
    """

    def __init__(self, make: Callable[[WireEvents], W], *, skip: bool = False) -> None:
        self.messages: list[tuple[bytes, bool]] = []
        self.answers: list[bytes] = []
        self.ends: list[tuple[int, str, bool]] = []
        self.sizes: list[int] = []
        self.heads: list[bytes] = []
        self.lates = self.turns = 0
        self.skip = skip
        self.holder = Holder(str(id(self)))
        self.wire = make(self)
        self.wire.message = lambda data, binary: self.messages.append((data, binary))

    def oversized_head(self, size: int, head: bytes) -> None:
        self.heads.append(head)

    def oversized(self, size: int) -> bool:
        self.sizes.append(size)
        return self.skip

    def pong(self, data: bytes) -> None:
        self.answer(data)

    def answer(self, data: bytes) -> None:
        self.answers.append(data)

    def read_on_later(self) -> None:
        self.lates += 1

    def read_on(self) -> None:
        """Read on in as many later turns as the wire needs."""
        while self.lates > self.turns:
            self.turns += 1
            assert isinstance(self.wire, HoldableWire)
            self.wire.go_on()

    def ended(self, code: int, reason: str, *, agreed: bool) -> None:
        self.ends.append((code, reason, agreed))

    @property
    def codes(self) -> list[int]:
        return [code for code, _, _ in self.ends]

    @property
    def texts(self) -> list[bytes]:
        """Messages without their kind."""
        return [data for data, _ in self.messages]
