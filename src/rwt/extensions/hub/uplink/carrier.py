"""WebSocket that carries an uplink: greeting, pumping, and its end."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import Final

from rwt.extensions.hub.uplink.frames import BadFrame, Hello, decode_frame, encode_hello
from rwt.extensions.hub.uplink.uplink import Uplink
from rwt_protocol.frames import Frame
from rwt_protocol.states import StateEnum
from rwt_transports.api import FlowControl
from rwt_transports.endpoint import Sink
from rwt_transports.scheduler import Scheduler
from rwt_transports.websocket.close_codes import POLICY, PROTOCOL_ERROR, TRY_AGAIN_LATER

PUMP_BYTES: Final = 256 * 1024
"""Bytes of frames that are handed to the connection in one turn."""

FULL_BYTES: Final = 64 * 1024
"""Bytes that may wait in the connection before it gets more."""

GREETING_SECONDS: Final = 10.0
"""Timeout of the greeting."""


class _CarrierState(StateEnum):
    GREETING = "CARRYING", "OVER"
    CARRYING = "OVER"
    OVER = ()


class Carrier(ABC):
    """Endpoint of the WebSocket between a robot and a hub, on either side.

    Life cycle::

        GREETING ── HELLO, carry() ──> CARRYING ── closed() ──> OVER

    * **GREETING**: the other side's `HELLO` is awaited.
    * **CARRYING**: frames pass between the connection and an uplink.
    * **OVER**: the connection has ended, or is given up; the uplink is told.

    Args:
        sink: the connection.
        scheduler: scheduler of the event loop for `WRITING`.

    Attributes:
        sink: the connection.
        uplink: the carried uplink; None before the greeting.
    """

    def __init__(self, sink: Sink, scheduler: Scheduler) -> None:
        self.sink = sink
        self.uplink: Uplink | None = None
        self._state = _CarrierState.GREETING
        self._scheduler = scheduler
        self._flow_control: FlowControl | None = None
        self._is_scheduled = self._is_full = False
        self._opened: float | None = None

    def set_flow_control(self, flow_control: FlowControl) -> None:
        """Set the flow control of the connection."""
        self._flow_control = flow_control

    def receive(self, data: bytes, binary: bool) -> None:
        """Process one frame."""
        if self._state is _CarrierState.OVER:
            return
        try:
            if not binary:
                raise BadFrame("expected binary messages")
            if self.uplink is None:
                hello = decode_frame(data)
                if not isinstance(hello, Hello):
                    raise BadFrame("expected HELLO first")
                self.greeted(hello)
            else:
                self.uplink.carrier_bytes = self.sink.received
                self.uplink.receive(data, time.monotonic())
        except BadFrame as error:
            self.give_up(PROTOCOL_ERROR, str(error))

    @abstractmethod
    def greeted(self, hello: Hello) -> None:
        """Choose the uplink, and :meth:`carry` it; raises BadFrame."""

    @abstractmethod
    def gone(self, code: int, reason: str) -> None:
        """Called once, when the connection has ended and the uplink knows it."""

    def greet(self, hello: Hello) -> None:
        """Send the greeting."""
        self.sink.send(Frame(encode_hello(hello), binary=True))

    def carry(self, uplink: Uplink, received: int) -> bool:
        """Carry an uplink, of which the other side has received so many bytes.

        Returns False if it cannot have.
        """
        if not uplink.carried(received, time.monotonic()):
            return False
        self.uplink = uplink
        self._state = self._state.become(_CarrierState.CARRYING)
        self.wake()
        return True

    def wake(self) -> None:
        """Send what can be sent, in this turn or the next."""
        if self._state is _CarrierState.CARRYING and not (self._is_scheduled or self._is_full):
            self._is_scheduled = True
            self._scheduler.wait(self._pump)

    def _pump(self) -> None:
        self._is_scheduled = False
        if self.uplink is None or self._state is not _CarrierState.CARRYING:
            return
        for frame in self.uplink.take(PUMP_BYTES, time.monotonic()):
            self.sink.send(Frame(frame, binary=True))
        if self._flow_control is not None and self.sink.backlog > FULL_BYTES:
            self._is_full = True
            self._flow_control.when_empty(self._emptied)
        elif self.uplink.has_more:
            self.wake()

    def _emptied(self) -> None:
        self._is_full = False
        self.wake()

    def check(self, now: float) -> None:
        """Give up a silent connection."""
        if self._opened is None:
            self._opened = now
        if self._state is _CarrierState.GREETING and now - self._opened >= GREETING_SECONDS:
            self.give_up(POLICY, f"no HELLO within {GREETING_SECONDS:g} s")
        elif self._state is _CarrierState.CARRYING and self.uplink is not None and not self.uplink.tick(now):
            self.give_up(TRY_AGAIN_LATER, "no sign of life")

    def give_up(self, code: int, reason: str) -> None:
        """Close the connection, and expect nothing more of it."""
        if self._state is not _CarrierState.OVER:
            self.sink.close(code, reason)
            self.closed(code, reason)

    def closed(self, code: int, reason: str) -> None:
        """Called when the connection has ended."""
        if self._state is _CarrierState.OVER:
            return
        self._state = self._state.become(_CarrierState.OVER)
        uplink, self.uplink = self.uplink, None
        if uplink is not None:
            uplink.lost(time.monotonic())
        self.gone(code, reason)
