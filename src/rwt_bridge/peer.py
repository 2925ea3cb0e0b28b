"""One rosbridge client: its session, and what it owns."""

from __future__ import annotations

import logging
from collections import deque
from typing import TYPE_CHECKING, Final, Protocol

from rwt_access.quotas import RateLimit
from rwt_bridge.ops.actions import Actions
from rwt_bridge.ops.services import Services
from rwt_bridge.ops.topics import Topics
from rwt_bridge.reply import Replies
from rwt_delivery.counters import UNKNOWN
from rwt_protocol.ops import OPS, CallService, Op, SendActionGoal, Status
from rwt_protocol.session import Refusal
from rwt_transports.errors import Refused
from rwt_transports.websocket.close_codes import POLICY

if TYPE_CHECKING:
    from rwt_access.access import Access
    from rwt_access.client_graph import ClientGraph
    from rwt_access.credentials import Rosauth
    from rwt_access.roles import Role
    from rwt_bridge.ops.actions import OrphanedGoals
    from rwt_bridge.settings import BridgeSettings
    from rwt_protocol.codecs import Encoding
    from rwt_protocol.dispatcher import Dispatcher
    from rwt_protocol.session import Session
    from rwt_protocol.transport import PeerInfo, Sink
    from rwt_transports.api import FlowControl


SHARE: Final = 0.005
"""Seconds of one turn of the event loop that the messages of one client may take; the rest waits its turn."""


class Gateway(Protocol):
    """What the clients of one bridge share."""

    settings: BridgeSettings
    access: Access
    dispatcher: Dispatcher[Peer]
    orphans: OrphanedGoals

    def encoding_of(self, compression: str) -> Encoding:
        """How a client that asks for `compression` gets its samples."""
        ...

    def left(self, peer: Peer) -> None:
        """A client has gone."""


class Peer:
    """One client. A new connection is a new, empty peer (DIS-06).

    Attributes:
        number: counts the clients of the bridge.
        info: what the transport knows of it.
        messages: how many have come from it.
        graph: the graph as it may see it.
        replies: how it is answered.
        topics: what it publishes and subscribes to.
        services: what it calls and offers.
        actions: the goals it sends and the actions it offers.
    """

    def __init__(
        self,
        bridge: Gateway,
        number: int,
        sink: Sink,
        info: PeerInfo,
        session: Session,
        graph: ClientGraph,
        *,
        by_auth: bool = False,
    ) -> None:
        settings = bridge.settings
        limits = settings.limits
        self._bridge = bridge
        self.number = number
        self._by_auth = by_auth
        self.info = info
        self.sink = sink
        self.messages = 0
        self.graph = graph
        self._flow_control: FlowControl | None = None
        self._is_held = False
        self._over = False
        self._received = 0
        self._began = 0.0
        self._waiting: deque[Op | Refusal | tuple[bytes, bool]] = deque()
        self._session = session
        self._monotonic = graph.clock.monotonic
        self._dispatch = bridge.dispatcher.dispatch
        self._rate = (
            RateLimit(limits.messages_per_second, limits.messages_burst)
            if limits.messages_per_second
            else None
        )
        self.replies = Replies(
            number, sink, info, session, limits.outgoing_message_bytes, bridge.access.audit, self._monotonic
        )
        self.topics = Topics(graph, self.replies, bridge.encoding_of, limits.data_bytes)
        self.services = Services(graph, self.replies, settings.default_call_service_timeout)
        self.actions = Actions(graph, self.replies, info.address, bridge.orphans)

    def set_flow_control(self, flow_control: FlowControl) -> None:
        """Hold this client back by `flow_control` while its messages wait their turn."""
        self._flow_control = flow_control

    def receive(self, data: bytes, binary: bool) -> None:
        """Take one frame from the wire, run what it holds, and answer what is refused.

        Beyond the client's share of a turn of the event loop the rest waits for the next turn.
        """
        now = self._monotonic()
        received = self.sink.received
        if received != self._received:
            self._received = received
            self._began = now
        if self._waiting or now - self._began > SHARE:
            self._wait((data if type(data) is bytes else bytes(data), binary))
        else:
            self._read(data, binary, now)

    def _read(self, data: bytes, binary: bool, now: float) -> None:
        if not self._may_send(now):
            return
        items = self._session.decode(data, binary, now)
        for number, item in enumerate(items):
            if number:
                if self._monotonic() - self._began > SHARE:
                    for later in items[number:]:
                        self._wait(later)
                    return
                if not self._may_send(now):
                    return
            self._do(item)

    def _may_send(self, now: float) -> bool:
        """Count one message: each of a frame, and each frame that holds none."""
        self.messages += 1
        if self._rate is None or self._rate.take(now):
            return True
        self._rate_exceeded()
        return False

    def _do(self, item: Op | Refusal) -> None:
        """Run one message, and answer it if it is refused."""
        if isinstance(item, Refusal):
            self.graph.counters.refuse(item.op if item.op in OPS else UNKNOWN)
            self.replies.log(logging.WARNING, item.reason, item.id)
            if item.answer is not None:
                self.replies.send(item.answer)
        else:
            answer = self._dispatch(self, item)
            if answer is not None:
                self.graph.counters.refuse(item.op)
                self.replies.refuse(answer)
            elif self._session.level == "info" and not isinstance(item, CallService | SendActionGoal):
                # Success, for ops that have no reply of their own (STA-04).
                self.replies.send(Status(level="info", msg=f"{item.op}: done", id=item.id))

    def _wait(self, what: Op | Refusal | tuple[bytes, bool]) -> None:
        """Let a frame or a message wait for a later turn; meanwhile nothing is read from this client."""
        self._waiting.append(what)
        if not self._is_held:
            self._is_held = True
            if self._flow_control is not None:
                self._flow_control.pause()
            self.graph.clock.call_later(0.0, self._go_on)

    def _go_on(self) -> None:
        """Take this turn's share of what waits."""
        waiting, self._waiting = self._waiting, deque()
        self._began = self._monotonic()
        try:
            while waiting and not (self._waiting or self._over):
                what = waiting.popleft()
                if isinstance(what, tuple):
                    data, binary = what
                    self._read(data, binary, self._began)
                elif self._may_send(self._began):
                    self._do(what)
                if self._monotonic() - self._began > SHARE:
                    break
        finally:
            if not self._over:
                self._waiting += waiting
            if self._waiting:
                self.graph.clock.call_later(0.0, self._go_on)
            else:
                self._is_held = False
                if self._flow_control is not None:
                    self._flow_control.resume()

    def oversized(self, size: int, limit: int) -> None:
        """A message was too large to be taken from the wire; its bytes were skipped."""
        reason = f"a message of {size} bytes was skipped: max_message_size is {limit}"
        self.replies.log(logging.WARNING, reason)
        self.replies.send(Status(level="error", msg=reason))

    def _rate_exceeded(self) -> None:
        """Too many messages: the client has to go, since reading on would serve it before all others."""
        rate = self._bridge.settings.limits.messages_per_second
        reason = f"more than {rate} messages a second (limits.messages_per_second)"
        self.replies.log(logging.WARNING, reason)
        self.sink.close(POLICY, reason)

    def closed(self, code: int, reason: str) -> None:
        """The connection has ended: give back everything (DIS-01 … DIS-07)."""
        self._over = True
        self._waiting.clear()
        self.topics.close()
        self.actions.close()
        self.graph.close()
        self._bridge.left(self)
        left_out = self.replies.log_lines_left_out
        if left_out:
            reason += f" ({left_out} lines about it were left out)"
        self._bridge.access.audit.write(
            logging.INFO, "client %d left: %d %s", self.number, code, reason, client=self.number
        )

    @property
    def rosauth(self) -> Rosauth | None:
        """The judge of `auth` ops, None where there is no secret."""
        return self._bridge.access.admission.rosauth

    def take_role(self, role: Role) -> None:
        """Act as another role from now on; what is open stays open, and publishing is asked for again."""
        self._by_auth = True
        self._act_as(role)

    def reload_role(self) -> None:
        """Take the role that the settings give the client now, and end what it does not allow; disconnect a
        client that they do not let in."""
        role = self.graph.role.name if self._by_auth else None
        try:
            self._act_as(self._bridge.access.admission.role_now(self.info, role))
        except Refused as refused:
            self.sink.close(POLICY, refused.reason)
            return
        self.topics.end_refused()
        self.graph.withdraw_refused()

    def _act_as(self, role: Role) -> None:
        self.graph.take_role(role)
        self.topics.forget_publishers()
