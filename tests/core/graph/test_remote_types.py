"""Types of topics whose publishers in other processes define them otherwise."""

from __future__ import annotations

from rwt_graph.backend import RemoteEndpoint
from rwt_graph.memory.graph import MemoryGraph
from rwt_interfaces.registry import Registry
from rwt_interfaces.structs import MessageType
from rwt_participant.qos import QoS


def defined(text: str) -> MessageType:
    """A message of a registry of its own."""
    registry = Registry()
    registry.add_text(text, "my_msgs/Thing")
    return registry.message("my_msgs/Thing")


def join(graph: MemoryGraph, type: MessageType | None, *, publishes: bool = True) -> RemoteEndpoint:
    endpoint = RemoteEndpoint("/robot", "my_msgs/msg/Thing", type, QoS())
    graph.topic_table.remote_joined("/thing", endpoint, publishes=publishes)
    return endpoint


def type_of(graph: MemoryGraph) -> MessageType | None:
    info = graph.topic("/thing")
    return None if info is None else info.type


def test_the_definition_of_a_publisher_replaces_that_of_a_subscriber_with_a_type() -> None:
    graph, ours, theirs = MemoryGraph(), defined("int8 x"), defined("int16 x")
    subscription = graph.participant("/ours").subscribe("/thing", lambda _: None, ours)
    assert type_of(graph) is ours
    unknown = join(graph, None)
    assert type_of(graph) is ours
    known = join(graph, theirs)
    graph.topic_table.remote_left("/thing", unknown)
    assert type_of(graph) is theirs
    graph.topic_table.remote_left("/thing", known)
    assert type_of(graph) is theirs
    subscription.close()
    assert type_of(graph) is None


def test_a_publisher_of_this_process_keeps_its_definition() -> None:
    graph, ours, theirs = MemoryGraph(), defined("int8 x"), defined("int16 x")
    graph.participant("/ours").advertise("/thing", ours)
    join(graph, theirs)
    assert type_of(graph) is ours


def test_a_type_that_contradicts_the_registry_has_the_name_of_its_own_registry() -> None:
    graph, theirs = MemoryGraph(), defined("int16 x")
    join(graph, theirs, publishes=False)
    assert type_of(graph) is theirs
    assert graph.registry.type_name(theirs) == "my_msgs/msg/Thing"
