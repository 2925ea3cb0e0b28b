"""One rosbridge client: its session, and what it owns."""

from __future__ import annotations

import logging
from contextlib import suppress
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, NamedTuple, Protocol

from rwt.access.errors import AccessError
from rwt.access.quotas import RateLimit
from rwt.delivery.counters import UNKNOWN
from rwt.delivery.turns import ALONE, SHARE, Arriving, TakesTurns
from rwt.gateways.rosbridge.numpy_loading import LARGE
from rwt.gateways.rosbridge.ops.actions import Actions
from rwt.gateways.rosbridge.ops.services import Services
from rwt.gateways.rosbridge.ops.topics import Topics
from rwt.gateways.rosbridge.reply import Replies
from rwt_participant.errors import RobotError
from rwt_protocol.codecs.quick_calls import UsualCall, split_call
from rwt_protocol.codecs.quick_publish import PUBLISH_STARTS, split_publish
from rwt_protocol.errors import ProtocolError
from rwt_protocol.ops import OPS, CallService, Op, SendActionGoal, Status
from rwt_protocol.session import Refusal
from rwt_transports.errors import Refused
from rwt_transports.websocket.close_codes import POLICY, TOO_BIG

if TYPE_CHECKING:
    from collections.abc import Sequence

    from rwt.access.access import Access
    from rwt.access.client_graph import ClientGraph
    from rwt.access.credentials import Rosauth
    from rwt.access.roles import Role
    from rwt.delivery.turns import Turns
    from rwt.gateways.rosbridge.numpy_loading import NumpyLoading
    from rwt.gateways.rosbridge.ops import actions, services
    from rwt.gateways.rosbridge.ops.actions import OrphanedGoals
    from rwt.gateways.rosbridge.ops.offers import Offers
    from rwt.gateways.rosbridge.settings import BridgeSettings
    from rwt_protocol.codecs import Encoding
    from rwt_protocol.dispatcher import Dispatcher, Steps
    from rwt_protocol.session import Session
    from rwt_transports.endpoint import PeerInfo, Sink


class _Work(NamedTuple):
    """What is left to do of one message."""

    op: Op
    steps: Steps


@dataclass(frozen=True, slots=True)
class _TooLarge:
    """A message that is too large to be taken from the wire, and does not tell who waits for an answer."""

    reason: str


_Waiting = Op | Refusal | _Work | _TooLarge | tuple[bytes, bool]
"""What may wait: a message, the rest of one, or a frame that is not read."""


class Gateway(Protocol):
    """What the clients of one bridge share."""

    settings: BridgeSettings
    access: Access
    dispatcher: Dispatcher[Peer]
    orphans: OrphanedGoals
    service_offers: Offers[services.Asked]
    action_offers: Offers[actions.Accepted]
    turns: Turns
    loading: NumpyLoading | None

    def encoding_of(self, compression: str) -> Encoding:
        """How a client that asks for `compression` gets its samples."""
        ...

    def left(self, peer: Peer) -> None:
        """A client has gone."""


class Peer(TakesTurns[_Waiting]):
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
        super().__init__(bridge.turns, graph.work, graph.clock.monotonic)
        settings = bridge.settings
        limits = settings.limits
        self._bridge = bridge
        self.number = number
        self._by_auth = by_auth
        self.info = info
        self.sink = sink
        self.messages = 0
        self.graph = graph
        self._loading = bridge.loading
        self._unfinished: Op | None = None
        self._session = session
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
        self.services = Services(
            graph,
            self.replies,
            info.address,
            bridge.service_offers,
            settings.default_call_service_timeout,
        )
        self.actions = Actions(graph, self.replies, info.address, bridge.action_offers, bridge.orphans)

    def receive(self, data: bytes, binary: bool) -> None:
        """Take one frame from the wire, run what it holds, and answer what is refused.

        Beyond the client's share of a turn of the event loop, or where all have had theirs, the rest waits
        for a later turn, and beyond its rate of work until no other such client has the turn.
        """
        received = self.sink.received
        if received != self._received:
            self._received = received
            self._turn_began = self._worked
            self._needs_turn = self._is_beyond
        if len(data) > LARGE and (
            (len(data) > ALONE and self._flow_control is not None)
            or (self._loading is not None and self._loading.holds_up(data, binary))
        ):
            self._wait((data if type(data) is bytes else bytes(data), binary))
            return
        if (
            self._is_held
            or self._needs_turn
            or self._turns.is_full
            or self._worked - self._turn_began > SHARE
        ) and self._must_wait(len(data)):
            self._wait((data if type(data) is bytes else bytes(data), binary))
            return
        now = self._began = self._monotonic()
        # As _read does it, written out: this runs for each message.
        self.messages += 1
        if (self._rate is None or self._may_send(now)) and (
            binary or not self._session.is_quick or not self._run_usual(data)
        ):
            self._decode(data, binary, now)
        self._worked += self._monotonic() - now
        if self._worked - self._counted > SHARE:
            self._count_work()

    def _run_usual(self, data: bytes) -> bool:
        """Run the usual `publish`, call or response in a text frame.

        Returns False, and does nothing, if the frame has to be decoded.
        """
        try:
            if data.startswith(PUBLISH_STARTS):
                publish = split_publish(data)
                return publish is not None and self.topics.publish_exact(*publish)
            usual = split_call(data)
            if usual is None:
                return False
            if isinstance(usual, UsualCall):
                self.services.call_usual(usual)
            else:
                self.services.answer_usual(usual)
        except Exception as error:
            (op,) = self._session.decode(data, False, self._began)
            assert isinstance(op, Op)  # The frame was found to hold one before the handler ran.
            self._after(op, self._bridge.dispatcher.refused(self, op, error))
        return True

    def _read(self, data: bytes, binary: bool, now: float) -> None:
        self.messages += 1
        if self._rate is None or self._may_send(now):
            self._decode(data, binary, now)

    def _decode(self, data: bytes, binary: bool, now: float) -> None:
        """Run what a frame holds; what is large is taken apart in steps."""
        if binary and len(data) > LARGE:
            self._read_on(Arriving(self._read_in_steps(data)))
        else:
            self._do_all(self._session.decode(data, binary, now), now)

    def _read_in_steps(self, data: bytes) -> Steps:
        """Take a large binary frame apart in steps, and run what it holds."""
        items = yield from self._session.decode_in_steps(data, True, self._began)
        self._do_all(items, self._began)

    def _do_all(self, items: Sequence[Op | Refusal], now: float) -> None:
        """Run the messages of one frame, the first of which is counted already."""
        for number, item in enumerate(items):
            if number:
                if self._waiting or self._worked - self._turn_began + self._monotonic() - now > SHARE:
                    for later in items[number:]:
                        self._wait(later)
                    return
                self.messages += 1
                if self._rate is not None and not self._may_send(now):
                    return
            self._do(item)

    def _may_send(self, now: float) -> bool:
        """Whether one message more is within the rate: each of a frame, and each frame that holds none."""
        if self._rate is None or self._rate.take(now):
            return True
        self._rate_exceeded()
        return False

    def _do(self, item: Op | Refusal) -> None:
        """Run one message, and answer it if it is refused."""
        if isinstance(item, Refusal):
            self.graph.counters.refuse(item.op if item.op in OPS else UNKNOWN)
            self.replies.log(logging.WARNING, item.reason, item.id)
            self._end_what_waits(item)
            if item.answer is not None:
                self.replies.send(item.answer)
        else:
            answer = self._dispatch(self, item)
            if answer is not None or self._session.level == "info":
                self._after(item, answer)

    def _end_what_waits(self, refusal: Refusal) -> None:
        """End what waits for an answer of this client that is malformed."""
        ends = {
            "service_response": self.services.answer_malformed,
            "action_result": self.actions.result_malformed,
        }
        end = ends.get(refusal.op) if refusal.name else None
        if end is not None:
            with suppress(
                ProtocolError, RobotError, AccessError
            ):  # It names nothing that waits, and is refused either way.
                end(refusal.name, refusal.id, refusal.reason)

    def work(self, op: Op, steps: Steps) -> Op | None:
        """Take steps of a message whose handler has returned them, and the rest of them in later turns.

        Returns:
            What reports the refusal of the message.
        """
        left = self._bridge.dispatcher.go_on(self, op, steps, self._has_time)
        if isinstance(left, Op):
            return left
        if left is not None:
            self._unfinished = op
            self._wait(_Work(op, left))
        return None

    def _after(self, op: Op, answer: Op | None) -> None:
        """Say what has become of a message."""
        if answer is not None:
            self.graph.counters.refuse(op.op)
            self.replies.refuse(answer)
        elif self._session.level == "info" and not (
            op is self._unfinished or isinstance(op, CallService | SendActionGoal)
        ):
            # Success, for ops that have no reply of their own (STA-04).
            self.replies.send(Status(level="info", msg=f"{op.op}: done", id=op.id))

    def _take_up(self, what: _Waiting, now: float) -> None:
        """Do a message that has waited, go on with the rest of one, or read a frame."""
        if isinstance(what, _Work):
            self._unfinished = None
            answer = self.work(what.op, what.steps)
            if answer is not None or self._session.level == "info":
                self._after(what.op, answer)
        elif isinstance(what, tuple):
            data, binary = what
            self._read(data, binary, now)
        elif isinstance(what, _TooLarge):
            self.replies.log(logging.WARNING, what.reason)
            self.sink.close(TOO_BIG, what.reason)
        else:
            self.messages += 1
            if self._may_send(now):
                self._do(what)

    def _is_held_up(self, what: _Waiting) -> bool:
        """Whether what has waited for a turn waits for numpy, too."""
        return (
            self._loading is not None
            and isinstance(what, tuple)
            and not isinstance(what, _Work)
            and self._loading.holds_up(*what)
        )

    def oversized(self, size: int, limit: int, head: bytes) -> None:
        """A message is too large to be taken from the wire. It is refused if its head tells what it is, and
        under which id; otherwise the connection is closed, since its sender would wait for ever (CFG-06).
        """
        reason = f"a message of {size} bytes: the limit is {limit} (max_message_size)"
        what = self._session.refuse_skipped(head, reason) or _TooLarge(reason)
        if self._is_held:
            self._wait(what)  # Behind what came before it, which may change how it is answered.
        else:
            self._take_up(what, self._monotonic())

    def _rate_exceeded(self) -> None:
        """Too many messages: the client has to go, since reading on would serve it before all others."""
        rate = self._bridge.settings.limits.messages_per_second
        reason = f"more than {rate} messages a second (limits.messages_per_second)"
        self.replies.log(logging.WARNING, reason)
        self.sink.close(POLICY, reason)

    def closed(self, code: int, reason: str) -> None:
        """The connection has ended: give back everything (DIS-01 … DIS-07)."""
        self._end_turns()
        self.graph.leave()
        self._bridge.left(self)
        self._give_back(self._belongings())
        left_out = self.replies.log_lines_left_out
        if left_out:
            reason += f" ({left_out} lines about it were left out)"
        self._bridge.access.audit.write(
            logging.INFO, "client %d left: %d %s", self.number, code, reason, client=self.number
        )

    def _belongings(self) -> Steps:
        """Give back everything that the client has, one thing in each step."""
        yield from self.services.close()
        yield from self.actions.close()
        yield from self.topics.close()
        yield from self.graph.close_in_steps()

    def _give_back(self, steps: Steps) -> None:
        """Take steps for this turn's share, and the rest of them in later turns: who leaves may have much."""
        self._began = self._monotonic()
        self._turn_began = self._worked
        try:
            for _ in steps:
                if self._turns.is_full or not self._has_time():
                    self._turns.wait(partial(self._give_back, steps))
                    return
        finally:
            self._worked += self._monotonic() - self._began
            self._count_work()

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
