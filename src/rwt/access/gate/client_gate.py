"""Gate of one client, as :class:`rwt.access.client_graph.ClientGraph` uses it."""

from __future__ import annotations

import json
import re
from contextvars import copy_context
from functools import partial
from typing import TYPE_CHECKING, Final
from uuid import uuid4

from rwt.access.client_graph import ClientPublisher, WrappedPublisher
from rwt.access.errors import AccessError, GateRefused, NotAllowed
from rwt.access.gate.gate import GATE_NODE, Gate
from rwt.access.gate.node import LEASES, TOPICS, answer_of, press
from rwt.access.gate.record import CALLER, Actor
from rwt.access.gate.topic import TopicState
from rwt.access.graph_view import STOP
from rwt.access.roles import Role, absolute_globs
from rwt_graph.api import ClientGoal, OnReply, PendingCall, ServiceInfo
from rwt_participant.errors import CallFailed, GoalRejected, RobotError, ServiceFailed
from rwt_participant.goals import GoalStatus
from rwt_participant.qos import Durability, QoS

if TYPE_CHECKING:
    from collections.abc import Callable, Mapping, Set

    from rwt.access.gate.approvals import Approval
    from rwt.access.gate.rules import GatedAct, Rule
    from rwt.access.gate.topic import GuardedTopic
    from rwt.delivery.counters import Counters
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.structs import ActionType, MessageType, ServiceType

    Needed = list[tuple[GatedAct, str, Rule]]

#: Service by which ROS 2 itself sends a goal to an action.
_SEND_GOAL: Final = re.compile(r"(?P<action>/.+)/_action/send_goal")

#: Topic by which ROS 1 sends a goal to an action.
_GOAL_TOPIC: Final = re.compile(r"(?P<action>/.+)/goal")

#: Wildcard of a glob.
_WILDCARD: Final = re.compile(r"[*?]|\[[^\]]*\]")

#: Maximum size of a request that the audit shows.
_MAX_SHOWN_BYTES: Final = 2000

#: Maximum number of topics per client whose first publication is not recorded again; then all are forgotten.
_MAX_RECORDED: Final = 1000


class GatedPublisher(WrappedPublisher):
    """Publisher of a client on a topic with gate rules."""

    __slots__ = ("_actor", "_gate", "_guarded")

    def __init__(self, gate: Gate, actor: Actor, inner: ClientPublisher, guarded: GuardedTopic) -> None:
        super().__init__(inner)
        self._gate = gate
        self._actor = actor
        self._guarded = guarded

    def publish(self, payload: Payload) -> None:
        """Publish a message if it passes the rules.

        Raises:
            GateRefused: a rule rejects it.
            QuotaExceeded: the topic is latched, and `limits.kept_bytes` is reached.
        """
        guarded = self._guarded
        if guarded.state is TopicState.CLOSED:
            guarded = self._guarded = self._gate.join_topic(self._actor, self.topic, self.type)
        guarded.publish(self._actor, payload, self._inner.publish)


class GoalPublisher(WrappedPublisher):
    """Publisher of a client on a topic whose messages are goals of an action, as in ROS 1.

    Its inner publisher checks the rules of the topic, if there are any.
    """

    __slots__ = ("_action", "_actor", "_gate")

    def __init__(self, gate: Gate, actor: Actor, inner: ClientPublisher, action: str) -> None:
        super().__init__(inner)
        self._gate = gate
        self._actor = actor
        self._action = action

    def publish(self, payload: Payload) -> None:
        """Publish a goal if it passes the rules for the action and the topic. Raises GateRefused."""
        try:
            _require_plain_goal(self._gate, self._actor, self._action, payload)
        except GateRefused as refused:
            self._gate.refuse(self._actor, "goal", self._action, refused)
        self._inner.publish(payload)


class StopPublisher:
    """Publisher of a client on the topic that presses the emergency stop; it holds nothing in the graph."""

    __slots__ = ("_actor", "_gate", "counts", "topic", "type")

    def __init__(self, gate: Gate, actor: Actor, counters: Counters) -> None:
        self._gate = gate
        self._actor = actor
        self.topic = STOP
        self.type = gate.stop_type
        self.counts = counters.use_topic(STOP)
        counters.release_topic(self.counts)

    def publish(self, payload: Payload) -> None:
        """Press the emergency stop, whatever the message.

        Raises:
            GateRefused: the role may not press it, or not every topic could be stopped.
        """
        undelivered = self._gate.stop(self._actor, f"by a message on {STOP}")
        if undelivered:
            raise GateRefused(f"these were not stopped: {undelivered}")


class _Waiting:
    """Act that requires approval.

    Attributes:
        asked: request for approval; if the act requires several, the last one.
    """

    asked: Approval | None = None

    @property
    def approval(self) -> Approval | None:
        """Request for approval that the act waits for; None if it waits for none."""
        return self.asked if self.asked is not None and self.asked.is_pending else None


class PendingApproval(_Waiting, PendingCall):
    """Service call that requires approval: first the request for approval is pending, then the call itself.

    Attributes:
        then: the call, once it is approved.
    """

    then: PendingCall | None = None

    def cancel(self) -> None:
        """Withdraw the request, and cancel the call."""
        for each in (self.asked, self.then):
            if each is not None:
                each.cancel()


class WaitingGoal(_Waiting, ClientGoal):
    """Goal that requires approval.

    States::

        pending ──send(), once approved──> sent: every method forwards to the sent goal
           └──refuse(), cancel(), abandon()──> ended: never sent

    Args:
        id: goal id under which it is sent.
        refused: called with the reason if the goal is not sent; not after :meth:`abandon`.
    """

    def __init__(self, id: str, action: str, refused: Callable[[CallFailed], None]) -> None:
        self.id = id
        self.action = action
        self._refused = refused
        self._sent: ClientGoal | None = None
        self._wants_feedback = True
        self._has_ended = False
        self._reason = ""

    @property
    def status(self) -> GoalStatus:
        """Last status that the server reported; UNKNOWN while the goal is pending."""
        return GoalStatus.UNKNOWN if self._sent is None else self._sent.status

    @property
    def reason(self) -> str:
        """Reason for the end of the goal; empty if none was given."""
        return self._reason if self._sent is None else self._sent.reason

    def send(self, send: Callable[[str], ClientGoal]) -> None:
        """Send the approved goal."""
        if not self._has_ended:
            self._sent = send(self.id)
            if not self._wants_feedback:
                self._sent.want_feedback(False)

    def refuse(self, why: str) -> None:
        """Refuse the goal; it is never sent."""
        if not self._has_ended:
            self._has_ended = True
            self._reason = why
            self._refused(GoalRejected(why))

    def cancel(self) -> None:
        """Request cancellation by the server; a pending goal is not sent."""
        if self._sent is not None:
            self._sent.cancel()
        elif not self._has_ended:
            if self.asked is not None:
                self.asked.cancel()
            self.refuse("it was cancelled before a person had said yes")

    def want_feedback(self, wanted: bool) -> None:
        """Turn feedback on or off."""
        self._wants_feedback = wanted
        if self._sent is not None:
            self._sent.want_feedback(wanted)

    def abandon(self) -> None:
        """Drop the goal's callbacks; a pending goal is not sent."""
        if self._sent is not None:
            self._sent.abandon()
        else:
            self._has_ended = True
            if self.asked is not None:
                self.asked.cancel()


class ClientGate:
    """Gate of one client.

    The client is an actor of the gate from the constructor until :meth:`close`.

    Attributes:
        actor: client as the gate knows it.

    Args:
        name: name of the client; empty: the gate assigns one.
        address: network address of the client.
        device: program and system of the client, for people.
    """

    __slots__ = ("_gate", "_recorded", "actor")

    def __init__(self, gate: Gate, name: str, role: Role, address: str, device: str) -> None:
        self._gate = gate
        self._recorded: set[str] = set()
        self.actor = gate.join(name, role, address, device)

    def take_role(self, role: Role) -> None:
        """Switch the client to another role, which may allow less."""
        self.actor.rights = role
        for topic in tuple(self.actor.topics):
            if not role.allows("publish", topic.name):
                topic.leave(self.actor, "its holder's role may not publish there")

    def close(self) -> None:
        """Remove the client: release its leases, and withdraw its requests for approval."""
        self._gate.leave(self.actor)

    def note_refusal(self, act: str, name: str, why: str) -> None:
        """Record an act that the client's role does not allow."""
        self._gate.recorder.note("refused", act, name, self.actor, why)

    @staticmethod
    def approval_of(pending: PendingCall | ClientGoal | None) -> Approval | None:
        """Return the request for approval that a call or goal waits for; None if it waits for none."""
        return pending.approval if isinstance(pending, _Waiting) else None

    # Topics

    def check_publisher(self, topic: str, qos: QoS | None) -> None:
        """Check a publisher before it is created.

        Args:
            topic: absolute name of the topic.
            qos: QoS of the publisher; None for the graph's default.

        Raises:
            NotAllowed: the topic is the gate's own, or the emergency stop, which the role may not press.
            GateRefused: no rule guards a topic of `gate.require`, or the QoS is latched, and a rule defines a
                stop message for the topic.
        """
        as_goal = _GOAL_TOPIC.fullmatch(topic)
        try:
            self._gate.rules.require("publish", topic)
            if as_goal:
                self._gate.rules.require("goal", as_goal["action"])
        except GateRefused as refused:
            self._gate.refuse(self.actor, "publish", topic, refused)
        if not self._gate.rules.all:
            return
        if qos is not None and qos.durability is not Durability.VOLATILE:
            rule = self._gate.latch_rule(topic)
            if rule is not None:
                text = f"{topic} may not be latched: a stop would not end what who subscribes later hears"
                self._gate.refuse(self.actor, "publish", topic, GateRefused(text, f"{rule.key}.stop"))
        if topic in TOPICS:
            raise NotAllowed(f"{topic} is published by the gate alone")
        if topic == STOP and not self._gate.may_stop(self.actor.role):
            text = f"role {self.actor.role!r} may not stop the robot (gate.emergency.stop_roles)"
            self.note_refusal("publish", topic, text)
            raise NotAllowed(text)

    def check_subscriber(self, topic: str) -> None:
        """Check a subscription: the topic of leases names the holders of all leases.

        Raises:
            NotAllowed: the role may not see every topic that rules with a lease are about.
        """
        if topic != LEASES or self.actor.rights.sees_every_topic:
            return
        for rule in self._gate.rules.all:
            for glob in absolute_globs(rule.settings.topics) if rule.settings.lease else ():
                if not all(map(self.actor.rights.sees_topic, _names_like(glob))):
                    raise NotAllowed(
                        f"role {self.actor.role!r} may not see {glob}, whose holder {LEASES} names"
                        f" (roles.{self.actor.role}.subscribe)"
                    )

    def check_type(self, topic: str, type: MessageType) -> None:
        """Check the type that the client gives a topic, as :meth:`rwt.access.gate.gate.Gate.require_type`."""
        self._gate.require_type(self.actor, topic, type)

    def reserve_offer(self, name: str) -> None:
        """Raise NotAllowed for a service or action of a client with a name of the gate."""
        if self._gate.rules.all and name.startswith(f"{GATE_NODE}/"):
            raise NotAllowed(f"{name} is the gate's own")

    def publisher(self, inner: ClientPublisher) -> ClientPublisher:
        """Return a publisher that checks the rules; `inner` itself if there are none for the topic."""
        gate, actor = self._gate, self.actor
        if gate.recorder.keeps_all and inner.topic not in self._recorded:
            if len(self._recorded) >= _MAX_RECORDED:
                self._recorded.clear()
            self._recorded.add(inner.topic)
            gate.recorder.note("allowed", "publish", inner.topic, actor, "begins to publish")
        publisher = inner
        if gate.rules.of("publish", inner.topic):
            publisher = GatedPublisher(gate, actor, inner, gate.join_topic(actor, inner.topic, inner.type))
        as_goal = _GOAL_TOPIC.fullmatch(inner.topic)
        if as_goal and inner.type.name.endswith("ActionGoal") and gate.rules.of("goal", as_goal["action"]):
            return GoalPublisher(gate, actor, publisher, as_goal["action"])
        return publisher

    def leave_topic(self, topic: str) -> None:
        """Note that the client no longer publishes on a topic."""
        self._gate.leave_topic(self.actor, topic)

    def lease_seconds(self, topic: str) -> float | None:
        """Return the seconds of silence after which the client loses a lease; None without a lease."""
        return self._gate.lease_seconds(self.actor.rights, topic)

    # Emergency stop

    @property
    def is_stop_due(self) -> bool:
        """True if the client can press the emergency stop now."""
        return self._gate.is_stop_due(self.actor.role)

    @property
    def is_stopped(self) -> bool:
        """True while the emergency stop is pressed."""
        return bool(self._gate.stopped_by)

    def is_stop_topic(self, topic: str) -> bool:
        """Return True for the topic that presses the emergency stop."""
        return topic == STOP and bool(self._gate.rules.all)

    def stop_publisher(self, counters: Counters) -> StopPublisher:
        """Return a publisher that presses the emergency stop."""
        return StopPublisher(self._gate, self.actor, counters)

    def stop(self, request: Payload, type: ServiceType) -> Payload:
        """Press the emergency stop by a call, and return the response."""
        return answer_of(type, partial(press, self._gate), self.actor, request)

    # Calls

    @property
    def open_services(self) -> Set[str]:
        """Services of the gate, which itself decides who may call them."""
        return self._gate.open_services

    def check_call(
        self, service: str, type: ServiceType, request: Payload, written: list[str], text: str = ""
    ) -> tuple[Payload, Needed]:
        """Check a service call; return the request as it may be sent, and the acts that require approval.

        Args:
            written: parameters that the call sets.
            text: value of the parameter as JSON text, if the request has one.

        Raises:
            GateRefused: a rule rejects the call.
        """
        gate = self._gate
        try:
            parameters = gate.affected_parameters(written, text)
            acts: list[tuple[GatedAct, str]] = [
                ("call", service),
                *(("set_param", each) for each in parameters),
            ]
            as_goal = _SEND_GOAL.fullmatch(service)
            if as_goal is not None:
                _require_plain_goal(gate, self.actor, as_goal["action"], request)
            return gate.check(self.actor, acts, type.request, request, text)
        except GateRefused as refused:
            gate.refuse(self.actor, "call", service, refused)
            return request, []

    def _note_call(self, service: str, written: list[str], request: Payload) -> None:
        """Record a call that is sent, with the request if it sets parameters."""
        recorder = self._gate.recorder
        if not recorder.keeps_all:
            return
        if not written:
            recorder.note("allowed", "call", service, self.actor)
            return
        after = _shown(request)

        def note(values: Mapping[str, object]) -> None:
            for name in written:
                before = values.get(name)
                recorder.note(
                    "allowed", "set_param", name, self.actor, f"by {service}", before=before, after=after
                )

        self._gate.read_parameters(written, note)

    def call(
        self,
        info: ServiceInfo,
        needed: Needed,
        written: list[str],
        request: Payload,
        send: Callable[[Payload], PendingCall],
        on_reply: OnReply,
    ) -> PendingCall:
        """Send a call once all of its acts are approved.

        Args:
            needed: acts that require approval, from :meth:`check_call`.
            written: parameters that the call sets.
            on_reply: called with the reason if the call is not sent.
        """
        if not needed:
            self._note_call(info.name, written, request)
            return send(request)
        waiting = PendingApproval()
        kept = request.detach()

        def go() -> None:
            # Check again: service and role may have changed while the call waited.
            self._gate.require_same_type(info)
            self.actor.rights.require("call", info.name)
            self._note_call(info.name, written, kept)
            waiting.then = send(kept)

        self._ask(needed, kept, waiting, go, lambda why: on_reply(ServiceFailed(why)))
        return waiting

    def as_caller(self, send: Callable[[], PendingCall]) -> PendingCall:
        """Call a service of the gate, which finds the client in :data:`CALLER`."""
        context = copy_context()
        context.run(CALLER.set, self.actor)
        return context.run(send)

    # Goals

    def check_goal(self, action: str, type: ActionType, goal: Payload) -> tuple[Payload, Needed]:
        """Return a goal as it may be sent, and the acts that require approval. Raises GateRefused."""
        try:
            return self._gate.check(self.actor, [("goal", action)], type.goal, goal)
        except GateRefused as refused:
            self._gate.refuse(self.actor, "goal", action, refused)
            return goal, []

    def send_goal(
        self,
        action: str,
        needed: Needed,
        goal: Payload,
        send: Callable[[str, Payload], ClientGoal],
        refused: Callable[[CallFailed], None],
    ) -> ClientGoal:
        """Send a goal once all of its acts are approved.

        Args:
            needed: acts that require approval, from :meth:`check_goal`.
            send: sends the goal under a goal id.
            refused: called with the reason if the goal is not sent.
        """
        recorder, goal_id = self._gate.recorder, uuid4().hex
        if not needed:
            if recorder.keeps_all:
                recorder.note("allowed", "goal", action, self.actor)
            return send(goal_id, goal)
        kept = goal.detach()
        waiting = WaitingGoal(goal_id, action, refused)

        def go() -> None:
            self.actor.rights.require("goals", action)  # The role may have changed while the goal waited.
            waiting.send(lambda id: send(id, kept))

        self._ask(needed, kept, waiting, go, waiting.refuse)
        return waiting

    def _ask(
        self,
        needed: Needed,
        payload: Payload,
        waiting: _Waiting,
        go: Callable[[], None],
        refuse: Callable[[str], None],
    ) -> None:
        gate = self._gate
        (act, name, rule), *others = needed

        def next_one() -> None:
            try:
                # Meanwhile the emergency stop may be pressed, and the client may have another role.
                for *_, each in needed:
                    gate.require_released(each)
                if (subject.role, subject.credential) != (self.actor.role, self.actor.credential):
                    raise GateRefused(f"{act} {name}: the client has another role now")
                if not others:
                    go()
            except (AccessError, RobotError) as refused:
                gate.recorder.note("refused", act, name, self.actor, str(refused))
                refuse(str(refused))
                return
            if others:
                self._ask(others, payload, waiting, go, refuse)

        try:
            subject = gate.approvals.subject(self.actor, act, name, rule, payload)
            approval = gate.approvals.ask(subject, rule, payload)
        except GateRefused as refused:
            gate.recorder.note("refused", act, name, self.actor, str(refused), refused.rule)
            refuse(str(refused))
            return
        approval.go = next_one
        approval.refuse = refuse
        waiting.asked = approval


def _names_like(glob: str) -> tuple[str, ...]:
    """Return names that a glob matches, of different lengths."""
    return tuple({_WILDCARD.sub(text, glob) for text in ("x", "yz", "a/b/c")})


def _shown(request: Payload) -> object:
    """Return a request as the audit has it; a large one by its size."""
    size = request.kept_size
    return json.loads(bytes(request.json())) if size <= _MAX_SHOWN_BYTES else f"{size} bytes"


def _require_plain_goal(gate: Gate, actor: Actor, action: str, payload: Payload) -> None:
    """Check that no rule needs to see a goal that is sent as a message or a service call.

    Raises:
        GateRefused: a rule limits goals of the action or requires approval, the emergency stop is pressed, or
            a number is not finite.
    """
    gate.rules.require("goal", action)
    for rule in gate.rules.of("goal", action):
        if not rule.holds_for(actor.role):
            continue
        gate.require_released(rule)
        settings = rule.settings
        if settings.emergency:
            gate.note_goal(action)
        if settings.fields or settings.approval or settings.largest_bytes:
            raise GateRefused(f"goals of {action} are only taken by `send_action_goal`", rule.key)
        gate.require_finite(rule, payload)
