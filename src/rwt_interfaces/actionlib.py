"""The messages that belong to services and actions by rule rather than by a file of their own."""

from __future__ import annotations

from rwt_interfaces.definitions import ActionDefinition, Field, FieldType, MessageDefinition
from rwt_interfaces.parser import format_message

SERVICE_PARTS = ("Request", "Response")
ACTION_PARTS = ("Goal", "Result", "Feedback")
#: What ROS 1 puts around the parts of an action to carry them over topics. `Action` only lists the three
#: others.
WRAPPERS = ("Action", "ActionGoal", "ActionResult", "ActionFeedback")


def split_part(name: str, parts: tuple[str, ...]) -> tuple[str, str] | None:
    """Split ``SetBool_Request`` or ``SetBoolRequest`` into ``SetBool`` and ``Request``; else None."""
    for part in parts:
        base = name.removesuffix(part)
        if base != name:
            base = base.removesuffix("_")
            return (base, part) if base else None
    return None


def wrapper(action: ActionDefinition, which: str) -> MessageDefinition:
    """The message ``XAction``, ``XActionGoal``, ``XActionResult`` or ``XActionFeedback`` of action ``X``."""
    if which == "Action":
        fields = tuple(
            Field(f"action_{part.lower()}", FieldType(f"{action.name}Action{part}")) for part in ACTION_PARTS
        )
    else:
        part = which.removeprefix("Action").lower()
        head = ("goal_id", "GoalID") if part == "goal" else ("status", "GoalStatus")
        body: dict[str, MessageDefinition] = {
            "goal": action.goal,
            "result": action.result,
            "feedback": action.feedback,
        }
        fields = (
            Field("header", FieldType("std_msgs/Header")),
            Field(head[0], FieldType(f"actionlib_msgs/{head[1]}")),
            Field(part, FieldType(body[part].name)),
        )
    definition = MessageDefinition(f"{action.name}{which}", fields)
    return MessageDefinition(definition.name, fields, (), format_message(definition))
