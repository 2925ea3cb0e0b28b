"""The graph as one client may see it: what a gateway is given instead of the graph.

Every verb is checked here: the client's role, its quotas, and names in their canonical form. A gateway that
only translates cannot forget a rule, and there is no other way from it to the graph.
"""

from __future__ import annotations

from contextvars import copy_context
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING, Final, TypeVar, Union

from rwt.access.disclosure import restrict, written_parameters
from rwt.access.errors import GateRefused, NotAllowed, QuotaExceeded
from rwt.access.graph_view import GraphView, canonical
from rwt_graph.accounts import WORK_ACCOUNT
from rwt_graph.names import resolve
from rwt_graph.parameters.accounts import ACCOUNT
from rwt_participant.errors import CallFailed, NotFound, ParameterRejected, ProviderNotFound
from rwt_participant.goals import GoalStatus

if TYPE_CHECKING:
    from collections.abc import Callable, Hashable, Iterator, Sequence, Set

    from rwt.access.disclosure import Disclosures, OutcomeFilter
    from rwt.access.gate.client_gate import ClientGate, GatedPublisher, Needed
    from rwt.access.quotas import Charge, ClientQuotas, Quota
    from rwt.access.roles import Act, Role
    from rwt.delivery.counters import Counters
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
    from rwt_interfaces.structs import ActionType, MessageType, ServiceType
    from rwt_participant.qos import QoS


T = TypeVar("T")
C = TypeVar("C")

#: Bytes of a request that count as a call alone: `limits.calls` bounds how many there are.
_SMALL: Final = 1024

#: The mark of a client that publishes without having advertised (UNA-05).
_IMPLICIT: Final = object()


class UnknownTopicType(NotFound):
    """A topic that nobody has advertised, and whose type is not given either."""


class _Call:
    """One call of a client under way; called with its outcome. It is the account of who answers it, too
    (:class:`rwt_graph.accounts.WorkAccount`), and stays charged for as long as that one needs it."""

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
        self._held = 1  # by the client, and by programs that are at work for it
        self.pending: PendingCall | None = None

    def hold(self, size: int) -> Callable[[], None]:
        """Stay charged until what is returned is called; the size of the request is charged already."""
        if not self._held:
            return _nothing
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
        """Forget the call, whose client leaves."""
        if self.pending is not None:
            self.pending.cancel()
        self._release()


def _nothing() -> None:
    """What is given back by who holds nothing."""


class GoalAccount:
    """The account of one client's goals that are sent as messages (ALB-01); satisfies
    :class:`rwt_graph.accounts.WorkAccount`."""

    __slots__ = ("_quotas",)

    def __init__(self, quotas: ClientQuotas) -> None:
        self._quotas = quotas

    def hold(self, size: int) -> Callable[[], None]:
        """Charge a goal of so many bytes until what is returned is called.

        Raises:
            CallFailed: the client has as many calls and goals under way, or as many bytes kept, as it may.
        """
        charges: list[Charge] = []

        def release() -> None:
            for charge in charges:
                charge.end()

        try:
            charges.append(self._quotas.calls.take())
            charges.append(self._quotas.kept.take(size))
        except QuotaExceeded as exceeded:
            release()
            raise CallFailed(str(exceeded)) from None
        return release


class GoalMessages:
    """A publisher of a topic whose messages are goals, for one client: goals that run are charged to it."""

    __slots__ = ("_account", "_inner", "counts", "topic", "type")

    def __init__(self, inner: SharedPublisher | LatchedPublisher, account: GoalAccount) -> None:
        self._inner = inner
        self._account = account
        self.topic = inner.topic
        self.type = inner.type
        self.counts = inner.counts

    def publish(self, payload: Payload) -> None:
        """Hand on a goal.

        Raises:
            QuotaExceeded: it would be kept, and as many bytes are kept for the client as may be.
        """
        asker = WORK_ACCOUNT.set(self._account)
        try:
            self._inner.publish(payload)
        finally:
            WORK_ACCOUNT.reset(asker)


class _ParameterAccount:
    """The account of one client's parameters."""

    __slots__ = ("_quota",)

    def __init__(self, quota: Quota) -> None:
        self._quota = quota

    def charge(self, amount: int, replaced: object) -> Charge:
        """Keep so many bytes for the client.

        Raises:
            ParameterRejected: it has set as many as it may.
        """
        try:
            return self._quota.exchange(replaced, amount)
        except QuotaExceeded as exceeded:
            raise ParameterRejected(str(exceeded)) from None


class LatchedPublisher:
    """A shared publisher of a latched topic, for one client: what it keeps is charged to who published it."""

    __slots__ = ("_kept", "_shared", "counts", "topic", "type")

    def __init__(self, shared: SharedPublisher, kept: Quota) -> None:
        self._shared = shared
        self._kept = kept
        self.topic = shared.topic
        self.type = shared.type
        self.counts = shared.counts

    def publish(self, payload: Payload) -> None:
        """Hand on a message.

        Raises:
            QuotaExceeded: as many bytes are kept for the client as may be.
        """
        replaced = self._shared.kept_next_to_go
        self._shared.publish_kept(payload, self._kept.exchange(replaced, payload.kept_size))


ClientPublisher = Union["SharedPublisher", LatchedPublisher, GoalMessages, "GatedPublisher"]
"""What a client publishes on."""


class ClientGraph(GraphView):
    """The graph as one client may see it and act on it.

    Args:
        shared: the gateway's part in the graph.
        role: the client's.
        quotas: how much the client may hold.
        disclosures: what services reveal, by the name of their type.
        setting_parameters: types of services whose calls set parameters.
        gate: what the client's acts have to pass; None: nothing.
        reserved: topics on which no client publishes, see :meth:`rwt.access.access.Access.reserve`.
    """

    def __init__(
        self,
        shared: SharedGraph,
        role: Role,
        quotas: ClientQuotas,
        disclosures: Disclosures,
        setting_parameters: frozenset[str],
        gate: ClientGate | None = None,
        reserved: Set[str] = frozenset(),
    ) -> None:
        super().__init__(shared.graph, role, quotas.work)
        self._reserved = reserved
        self._shared = shared
        self._gate = gate
        self._disclosures = disclosures
        self._setting_parameters = setting_parameters
        self._advertised: dict[str, dict[Hashable, Charge]] = {}
        self._services: dict[str, tuple[Registration, Charge]] = {}
        self._actions: dict[str, tuple[Registration, Charge]] = {}
        self._calls: set[_Call] = set()
        self._quotas = quotas
        self._parameters = _ParameterAccount(quotas.parameters)
        self._subscriptions: list[Charge] = []

    def take_role(self, role: Role) -> None:
        """Act as another role from now on. What is open stays open; publishers have to be asked for again."""
        self.role = role
        self._named_at = -1
        if self._gate is not None:
            self._gate.take_role(role)

    @property
    def gate_name(self) -> str:
        """What the gate calls this client, in leases and requests for a yes; empty where there is no gate."""
        return "" if self._gate is None else self._gate.name

    def lease_seconds(self, topic: str) -> float | None:
        """Silence after which this client loses the gate's lease of a topic; None where there is none, and
        where its role may not publish there."""
        if self._gate is None or not self.role.allows("publish", canonical(topic)):
            return None
        return self._gate.lease_seconds(topic)

    def require(self, act: Act, name: str) -> str:
        """As :meth:`GraphView.require`; refusals are noted by the gate."""
        try:
            return super().require(act, name)
        except NotAllowed as refused:
            if self._gate is not None:
                self._gate.note_refusal(act, resolve(name), str(refused))
            raise

    def sees_service(self, name: str) -> bool:
        """As :meth:`GraphView.sees_service`; those of the gate are open to every role, and so shown."""
        return super().sees_service(name) or (self._gate is not None and self._gate.is_own(name))

    def withdraw_refused(self) -> None:
        """End what the client publishes and offers and its role does not allow."""
        for topic, marks in tuple(self._advertised.items()):
            if not self.role.allows("publish", topic):
                self._release(topic, tuple(marks))
        for service in tuple(self._services):
            if not self.role.allows("provide", service):
                self.withdraw_service(service)
        for action in tuple(self._actions):
            if not self.role.allows("provide", action):
                self.withdraw_action(action)

    @property
    def counters(self) -> Counters:
        """What the client's gateway counts."""
        return self._shared.counters

    @property
    def calls_in_flight(self) -> int:
        """Service calls that wait for their answer."""
        return len(self._calls)

    @property
    def kept_bytes(self) -> int:
        """Bytes that the server keeps for the client (`limits.kept_bytes`)."""
        return self._quotas.kept.held

    def keep(self, size: int) -> Charge:
        """Charge the client for bytes that its gateway keeps for it, until the charge ends.

        Raises:
            QuotaExceeded: as many bytes are kept for the client as may be.
        """
        return self._quotas.kept.take(size)

    # Topics

    def advertise(
        self, topic: str, type: str, mark: Hashable, qos: QoS | None = None, lacks: Lacks | None = None
    ) -> str:
        """Become a publisher of a topic, under a mark of the client's own; returns the topic's absolute name.

        Args:
            topic: its name.
            type: its type's name.
            mark: one advertisement is one mark; the same again changes it.
            qos: policies of a new publisher; None for the graph's own.
            lacks: see :meth:`rwt.delivery.shared_publishers.SharedPublishers.acquire`.

        Raises:
            NotAllowed: the role may not publish on the topic.
            GateRefused: it would be latched, and a rule of the gate stops what moves by the topic.
            QuotaExceeded: the client advertises as much as it may.
            UnknownType: no such message is known.
            TypeConflict, IncompatiblePolicies: the topic has another type, or other policies.
        """
        name = self._require_publish(topic, qos)
        self._acquire(name, self.registry.message(type), mark, qos, lacks)
        return name

    def _require_publish(self, topic: str, qos: QoS | None) -> str:
        name = self.require("publish", topic)
        if name in self._reserved:
            raise NotAllowed(f"{name} is published by the server alone")
        if self._gate is not None:
            self._gate.check_publisher(name, qos)
        return name

    def unadvertise(self, topic: str, mark: Hashable = None) -> bool:
        """Take one advertisement back, or all of this client's for the topic; whether it advertises it.

        A topic that it only publishes on stays its own until it leaves (UNA-05).
        """
        name = resolve(topic)
        advertised = [each for each in self._advertised.get(name, ()) if each is not _IMPLICIT]
        self._release(name, [each for each in advertised if mark is None or each == mark])
        return bool(advertised)

    def _release(self, name: str, dropped: Sequence[Hashable]) -> None:
        marks = self._advertised.get(name, {})
        for each in dropped:
            # A publisher outlives its last user, and counts as long.
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
        """What publishes on a topic, for a client that may not have advertised it (UNA-05).

        The right to publish is decided here and not for each message: whoever keeps the publisher drops it
        after :meth:`take_role` and :meth:`unadvertise`.

        Args:
            topic: its name.
            type: its type's name; None takes the one that the graph knows.
            mark: under which the client can take back what it advertises thereby (UNA-06); None: not before
                it leaves.
            qos, lacks: as of :meth:`advertise`.

        Raises:
            NotAllowed: the role may not publish on the topic.
            UnknownTopicType: the topic has no type yet, and none is given.
            GateRefused: as :meth:`advertise`, or rules of the gate know the topic with another type.
            QuotaExceeded, UnknownType, TypeConflict: as :meth:`advertise`.
        """
        name = self._require_publish(topic, qos)
        marks = self._advertised.get(name)
        known = next(iter(marks)) if marks else _IMPLICIT if mark is None else mark
        shared = self._acquire(name, self._type_of(name, type), known, qos, lacks)
        kept = LatchedPublisher(shared, self._quotas.kept) if shared.keeps_samples else shared
        is_goal = shared.type.name.endswith("ActionGoal")
        publisher = GoalMessages(kept, GoalAccount(self._quotas)) if is_goal else kept
        return publisher if self._gate is None else self._gate.publisher(publisher)

    def _acquire(
        self, name: str, type: MessageType, mark: Hashable, qos: QoS | None, lacks: Lacks | None = None
    ) -> SharedPublisher:
        publishers, quota = self._shared.publishers, self._quotas.advertisements
        known = self._advertised.get(name, {}).get(mark)
        # A publisher of this client that lingers is taken up again, at the same cost.
        charge = known or quota.exchange(publishers.lingering(name), 1)
        try:
            publisher = publishers.acquire(name, type, qos, (self, mark), lacks)
        except BaseException:
            if known is None:
                publishers.linger_for(name, charge)
            raise
        self._advertised.setdefault(name, {})[mark] = charge
        return publisher

    def subscribe(self, topic: str, type: str | None, *, is_new: bool = True) -> Fanout:
        """The fan-out of a topic, on which samples are taken by joining it.

        Args:
            topic: its name.
            type: its type's name; None takes the one that the graph knows.
            is_new: whether this is one more subscription, and no change of one; it is counted until
                :meth:`unsubscribe`.

        Raises:
            NotAllowed: the role may not subscribe to the topic.
            QuotaExceeded: the client has as many subscriptions as it may.
            UnknownTopicType: the topic has no type yet, and none is given.
            UnknownType: no such message is known.
            TypeConflict: the topic has another type.
        """
        name = self.require("subscribe", topic)
        if is_new:
            self._subscriptions.append(self._quotas.subscriptions.take())
        try:
            return self._shared.fanout(name, self._type_of(name, type))
        except BaseException:
            if is_new:
                self._subscriptions.pop().end()
            raise

    def unsubscribe(self, fanout: Fanout, count: int = 1) -> None:
        """End some subscriptions on a fan-out, which ends with its last listener."""
        for _ in range(count):
            self._subscriptions.pop().end()
        self._shared.release(fanout)

    def late_sends(self, topic: str) -> Iterator[None]:
        """What is still to be done of the samples of a topic, to be sent to its readers, in steps."""
        fanout = self._shared.fanouts.get(topic)
        if fanout is not None:
            yield from fanout.late.steps()

    def startup_samples(self, fanout: Fanout) -> tuple[Sample, ...]:
        """The samples of the first second of the publisher of a topic that is subscribed (ADV-08)."""
        return self._shared.publishers.startup_samples(fanout.topic)

    def _type_of(self, name: str, type: str | None) -> MessageType:
        if type:
            return self.registry.message(type)
        info = self._graph.topic(name)
        if info is None or info.type is None:
            raise UnknownTopicType(f"cannot infer the type of {name}, which nobody has advertised")
        return info.type

    # Services

    def call_service(
        self,
        service: str,
        request: Callable[[ServiceType], Payload],
        on_reply: OnReply,
        timeout: float | None = None,
    ) -> None:
        """Call a service; what the answer lists is filtered by the client's role.

        Args:
            service: its name.
            request: makes the request, of the service's type.
            on_reply: called once with the outcome, unless the client leaves before.
            timeout: seconds; None waits without end.

        Raises:
            NotAllowed: the role may not call the service, or not what the request asks of it.
            GateRefused: a rule of the gate does not let the call through.
            ProviderNotFound: nobody offers the service.
            QuotaExceeded: as many calls and goals of the client are under way as may be.
        """
        gate = self._gate
        is_gates = gate is not None and gate.is_own(resolve(service))
        name = resolve(service) if is_gates else self.require("call", service)
        info = self._graph.service(name)
        if info is None:
            raise ProviderNotFound(f"Service {name} does not exist")
        quotas = self._quotas
        quotas.calls.add(1)
        needed: Needed = []
        written: list[str] = []
        try:
            payload, filtered = request(info.type), None
            if not self.role.unrestricted:
                payload, filtered = restrict(self, self._disclosures, name, info.type, payload)
            if gate is not None and not is_gates:
                if info.type.name in self._setting_parameters:
                    written = written_parameters(self._disclosures, name, info.type, payload)
                payload, needed = gate.check_call(name, info.type, payload, written)
            size = payload.kept_size
            if size > _SMALL:
                quotas.kept.add(size)
            else:
                size = 0
        except BaseException:
            quotas.calls.held -= 1
            raise
        call = _Call(self._calls, quotas, size, on_reply, filtered)
        self._calls.add(call)
        self._shared.counters.calls += 1
        if gate is None:
            call.pending = self._send(info, payload, call, timeout)
        elif is_gates:
            call.pending = gate.as_caller(partial(self._send, info, payload, call, timeout))
        else:
            self._send_through(gate, info, payload, call, timeout, needed, written)

    def _send(self, info: ServiceInfo, payload: Payload, call: _Call, timeout: float | None) -> PendingCall:
        send = self._shared.participant.call_service
        asker = WORK_ACCOUNT.set(call)
        try:
            if info.type.name in self._setting_parameters:
                # Whatever answers it, at once or in a task, sets them on the client's account.
                context = copy_context()
                context.run(ACCOUNT.set, self._parameters)
                return context.run(send, info.name, payload, call, timeout)
            return send(info.name, payload, call, timeout)
        finally:
            WORK_ACCOUNT.reset(asker)

    def _send_through(
        self,
        gate: ClientGate,
        info: ServiceInfo,
        payload: Payload,
        call: _Call,
        timeout: float | None,
        needed: Needed,
        written: list[str],
    ) -> None:
        """Make a call that the gate lets through, or let it wait for a person's yes."""

        def send(kept: Payload) -> PendingCall:
            now = self._graph.service(info.name)
            if now is not None and now.type is not info.type:
                raise GateRefused(f"{info.name} is of another type now: call it again")
            self.role.require("call", info.name)
            gate.note_call(info.name, written)
            return self._send(info, kept, call, timeout)

        if needed:
            call.pending = gate.call(needed, payload, send, call)
        else:
            gate.note_call(info.name, written)
            call.pending = self._send(info, payload, call, timeout)

    def advertise_service(
        self, service: str, type: str, on_call: Callable[[ServiceType, ServiceCall], None]
    ) -> str:
        """Offer a service, in place of any other of that name; returns its absolute name.

        Raises:
            NotAllowed: the role may not provide the service, or not in the place of the robot's own.
            QuotaExceeded: the client offers as much as it may.
            UnknownType: no such service is known.
        """
        interface = self.registry.service(type)
        advertise = self._shared.participant.advertise_service
        return self._offer(self._services, service, interface, self._graph.service, advertise, on_call)

    def withdraw_service(self, service: str) -> bool:
        """Withdraw a service of this client; whether there was one. Its calls in flight fail."""
        return self._withdraw(self._services, resolve(service))

    # Actions

    def send_goal(self, action: str, goal: Callable[[ActionType], Payload], events: GoalEvents) -> ClientGoal:
        """Send a goal.

        Args:
            action: the name of the action.
            goal: makes the goal, of the action's type.
            events: what the client hears.

        Raises:
            NotAllowed: the role may not send goals to the action.
            GateRefused: a rule of the gate does not let the goal through.
            ProviderNotFound: nobody offers the action.
            QuotaExceeded: as many calls and goals of the client are under way as may be.
        """
        name = self.require("goals", action)
        info = self._graph.action(name)
        if info is None:
            raise ProviderNotFound(f"Action {name} does not exist")
        gate = self._gate
        charge = self._quotas.calls.take()
        needed: Needed = []
        try:
            payload = goal(info.type)
            if gate is not None:
                payload, needed = gate.check_goal(name, info.type, payload)
            kept = self._quotas.kept.take(payload.kept_size)
        except BaseException:
            charge.end()
            raise

        def on_result(status: GoalStatus, outcome: Payload | CallFailed) -> None:
            charge.end()
            kept.end()
            events.on_result(status, outcome)

        self._shared.counters.goals += 1
        if gate is None:
            return self._shared.participant.send_goal(name, payload, replace(events, on_result=on_result))

        def send(goal_id: str, payload: Payload) -> ClientGoal:
            self.role.require("goals", name)  # It may have waited, and the role be another.

            heard = replace(events, on_result=on_result)
            return self._shared.participant.send_goal(name, payload, heard, goal_id)

        return gate.send_goal(name, needed, payload, send, partial(on_result, GoalStatus.UNKNOWN))

    def cancel_goal(self, action: str, goal_id: str) -> None:
        """Ask to cancel a goal that anybody sent, by its id.

        Raises:
            NotAllowed: the role may not send goals to the action.
        """
        self._shared.participant.cancel_goal(self.require("goals", action), goal_id)

    def advertise_action(
        self, action: str, type: str, on_goal: Callable[[ActionType, ServerGoal], None]
    ) -> str:
        """Offer an action, in place of any other of that name; returns its absolute name.

        Raises:
            NotAllowed: the role may not provide the action, or not in the place of the robot's own.
            QuotaExceeded: the client offers as much as it may.
            UnknownType: no such action is known.
        """
        interface = self.registry.action(type)
        advertise = self._shared.participant.advertise_action
        return self._offer(self._actions, action, interface, self._graph.action, advertise, on_goal)

    def withdraw_action(self, action: str) -> bool:
        """Withdraw an action of this client; whether there was one. Its running goals are aborted."""
        return self._withdraw(self._actions, resolve(action))

    def _offer(
        self,
        offers: dict[str, tuple[Registration, Charge]],
        name: str,
        interface: T,
        find: Callable[[str], ServiceInfo | ActionInfo | None],
        advertise: Callable[[str, T, Callable[[C], None]], Registration],
        on_ask: Callable[[T, C], None],
    ) -> str:
        """Offer a service or an action; the client's own of the same name gives way to it."""
        absolute = self.require("provide", name)
        if self._gate is not None:
            self._gate.reserve_offer(absolute)
        present = find(absolute)
        gateway = self._shared.participant.name
        # All clients act as the gateway's node, whose own services are below its name.
        if present is not None and (present.node != gateway or absolute.startswith(f"{gateway}/")):
            self.role.require("displace", absolute)
        previous = offers.get(absolute)
        charge = self._quotas.advertisements.take() if previous is None else previous[1]
        try:
            offers[absolute] = (advertise(absolute, interface, partial(on_ask, interface)), charge)
        except BaseException:
            if previous is None:
                charge.end()
            raise
        if previous is not None:
            previous[0].close()
        return absolute

    def _withdraw(self, offers: dict[str, tuple[Registration, Charge]], name: str) -> bool:
        offered = offers.pop(name, None)
        if offered is None:
            return False
        registration, charge = offered
        charge.end()
        registration.close()
        return True

    # Leaving

    def leave(self) -> None:
        """Give back what it alone may use, and charge to its address what else it has, until that is given
        back."""
        if self._gate is not None:
            self._gate.close()
        self._quotas.leave()

    def close(self) -> None:
        """Leave, and give back everything at once."""
        self.leave()
        for _ in self.close_in_steps():
            pass

    def close_in_steps(self) -> Iterator[None]:
        """Give back publishers, services and actions, and forget the calls under way (DIS-02 … DIS-05): one
        in each step, after :meth:`leave`."""
        for service in tuple(self._services):
            self.withdraw_service(service)
            yield
        for action in tuple(self._actions):
            self.withdraw_action(action)
            yield
        for topic, marks in tuple(self._advertised.items()):
            self._release(topic, tuple(marks))
            yield
        for call in tuple(self._calls):
            call.cancel()
            yield
        self._calls.clear()
