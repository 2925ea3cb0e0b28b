"""Two graphs behind one face: providers are in the one, consumers in the other."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any, Self

from rwt_graph.api import Graph, Participant
from rwt_graph.backend import DistributedGraph


def _of(side: str, name: str) -> Any:
    """Return a method that calls the one of the same name of a side."""

    def method(self: object, *args: Any, **options: Any) -> Any:
        return getattr(getattr(self, side), name)(*args, **options)

    return method


class SplitParticipant(Participant):
    """One name in both graphs."""

    advertise, advertise_service, advertise_action = (
        _of("provider", name) for name in ("advertise", "advertise_service", "advertise_action")
    )
    subscribe, call_service, send_goal, cancel_goal, cancel_every_goal = (
        _of("consumer", name)
        for name in ("subscribe", "call_service", "send_goal", "cancel_goal", "cancel_every_goal")
    )

    def __init__(self, provider: Participant, consumer: Participant) -> None:
        self.name = provider.name
        self.provider = provider
        self.consumer = consumer

    def close(self) -> None:
        self.consumer.close()
        self.provider.close()


class PairedGraph(Graph):
    """Two graphs of one clock, each connected to the other. What it knows is what the consumers' graph
    knows."""

    topics, topic, services, service, actions, action, nodes = (
        _of("consumer", name)
        for name in ("topics", "topic", "services", "service", "actions", "action", "nodes")
    )
    on_graph_thread, run_on_graph, spawn = (
        _of("provider", name) for name in ("on_graph_thread", "run_on_graph", "spawn")
    )

    def __init__(self, provider: DistributedGraph, consumer: DistributedGraph) -> None:
        self.provider, self.consumer = provider, consumer
        self.distro, self.registry, self.clock = provider.distro, provider.registry, provider.clock
        self.parameters = provider.parameters
        self.limitations = provider.limitations

    async def start(self) -> None:
        """Called when both graphs run."""

    def participant(self, name: str, *, for_clients: bool = False) -> Participant:
        return SplitParticipant(
            self.provider.participant(name, for_clients=for_clients),
            self.consumer.participant(name, for_clients=for_clients),
        )

    def reserve(self, names: Iterable[str]) -> None:
        names = tuple(names)
        self.provider.reserve(names)
        self.consumer.reserve(names)

    def is_reserved(self, name: str) -> bool:
        return self.consumer.is_reserved(name)

    @property
    def version(self) -> int:
        return self.consumer.version

    @property
    def running(self) -> bool:
        return self.provider.running and self.consumer.running

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
