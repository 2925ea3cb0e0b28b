"""Remapping of names, by the rules of `--ros-args -r`."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from functools import wraps
from typing import Any, TypeVar, cast

from rwt_graph.backend import DistributedGraph, MemoryParticipant
from rwt_graph.errors import InvalidGraphName, Ros2Error
from rwt_graph.names import namespace_of, resolve

Method = TypeVar("Method", bound=Callable[..., Any])


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


def _remapped(method: Method) -> Method:
    """Return a method of a participant whose first argument, a name, is remapped."""

    @wraps(method)
    def with_new_name(self: RemappedParticipant, name: str, *args: Any, **options: Any) -> Any:
        return method(self, self.remapping.name(name), *args, **options)

    return cast("Method", with_new_name)


class RemappedParticipant(MemoryParticipant):
    """Node whose topics, services and actions are remapped."""

    def __init__(self, graph: DistributedGraph, name: str, remapping: Remapping) -> None:
        super().__init__(graph, name)
        self.remapping = remapping

    advertise = _remapped(MemoryParticipant.advertise)
    subscribe = _remapped(MemoryParticipant.subscribe)
    advertise_service = _remapped(MemoryParticipant.advertise_service)
    call_service = _remapped(MemoryParticipant.call_service)
    advertise_action = _remapped(MemoryParticipant.advertise_action)
    send_goal = _remapped(MemoryParticipant.send_goal)
    cancel_goal = _remapped(MemoryParticipant.cancel_goal)
    cancel_every_goal = _remapped(MemoryParticipant.cancel_every_goal)
