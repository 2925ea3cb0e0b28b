"""Minimal backend as another distribution would write it: two graphs linked by a queue in the process.

It imports public modules only: `rwt_graph.backend` and those beside it. Whatever crosses the queue is bytes,
names and numbers, as on a wire.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from itertools import count

import anyio
import anyio.lowlevel

from rwt_graph import SimulatedClock
from rwt_graph.api import OnReply, PendingCall, Sample, ServiceInfo
from rwt_graph.backend import (
    DistributedGraph,
    EndpointTypes,
    Limitation,
    MemoryCall,
    MemoryParticipant,
    MemoryProvider,
    MemoryPublisher,
    MemorySubscription,
    NodeResources,
    RemoteEndpoint,
    RemoteServiceTable,
    Ros2Actions,
    Topic,
    TransientLocalCache,
)
from rwt_interfaces.payload import Payload
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType
from rwt_participant.errors import CallFailed, ProviderGone, ServiceFailed
from rwt_participant.qos import Durability, QoS
from tests.contract.graph.harness import Harness
from tests.contract.graph.paired import PairedGraph


class QueueGraph(DistributedGraph):
    """Graph that is linked to another one while both run.

    Attributes:
        other: graph at the other end of the queue.
        queued: number of calls in the queue to this graph.
    """

    limitations = frozenset((Limitation.PARAMETER_TREE,))
    other: QueueGraph

    def __init__(self, registry: Registry, clock: SimulatedClock) -> None:
        super().__init__(registry, clock)
        self.is_linked = False
        self.queued = 0
        self.topics_of_other = QueueTopics(self)
        self.services_of_other = QueueServices(self)
        actions = Ros2Actions(self.topic_table, self.service_table, self.services_of_other, registry)
        self.set_remotes(self.topics_of_other, self.services_of_other, actions)

    def post(self, call: Callable[[], None]) -> None:
        """Put a call into the queue to the other graph."""
        other = self.other

        def carry_out() -> None:
            other.queued -= 1
            if other.is_linked:
                call()

        if self.is_linked:
            other.queued += 1
            other.run_on_graph(carry_out)

    async def join(self) -> None:
        self.is_linked = True
        if self.other.is_linked:
            self.other.announce()
            self.announce()

    def announce(self) -> None:
        """Announce what exists."""
        for participant in self.participants:
            self.post(partial(self.other.node_joined, participant.name))
        for topic in self.topic_table.all():
            self.topics_of_other.changed(topic)
        for provider in self.service_table:
            self.services_of_other.offered(provider)

    async def leave(self) -> None:
        self.is_linked = False
        self.services_of_other.close()

    def participant(self, name: str, *, for_clients: bool = False) -> MemoryParticipant:
        made = super().participant(name, for_clients=for_clients)
        self.post(partial(self.other.node_joined, name))
        return made

    def left(self, participant: MemoryParticipant) -> None:
        super().left(participant)
        self.post(partial(self.other.node_left, participant.name))


class QueueTopics:
    """Endpoints of both sides."""

    def __init__(self, graph: QueueGraph) -> None:
        self._graph = graph
        self._types = EndpointTypes(graph.registry)
        self._numbers = count()
        # Number of each announced endpoint, with its topic and the type that was announced.
        self._own: dict[MemoryPublisher | MemorySubscription, tuple[int, str, MessageType]] = {}
        self._found: dict[int, tuple[str, RemoteEndpoint]] = {}

    def changed(self, topic: Topic) -> None:
        graph = self._graph
        if not graph.is_linked or not graph.other.is_linked:
            return
        ends: list[MemoryPublisher | MemorySubscription] = [
            *(each for each in topic.publishers if not each.owner.private),
            *(each for each in topic.subscribers if not each.owner.private),
        ]
        for end, (number, name, type) in tuple(self._own.items()):
            # A subscription without a type of its own follows that of the topic.
            if name == topic.name and (end not in ends or end.type is not type):
                del self._own[end]
                graph.post(partial(graph.other.topics_of_other.on_left, number))
        for end in ends:
            if end not in self._own and end.type is not None:
                self._announce(topic, end, end.type)

    def _announce(self, topic: Topic, end: MemoryPublisher | MemorySubscription, type: MessageType) -> None:
        graph, number = self._graph, next(self._numbers)
        self._own[end] = (number, topic.name, type)
        publishes, type_name = isinstance(end, MemoryPublisher), graph.registry.type_name(type)
        joined = graph.other.topics_of_other.on_joined
        graph.post(partial(joined, number, topic.name, end.node, type_name, end.qos, publishes))
        if isinstance(end, MemoryPublisher):
            end.on_publish_remote = partial(self._send_new, topic, end, number)
            for sample in () if end.cache is None else end.cache.samples():
                self._send(number, True, sample)

    def _send_new(self, topic: Topic, publisher: MemoryPublisher, number: int, sample: Sample) -> None:
        # The other graph keeps what is retained, for those that subscribe later.
        if topic.remote_subscribers or publisher.cache is not None:
            self._send(number, False, sample)

    def _send(self, number: int, is_retained: bool, sample: Sample) -> None:
        graph, data = self._graph, sample.payload.cdr()
        receive = graph.other.topics_of_other.on_sample
        graph.post(partial(receive, number, is_retained, data, sample.stamp_ns, sample.expires_ns))

    # What the other graph sends

    def on_joined(
        self, number: int, topic: str, node: str, type_name: str, qos: QoS, publishes: bool
    ) -> None:
        graph = self._graph
        endpoint = RemoteEndpoint(node, type_name, self._types.find(type_name, "", topic, node), qos)
        if publishes and qos.durability is Durability.TRANSIENT_LOCAL:
            endpoint.cache = TransientLocalCache(qos, graph.clock)
        self._found[number] = (topic, endpoint)
        graph.topic_table.remote_joined(topic, endpoint, publishes=publishes)

    def on_left(self, number: int) -> None:
        self._graph.topic_table.remote_left(*self._found.pop(number))

    def on_sample(self, number: int, is_retained: bool, data: bytes, stamp_ns: int, expires_ns: int) -> None:
        name, endpoint = self._found[number]
        topic = self._graph.topic_table.find(name)
        if endpoint.type is None or topic is None or endpoint.type is not topic.type:
            return
        sample = Sample(name, Payload.relayed_cdr(endpoint.type, data), stamp_ns, endpoint.node, expires_ns)
        if endpoint.cache is not None:
            endpoint.cache.add(sample)
        for subscription in topic.subscribers:
            if subscription.wants_history or not is_retained:
                subscription.deliver(sample)


class QueueServices:
    """Services of both sides."""

    def __init__(self, graph: QueueGraph) -> None:
        self._graph = graph
        self._numbers = count()
        self._own: dict[MemoryProvider, int] = {}
        self._remote: RemoteServiceTable[None] = RemoteServiceTable(graph.service_table)
        self.info, self.names, self.by_node = self._remote.info, self._remote.names, self._remote.by_node
        self._callers = NodeResources("/_queue", private=True)
        # Calls by number: those of this process, and those of the other that are open here.
        self._asked: dict[int, MemoryCall] = {}
        self._open: dict[int, PendingCall] = {}

    def close(self) -> None:
        """End the calls of the other process's services."""
        self._remote.close()

    @property
    def _other(self) -> QueueServices:
        return self._graph.other.services_of_other

    def offered(self, provider: MemoryProvider) -> None:
        graph = self._graph
        if graph.is_linked and graph.other.is_linked and not provider.owner.private:
            number = self._own[provider] = next(self._numbers)
            info = provider.name, graph.registry.type_name(provider.type), provider.node
            graph.post(partial(self._other.on_offered, number, *info))

    def withdrawn(self, provider: MemoryProvider) -> None:
        number = self._own.pop(provider, None)
        if number is not None:
            self._graph.post(partial(self._other.on_withdrawn, number, provider.name))

    def call(
        self, name: str, request: Payload, on_reply: OnReply, timeout: float | None, caller: NodeResources
    ) -> PendingCall | None:
        service = self._remote.get(name)
        if service is None:
            return None
        call, number, graph = MemoryCall(name, request, on_reply), next(self._numbers), self._graph
        self._asked[number] = call
        call.on_end = partial(self._on_end, number)
        call.wait(service.open, caller, graph.service_table.deadlines, timeout)
        graph.post(partial(self._other.on_request, number, name, request.cdr()))
        return call

    def _on_end(self, number: int) -> None:
        del self._asked[number]
        self._graph.post(partial(self._other.on_abandoned, number))

    # What the other graph sends

    def on_offered(self, number: int, name: str, type_name: str, node: str) -> None:
        type = self._graph.registry.service(type_name)
        self._remote.found(number, ServiceInfo(name, type, node), None)

    def on_withdrawn(self, number: int, name: str) -> None:
        self._remote.lost(number, name)

    def on_request(self, number: int, name: str, data: bytes) -> None:
        graph = self._graph
        provider = graph.service_table.current.get(name)
        if provider is None:
            self._answer(number, ProviderGone(f"Service {name} was unadvertised"))
            return
        request = Payload.from_cdr(provider.type.request, data)
        call = graph.service_table.call(name, request, partial(self._answer, number), None, self._callers)
        if isinstance(call, MemoryCall) and not call.done:
            self._open[number] = call

    def _answer(self, number: int, answer: Payload | CallFailed) -> None:
        self._open.pop(number, None)
        if isinstance(answer, CallFailed):
            sent: bytes | str = str(answer)
            is_gone = isinstance(answer, ProviderGone)
        else:
            sent, is_gone = answer.cdr(), False
        self._graph.post(partial(self._other.on_answer, number, sent, is_gone))

    def on_answer(self, number: int, answer: bytes | str, is_gone: bool) -> None:
        call = self._asked.get(number)
        info = None if call is None else self.info(call.service)
        if call is None:
            return
        if isinstance(answer, str):
            call.end_with(ProviderGone(answer) if is_gone else ServiceFailed(answer))
        elif info is not None:
            call.reply(Payload.from_cdr(info.type.response, answer))

    def on_abandoned(self, number: int) -> None:
        call = self._open.pop(number, None)
        if call is not None:
            call.cancel()


class QueueHarness(Harness):
    def __init__(self) -> None:
        super().__init__()
        registry = Registry()
        first, second = self._pair = QueueGraph(registry, self.clock), QueueGraph(registry, self.clock)
        first.other, second.other = second, first
        self.graph = PairedGraph(*self._pair)

    async def settle(self) -> None:
        await anyio.wait_all_tasks_blocked()
        while any(graph.queued for graph in self._pair):
            await anyio.lowlevel.checkpoint()
            await anyio.wait_all_tasks_blocked()
