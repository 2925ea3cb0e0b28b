"""Replies to one client: every op sent to it, besides samples."""

from __future__ import annotations

import logging
from typing import Any

from rwt.gateways.base import ConnectionGateway, ReplySender
from rwt_protocol.frames import Frame
from rwt_protocol.ops import ActionResult, Op, ServiceResponse, Status
from rwt_protocol.session import Session
from rwt_transports.endpoint import PeerInfo, Sink

_LOG_LEVELS = {
    "error": logging.WARNING,
    "warning": logging.INFO,
    "info": logging.DEBUG,
    "none": logging.DEBUG,
}


class Replies(ReplySender):
    """Sender of all messages except samples to one rosbridge client."""

    __slots__ = ("_info", "session")

    def __init__(
        self, bridge: ConnectionGateway[Any], number: int, sink: Sink, info: PeerInfo, session: Session
    ) -> None:
        super().__init__(bridge, number, sink)
        self.session = session
        self._info = info

    def send(self, op: Op, fragment_size: int | None = None) -> bool:
        """Send one op, in fragments of `fragment_size` characters if given (FRG-20).

        A `status` is only sent to clients that ask for its level (STA-02). If the op is too large, the client
        gets the reason instead: as a failed result, or as a `status`.

        Returns:
            True if the op itself was sent.
        """
        frame = self.session.answer(op)
        if frame is None:
            return False
        reason = self.send_frame(frame, op.id, fragment_size)
        if reason is None:
            return True
        self.log(logging.WARNING, f"{op.op}: {reason}", op.id)
        if isinstance(op, ServiceResponse | ActionResult):
            self.send(op.model_copy(update={"values": reason, "result": False}))
        else:
            self.send(Status(level="error", msg=f"{op.op}: {reason}", id=op.id))
        return False

    def send_frame(self, frame: Frame, id: str | int | None, fragment_size: int | None = None) -> str | None:
        """Send a frame, in fragments if `fragment_size` is given. Returns None, or why it was not sent."""
        size = frame.size
        carries = self._info.max_message_size
        if carries and size > carries and fragment_size is None:
            return (
                f"a message of {size} bytes, and {self._info.transport} carries {carries}: ask for "
                "`fragment_size`, or connect by tcp"
            )
        if size > self.max_bytes:
            return self.too_large(size)
        if fragment_size:
            for piece in self.session.cut(frame, fragment_size, id):
                self.sink.send(piece)
        else:
            self.sink.send(frame)
        return None

    def refuse(self, answer: Op) -> None:
        """Send the reply to a rejected op, and log it: the client may not have asked for its `status`."""
        if isinstance(answer, Status):
            self.log(_LOG_LEVELS[answer.level], answer.msg, answer.id)
        elif isinstance(answer, ServiceResponse | ActionResult):
            self.log(logging.INFO, str(answer.values), answer.id)
        self.send(answer)
