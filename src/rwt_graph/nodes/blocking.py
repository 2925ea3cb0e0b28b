"""Nodes for other threads than their graph's: the verbs of :class:`~rwt_graph.nodes.node.Node` block."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from typing import TypeVar

from rwt_graph.clock import Clock
from rwt_graph.nodes.node import Node
from rwt_participant.blocking import (
    Blocking,
    BlockingHandle,
    BlockingPublisher,
    BlockingSubscription,
    BlockingTransforms,
    BlockingVerbs,
    LoopThread,
    holds,
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

    def wait(self, function: Callable[[], Awaitable[T]]) -> T:
        return self._node.run_blocking(function)


class BlockingClock(Blocking[Clock]):
    """Clock of the graph; see :class:`~rwt_graph.clock.Clock`."""

    time_ns = runs(Clock.time_ns)
    monotonic = runs(Clock.monotonic)
    sleep = waits(Clock.sleep)


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

    advertise = holds(Node.advertise, BlockingPublisher)
    publish = holds(Node.publish, BlockingPublisher)
    subscribe = holds(Node.subscribe, BlockingHandle)
    topic = holds(Node.topic, BlockingSubscription)
    once = waits(Node.once)
    call = waits(Node.call)
    advertise_action = holds(Node.advertise_action, BlockingHandle)
    serve_over_topics = holds(Node.serve_over_topics, BlockingHandle)
    subscribe_samples = holds(Node.subscribe_samples, BlockingHandle)
    resolve = runs(Node.resolve)
    close = runs(Node.close)
