"""One rosbridge client: its session, and its topics, services and actions."""

from __future__ import annotations

import logging
from contextlib import suppress
from typing import TYPE_CHECKING, Final, NamedTuple

from rwt.access.errors import AccessError, NotAuthenticated
from rwt.access.graph_view import STOP, canonical
from rwt.delivery.counters import UNKNOWN
from rwt.gateways.base import LARGE_BYTES, Arriving, ConnectedClient, UnreadFrame
from rwt.gateways.early_look import may_name_stop
from rwt.rosbridge.ops.actions import PeerActions
from rwt.rosbridge.ops.services import PeerServices
from rwt.rosbridge.ops.topics import PeerTopics
from rwt.rosbridge.reply import Replies
from rwt_participant.errors import RobotError
from rwt_protocol.errors import Misread, ProtocolError, Refused
from rwt_protocol.ops import OPS, Auth, Op, Status
from rwt_protocol.session import Refusal, Session
from rwt_transports.websocket.close_codes import POLICY, TOO_BIG

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rwt.access.client_graph import ClientGraph
    from rwt.access.roles import Role
    from rwt.rosbridge.bridge import Bridge
    from rwt_protocol.dispatcher import Steps
    from rwt_transports.endpoint import PeerInfo, Sink


_WITH_REPLY: Final = frozenset({"call_service", "send_action_goal"})
"""Ops with a reply of their own, which reports their success."""


class _Unfinished(NamedTuple):
    """The remaining steps of one message."""

    op: Op
    steps: Steps


_Waiting = _Unfinished | str
"""Rest of a message, or the reason to close the connection, which waits for a turn."""


class Peer(ConnectedClient[Op | Refusal, _Waiting]):
    """One rosbridge client; see :class:`~rwt.gateways.base.ConnectedClient` for its life cycle.

    Attributes by purpose:

    * Wire: ``_session`` (its wire state), ``_loading`` (holds large frames back until numpy is loaded).
    * Resources of the client, by kind of op: ``topics``, ``services``, ``actions``.
    * Dispatch: ``_dispatch`` (bound method of the bridge's dispatcher), ``_unfinished`` (op whose steps wait
      for a later turn; it is not yet reported as done).
    """

    replies: Replies
    topics: PeerTopics
    services: PeerServices
    actions: PeerActions

    def __init__(
        self, bridge: Bridge, number: int, sink: Sink, info: PeerInfo, session: Session, graph: ClientGraph
    ) -> None:
        replies = Replies(bridge, number, sink, info, session)
        super().__init__(bridge, number, info, graph, replies, session.decode)
        settings, limits = bridge.settings, bridge.access.limits
        self._bridge = bridge
        self._session = session
        self._loading = bridge.loading
        self._dispatch = bridge.dispatcher.dispatch
        self._unfinished: Op | None = None
        self.topics = PeerTopics(graph, replies, bridge.encoding_of, limits.data_bytes)
        graph.tell_notices(self._tell_notice)
        graph.tell_ended(self._tell_ended)
        self.services = PeerServices(
            graph, replies, info.address, bridge.service_offers, settings.default_call_service_timeout
        )
        self.actions = PeerActions(graph, replies, info.address, bridge.action_offers, bridge.orphans)

    def _tell_notice(self, text: str) -> None:
        self.replies.send(Status(level="warning", msg=f"gate: {text}"))

    def _tell_ended(self, kind: str, name: str, reason: str) -> None:
        """Forget what the client advertised and the robot has displaced, and say why."""
        if kind == "topic":
            self.topics.forget_publisher(name)
        elif kind == "service":
            self.services.provided.discard(name)
        else:
            self.actions.provided.discard(name)
        op = "advertise" if kind == "topic" else f"advertise_{kind}"
        self.replies.refuse(Status(level="error", msg=f"{op}: {reason}"))

    def report_connection(self, text: str, is_connected: bool) -> None:
        """Send a status: an error if the connection is lost."""
        self.replies.send(Status(level="warning" if is_connected else "error", msg=text))

    def _names_stop(self, data: bytes, binary: bool) -> bool:
        return may_name_stop(data)

    def report_problem(self, topic: str, text: str) -> None:
        """Send a status about a topic that the client uses."""
        self.topics.report_problem(topic, text)

    def _presses_stop(self, data: bytes, binary: bool) -> bool:
        members = self._session.peek(data, binary)
        if members is None:
            return False
        key = {"call_service": "service", "publish": "topic"}.get(str(members.get("op")))
        return key is not None and canonical(str(members.get(key))) == STOP

    def _read(self, data: bytes, binary: bool, now: float) -> None:
        if binary and len(data) > LARGE_BYTES:
            self._read_on(Arriving(self._read_in_steps(data)))
        else:
            super()._read(data, binary, now)

    def _read_in_steps(self, data: bytes) -> Steps:
        items = yield from self._session.decode_in_steps(data, True, self._began)
        self._run(items, self._began)

    def _run(self, messages: Sequence[Op | Refusal], now: float) -> None:
        if len(messages) != 1:
            self._run_several(messages, now)
            return
        message = messages[0]
        if isinstance(message, Refusal):
            self._reject(message)
        else:
            try:
                answer = self._dispatch(self, message)
            except Misread as misread:
                self._run(self._session.decode_again(misread, now), now)
                return
            if answer is not None or self._session.level == "info":
                self._after(message, answer)

    def _reject(self, refusal: Refusal) -> None:
        """Answer a part of a frame that is no valid message."""
        self.graph.counters.refuse(refusal.op if refusal.op in OPS else UNKNOWN)
        self.replies.log(logging.WARNING, refusal.reason, refusal.id)
        self._end_what_waits(refusal)
        if refusal.answer is not None:
            self.replies.send(refusal.answer)

    def _end_what_waits(self, refusal: Refusal) -> None:
        """End the pending request whose response is malformed."""
        # A response without a pending request is rejected in either case.
        with suppress(ProtocolError, RobotError, AccessError):
            if refusal.op == "service_response" and refusal.name:
                self.services.answer_malformed(refusal.name, refusal.id, refusal.reason)
            elif refusal.op == "action_result" and refusal.name:
                self.actions.result_malformed(refusal.name, refusal.id, refusal.reason)

    def work(self, op: Op, steps: Steps) -> Op | None:
        """Run steps of a message now, and the rest in later turns. Return the report of its refusal."""
        left = self._bridge.dispatcher.go_on(self, op, steps, self._has_time)
        if isinstance(left, Op):
            return left
        if left is not None:
            self._unfinished = op
            self._wait(_Unfinished(op, left))
        return None

    def _after(self, op: Op, answer: Op | None) -> None:
        if answer is not None:
            self.graph.counters.refuse(op.op)
            self.replies.refuse(answer)
        elif self._session.level == "info" and not (op is self._unfinished or op.op in _WITH_REPLY):
            # Success, for ops that have no reply of their own (STA-04).
            self.replies.send(Status(level="info", msg=f"{op.op}: done", id=op.id))

    def _resume(self, what: Op | Refusal | _Waiting, now: float) -> None:
        if isinstance(what, _Unfinished):
            self._unfinished = None
            answer = self.work(what.op, what.steps)
            if answer is not None or self._session.level == "info":
                self._after(what.op, answer)
        elif isinstance(what, str):
            self.replies.log(logging.WARNING, what)
            self.sink.close(TOO_BIG, what)
        else:
            self.messages += 1
            if self._is_within_rate(now):
                self._run((what,), now)

    def _is_held_up(self, what: Op | Refusal | _Waiting | UnreadFrame) -> bool:
        """True if a frame also waits for numpy."""
        return self._loading is not None and isinstance(what, UnreadFrame) and self._loading.holds_up(*what)

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        """Called for a message over the size limit, of which only the head was read.

        It is rejected if its head shows its op and its id. Otherwise the connection is closed, because the
        sender would wait forever (CFG-06).
        """
        reason = f"a message of {size} bytes: the limit is {limit} (max_message_size)"
        what = self._session.refuse_skipped(head, reason) or reason
        if self._is_held:
            self._wait(what)  # Messages before it may change the reply.
        else:
            self._resume(what, self._monotonic())

    def _releases(self) -> Steps:
        yield from self.services.provided.close()
        yield from self.actions.close()
        yield from self.topics.close()

    def authenticate(self, op: Auth) -> None:
        """Switch to the role that an `auth` op proves, or disconnect the client (AUT-03).

        Raises:
            Refused: `op` is not valid, or the server has no secret and needs no authentication (AUT-04).
        """
        rosauth = self._bridge.access.admission.rosauth
        if rosauth is None:
            raise Refused("auth: this server has no authentication; go on without", level="warning")
        try:
            role = rosauth.authenticate(op)
        except NotAuthenticated as error:
            self.sink.close(POLICY, str(error))
            raise Refused(str(error)) from None
        self.is_role_by_auth = True
        self.take_role(role)

    def take_role(self, role: Role) -> None:
        """Switch to another role; permission to publish is checked again."""
        super().take_role(role)
        self.topics.forget_publishers()

    def withdraw_refused(self) -> None:
        """Withdraw what the client's role does not allow, and end such subscriptions."""
        self.topics.end_refused()
        super().withdraw_refused()
