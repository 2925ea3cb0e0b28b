"""How one client is answered: every op that goes to it, and no sample of a topic."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from rwt.access.audit import LineRate, is_written, one_line
from rwt_protocol.ops import ActionResult, ServiceResponse, Status

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.audit import Audit
    from rwt_interfaces.payload import Payload
    from rwt_protocol.frames import Frame
    from rwt_protocol.ops import Op
    from rwt_protocol.session import Session
    from rwt_transports.endpoint import PeerInfo, Sink

_LOG_LEVELS = {
    "error": logging.WARNING,
    "warning": logging.INFO,
    "info": logging.DEBUG,
    "none": logging.DEBUG,
}


class Replies:
    """The control lane to one client, with the bound on what it is sent, and the log about it.

    Args:
        number: the client's.
        sink: its connection.
        info: what the transport knows of it.
        session: its wire state.
        most: bytes of the largest message that it is sent (`limits.outgoing_message_bytes`).
        audit: the log.
        monotonic: seconds on a clock that never goes back.
    """

    __slots__ = ("_audit", "_info", "_line_rate", "_monotonic", "_most", "_number", "session", "sink")

    def __init__(
        self,
        number: int,
        sink: Sink,
        info: PeerInfo,
        session: Session,
        most: int,
        audit: Audit,
        monotonic: Callable[[], float],
    ) -> None:
        self.sink = sink
        self.session = session
        self._number = number
        self._info = info
        self._most = most
        self._audit = audit
        self._line_rate = LineRate(per_second=1, burst=50)
        self._monotonic = monotonic

    def send(self, op: Op, fragment_size: int | None = None) -> bool:
        """Send one op, in pieces of `fragment_size` characters if that is given (FRG-20).

        A `status` goes only to clients that want to hear it (STA-02). In place of a result that is too large
        the client gets why, and of anything else that is too large a `status`.

        Returns:
            Whether it was sent as it is.
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

    def request(self, service: str, args: Payload, id: str) -> str | None:
        """Ask the client, which offers a service, to run it; returns why it cannot be asked, or None."""
        return self.send_frame(self.session.call(service, args, id), id)

    def send_frame(self, frame: Frame, id: str | int | None, fragment_size: int | None = None) -> str | None:
        """Send a frame, in pieces if `fragment_size` is given; returns why it may not be sent, or None."""
        size = frame.size
        carries = self._info.max_message_size
        if carries and size > carries and fragment_size is None:
            return (
                f"a message of {size} bytes, and {self._info.transport} carries {carries}: ask for "
                "`fragment_size`, or connect by tcp"
            )
        if size > self._most:
            return f"a message of {size} bytes, and {self._most} is the limit (limits.outgoing_message_bytes)"
        if fragment_size:
            for piece in self.session.cut(frame, fragment_size, id):
                self.sink.send(piece)
        else:
            self.sink.send(frame)
        return None

    def refuse(self, answer: Op) -> None:
        """Send what answers a refused op, and note it: what a client is not told must be found in the log."""
        if isinstance(answer, Status):
            self.log(_LOG_LEVELS[answer.level], answer.msg, answer.id)
        elif isinstance(answer, ServiceResponse | ActionResult):
            self.log(logging.INFO, str(answer.values), answer.id)
        self.send(answer)

    def log(self, level: int, text: str, id_: object = None) -> None:
        """One line in the log, with the client's number and the op's id."""
        if not is_written(level):
            return
        note = "" if id_ is None else f"[id: {one_line(str(id_))}] "
        line = self._line_rate.admit(note + one_line(text), self._monotonic())
        if line is not None:
            self._audit.write(level, "[client %d] %s", self._number, line, client=self._number, op_id=id_)

    @property
    def log_lines_left_out(self) -> int:
        """Lines about this client that its rate did not allow since the last one."""
        return self._line_rate.left_out
