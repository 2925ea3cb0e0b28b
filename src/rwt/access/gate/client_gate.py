"""The gate as one client meets it: what :class:`rwt.access.client_graph.ClientGraph` asks."""

from __future__ import annotations

import re
from contextvars import copy_context
from typing import TYPE_CHECKING, Final, Protocol, TypeVar
from uuid import uuid4

from rwt.access.errors import AccessError, GateRefused, NotAllowed
from rwt.access.gate.gate import GATE_NODE
from rwt.access.gate.node import SERVICES, STOP_TOPIC, TOPICS
from rwt.access.gate.record import CALLER
from rwt.access.gate.rules import pattern
from rwt_graph.api import ClientGoal, PendingCall
from rwt_participant.errors import CallFailed, GoalRejected, RobotError, ServiceFailed
from rwt_participant.goals import GoalStatus
from rwt_participant.qos import Durability

if TYPE_CHECKING:
    from collections.abc import Callable

    from rwt.access.gate.approvals import Approval
    from rwt.access.gate.gate import Gate
    from rwt.access.gate.record import Actor
    from rwt.access.gate.rules import GatedAct, Rule
    from rwt.access.roles import Role
    from rwt.delivery.counters import TopicCounts
    from rwt_graph.api import OnReply
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.structs import ActionType, MessageType, ServiceType
    from rwt_participant.qos import QoS

    Needed = list[tuple[GatedAct, str, Rule]]

#: The service by which ROS 2 itself sends a goal to an action.
_SEND_GOAL: Final = re.compile(r"(?P<action>/.+)/_action/send_goal")

#: The topic by which ROS 1 sends a goal to an action.
_GOAL_TOPIC: Final = re.compile(r"(?P<action>/.+)/goal")


#: Topics of which it is remembered that the audit says of a client that it publishes there.
_MOST_NOTED: Final = 1000

T = TypeVar("T", bound="Inner")


class Inner(Protocol):
    """What publishes on a topic without the gate."""

    @property
    def topic(self) -> str:
        """Absolute name."""
        ...

    @property
    def type(self) -> MessageType:
        """Of its messages."""
        ...

    @property
    def counts(self) -> TopicCounts:
        """Of the topic."""
        ...

    @property
    def publish(self) -> Callable[[Payload], None]:
        """Hands on a message."""
        ...


class GatedPublisher:
    """What a client publishes on where rules of the gate are about the topic."""

    __slots__ = ("_actor", "_gate", "_inner", "counts", "topic", "type")

    def __init__(self, gate: Gate, actor: Actor, inner: Inner) -> None:
        self._gate = gate
        self._actor = actor
        self._inner = inner
        self.topic = inner.topic
        self.type = inner.type
        self.counts = inner.counts

    def publish(self, payload: Payload) -> None:
        """Hand on a message, if the rules let it pass.

        Raises:
            GateRefused: a rule does not.
            QuotaExceeded: as many bytes are kept for the client as may be.
        """
        topic = self._gate.guarded(self.topic, self.type)
        topic.publish(self._actor, payload, self._inner.publish)


class GoalPublisher(GatedPublisher):
    """What a client publishes on where messages are goals of an action, as on ROS 1."""

    __slots__ = ("_action", "_own_rules")

    def __init__(self, gate: Gate, actor: Actor, inner: Inner, action: str) -> None:
        super().__init__(gate, actor, inner)
        self._action = action
        self._own_rules = bool(gate.rules.of("publish", inner.topic))

    def publish(self, payload: Payload) -> None:
        """Hand on a goal, if the rules let it pass that are about the action, and those about the topic.

        Raises:
            GateRefused: a rule does not.
        """
        try:
            _require_plain_goal(self._gate, self._actor, self._action)
        except GateRefused as refused:
            _refuse(self._gate, self._actor, "goal", self._action, refused)
        if self._own_rules:
            super().publish(payload)
        else:
            self._inner.publish(payload)


class Waiting(PendingCall):
    """A call that waits for one yes after the other."""

    __slots__ = ("asked", "then")

    def __init__(self) -> None:
        self.asked: Approval | None = None
        self.then: PendingCall | None = None

    def cancel(self) -> None:
        """Ask no more, and forget the call."""
        for each in (self.asked, self.then):
            if each is not None:
                each.cancel()


class WaitingGoal(ClientGoal):
    """A goal that waits for a yes, and is like any other after it.

    Args:
        id: under which it is sent.
        action: absolute name.
        refused: is told why the goal is not sent.
    """

    def __init__(self, id: str, action: str, refused: Callable[[CallFailed], None]) -> None:
        self.id = id
        self.action = action
        self.asked: Approval | None = None
        self._refused = refused
        self._sent: ClientGoal | None = None
        self._wants_feedback = True
        self._is_over = False
        self._reason = ""

    @property
    def status(self) -> GoalStatus:
        """The last state that the server reported; UNKNOWN while it waits."""
        return GoalStatus.UNKNOWN if self._sent is None else self._sent.status

    @property
    def reason(self) -> str:
        """Why the goal ended as it did."""
        return self._reason if self._sent is None else self._sent.reason

    def send(self, send: Callable[[str], ClientGoal]) -> None:
        """Somebody has said yes."""
        if not self._is_over:
            self._sent = send(self.id)
            if not self._wants_feedback:
                self._sent.want_feedback(False)

    def refuse(self, why: str) -> None:
        """It is not sent."""
        if not self._is_over:
            self._is_over = True
            self._reason = why
            self._refused(GoalRejected(why))

    def cancel(self) -> None:
        """Ask the server to cancel; a goal that waits is not sent."""
        if self._sent is not None:
            self._sent.cancel()
        elif not self._is_over:
            if self.asked is not None:
                self.asked.cancel()
            self.refuse("it was cancelled before a person had said yes")

    def want_feedback(self, wanted: bool) -> None:
        """Say whether feedback is of use now."""
        self._wants_feedback = wanted
        if self._sent is not None:
            self._sent.want_feedback(wanted)

    def abandon(self) -> None:
        """Drop the goal's callbacks; a goal that waits is not sent."""
        if self._sent is not None:
            self._sent.abandon()
        else:
            self._is_over = True
            if self.asked is not None:
                self.asked.cancel()


class ClientGate:
    """The gate as one client meets it.

    Args:
        gate: see there.
        name: of the client; empty: the gate gives it one.
        role: its role.
        address: where it comes from.
    """

    __slots__ = ("_actor", "_gate", "_noted")

    def __init__(self, gate: Gate, name: str, role: Role, address: str) -> None:
        self._gate = gate
        self._noted: set[str] = set()
        self._actor = gate.join(name, role, address)

    @property
    def name(self) -> str:
        """What the client is called by the gate."""
        return self._actor.name

    def take_role(self, role: Role) -> None:
        """The client has another role."""
        self._gate.take_role(self._actor, role)

    def close(self) -> None:
        """The client has gone: what it holds is free, and what it asked is not done."""
        self._gate.leave(self._actor)

    def note_refusal(self, act: str, name: str, why: str) -> None:
        """Note what the client's role does not allow."""
        self._gate.recorder.note("refused", act, name, self._actor, why)

    # Topics

    def check_publisher(self, topic: str, qos: QoS | None) -> None:
        """Look at a publisher before it is made.

        Args:
            topic: absolute name.
            qos: its policies; None: those of the graph.

        Raises:
            NotAllowed: the gate's own topic, or the stop, and the role may not stop the robot.
            GateRefused: its last message would be heard again by whoever subscribes later, also when the
                robot was told to stop meanwhile.
        """
        if not self._gate.rules.all:
            return
        if qos is not None and qos.durability is not Durability.VOLATILE:
            for rule in self._gate.rules.of("publish", topic):
                if rule.settings.stop is not None:
                    text = f"{topic} may not be latched: a stop would not end what who subscribes later hears"
                    _refuse(self._gate, self._actor, "publish", topic, GateRefused(text, f"{rule.key}.stop"))
                    break
        if topic in TOPICS:
            raise NotAllowed(f"{topic} is published by the gate alone")
        roles = self._gate.settings.emergency.stop_roles
        if topic == STOP_TOPIC and pattern(roles).fullmatch(self._actor.role) is None:
            raise NotAllowed(f"role {self._actor.role!r} may not stop the robot (gate.emergency.stop_roles)")

    def reserve_offer(self, name: str) -> None:
        """Keep the gate's own services from being offered by clients.

        Raises:
            NotAllowed: it is one of them.
        """
        if self._gate.rules.all and name.startswith(f"{GATE_NODE}/"):
            raise NotAllowed(f"{name} is the gate's own")

    def publisher(self, inner: T) -> T | GatedPublisher:
        """What the client publishes on; what it is given where no rule is about the topic."""
        gate, actor = self._gate, self._actor
        if gate.recorder.keeps_all and inner.topic not in self._noted:
            if len(self._noted) >= _MOST_NOTED:
                self._noted.clear()
            self._noted.add(inner.topic)
            gate.recorder.note("allowed", "publish", inner.topic, actor, "begins to publish")
        as_goal = _GOAL_TOPIC.fullmatch(inner.topic)
        if as_goal and inner.type.name.endswith("ActionGoal") and gate.rules.of("goal", as_goal["action"]):
            return GoalPublisher(gate, actor, inner, as_goal["action"])
        if not gate.rules.of("publish", inner.topic):
            return inner
        gate.guarded(inner.topic, inner.type).users.add(actor)
        return GatedPublisher(gate, actor, inner)

    def left_topic(self, topic: str) -> None:
        """The client does not publish on a topic any more."""
        self._gate.left_topic(self._actor, topic)

    def lease_seconds(self, topic: str) -> float | None:
        """Silence after which the client loses the lease of a topic; None where no rule asks for one."""
        return self._gate.lease_seconds(self._actor.rights, topic)

    # Calls

    def is_own(self, service: str) -> bool:
        """Whether a service is the gate's own, which decides itself who may call it."""
        return service in SERVICES and bool(self._gate.rules.all)

    def check_call(
        self, service: str, type: ServiceType, request: Payload, written: list[str]
    ) -> tuple[Payload, Needed]:
        """The request as it may be sent, and to what a person has to say yes.

        Args:
            service: absolute name.
            type: of the service.
            request: of the client.
            written: parameters that the call sets.

        Raises:
            GateRefused: a rule does not let it through.
        """
        gate = self._gate
        acts: list[tuple[GatedAct, str]] = [("call", service), *(("set_param", name) for name in written)]
        try:
            as_goal = _SEND_GOAL.fullmatch(service)
            if as_goal is not None:
                _require_plain_goal(gate, self._actor, as_goal["action"])
            return gate.check(self._actor, acts, type.request, request)
        except GateRefused as refused:
            _refuse(gate, self._actor, "call", service, refused)
            return request, []

    def note_call(self, service: str, written: list[str]) -> None:
        """Note a call that is made."""
        recorder = self._gate.recorder
        if recorder.keeps_all:
            for name in written:
                recorder.note("allowed", "set_param", name, self._actor, f"by {service}")
            if not written:
                recorder.note("allowed", "call", service, self._actor)

    def call(
        self, needed: Needed, request: Payload, send: Callable[[Payload], PendingCall], on_reply: OnReply
    ) -> PendingCall:
        """Make a call when a person has said yes to all that it needs.

        Args:
            needed: see :meth:`check_call`.
            request: of the client.
            send: makes the call.
            on_reply: is told why it is not made.
        """
        waiting = Waiting()
        kept = request.detach()

        def go() -> None:
            waiting.then = send(kept)

        def refuse(why: str) -> None:
            on_reply(ServiceFailed(why))

        def ask(approval: Approval) -> None:
            waiting.asked = approval

        self._ask(needed, kept, ask, go, refuse)
        return waiting

    def as_caller(self, send: Callable[[], PendingCall]) -> PendingCall:
        """Call a service of the gate's own, which then knows who calls."""
        context = copy_context()
        context.run(CALLER.set, self._actor)
        return context.run(send)

    # Goals

    def check_goal(self, action: str, type: ActionType, goal: Payload) -> tuple[Payload, Needed]:
        """The goal as it may be sent, and to what a person has to say yes.

        Raises:
            GateRefused: a rule does not let it through.
        """
        try:
            return self._gate.check(self._actor, [("goal", action)], type.goal, goal)
        except GateRefused as refused:
            _refuse(self._gate, self._actor, "goal", action, refused)
            return goal, []

    def send_goal(
        self,
        action: str,
        needed: Needed,
        goal: Payload,
        send: Callable[[str, Payload], ClientGoal],
        refused: Callable[[CallFailed], None],
    ) -> ClientGoal:
        """Send a goal, when a person has said yes to all that it needs.

        Args:
            action: absolute name.
            needed: see :meth:`check_goal`.
            goal: of the client.
            send: sends it under an id.
            refused: is told why it is not sent.
        """
        gate, goal_id = self._gate, uuid4().hex
        if gate.recorder.keeps_all and not needed:
            gate.recorder.note("allowed", "goal", action, self._actor)

        if not needed:
            return send(goal_id, goal)
        kept = goal.detach()
        waiting = WaitingGoal(goal_id, action, refused)

        def ask(approval: Approval) -> None:
            waiting.asked = approval

        self._ask(needed, kept, ask, lambda: waiting.send(lambda id: send(id, kept)), waiting.refuse)
        return waiting

    def _ask(
        self,
        needed: Needed,
        payload: Payload,
        asked: Callable[[Approval], None],
        go: Callable[[], None],
        refuse: Callable[[str], None],
    ) -> None:
        """Ask for one yes after the other."""
        gate = self._gate
        (act, name, rule), *others = needed

        def next_one() -> None:
            try:
                # Meanwhile the robot may have been stopped, and the client may have another role.
                for *_, each in needed:
                    gate.require_moving(each)
                if not others:
                    go()
            except (AccessError, RobotError) as refused:
                gate.recorder.note("refused", act, name, self._actor, str(refused))
                refuse(str(refused))
                return
            if others:
                self._ask(others, payload, asked, go, refuse)

        try:
            approval = gate.approvals.ask(self._actor, act, name, rule, payload)
        except GateRefused as refused:
            gate.recorder.note("refused", act, name, self._actor, str(refused), refused.rule)
            refuse(str(refused))
            return
        approval.go = next_one
        approval.refuse = refuse
        asked(approval)


def _require_plain_goal(gate: Gate, actor: Actor, action: str) -> None:
    """Refuse a goal that does not come as one, where a rule wants to look at it or ask about it.

    Raises:
        GateRefused: a rule does, or the emergency stop forbids the goal.
    """
    for rule in gate.rules.of("goal", action):
        if not rule.holds_for(actor.role):
            continue
        gate.require_moving(rule)
        settings = rule.settings
        if settings.fields or settings.approval or settings.largest_bytes:
            raise GateRefused(f"goals of {action} are only taken by `send_action_goal`", rule.key)


def _refuse(gate: Gate, actor: Actor, act: GatedAct, name: str, refused: GateRefused) -> None:
    """Note a refusal, and raise it unless the gate only observes."""
    gate.recorder.note(
        "would refuse" if gate.is_observing else "refused", act, name, actor, str(refused), refused.rule
    )
    if not gate.is_observing:
        raise refused
