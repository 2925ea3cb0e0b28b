"""Data channel as a driver's link: each open channel carries its own connection."""

from __future__ import annotations

import asyncio
from collections import deque
from typing import TYPE_CHECKING

from rwt_protocol.states import StateEnum
from rwt_transports.wires.whole_messages import BINARY, HEADER, MessageCutter
from rwt_webrtc.packets.reassembly import Truncated

if TYPE_CHECKING:
    from aiortc import RTCDataChannel

    from rwt_transports.api import DriverCallbacks
    from rwt_webrtc.upstream.association import Association


class _LinkState(StateEnum):
    OPEN = "CLOSING", "CLOSED"
    CLOSING = "CLOSING", "CLOSED"
    CLOSED = ()


class ChannelLink:
    """One data channel; satisfies :class:`rwt_transports.api.Link`.

    Life cycle::

        OPEN ── close(), finish() ──> CLOSING ── all is sent ──> CLOSED
          │                              │                         ^
          └──────────────────────────────┴── abort(), peer gone ───┘

    * **OPEN**: messages pass both ways.
    * **CLOSING**: queued messages are sent; then aiortc closes the channel.
    * **CLOSED**: the association does not know the link any more, and nothing refers to the callbacks.

    A pause holds received messages back in every state but CLOSED: they wait in ``_unread``, and reduce the
    window of the association, until they have been handed over after :meth:`resume`.

    Attributes:
        channel: aiortc's channel.
        is_fresh: True if the channel does not retransmit, or not for long.
    """

    __slots__ = (
        "_association", "_callbacks", "_cutter", "_is_paused", "_state", "_unread", "channel", "is_fresh",
    )  # fmt: skip

    def __init__(self, association: Association, channel: RTCDataChannel) -> None:
        self._association = association
        self.channel = channel
        self.is_fresh = channel.maxRetransmits is not None or channel.maxPacketLifeTime is not None
        self._state = _LinkState.OPEN
        self._callbacks: DriverCallbacks | None = None
        self._cutter: MessageCutter | None = None
        self._is_paused = False
        self._unread = deque[tuple[bytes, bool]]()
        channel.on("close", self._closed)
        association.register(self)

    # -- the association's side ----------------------------------------------------------------------------

    def message(self, data: bytes, binary: bool) -> None:
        if self._is_paused or self._unread:
            self._unread.append((data, binary))
            self._association.count_unread(len(data))
        else:
            self._hand_over(data, binary)

    def _hand_over(self, data: bytes, binary: bool) -> None:
        callbacks = self._callbacks
        if callbacks is None:
            return
        size = data.size if isinstance(data, Truncated) else len(data)
        callbacks.receive(HEADER.pack(binary, size))
        callbacks.receive(data)

    def next_message(self) -> tuple[bytes, bool] | None:
        """Return the next message to send, and True if it is binary."""
        if self._cutter is None or (message := self._cutter.next()) is None:
            return None
        return message[0], message[1] == BINARY

    def sent_all(self) -> None:
        if self._state is _LinkState.CLOSING:
            self._association.unregister(self)
            self.channel.close()

    def _closed(self) -> None:
        if self._state is _LinkState.CLOSED:
            return
        self._state = self._state.become(_LinkState.CLOSED)
        self._association.unregister(self)
        self._drop_unread()
        callbacks, self._callbacks, self._cutter = self._callbacks, None, None
        if callbacks is not None:
            callbacks.lost()

    def _drop_unread(self) -> None:
        size = sum(len(data) for data, _ in self._unread)
        self._unread.clear()
        if size:
            self._association.count_unread(-size)

    # -- Link ----------------------------------------------------------------------------------------------

    def set_callbacks(self, callbacks: DriverCallbacks) -> None:
        self._callbacks = callbacks
        self._cutter = MessageCutter(callbacks.take)

    def wake(self) -> None:
        if self._state is not _LinkState.CLOSED:
            self._association.wake(self)

    def finish(self) -> None:
        """Close: a channel has no half that could stay open."""
        self.close()

    def close(self) -> None:
        if self._state is not _LinkState.CLOSED:
            self._state = self._state.become(_LinkState.CLOSING)
            self.wake()

    def abort(self) -> None:
        if self._state is _LinkState.CLOSED:
            return
        self.channel.close()
        self._closed()

    def pause(self) -> None:
        """Hand over nothing until :meth:`resume`, and announce a smaller window to the peer."""
        self._is_paused = True

    def resume(self) -> None:
        """Hand over again what comes, after what has come meanwhile."""
        if self._is_paused:
            self._is_paused = False
            # Not within this call: an endpoint resumes while it works on what waits.
            asyncio.get_running_loop().call_soon(self._catch_up)

    def _catch_up(self) -> None:
        while self._unread and not self._is_paused:
            data, binary = self._unread.popleft()
            self._association.count_unread(-len(data))
            self._hand_over(data, binary)
