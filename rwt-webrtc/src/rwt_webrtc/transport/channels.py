"""Data channel as a driver's link: each open channel carries its own connection."""

from __future__ import annotations

import asyncio
from typing import TYPE_CHECKING

from rwt_transports.wires.whole_messages import BINARY, HEADER, MessageCutter
from rwt_webrtc.transport.reassembly import Truncated

if TYPE_CHECKING:
    from collections import deque

    from aiortc import RTCDataChannel

    from rwt_transports.api import DriverCallbacks
    from rwt_webrtc.transport.aiortc_internals import Association


class ChannelLink:
    """One data channel; satisfies :class:`rwt_transports.api.Link` and
    :class:`rwt_webrtc.transport.aiortc_internals.ChannelReceiver`.

    Args:
        unread: where messages wait while the endpoint is held back.
    """

    __slots__ = (
        "_association", "_callbacks", "_closing", "_cutter", "_over", "_paused", "_unread", "channel",
        "is_fresh",
    )  # fmt: skip

    def __init__(
        self, association: Association, channel: RTCDataChannel, unread: deque[tuple[bytes, bool]]
    ) -> None:
        self._association = association
        self.channel = channel
        self.is_fresh = channel.maxRetransmits is not None or channel.maxPacketLifeTime is not None
        self._callbacks: DriverCallbacks | None = None
        self._cutter: MessageCutter | None = None
        self._closing = False
        self._over = False
        self._paused = False
        self._unread = unread
        channel.on("close", self._closed)
        association.register(self)

    # -- the association's side ----------------------------------------------------------------------------

    def message(self, data: bytes, binary: bool) -> None:
        if self._paused or self._unread:
            self._unread.append((data, binary))
            self._association.count_unread(len(data))
        else:
            self._hand_over(data, binary)

    def _hand_over(self, data: bytes, binary: bool) -> None:
        callbacks = self._callbacks
        if callbacks is None or self._over:
            return
        size = data.size if isinstance(data, Truncated) else len(data)
        callbacks.receive(HEADER.pack(binary, size))
        callbacks.receive(data)

    def next_message(self) -> tuple[bytes, bool] | None:
        """Return the next message to send, and True if it is binary."""
        if self._cutter is None or self._over or (message := self._cutter.next()) is None:
            return None
        return message[0], message[1] == BINARY

    def sent_all(self) -> None:
        if self._closing and not self._over:
            self._association.unregister(self)
            self.channel.close()

    def _closed(self) -> None:
        if self._over:
            return
        self._over = True
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
        if not self._over:
            self._association.wake(self)

    def finish(self) -> None:
        """Close: a channel has no half that could stay open."""
        self.close()

    def close(self) -> None:
        self._closing = True
        self.wake()

    def abort(self) -> None:
        if self._over:
            return
        self.channel.close()
        self._closed()

    def pause(self) -> None:
        """Hand over nothing until :meth:`resume`; the peer hears of a smaller window."""
        self._paused = True

    def resume(self) -> None:
        """Hand over again what comes, after what has come meanwhile."""
        if self._paused:
            self._paused = False
            # Not within this call: an endpoint resumes while it works on what waits.
            asyncio.get_running_loop().call_soon(self._catch_up)

    def _catch_up(self) -> None:
        while self._unread and not self._paused and not self._over:
            data, binary = self._unread.popleft()
            self._association.count_unread(-len(data))
            self._hand_over(data, binary)
