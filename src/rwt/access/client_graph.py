"""Robot graph as one client may see it.

Gateways get this instead of the graph. Every call is checked against the client's role and quotas, with names
in canonical form. A gateway has no other access to the graph, so it cannot bypass a rule.
"""

from __future__ import annotations

from contextlib import ExitStack, contextmanager
from contextvars import copy_context
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final, Literal, NamedTuple, TypeVar, Union

from rwt.access.disclosure import Disclosures, OutcomeFilter, restrict, written_parameters
from rwt.access.errors import NotAllowed, QuotaExceeded
from rwt.access.graph_view import NOBODY, STOP, GraphView, canonical
from rwt_graph.accounts import ACCOUNT, ASKER, WORK_ACCOUNT
from rwt_graph.actions.names import SEND_GOAL
from rwt_graph.names import resolve
from rwt_interfaces.steps import Steps, finished
from rwt_participant.errors import CallFailed, NotFound, ParameterRejected, ProviderNotFound
from rwt_participant.goals import GoalStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence, Set

    from rwt.access.gate.approvals import Approval
    from rwt.access.gate.client_gate import ClientGate, GatedPublisher, GoalPublisher, Needed, StopPublisher
    from rwt.access.quotas import Charge, ClientQuotas, Quota
    from rwt.access.roles import Act, Role
    from rwt.delivery.counters import Counters, TopicCounts
    from rwt.delivery.fanout import Fanout
    from rwt.delivery.shared_graph import SharedGraph
    from rwt.delivery.shared_publishers import Lacks, SharedPublisher
    from rwt_graph.api import (
        ActionInfo,
        ClientGoal,
        GoalEvents,
        OnReply,
        PendingCall,
        Registration,
        Sample,
        ServerGoal,
        ServiceCall,
        ServiceInfo,
    )
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.point_clouds.wish import CloudWish
    from rwt_interfaces.structs import ActionType, MessageType, ServiceType
    from rwt_participant.qos import QoS
    from rwt_transports.shared_pool import Holder, Share

    OnEnded = Callable[[str, str, str], None]


T = TypeVar("T")
C = TypeVar("C")

_OfferKind = Literal["service", "action"]

#: Requests up to this size are not charged to `limits.kept_bytes`: `limits.calls` bounds their number.
_SMALL_BYTES: Final = 1024

#: Mark of a client that publishes without advertising (UNA-05).
_IMPLICIT: Final = object()


class UnknownTopicType(NotFound):
    """The type of the topic is not known, and none was given.

    Attributes:
        is_advertised: True if another program has advertised the topic, with an unknown type.
    """

    def __init__(self, topic: str, *, is_advertised: bool = False, problems: Sequence[str] = ()) -> None:
        text = f"cannot infer the type of {topic}, which nobody has advertised"
        if is_advertised:
            text = f"the type of {topic} is not known yet: its publisher is being asked; try again"
        super().__init__("; ".join(problems) or text)
        self.topic = topic
        self.is_advertised = is_advertised


class _Call:
    """Pending service call of a client; call it with the outcome.

    Also the account of the program that answers (:class:`rwt_graph.accounts.WorkAccount`): the charge lasts
    until the client and that program have released it.
    """

    __slots__ = ("_calls", "_filtered", "_held", "_on_reply", "_quotas", "_size", "pending")

    def __init__(
        self,
        calls: set[_Call],
        quotas: ClientQuotas,
        size: int,
        on_reply: OnReply,
        filtered: OutcomeFilter | None,
    ) -> None:
        self._calls = calls
        self._quotas = quotas
        self._size = size
        self._on_reply = on_reply
        self._filtered = filtered
        self._held = 1  # number of holders: the client, and programs that work for it
        self.pending: PendingCall | None = None

    def hold(self, size: int) -> Callable[[], None]:
        """Hold the charge until the returned function is called; the size is charged already."""
        if not self._held:
            return lambda: None
        self._held += 1
        return self._release

    def _release(self) -> None:
        self._held -= 1
        if not self._held:
            self._quotas.calls.held -= 1
            if self._size:
                self._quotas.kept.give_back(self._size)

    def __call__(self, outcome: Payload | CallFailed) -> None:
        self._calls.discard(self)
        self._release()
        if self._filtered is not None:
            outcome = self._filtered(outcome)
        self._on_reply(outcome)

    def cancel(self) -> None:
        if self.pending is not None:
            self.pending.cancel()
        self._release()


class WrappedPublisher:
    """Publisher of a client in front of another one."""

    __slots__ = ("_inner", "counts", "topic", "type")

    def __init__(self, inner: ClientPublisher) -> None:
        self._inner = inner
        self.topic: str = inner.topic
        self.type: MessageType = inner.type
        self.counts: TopicCounts = inner.counts


class GoalMessages(WrappedPublisher):
    """Publisher of an action's goal topic for one client; running goals are charged to the client (ALB-01).

    The program that runs the goals holds their charges with :meth:`hold` (:data:`rwt_graph.accounts.Hold`).
    """

    __slots__ = ("_holder", "_quotas")

    def __init__(self, inner: ClientPublisher, quotas: ClientQuotas, holder: Holder) -> None:
        super().__init__(inner)
        self._quotas = quotas
        self._holder = holder

    def hold(self, size: int) -> Callable[[], None]:
        """Charge a goal of `size` bytes until the returned function is called.

        Raises:
            CallFailed: `limits.calls` or `limits.kept_bytes` is reached.
        """
        with ExitStack() as charges:
            try:
                charges.callback(self._quotas.calls.take().end)
                charges.callback(self._quotas.kept.take(size).end)
            except QuotaExceeded as exceeded:
                raise CallFailed(str(exceeded)) from None
            return charges.pop_all().close

    def publish(self, payload: Payload) -> None:
        """Publish a goal.

        Raises:
            QuotaExceeded: the topic is latched, and `limits.kept_bytes` is reached.
        """
        account, asker = WORK_ACCOUNT.set(self.hold), ASKER.set(self._holder)
        try:
            self._inner.publish(payload)
        finally:
            WORK_ACCOUNT.reset(account)
            ASKER.reset(asker)


class LatchedPublisher(WrappedPublisher):
    """Publisher of a latched topic for one client; each retained message is charged to its sender."""

    __slots__ = ("_kept", "_shared")

    def __init__(self, shared: SharedPublisher, kept: Quota) -> None:
        super().__init__(shared)
        self._shared = shared
        self._kept = kept

    def publish(self, payload: Payload) -> None:
        """Publish a message.

        Raises:
            QuotaExceeded: `limits.kept_bytes` is reached.
        """
        replaced = self._shared.kept_next_to_go
        self._shared.publish_kept(payload, self._kept.exchange(replaced, payload.kept_size))


ClientPublisher = Union[
    "SharedPublisher", LatchedPublisher, GoalMessages, "GatedPublisher", "GoalPublisher", "StopPublisher"
]
"""Publisher of a client."""


class ServerPolicy(NamedTuple):
    """Rules that hold for all clients of a server.

    Attributes:
        disclosures: declarations of what services reveal, by service type.
        setting_parameters: service types whose calls set parameters.
        reserved: topics that clients cannot publish on, see :meth:`rwt.access.access.Access.reserve`.
    """

    disclosures: Disclosures
    setting_parameters: frozenset[str]
    reserved: Set[str]


class ClientGraph(GraphView):
    """Robot graph as one client may see and use it.

    Gateways get this instead of the graph. Every method checks the client's role, quotas and gate rules, with
    names in canonical form; every listing is filtered.

    Life cycle::

        active ──leave()──> left ──its steps──> closed
           └──close()───────────────────────────────^

    * **active**: from the constructor on. :meth:`take_role` replaces the role; what is open stays open until
      :meth:`withdraw_refused`, and cached publishers must be requested again.
    * **left**: leases and requests for approval are released. What the client still has is charged to its
      address.
    * **closed**: publishers, services, actions and calls are released.

    Attributes by purpose:

    * Policy: ``role``, ``_decisions``, ``_quotas``, ``_gate``, ``_policy``.
    * Graph: ``_graph`` (from `GraphView`), ``_shared`` (publishers, fan-outs and counters of the gateway).
    * What the client holds, each with the charge that counts it: ``_advertised`` (by topic and mark), and
      ``_offers`` (services and actions, by kind and name).
    * In progress: ``_calls``. Goals hold their own charges.
    * What the robot displaces: ``_on_ended`` is told, see :meth:`tell_ended`.

    Args:
        policy: rules that hold for all clients.
        gate: gate of the client; None if the server has no gate.
        decisions: permission by verb; verbs without are rejected.
    """

    def __init__(
        self,
        shared: SharedGraph,
        role: Role,
        quotas: ClientQuotas,
        policy: ServerPolicy,
        gate: ClientGate | None,
        decisions: Mapping[str, Act],
        holder: Holder = NOBODY,
    ) -> None:
        open_services = frozenset[str]() if gate is None else gate.open_services
        super().__init__(shared.graph, role, quotas.work, open_services=open_services, holder=holder)
        self._policy = policy
        self._decisions = decisions
        self._shared = shared
        self._gate = gate
        self._advertised: dict[str, dict[Hashable, Charge]] = {}
        self._offers: dict[tuple[_OfferKind, str], tuple[Registration, Charge]] = {}
        self._calls: set[_Call] = set()
        self._quotas = quotas
        self._on_ended: OnEnded | None = None

    def take_role(self, role: Role) -> None:
        """Switch to another role. What is open stays open; callers must request publishers again."""
        self.role = role
        self.holder = self.holder._replace(credential=role.credential)
        self._names_version = -1
        if self._gate is not None:
            self._gate.take_role(role)

    @property
    def is_stop_due(self) -> bool:
        """True if this client can press the emergency stop now.

        Gateways then run a message that presses it ahead of all that waits.
        """
        return self._gate is not None and self._gate.is_stop_due

    @property
    def is_stopped(self) -> bool:
        """True while the emergency stop is pressed."""
        return self._gate is not None and self._gate.is_stopped

    def tell_notices(self, on_notice: Callable[[str], None]) -> None:
        """Call `on_notice` with what the gate does to the client's commands, such as clamping or waiting."""
        if self._gate is not None:
            self._gate.actor.on_notice = self._gate.actor.on_approval = on_notice

    def tell_ended(self, on_ended: OnEnded) -> None:
        """Call `on_ended` after something that the client advertises has ended, with kind, name and reason.

        The kinds are `topic`, `service` and `action`. They end if the robot uses the topic with another type,
        or offers the service or action: what a client advertises does not stand in the robot's way.
        Publishers of the topic must not be used any more.
        """
        self._on_ended = on_ended

    def approval_of(self, pending: PendingCall | ClientGoal | None) -> Approval | None:
        """Return the request for approval that a call or goal waits for; None if it waits for none."""
        return None if self._gate is None else self._gate.approval_of(pending)

    @contextmanager
    def notices(self) -> Iterator[list[str]]:
        """Collect what the gate does to the commands within a block, which must not wait for anything."""
        found: list[str] = []
        if self._gate is None:
            yield found
            return
        actor = self._gate.actor
        before, actor.on_notice = actor.on_notice, found.append
        try:
            yield found
        finally:
            actor.on_notice = before

    @property
    def gate_name(self) -> str:
        """Name of this client in leases and requests for approval; empty without a gate."""
        return "" if self._gate is None else self._gate.actor.name

    def lease_seconds(self, topic: str) -> float | None:
        """Return the seconds of silence after which this client loses the lease of a topic.

        None if the topic has no lease, or if the role may not publish on it.
        """
        if self._gate is None or not self.role.allows("publish", canonical(topic)):
            return None
        return self._gate.lease_seconds(topic)

    def require(self, act: Act, name: str) -> str:
        """Like :meth:`GraphView.require`, and record rejections in the gate's audit."""
        absolute = resolve(name)
        if (act == "call" and absolute in self._open_services) or (
            act == "publish" and self._gate is not None and self._gate.is_stop_topic(absolute)
        ):
            return absolute  # The gate itself decides.
        if not self.role.unrestricted:
            try:
                self.role.require(act, absolute)
            except NotAllowed as refused:
                if self._gate is not None:
                    self._gate.note_refusal(act, absolute, str(refused))
                raise
        return absolute

    def _admit(self, verb: str, name: str) -> str:
        """Return the absolute form of a name. Raises NotAllowed unless decisions and role allow the verb."""
        act = self._decisions.get(verb)
        if act is None:
            raise NotAllowed(f"{verb} is not declared for this gateway (rwt.access.decisions)")
        return self.require(act, name)

    def withdraw_refused(self) -> None:
        """Withdraw what the client's role no longer allows, and tell it why (:meth:`tell_ended`)."""
        on_ended = self._on_ended or (lambda kind, name, reason: None)
        for topic, marks in tuple(self._advertised.items()):
            if reason := self._refusal("publish", topic):
                self._release(topic, tuple(marks))
                on_ended("topic", topic, reason)
        for kind, name in tuple(self._offers):
            if reason := self._refusal("provide", name):
                self._withdraw(kind, name)
                on_ended(kind, name, reason)

    def _refusal(self, act: Act, name: str) -> str:
        """Return why the role does not allow what it allowed before; empty if it does."""
        try:
            self.role.require(act, name)
        except NotAllowed as refused:
            return f"the settings have changed: {refused}"
        return ""

    def why_not_subscribe(self, topic: str) -> str:
        """Return why a subscription has to end after a change of role; empty if it may stay."""
        return "" if self.may_subscribe(topic) else self._refusal("subscribe", resolve(topic))

    @property
    def counters(self) -> Counters:
        """Counters of the client's gateway."""
        return self._shared.counters

    @property
    def calls_in_flight(self) -> int:
        """Number of pending service calls."""
        return len(self._calls)

    @property
    def kept_bytes(self) -> int:
        """Bytes that the server keeps for the client (`limits.kept_bytes`)."""
        return self._quotas.kept.held

    def keep(self, size: int) -> Charge:
        """Charge `size` bytes that the gateway keeps for the client, until the charge ends.

        Raises:
            QuotaExceeded: `limits.kept_bytes` is reached.
        """
        return self._quotas.kept.take(size)

    # Topics

    def advertise(
        self, topic: str, type: str, mark: Hashable, qos: QoS | None = None, lacks: Lacks | None = None
    ) -> str:
        """Advertise a topic and return its absolute name.

        Args:
            mark: identifies the advertisement; the same mark replaces it.
            qos: policies for a new publisher; None for the graph's default.
            lacks: see :meth:`rwt.delivery.shared_publishers.SharedPublishers.acquire`.

        Raises:
            NotAllowed: the role may not publish on the topic.
            GateRefused: the QoS is latched, and a gate rule defines a stop message for the topic.
            QuotaExceeded: `limits.advertisements` is reached.
            UnknownType: the message type is unknown.
            TypeConflict, IncompatiblePolicies: the topic has another type, or other policies.
        """
        name = self._require_publish("advertise", topic, qos)
        if self._gate is None or not self._gate.is_stop_topic(name):
            self._acquire(name, self._named_type(name, type), mark, qos, lacks)
        return name

    def _require_publish(self, verb: str, topic: str, qos: QoS | None) -> str:
        name = self._admit(verb, topic)
        if name in self._policy.reserved:
            raise NotAllowed(f"{name} is published by the server alone")
        if self._gate is not None:
            self._gate.check_publisher(name, qos)
        return name

    def advertises(self, topic: str) -> bool:
        """Return True if the client is a publisher of the topic with that absolute name."""
        return topic in self._advertised

    def unadvertise(self, topic: str, mark: Hashable = None) -> bool:
        """Withdraw one advertisement, or all of this client for the topic. Returns False if it had none.

        A topic that was published without advertising is kept until the client leaves (UNA-05).
        """
        name = resolve(topic)
        advertised = [each for each in self._advertised.get(name, ()) if each is not _IMPLICIT]
        self._release(name, [each for each in advertised if mark is None or each == mark])
        return bool(advertised)

    def _release(self, name: str, dropped: Sequence[Hashable]) -> None:
        marks = self._advertised.get(name, {})
        for each in dropped:
            # The shared publisher lingers after its last user, and stays charged.
            self._shared.publishers.release(name, (self, each), marks.pop(each))
        if dropped and not marks:
            del self._advertised[name]
            if self._gate is not None:
                self._gate.leave_topic(name)

    def publisher(
        self,
        topic: str,
        type: str | None,
        mark: Hashable = None,
        qos: QoS | None = None,
        lacks: Lacks | None = None,
    ) -> ClientPublisher:
        """Return a publisher for a topic, which need not be advertised (UNA-05).

        Permission is checked here, not for each message. Callers must drop the publisher after
        :meth:`take_role` and :meth:`unadvertise`.

        Args:
            type: name of its message type; None for the type that the graph knows.
            mark: mark for :meth:`unadvertise` (UNA-06); None: the topic is kept until the client leaves.
            qos, lacks: as for :meth:`advertise`.

        Raises:
            NotAllowed: the role may not publish on the topic.
            UnknownTopicType: the topic has no type yet, and none is given.
            GateRefused: as for :meth:`advertise`, or the gate knows the topic with another type.
            QuotaExceeded, UnknownType, TypeConflict: as for :meth:`advertise`.
        """
        name = self._require_publish("publisher", topic, qos)
        if self._gate is not None and self._gate.is_stop_topic(name):
            return self._gate.stop_publisher(self._shared.counters)
        marks = self._advertised.get(name)
        known = next(iter(marks)) if marks else _IMPLICIT if mark is None else mark
        shared = self._acquire(name, self._type_of(name, type), known, qos, lacks)
        kept = LatchedPublisher(shared, self._quotas.kept) if shared.keeps_samples else shared
        is_goal = shared.type.name.endswith("ActionGoal")
        publisher = GoalMessages(kept, self._quotas, self.holder) if is_goal else kept
        return publisher if self._gate is None else self._gate.publisher(publisher)

    def _acquire(
        self, name: str, type: MessageType, mark: Hashable, qos: QoS | None, lacks: Lacks | None = None
    ) -> SharedPublisher:
        if self._gate is not None:
            self._gate.check_type(name, type)
        publishers, quota = self._shared.publishers, self._quotas.advertisements
        known = self._advertised.get(name, {}).get(mark)
        # A lingering publisher of this client is reused with its charge.
        charge = known or quota.exchange(publishers.lingering(name), 1)
        try:
            on_end = partial(self._publisher_ended, name, mark)
            publisher = publishers.acquire(name, type, qos, (self, mark), on_end, lacks)
        except BaseException:
            if known is None:
                publishers.linger_for(name, charge)
            raise
        self._advertised.setdefault(name, {})[mark] = charge
        return publisher

    def _publisher_ended(self, name: str, mark: Hashable, reason: str) -> None:
        marks = self._advertised[name]
        marks.pop(mark).end()
        if marks:
            return  # Told once, when the last one ends.
        del self._advertised[name]
        if self._gate is not None:
            self._gate.leave_topic(name)
        if self._on_ended is not None:
            self._on_ended("topic", name, reason)

    def subscribe(self, topic: str, type: str | None, *, is_new: bool = True) -> Fanout:
        """Return the fan-out of a topic; join it to receive samples.

        Args:
            type: name of its message type; None for the type that the graph knows.
            is_new: True for a new subscription, which counts until :meth:`unsubscribe`; False to change an
                existing one.

        The fan-out ends with the function given to :meth:`Fanout.join` if the robot gives the topic another
        type.

        Raises:
            NotAllowed: the role may not subscribe to the topic.
            GateRefused: a gate rule is about the topic, and the client would give it its type.
            QuotaExceeded: `limits.subscriptions` is reached.
            UnknownTopicType: the topic has no type yet, and none is given.
            UnknownType: the message type is unknown.
            TypeConflict: the topic has another type.
        """
        name = self._admit("subscribe", topic)
        if self._gate is not None:
            self._gate.check_subscriber(name)
        if self._gate is not None and type:
            self._gate.check_type(name, self.registry.message(type))
        if is_new:
            self._quotas.subscriptions.add(1)
        try:
            return self._shared.fanout(name, self._type_of(name, type))
        except BaseException:
            if is_new:
                self._quotas.subscriptions.give_back(1)
            raise

    def unsubscribe(self, fanout: Fanout, count: int = 1) -> None:
        """End `count` subscriptions on a fan-out; it closes with its last subscriber."""
        self._quotas.subscriptions.give_back(count)
        self._shared.release(fanout)

    def join_compact(
        self, fanout: Fanout, wish: CloudWish, on_end: Callable[[str], None]
    ) -> tuple[Fanout, Share] | None:
        """Return the fan-out of a topic's compact form, and the client's share of the work, which
        :meth:`leave_compact` returns; None if the topic has none.

        Raises:
            PoolFull: no client has more such subscriptions than this one.
        """
        forms = self._shared.compact
        return forms.join(fanout, wish, self.holder, on_end) if forms.has(fanout) else None

    def leave_compact(self, form: Fanout, wish: CloudWish, share: Share) -> None:
        """End a subscriber of a compact form, who has left the fan-out."""
        self._shared.compact.leave(form, wish, share)

    def late_sends(self, topic: str) -> Iterator[None]:
        """Encode and send the deferred samples of a topic, in steps."""
        fanout = self._shared.fanouts.get(topic)
        if fanout is not None:
            yield from fanout.late.steps()

    def startup_samples(self, fanout: Fanout) -> tuple[Sample, ...]:
        """Return the samples from the publisher's first second (ADV-08)."""
        return self._shared.publishers.startup_samples(fanout.topic)

    def _type_of(self, name: str, type: str | None) -> MessageType:
        if type:
            return self._named_type(name, type)
        info = self._graph.topic(name)
        if info is None or info.type is None:
            is_advertised = info is not None and bool(info.publishers)
            raise UnknownTopicType(name, is_advertised=is_advertised, problems=self.problems(name))
        return info.type

    def _named_type(self, name: str, type: str) -> MessageType:
        """Return the message type of that name; of a topic that has it, with the definition of the robot."""
        wanted = self.registry.message(type)
        info = self._graph.topic(name)
        return info.type if info and info.type and info.type.name == wanted.name else wanted

    # Services

    def call_service(
        self,
        service: str,
        request: Callable[[MessageType], Payload],
        on_reply: OnReply,
        timeout: float | None = None,
    ) -> PendingCall | None:
        """Call a service; listings in the response are filtered by the client's role.

        Args:
            request: creates the request, of the service's request type.
            on_reply: called once with the outcome, unless the client leaves first.
            timeout: seconds; None: no timeout.

        Returns:
            The pending call, for :meth:`approval_of`; None if it was answered at once.

        Raises:
            NotAllowed: the role may not call the service, or not with this request.
            GateRefused: a gate rule rejects the call.
            ProviderNotFound: the service does not exist.
            QuotaExceeded: `limits.calls` or `limits.kept_bytes` is reached.
        """
        gate = self._gate
        name = self._admit("call_service", service)
        is_gates = gate is not None and name in self._open_services
        info = self._graph.service(name)
        if info is None:
            raise ProviderNotFound("; ".join(self.problems(name)) or f"Service {name} does not exist")
        if gate is not None and is_gates and name == STOP:
            # Without quotas and accounts: nothing that the client does delays or rejects its stop.
            self._shared.counters.calls += 1
            on_reply(gate.stop(request(info.type.request), info.type))
            return None
        quotas = self._quotas
        quotas.calls.add(1)
        needed: Needed = []
        written: list[str] = []
        text = ""
        try:
            payload, filtered = request(info.type.request), None
            if not self.role.unrestricted:
                payload, filtered = restrict(self, self._policy.disclosures, name, info.type, payload)
            if gate is not None and not is_gates:
                if info.type.name in self._policy.setting_parameters:
                    written, text = written_parameters(self._policy.disclosures, name, info.type, payload)
                payload, needed = gate.check_call(name, info.type, payload, written, text)
            size = payload.kept_size
            if size > _SMALL_BYTES:
                quotas.kept.add(size)
            else:
                size = 0
        except BaseException:
            quotas.calls.held -= 1
            raise
        call = _Call(self._calls, quotas, size, on_reply, filtered)
        self._calls.add(call)
        self._shared.counters.calls += 1
        send = partial(self._send, info, call, timeout)
        if gate is None:
            call.pending = send(payload)
        elif is_gates:
            call.pending = gate.as_caller(partial(send, payload))
        else:
            call.pending = gate.call(info, needed, written, payload, send, call)
        return call.pending

    def _send(self, info: ServiceInfo, call: _Call, timeout: float | None, payload: Payload) -> PendingCall:
        send = self._shared.participant.call_service
        account, asker = WORK_ACCOUNT.set(call.hold), ASKER.set(self.holder)
        try:
            if info.type.name in self._policy.setting_parameters:
                # The handler, called now or in a task, sets parameters on the client's account.
                context = copy_context()
                context.run(ACCOUNT.set, self._charge_parameters)
                return context.run(send, info.name, payload, call, timeout)
            return send(info.name, payload, call, timeout)
        finally:
            WORK_ACCOUNT.reset(account)
            ASKER.reset(asker)

    def _charge_parameters(self, amount: int, replaced: object) -> Charge:
        """Charge the bytes of a parameter to the client that sets it, in place of the charge `replaced`.

        Raises:
            ParameterRejected: `limits.parameter_bytes` is reached.
        """
        try:
            return self._quotas.parameters.exchange(replaced, amount)
        except QuotaExceeded as exceeded:
            raise ParameterRejected(str(exceeded)) from None

    def advertise_service(
        self, service: str, type: str, on_call: Callable[[ServiceType, ServiceCall], None]
    ) -> str:
        """Offer a service, replacing any other of the same name. Returns its absolute name.

        Raises:
            NotAllowed: the role may not provide the service, or may not replace the robot's own.
            QuotaExceeded: `limits.advertisements` is reached.
            UnknownType: the service type is unknown.
        """
        interface = self.registry.service(type)
        advertise = self._shared.participant.advertise_service
        name = self._admit("advertise_service", service)
        return self._offer("service", name, interface, self._graph.service, advertise, on_call)

    def withdraw_service(self, service: str) -> bool:
        """Withdraw a service of this client; its pending calls fail. Returns False if there was none."""
        return self._withdraw("service", resolve(service))

    # Actions

    def send_goal(self, action: str, goal: Callable[[ActionType], Payload], events: GoalEvents) -> ClientGoal:
        """Send a goal.

        Args:
            goal: creates the goal of the action's type.

        Raises:
            NotAllowed: the role may not send goals to the action.
            GateRefused: a gate rule rejects the goal.
            ProviderNotFound: the action does not exist.
            QuotaExceeded: `limits.calls` or `limits.kept_bytes` is reached.
        """
        name = self._admit("send_goal", action)
        info = self._graph.action(name)
        if info is None:
            problems = self.problems(f"{name}{SEND_GOAL}")
            raise ProviderNotFound("; ".join(problems) or f"Action {name} does not exist")
        gate = self._gate
        needed: Needed = []
        with ExitStack() as charges:
            charges.callback(self._quotas.calls.take().end)
            payload = goal(info.type)
            if gate is not None:
                payload, needed = gate.check_goal(name, info.type, payload)
            charges.callback(self._quotas.kept.take(payload.kept_size).end)
            release = charges.pop_all().close

        def on_result(status: GoalStatus, outcome: Payload | CallFailed) -> None:
            release()
            events.on_result(status, outcome)

        self._shared.counters.goals += 1
        charged = replace(events, on_result=on_result)

        def send(goal_id: str | None, payload: Payload) -> ClientGoal:
            asker = ASKER.set(self.holder)
            try:
                return self._shared.participant.send_goal(name, payload, charged, goal_id)
            finally:
                ASKER.reset(asker)

        if gate is None:
            return send(None, payload)

        return gate.send_goal(name, needed, payload, send, partial(on_result, GoalStatus.UNKNOWN))

    def cancel_goal(self, action: str, goal_id: str) -> None:
        """Request cancellation of a goal of any sender, by its id.

        Raises:
            NotAllowed: the role may not send goals to the action.
        """
        self._shared.participant.cancel_goal(self._admit("cancel_goal", action), goal_id)

    def advertise_action(
        self, action: str, type: str, on_goal: Callable[[ActionType, ServerGoal], None]
    ) -> str:
        """Offer an action, replacing any other of the same name. Returns its absolute name.

        Raises:
            NotAllowed: the role may not provide the action, or may not replace the robot's own.
            QuotaExceeded: `limits.advertisements` is reached.
            UnknownType: the action type is unknown.
        """
        interface = self.registry.action(type)
        advertise = self._shared.participant.advertise_action
        name = self._admit("advertise_action", action)
        return self._offer("action", name, interface, self._graph.action, advertise, on_goal)

    def withdraw_action(self, action: str) -> bool:
        """Withdraw an action of this client; its goals are aborted. Returns False if there was none."""
        return self._withdraw("action", resolve(action))

    def _offer(
        self,
        kind: _OfferKind,
        absolute: str,
        interface: T,
        find: Callable[[str], ServiceInfo | ActionInfo | None],
        advertise: Callable[[str, T, Callable[[C], None]], Registration],
        on_ask: Callable[[T, C], None],
    ) -> str:
        """Offer a service or action, replacing the client's own of the same name."""
        if self._gate is not None:
            self._gate.reserve_offer(absolute)
        present = find(absolute)
        gateway = self._shared.participant.name
        # All clients act as the gateway's node; the gateway's own services have its name as prefix.
        if present is not None and (present.node != gateway or absolute.startswith(f"{gateway}/")):
            self.role.require("displace", absolute)
        previous = self._offers.get((kind, absolute))
        charge = self._quotas.advertisements.take() if previous is None else previous[1]
        try:
            offer = advertise(absolute, interface, partial(on_ask, interface))
        except BaseException:
            if previous is None:
                charge.end()
            raise
        self._offers[kind, absolute] = (offer, charge)
        offer.on_displaced = partial(self._offer_ended, kind, absolute, offer)
        if previous is not None:
            previous[0].close()
        return absolute

    def _offer_ended(self, kind: _OfferKind, name: str, offer: Registration, reason: str) -> None:
        present = self._offers.get((kind, name))
        if present is None or present[0] is not offer:
            return
        self._withdraw(kind, name)
        if self._on_ended is not None:
            self._on_ended(kind, name, reason)

    def _withdraw(self, kind: _OfferKind, name: str) -> bool:
        offered = self._offers.pop((kind, name), None)
        if offered is None:
            return False
        registration, charge = offered
        charge.end()
        registration.close()
        return True

    # Closing

    def leave(self) -> Steps[None]:
        """Release the client's leases and requests, and charge what it still holds to its address.

        Returns:
            The release of services, actions, publishers and pending calls, one per step (DIS-02 … DIS-05).
        """
        self._on_ended = None
        if self._gate is not None:
            self._gate.close()
            # The gateway's client refers to this graph, and would live until a full garbage collection.
            self._gate.actor.on_notice = self._gate.actor.on_approval = None
        self._quotas.leave()
        return self._release_all()

    def close(self) -> None:
        """Leave, and release everything at once."""
        finished(self.leave())

    def _release_all(self) -> Steps[None]:
        for offer in tuple(self._offers):
            self._withdraw(*offer)
            yield
        for topic, marks in tuple(self._advertised.items()):
            self._release(topic, tuple(marks))
            yield
        for call in tuple(self._calls):
            call.cancel()
            yield
        self._calls.clear()
