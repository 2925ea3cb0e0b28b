"""Flow of a topic to one client, which fills the client's own bytes into the shared frames."""

from __future__ import annotations

from collections.abc import Hashable, Sequence

from rwt_protocol.frames import Burst, Frame
from rwt_transports.endpoint import FeedFlow, Flow, Membership


class GapFlow:
    """Flow that fills the gaps of its frames (:class:`~rwt_protocol.frames.GapFrame`).

    Implements :class:`rwt_transports.endpoint.Flow` and :class:`rwt_transports.endpoint.FeedFlow`.

    Args:
        own: bytes that fill the gaps.
    """

    __slots__ = ("_flow", "_own", "close", "configure")

    def __init__(self, flow: Flow, own: bytes) -> None:
        self._flow = flow
        self._own = own
        self.close = flow.close
        self.configure = flow.configure

    def enter(self, key: Hashable, gap: bytes = b"") -> Membership | None:
        """See :class:`~rwt_transports.endpoint.FeedFlow`."""
        return self._flow.enter(key, gap or self._own) if isinstance(self._flow, FeedFlow) else None

    def send(self, frame: Frame) -> None:
        """See :class:`~rwt_transports.endpoint.Flow`."""
        self._flow.send(frame.filled(self._own))

    def join(self, burst: Burst) -> bool:
        """See :class:`~rwt_transports.endpoint.Flow`."""
        return self._flow.join(burst.filled(self._own))

    def send_message(self, pieces: Sequence[Frame], expires_ns: int = 0) -> None:
        """See :class:`~rwt_transports.endpoint.Flow`."""
        self._flow.send_message([piece.filled(self._own) for piece in pieces], expires_ns)
