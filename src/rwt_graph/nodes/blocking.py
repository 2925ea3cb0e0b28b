"""Nodes for other threads than their graph's: the verbs of :class:`~rwt_graph.nodes.node.Node` block."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import Self, TypeVar

from rwt_graph.clock import Clock
from rwt_graph.nodes.endpoints import TopicPublisher, TopicSubscription
from rwt_graph.nodes.node import Node
from rwt_interfaces.structs import MessageType
from rwt_participant.blocking import (
    Blocking,
    BlockingGoal,
    BlockingHandle,
    BlockingPublisher,
    BlockingSubscription,
    BlockingTransforms,
    BlockingVerbs,
    LoopThread,
    holds,
    passes,
    runs,
    waits,
)

T = TypeVar("T")


class _GraphThread(LoopThread):
    """Thread of a graph."""

    def __init__(self, node: Node) -> None:
        self._node = node

    @property
    def here(self) -> bool:
        return self._node.graph.on_graph_thread()

    def run(self, function: Callable[[], T]) -> T:
        return self._node.run(function)

    def post(self, function: Callable[[], None]) -> None:
        self._node.graph.run_on_graph(function)

    def wait(self, function: Callable[[], Awaitable[T]]) -> T:
        return self._node.run_blocking(function)


class BlockingTopicPublisher(BlockingPublisher):
    """Publisher of one topic; see :class:`~rwt_graph.nodes.endpoints.TopicPublisher`."""

    _inner: TopicPublisher

    @property
    def type(self) -> MessageType:
        """Type of the topic."""
        return self._inner.type

    @property
    def dropped(self) -> int:
        """Number of messages that were dropped for newer ones: the graph's thread was held."""
        return self._inner.dropped

    @property
    def subscriber_count(self) -> int:
        """Number of known subscribers; all clients of one server count as one."""
        return self._inner.subscriber_count


class BlockingTopicSubscription(BlockingSubscription):
    """Messages of a topic, or a subscription with a callback; see :class:`TopicSubscription`."""

    _inner: TopicSubscription

    @property
    def type(self) -> MessageType | None:
        """Type of the topic; None while it is unknown."""
        return self._inner.type


class BlockingClock(Blocking[Clock]):
    """Clock of the graph; see :class:`~rwt_graph.clock.Clock`."""

    time_ns = runs(Clock.time_ns)
    monotonic = runs(Clock.monotonic)
    boottime = runs(Clock.boottime)
    call_later = runs(Clock.call_later)
    sleep = waits(Clock.sleep)

    @property
    def is_real(self) -> bool:
        """False for a simulated clock."""
        return self._inner.is_real


class BlockingGraphNode(BlockingVerbs[Node]):
    """Node for other threads than its graph's: its verbs block; see :class:`Node` for them.

    Attributes:
        node: the node itself.
        name, namespace: absolute name, and the namespace of relative names.
        log: log of the node.
        parameters: parameters that the node itself declares.
        clock: clock of the graph.
        tf: transforms between frames.
        distro: ROS distribution of the graph.
        registry: interfaces that the graph knows.
    """

    def __init__(self, node: Node) -> None:
        super().__init__(_GraphThread(node), node)
        self.node = node
        self.name = node.name
        self.namespace = node.namespace
        self.log = node.log
        self.parameters = node.parameters
        self.clock = BlockingClock(self._loop, node.clock)
        self.tf = BlockingTransforms(self._loop, node.tf)
        self.distro = node.distro
        self.registry = node.registry

    advertise = holds(Node.advertise, BlockingTopicPublisher)
    publish = passes(Node.publish, BlockingTopicPublisher)
    subscribe = holds(Node.subscribe, BlockingTopicSubscription)
    topic = holds(Node.topic, BlockingTopicSubscription)
    once = waits(Node.once)
    call = waits(Node.call)
    send_goal = holds(Node.send_goal, BlockingGoal)
    advertise_action = holds(Node.advertise_action, BlockingHandle)
    serve_over_topics = holds(Node.serve_over_topics, BlockingHandle)
    subscribe_samples = holds(Node.subscribe_samples, BlockingTopicSubscription)
    resolve = runs(Node.resolve)
    close = runs(Node.close)

    @property
    def blocking(self) -> Self:
        """This node: functions that get a node or a blocking one can use its blocking verbs."""
        return self
