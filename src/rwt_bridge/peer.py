"""One rosbridge client: its session, and what it owns."""

from __future__ import annotations

import logging
from typing import TYPE_CHECKING, Protocol

from rwt_access.quotas import RateLimit
from rwt_bridge.ops.actions import Actions
from rwt_bridge.ops.services import Services
from rwt_bridge.ops.topics import Topics
from rwt_bridge.reply import Replies
from rwt_delivery.counters import UNKNOWN
from rwt_protocol.ops import OPS, CallService, SendActionGoal, Status
from rwt_protocol.session import Refusal
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
    ) -> None:
        settings = bridge.settings
        limits = settings.limits
        self._bridge = bridge
        self.number = number
        self.info = info
        self.sink = sink
        self.messages = 0
        self.graph = graph
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
        self.topics = Topics(graph, self.replies, bridge.encoding_of)
        self.services = Services(graph, self.replies, settings.default_call_service_timeout)
        self.actions = Actions(graph, self.replies, info.address, bridge.orphans)

    def receive(self, data: bytes, binary: bool) -> None:
        """Take one message from the wire, run what it holds, and answer what is refused."""
        self.messages += 1
        now = self._monotonic()
        if self._rate is not None and not self._rate.take(now):
            self._rate_exceeded()
            return
        for item in self._session.decode(data, binary, now):
            if isinstance(item, Refusal):
                self.graph.counters.refuse(item.op if item.op in OPS else UNKNOWN)
                self.replies.log(logging.WARNING, item.reason, item.id)
                if item.answer is not None:
                    self.replies.send(item.answer)
                continue
            answer = self._dispatch(self, item)
            if answer is not None:
                self.graph.counters.refuse(item.op)
                self.replies.refuse(answer)
            elif self._session.level == "info" and not isinstance(item, CallService | SendActionGoal):
                # Success, for ops that have no reply of their own (STA-04).
                self.replies.send(Status(level="info", msg=f"{item.op}: done", id=item.id))

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
        self.graph.take_role(role)
        self.topics.forget_publishers()
