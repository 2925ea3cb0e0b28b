"""Remapping of names, by the rules of `--ros-args -r`."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator

from rwt_graph.api import (
    ClientGoal,
    GoalEvents,
    OnReply,
    PendingCall,
    Publisher,
    Registration,
    Sample,
    ServerGoal,
    ServiceCall,
    Subscription,
)
from rwt_graph.backend import DistributedGraph, MemoryParticipant
from rwt_graph.errors import InvalidGraphName, Ros2Error
from rwt_graph.names import namespace_of, resolve
from rwt_interfaces.payload import Payload
from rwt_interfaces.structs import ActionType, MessageType, ServiceType
from rwt_participant.qos import BEST_AVAILABLE, DEFAULT_QOS, QoS


class Remapping:
    """Remapping rules of one process.

    Args:
        rules: `/cmd_vel:=/input/cmd_vel` for a topic, service or action; `__ns:=/robot1` for the namespace
            of all nodes; `rosapi:__node:=api` for the name of one node.

    Raises:
        Ros2Error: a rule is invalid.
    """

    def __init__(self, rules: Iterable[str] = ()) -> None:
        self._names: dict[str, str] = {}
        self._nodes: dict[str, str] = {}
        self._namespace = ""
        for rule in rules:
            try:
                self._add(rule)
            except (InvalidGraphName, ValueError) as error:
                raise Ros2Error(f"remapping rule {rule!r}: {error}") from None

    def _add(self, rule: str) -> None:
        old, separator, new = rule.partition(":=")
        if not separator:
            raise ValueError("expected OLD:=NEW")
        node, colon, last = old.rpartition(":")
        if last in ("__node", "__name"):
            if not node:
                raise ValueError(f"name the node to rename: NODE:{last}:={new}")
            renamed = resolve(new)
            if namespace_of(renamed) != "/":
                raise ValueError("a node's name has no namespace; set it with __ns")
            self._nodes.setdefault(resolve(node), renamed)
        elif colon:
            raise ValueError("rules for one node can only change its name")
        elif last == "__ns":
            self._namespace = self._namespace or resolve(new)
        else:
            # The first rule that matches applies, as in ROS 2.
            self._names.setdefault(resolve(old), resolve(new))

    def node(self, name: str) -> str:
        """Return the name of a node in ROS 2."""
        return self._namespace + self._nodes.get(name, name)

    def name(self, name: str) -> str:
        """Return the name of a topic, service or action in ROS 2."""
        return self._names.get(name, name)


class RemappedParticipant(MemoryParticipant):
    """Node whose topics, services and actions are remapped."""

    def __init__(self, graph: DistributedGraph, name: str, remapping: Remapping) -> None:
        super().__init__(graph, name)
        self._remapped = remapping.name

    def advertise(self, topic: str, type: MessageType, qos: QoS = DEFAULT_QOS) -> Publisher:
        return super().advertise(self._remapped(topic), type, qos)

    def subscribe(
        self,
        topic: str,
        on_sample: Callable[[Sample], None],
        type: MessageType | None = None,
        qos: QoS = BEST_AVAILABLE,
    ) -> Subscription:
        return super().subscribe(self._remapped(topic), on_sample, type, qos)

    def advertise_service(
        self, service: str, type: ServiceType, on_call: Callable[[ServiceCall], None]
    ) -> Registration:
        return super().advertise_service(self._remapped(service), type, on_call)

    def call_service(
        self, service: str, request: Payload, on_reply: OnReply, timeout: float | None = None
    ) -> PendingCall:
        return super().call_service(self._remapped(service), request, on_reply, timeout)

    def advertise_action(
        self, action: str, type: ActionType, on_goal: Callable[[ServerGoal], None]
    ) -> Registration:
        return super().advertise_action(self._remapped(action), type, on_goal)

    def send_goal(
        self, action: str, goal: Payload, events: GoalEvents, goal_id: str | None = None
    ) -> ClientGoal:
        return super().send_goal(self._remapped(action), goal, events, goal_id)

    def cancel_goal(self, action: str, goal_id: str) -> None:
        super().cancel_goal(self._remapped(action), goal_id)

    def cancel_every_goal(self, action: str) -> Iterator[None]:
        return super().cancel_every_goal(self._remapped(action))
