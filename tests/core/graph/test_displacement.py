"""Random endpoints of clients and of the robot, here and in other processes: whose type a topic has."""

from __future__ import annotations

from functools import partial
from random import Random
from typing import TYPE_CHECKING

import pytest

from rwt_graph import MemoryGraph, TypeConflict
from rwt_graph.backend import MemoryPublisher, MemorySubscription, RemoteEndpoint
from rwt_interfaces.registry import Registry
from rwt_participant.qos import DEFAULT_QOS, LATCHED

if TYPE_CHECKING:
    from rwt_interfaces.payload import Payload
    from rwt_interfaces.structs import MessageType

REGISTRY = Registry()
TYPES = tuple(map(REGISTRY.message, ("std_msgs/String", "std_msgs/Int32", "std_msgs/Bool")))
ROBOT, CLIENTS = "/robot", "/rosbridge_websocket"


class Endpoint:
    """Endpoint of this process, with what it was told and what it received."""

    def __init__(self, graph: Graph, *, for_clients: bool, publishes: bool, type: MessageType) -> None:
        self.for_clients = for_clients
        self.type = type
        self.displaced: list[str] = []
        self.received: list[MessageType] = []
        node = graph.clients if for_clients else graph.robot
        self.end: MemoryPublisher | MemorySubscription
        if publishes:
            self.end = node.advertise("/t", type, graph.random.choice((DEFAULT_QOS, LATCHED)))  # type: ignore[assignment]
        else:
            self.end = node.subscribe("/t", lambda s: self.received.append(s.payload.type), type)  # type: ignore[assignment]
        if for_clients:
            self.end.on_displaced = self.displaced.append


class Graph:
    """Graph with one topic, and a record of its endpoints."""

    def __init__(self, seed: int) -> None:
        self.random = Random(seed)
        self.graph = MemoryGraph(REGISTRY)
        self.table = self.graph.topic_table
        self.robot = self.graph.participant(ROBOT)
        self.clients = self.graph.participant(CLIENTS, for_clients=True)
        self.local: list[Endpoint] = []
        self.remote: list[RemoteEndpoint] = []

    def step(self) -> None:
        acts = [self.join] * 4 + [self.join_elsewhere] * 2 + [self.leave, self.leave_elsewhere, self.publish]
        self.random.choice(acts)()
        self.check()

    def join(self) -> None:
        random = self.random
        for_clients = random.random() < 0.6
        make = partial(
            Endpoint,
            self,
            for_clients=for_clients,
            publishes=random.random() < 0.5,
            type=random.choice(TYPES),
        )
        robots = [each for each in self.local if not each.for_clients]
        robots_elsewhere = [each for each in self.remote if not each.for_clients]
        is_free = not (robots or robots_elsewhere)
        try:
            self.local.append(make())
        except TypeConflict:
            assert for_clients or not is_free, "clients have kept the robot from its topic"

    def join_elsewhere(self) -> None:
        random = self.random
        endpoint = RemoteEndpoint(
            random.choice((ROBOT, CLIENTS)), "", random.choice((*TYPES, None)), DEFAULT_QOS
        )
        self.remote.append(endpoint)
        self.table.remote_joined("/t", endpoint, publishes=random.random() < 0.5)

    def leave(self) -> None:
        if self.local:
            self.local.pop(self.random.randrange(len(self.local))).end.close()

    def leave_elsewhere(self) -> None:
        if self.remote:
            self.table.remote_left("/t", self.remote.pop(self.random.randrange(len(self.remote))))

    def publish(self) -> None:
        for each in self.local:
            if isinstance(each.end, MemoryPublisher):
                payload: Payload = _message(each.type)
                each.end.publish(payload)

    def check(self) -> None:
        topic = self.table.find("/t")
        present = () if topic is None else (*topic.publishers, *topic.subscribers)
        for each in tuple(self.local):
            # An endpoint is there, or it was displaced, once, and only a client's is.
            assert (each.end in present) is not bool(each.displaced)
            assert len(each.displaced) <= each.for_clients
            # Nothing of another type is ever delivered.
            assert all(type is each.type for type in each.received)
            if each.displaced:
                self.local.remove(each)
        held = {each.type for each in self.local}
        assert len(held) <= 1, "endpoints of one topic have different types"
        if topic is None:
            assert not self.remote
        elif held:
            assert {topic.type} == held
        of_robot = {each.type for each in self.remote if each.type is not None and not each.for_clients}
        if topic is not None and not held and topic.type is not None and of_robot:
            publishing = {p.type for p in topic.remote_publishers if not p.for_clients and p.type is not None}
            assert not publishing or topic.type in publishing


def _message(type: MessageType) -> Payload:
    from rwt_interfaces.payload import Payload

    return Payload.from_value(type, {})


@pytest.mark.parametrize("seed", range(200))
def test_the_robot_comes_first_and_a_topic_has_one_type(seed: int) -> None:
    graph = Graph(seed)
    for _ in range(60):
        graph.step()
