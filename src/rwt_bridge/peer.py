"""What one client owns: its session, its subscriptions, publishers, services, actions, calls and goals."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING

from rwt_access.audit import is_written, one_line, write
from rwt_access.log_rate import LogRate
from rwt_access.quotas import message_rate, too_large
from rwt_bridge.ops.topics import release_publishers
from rwt_delivery.counters import UNKNOWN
from rwt_protocol.ops import OPS, ActionResult, CallService, SendActionGoal, ServiceResponse, Status
from rwt_protocol.session import Refusal
from rwt_transports.websocket.close_codes import POLICY

if TYPE_CHECKING:
    from rwt_access.roles import Role
    from rwt_bridge.bridge import Bridge
    from rwt_bridge.ops.actions import ProvidedAction, SentGoal
    from rwt_bridge.ops.services import ClientCall, ProvidedService
    from rwt_bridge.ops.subscriptions import ClientSubscription
    from rwt_delivery.shared_publishers import Publication
    from rwt_protocol.ops import Op
    from rwt_protocol.session import Session
    from rwt_protocol.transport import Frame, PeerInfo, Sink

_LOG_LEVELS = {
    "error": logging.WARNING,
    "warning": logging.INFO,
    "info": logging.DEBUG,
    "none": logging.DEBUG,
}


class Peer:
    """One client. A new connection is a new, empty peer (DIS-06).

    Attributes:
        messages: how many have come from it.
    """

    def __init__(
        self, bridge: Bridge, number: int, sink: Sink, info: PeerInfo, session: Session, role: Role
    ) -> None:
        self.bridge = bridge
        self.number = number
        self.sink = sink
        self.info = info
        self.session = session
        self.role = role
        self.messages = 0
        self._monotonic = bridge.graph.clock.monotonic
        self._dispatch = bridge.dispatcher.dispatch
        self._rate = message_rate(bridge.limits)
        self._log_rate = LogRate(per_second=1, burst=50)
        self.advertised: dict[str, set[str | int | None]] = {}
        self.implicit: set[str] = set()
        self.publishers: dict[str, Publication] = {}
        self.subscriptions: dict[str, ClientSubscription] = {}
        self.services: dict[str, ProvidedService] = {}
        self.actions: dict[str, ProvidedAction] = {}
        self.calls: set[ClientCall] = set()
        self.goals: set[SentGoal] = set()

    def receive(self, data: bytes, binary: bool) -> None:
        """Take one message from the wire, run what it holds, and answer what is refused."""
        self.messages += 1
        now = self._monotonic()
        if self._rate is not None and not self._rate.take(now):
            self._flooded()
            return
        for item in self.session.decode(data, binary, now):
            if isinstance(item, Refusal):
                self.bridge.ledger.refuse(item.op if item.op in OPS else UNKNOWN)
                self.log(logging.WARNING, item.reason, item.id)
                answer = item.answer
            else:
                answer = self._dispatch(self, item)
                if answer is not None:
                    self.bridge.ledger.refuse(item.op)
                    self._log_answer(answer)
                elif self.session.level == "info":
                    answer = self._done(item)
            if answer is not None:
                self._answer(answer)

    def _done(self, op: Op) -> Op | None:
        """The `status` that tells of success, for ops that have no reply of their own (STA-04)."""
        if isinstance(op, CallService | SendActionGoal):
            return None
        return Status(level="info", msg=f"{op.op}: done", id=op.id)

    def oversized(self, size: int, limit: int) -> None:
        """A message was too large to be taken from the wire; its bytes were skipped."""
        reason = f"a message of {size} bytes was skipped: max_message_size is {limit}"
        self.log(logging.WARNING, reason)
        self._answer(Status(level="error", msg=reason))

    def _flooded(self) -> None:
        """Too many messages: the client has to go, since reading on would serve it before all others."""
        rate = self.bridge.limits.messages_per_second
        reason = f"more than {rate} messages a second (limits.messages_per_second)"
        self.log(logging.WARNING, reason)
        self.sink.close(POLICY, reason)

    def closed(self, code: int, reason: str) -> None:
        """The connection has ended: give back everything (DIS-01 … DIS-07)."""
        for subscription in self.subscriptions.values():
            subscription.close()
        release_publishers(self)
        for service in self.services.values():
            service.close()
        for action in self.actions.values():
            action.close()
        for call in self.calls:
            if call.pending is not None:
                call.pending.cancel()
        self.bridge.left(self)
        if self._log_rate.left_out:
            reason += f" ({self._log_rate.left_out} lines about it were left out)"
        write(logging.INFO, "client %d left: %d %s", self.number, code, reason, client=self.number)

    def send(self, op: Op) -> None:
        """Send one op in the control lane; one that is too large is left out, and the client told so."""
        self.send_if_small(op)

    def send_if_small(self, op: Op, fragment_size: int | None = None) -> bool:
        """As :meth:`send`, in pieces of `fragment_size` characters if that is given; whether it was sent.

        The client is told so: of a result in its place, of anything else by a `status`.
        """
        frame = self.session.encode(op)
        reason = too_large(self, frame, in_pieces=fragment_size is not None)
        if reason is None:
            self.send_cut(frame, fragment_size, op.id)
            return True
        self.log(logging.WARNING, f"{op.op}: {reason}", op.id)
        if isinstance(op, ActionResult):
            self._answer(op.model_copy(update={"values": reason, "result": False}))
        else:
            self._answer(Status(level="error", msg=f"{op.op}: {reason}", id=op.id))
        return False

    def send_cut(self, frame: Frame, size: int | None, id_: str | int | None) -> None:
        """Send a reply in the control lane, in pieces of `size` characters if that was asked for (FRG-20)."""
        for piece in self.session.cut(frame, size, id_):
            self.sink.send(piece)

    def warning(self, text: str) -> Frame | None:
        """A `status` about something that no op caused; None if this client does not want to hear it."""
        return self.session.answer(Status(level="warning", msg=text))

    def warn(self, text: str, id_: str | int | None) -> None:
        """Tell the client of something that was done, though not quite as it may expect (STA-04)."""
        self._answer(Status(level="warning", msg=text, id=id_))

    def take_role(self, role: Role) -> None:
        """Act as another role from now on; what is open stays open, and publishing is asked anew."""
        self.role = role
        self.publishers.clear()

    def forget_publisher(self, topic: str) -> None:
        """Look the topic's publisher up again at the next publish."""
        self.publishers = {name: held for name, held in self.publishers.items() if held.topic != topic}

    def log(self, level: int, text: str, id_: object = None) -> None:
        """One line in the log, with the client's number and the op's id."""
        if not is_written(level):
            return
        note = "" if id_ is None else f"[id: {one_line(str(id_))}] "
        line = self._log_rate.admit(note + one_line(text), self._monotonic())
        if line is not None:
            write(level, "[client %d] %s", self.number, line, client=self.number, op_id=id_)

    def _answer(self, op: Op) -> None:
        """Send what answers a refused op; a `status` only if this client wants to hear it."""
        frame = self.session.answer(op)
        if frame is not None:
            self.sink.send(frame)

    def _log_answer(self, op: Op) -> None:
        """Note a refusal: what a client is not told must be found in the log."""
        if isinstance(op, Status):
            self.log(_LOG_LEVELS[op.level], op.msg, op.id)
        elif isinstance(op, ServiceResponse | ActionResult):
            self.log(logging.INFO, str(op.values), op.id)
