"""Two graphs behind one face: providers are in the one, consumers in the other."""

from __future__ import annotations

from collections.abc import Awaitable, Callable, Iterator
from typing import Self

from rwt_graph.api import (
    ActionInfo,
    ClientGoal,
    GoalEvents,
    Graph,
    NodeInfo,
    OnReply,
    Participant,
    PendingCall,
    Publisher,
    Registration,
    Sample,
    ServerGoal,
    ServiceCall,
    ServiceInfo,
    Subscription,
    TopicInfo,
)
from rwt_graph.backend import DistributedGraph
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_participant.qos import BEST_AVAILABLE, DEFAULT_QOS, QoS


class SplitParticipant(Participant):
    """One name in both graphs."""

    def __init__(self, provider: Participant, consumer: Participant) -> None:
        self.name = provider.name
        self._provider = provider
        self._consumer = consumer

    def advertise(self, topic: str, type: MessageType, qos: QoS = DEFAULT_QOS) -> Publisher:
        return self._provider.advertise(topic, type, qos)

    def subscribe(
        self,
        topic: str,
        on_sample: Callable[[Sample], None],
        type: MessageType | None = None,
        qos: QoS = BEST_AVAILABLE,
    ) -> Subscription:
        return self._consumer.subscribe(topic, on_sample, type, qos)

    def advertise_service(
        self, service: str, type: ServiceType, on_call: Callable[[ServiceCall], None]
    ) -> Registration:
        return self._provider.advertise_service(service, type, on_call)

    def call_service(
        self, service: str, request: Payload, on_reply: OnReply, timeout: float | None = None
    ) -> PendingCall:
        return self._consumer.call_service(service, request, on_reply, timeout)

    def advertise_action(
        self, action: str, type: ActionType, on_goal: Callable[[ServerGoal], None]
    ) -> Registration:
        return self._provider.advertise_action(action, type, on_goal)

    def send_goal(
        self, action: str, goal: Payload, events: GoalEvents, goal_id: str | None = None
    ) -> ClientGoal:
        return self._consumer.send_goal(action, goal, events, goal_id)

    def cancel_goal(self, action: str, goal_id: str) -> None:
        self._consumer.cancel_goal(action, goal_id)

    def cancel_every_goal(self, action: str) -> Iterator[None]:
        return self._consumer.cancel_every_goal(action)

    def close(self) -> None:
        self._consumer.close()
        self._provider.close()


class PairedGraph(Graph):
    """Two graphs of one clock, each connected to the other. What it knows is what the consumers' graph
    knows."""

    def __init__(self, provider: DistributedGraph, consumer: DistributedGraph) -> None:
        self.provider, self.consumer = provider, consumer
        self.distro, self.registry, self.clock = provider.distro, provider.registry, provider.clock
        self.parameters = provider.parameters
        self.limitations = provider.limitations

    async def start(self) -> None:
        """Called when both graphs run."""

    def participant(self, name: str) -> Participant:
        return SplitParticipant(self.provider.participant(name), self.consumer.participant(name))

    @property
    def version(self) -> int:
        return self.consumer.version

    def topics(self) -> tuple[TopicInfo, ...]:
        return self.consumer.topics()

    def topic(self, name: str) -> TopicInfo | None:
        return self.consumer.topic(name)

    def services(self) -> tuple[ServiceInfo, ...]:
        return self.consumer.services()

    def service(self, name: str) -> ServiceInfo | None:
        return self.consumer.service(name)

    def actions(self) -> tuple[ActionInfo, ...]:
        return self.consumer.actions()

    def action(self, name: str) -> ActionInfo | None:
        return self.consumer.action(name)

    def nodes(self) -> tuple[NodeInfo, ...]:
        return self.consumer.nodes()

    @property
    def running(self) -> bool:
        return self.provider.running and self.consumer.running

    def on_graph_thread(self) -> bool:
        return self.provider.on_graph_thread()

    def run_on_graph(self, call: Callable[[], None]) -> None:
        self.provider.run_on_graph(call)

    def spawn(self, task: Callable[[], Awaitable[None]], name: str) -> None:
        self.provider.spawn(task, name)

    async def __aenter__(self) -> Self:
        await self.provider.__aenter__()
        try:
            await self.consumer.__aenter__()
            await self.start()
        except BaseException:
            await self.__aexit__()
            raise
        return self

    async def __aexit__(self, *exc: object) -> None:
        await self.consumer.__aexit__(*exc)
        await self.provider.__aexit__(*exc)
