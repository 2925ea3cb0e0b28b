"""The services and the message with which ROS 2 carries an action, made by rule from its definition.

Action ``X`` is two services and a topic of its own (``X_SendGoal``, ``X_GetResult``, ``X_FeedbackMessage``),
and two that all actions share (``action_msgs/CancelGoal`` and ``action_msgs/GoalStatusArray``).
"""

from __future__ import annotations

from rwt_interfaces.definitions import (
    ActionDefinition,
    Field,
    FieldType,
    MessageDefinition,
    ServiceDefinition,
)
from rwt_interfaces.parser import format_message

SERVICES = ("_SendGoal", "_GetResult")
FEEDBACK = "_FeedbackMessage"

_GOAL_ID = Field("goal_id", FieldType("unique_identifier_msgs/UUID"))


def split_service(name: str) -> tuple[str, str] | None:
    """Split ``Fibonacci_SendGoal`` into ``Fibonacci`` and ``_SendGoal``; else None."""
    for suffix in SERVICES:
        base = name.removesuffix(suffix)
        if base and base != name:
            return base, suffix
    return None


def service(action: ActionDefinition, suffix: str) -> ServiceDefinition:
    """The service of that suffix, one of :data:`SERVICES`."""
    if suffix == "_SendGoal":
        asked = Field("goal", FieldType(action.goal.name))
        told: tuple[Field, ...] = (
            Field("accepted", FieldType("bool")),
            Field("stamp", FieldType("builtin_interfaces/Time")),
        )
        request: tuple[Field, ...] = (_GOAL_ID, asked)
    else:
        request = (_GOAL_ID,)
        told = (Field("status", FieldType("int8")), Field("result", FieldType(action.result.name)))
    name = f"{action.name}{suffix}"
    return ServiceDefinition(name, _message(f"{name}_Request", request), _message(f"{name}_Response", told))


def feedback(action: ActionDefinition) -> MessageDefinition:
    """The message of the action's feedback topic."""
    return _message(
        f"{action.name}{FEEDBACK}", (_GOAL_ID, Field("feedback", FieldType(action.feedback.name)))
    )


def _message(name: str, fields: tuple[Field, ...]) -> MessageDefinition:
    definition = MessageDefinition(name, fields)
    return MessageDefinition(name, fields, (), format_message(definition))
