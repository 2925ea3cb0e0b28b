"""Messages and services that are derived from services and actions by rule."""

from __future__ import annotations

from rwt_interfaces.definitions.model import (
    ActionDefinition,
    Field,
    MessageDefinition,
    ServiceDefinition,
    WrittenType,
)
from rwt_interfaces.definitions.parser import format_message

SERVICE_PARTS = ("Request", "Response")
ACTION_PARTS = ("Goal", "Result", "Feedback")
#: Suffixes of ROS 1's messages that carry an action over topics. `Action` only lists the three
#: others.
WRAPPERS = ("Action", "ActionGoal", "ActionResult", "ActionFeedback")
#: Suffix of ROS 2's service introspection messages.
EVENT = "_Event"
#: Suffixes of the services of a ROS 2 action.
ACTION_SERVICES = ("_SendGoal", "_GetResult")
#: Suffix of the feedback message of a ROS 2 action.
FEEDBACK_MESSAGE = "_FeedbackMessage"

_UUID = WrittenType("unique_identifier_msgs/UUID")


def split_part(name: str, parts: tuple[str, ...]) -> tuple[str, str]:
    """Split ``SetBool_Request`` or ``SetBoolRequest`` into ``SetBool`` and ``Request``; else empty texts."""
    part = next((part for part in parts if name.endswith(part)), "")
    return (name.removesuffix(part).removesuffix("_"), part) if part else ("", "")


def wrapper(action: ActionDefinition, which: str) -> MessageDefinition:
    """Return ``XAction``, ``XActionGoal``, ``XActionResult`` or ``XActionFeedback`` of action ``X``."""
    if which == "Action":
        fields = tuple(
            Field(f"action_{part.lower()}", WrittenType(f"{action.name}Action{part}"))
            for part in ACTION_PARTS
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
            Field("header", WrittenType("std_msgs/Header")),
            Field(head[0], WrittenType(f"actionlib_msgs/{head[1]}")),
            Field(part, WrittenType(body[part].name)),
        )
    return _made(f"{action.name}{which}", fields)


def service_event(service: ServiceDefinition) -> MessageDefinition:
    """Return ``X_Event`` of service ``X``, which is published on ``/name/_service_event``."""
    fields = (
        Field("info", WrittenType("service_msgs/ServiceEventInfo")),
        Field("request", WrittenType(service.request.name, is_array=True, bound=1)),
        Field("response", WrittenType(service.response.name, is_array=True, bound=1)),
    )
    return _made(f"{service.name}{EVENT}", fields)


def feedback_message(action: ActionDefinition) -> MessageDefinition:
    """Return ``X_FeedbackMessage`` of action ``X``, which is published on ``/name/_action/feedback``."""
    fields = (Field("goal_id", _UUID), Field("feedback", WrittenType(action.feedback.name)))
    return _made(f"{action.name}{FEEDBACK_MESSAGE}", fields)


def action_service(action: ActionDefinition, which: str) -> ServiceDefinition:
    """Return the service ``X_SendGoal`` or ``X_GetResult`` of action ``X``."""
    name = f"{action.name}{which}"
    request: tuple[Field, ...]
    if which == "_SendGoal":
        request = (Field("goal_id", _UUID), Field("goal", WrittenType(action.goal.name)))
        stamp = Field("stamp", WrittenType("builtin_interfaces/Time"))
        response = (Field("accepted", WrittenType("bool")), stamp)
    else:
        request = (Field("goal_id", _UUID),)
        response = (Field("status", WrittenType("int8")), Field("result", WrittenType(action.result.name)))
    return ServiceDefinition(name, _made(f"{name}_Request", request), _made(f"{name}_Response", response))


def _made(name: str, fields: tuple[Field, ...]) -> MessageDefinition:
    return MessageDefinition(name, fields, (), format_message(MessageDefinition(name, fields)))
