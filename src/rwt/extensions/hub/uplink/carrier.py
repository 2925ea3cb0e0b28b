"""WebSocket that carries an uplink: greeting, pumping, and its end."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from typing import ClassVar, Final, Literal

from rwt.extensions.hub.uplink.frames import BadFrame, Hello, decode_frame, encode_hello
from rwt.extensions.hub.uplink.uplink import Uplink
from rwt_protocol.frames import Frame
from rwt_protocol.states import StateEnum
from rwt_transports.api import FlowControl
from rwt_transports.endpoint import Sink
from rwt_transports.scheduler import Scheduler
from rwt_transports.websocket.close_codes import POLICY, PROTOCOL_ERROR, TRY_AGAIN_LATER

PUMP_BYTES: Final = 256 * 1024
"""Maximum number of bytes that are handed to the connection in one turn; fewer if that takes long."""

PIECE_BYTES: Final = 8 * 1024
"""Bytes that are handed to the connection between two looks at the clock."""

READ_SECONDS: Final = 0.01
"""Time in which a connection's frames are processed in one turn; they are those of many clients."""

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

    Reading stops once the frames of one read have taken `READ_SECONDS`, until another turn of the event loop:
    a read may have tens of thousands.

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

    holds_wire: ClassVar[Literal[True]] = True

    def __init__(self, sink: Sink, scheduler: Scheduler) -> None:
        self.sink = sink
        self.uplink: Uplink | None = None
        self._state = _CarrierState.GREETING
        self._scheduler = scheduler
        self._flow_control: FlowControl | None = None
        self._is_scheduled = self._is_full = False
        self._opened: float | None = None
        self._received = -1
        self._turn_began = 0.0
        self._is_late = False

    def set_flow_control(self, flow_control: FlowControl) -> None:
        """Set the flow control of the connection."""
        self._flow_control = flow_control

    def receive(self, data: bytes, binary: bool) -> None:
        """Process one frame."""
        if self._state is _CarrierState.OVER:
            return
        if self.sink.received != self._received:  # Another read, and therefore another turn.
            self._received = self.sink.received
            self._turn_began = self._scheduler.monotonic()
        self._process(data, binary)
        used = self._scheduler.monotonic() - self._turn_began
        if used > READ_SECONDS and not self._is_late and self._flow_control is not None:
            self._is_late = True
            self._flow_control.pause()
            self._scheduler.wait(self._read_on)

    def _read_on(self) -> None:
        self._is_late = False
        self._turn_began = self._scheduler.monotonic()
        if self._flow_control is not None:
            self._flow_control.resume()

    def _process(self, data: bytes, binary: bool) -> None:
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
        self._send_for_a_turn(self.uplink)
        if self._flow_control is not None and self.sink.backlog > FULL_BYTES:
            self._is_full = True
            self._flow_control.when_empty(self._emptied)
        elif self.uplink.has_more:
            self.wake()

    def _send_for_a_turn(self, uplink: Uplink) -> None:
        until = self._scheduler.monotonic() + self._scheduler.budget.share
        for _ in range(PUMP_BYTES // PIECE_BYTES):
            frames = uplink.take(PIECE_BYTES, time.monotonic())
            for frame in frames:
                self.sink.send(Frame(frame, binary=True))
            if not frames or self._state is not _CarrierState.CARRYING or self._scheduler.monotonic() > until:
                return

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
