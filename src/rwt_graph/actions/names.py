"""Topics and services of an action on ROS 2: hidden, below `<action>/_action`."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from rwt_interfaces.payload import Payload

if TYPE_CHECKING:
    import msgspec

    from rwt_interfaces.structs import MessageType

_PART = "/_action/"
SEND_GOAL = f"{_PART}send_goal"


class ActionNames:
    """Names of the topics and services of one action.

    Attributes:
        send_goal: service `<Action>_SendGoal`.
        get_result: service `<Action>_GetResult`.
        cancel_goal: service `action_msgs/CancelGoal`.
        feedback: topic `<Action>_FeedbackMessage`.
        status: topic `action_msgs/GoalStatusArray`, latched.
        reasons: topic of this project: why a goal was rejected or ended, for which ROS 2's messages have no
            field. Each message is a `std_msgs/String`: the goal's id, a space, the reason.
    """

    def __init__(self, action: str) -> None:
        self.send_goal = f"{action}{SEND_GOAL}"
        self.get_result = f"{action}{_PART}get_result"
        self.cancel_goal = f"{action}{_PART}cancel_goal"
        self.feedback = f"{action}{_PART}feedback"
        self.status = f"{action}{_PART}status"
        self.reasons = f"{action}{_PART}reasons"


def belongs_to_action(topic: str) -> bool:
    """Return True if a topic or service belongs to an action."""
    return _PART in topic


def struct_payload(type: MessageType, **fields: object) -> Payload:
    """Return a payload from fields that are known to be valid."""
    return Payload(type, type.struct(**fields))


def uuid_struct(type: MessageType, goal_id: str) -> msgspec.Struct:
    """Return a goal's id as the `goal_id` of a message of that type."""
    empty: Any = type.struct()
    uuid: msgspec.Struct = empty.goal_id.__class__(uuid=bytes.fromhex(goal_id))
    return uuid
