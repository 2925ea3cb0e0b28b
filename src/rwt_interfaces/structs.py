"""Types compiled from definitions."""

from __future__ import annotations

from typing import TYPE_CHECKING

from rwt_interfaces.definitions import MessageDefinition

if TYPE_CHECKING:
    from rwt_interfaces.registry import Registry


class MessageType:
    """One message type."""

    __slots__ = ("definition", "name", "registry")

    def __init__(self, definition: MessageDefinition, registry: Registry) -> None:
        self.name = definition.name
        self.definition = definition
        self.registry = registry


class ServiceType:
    """One service type."""

    __slots__ = ("name", "request", "response")

    def __init__(self, name: str, request: MessageType, response: MessageType) -> None:
        self.name = name
        self.request = request
        self.response = response


class ActionType:
    """One action type."""

    __slots__ = ("feedback", "goal", "name", "result")

    def __init__(self, name: str, goal: MessageType, result: MessageType, feedback: MessageType) -> None:
        self.name = name
        self.goal = goal
        self.result = result
        self.feedback = feedback
