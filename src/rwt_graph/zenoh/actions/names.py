"""Topics and services of an action on ROS 2: hidden, below `<action>/_action`."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from rwt_interfaces.payload import Payload

if TYPE_CHECKING:
    import msgspec

    from rwt_interfaces.structs import ActionType, MessageType

_PART = "/_action/"
SEND_GOAL = f"{_PART}send_goal"


@dataclass(frozen=True, slots=True)
class ActionNames:
    """Names of the topics and services of one action.

    `reasons` is a topic of this project: why a goal was rejected or ended, for which ROS 2's messages have no
    field. Each message is a `std_msgs/String`: the goal's id, a space, the reason.
    """

    action: str

    @property
    def send_goal(self) -> str:
        """Service `<Action>_SendGoal`."""
        return f"{self.action}{SEND_GOAL}"

    @property
    def get_result(self) -> str:
        """Service `<Action>_GetResult`."""
        return f"{self.action}{_PART}get_result"

    @property
    def cancel_goal(self) -> str:
        """Service `action_msgs/CancelGoal`."""
        return f"{self.action}{_PART}cancel_goal"

    @property
    def feedback(self) -> str:
        """Topic `<Action>_FeedbackMessage`."""
        return f"{self.action}{_PART}feedback"

    @property
    def status(self) -> str:
        """Topic `action_msgs/GoalStatusArray`, latched."""
        return f"{self.action}{_PART}status"

    @property
    def reasons(self) -> str:
        """Topic `std_msgs/String`."""
        return f"{self.action}{_PART}reasons"


def belongs_to_action(topic: str) -> bool:
    """Return True if a topic or service belongs to an action."""
    return _PART in topic


def part_type(action: ActionType, suffix: str) -> str:
    """Return the type name of a part of an action: `Fibonacci` and `_SendGoal`."""
    return f"{action.name}{suffix}"


def struct_payload(type: MessageType, **fields: object) -> Payload:
    """Return a payload from fields that are known to be valid."""
    return Payload(type, None, type.struct(**fields))


def uuid_struct(type: MessageType, goal_id: str) -> msgspec.Struct:
    """Return a goal's id as the `goal_id` of a message of that type."""
    empty: Any = type.struct()
    uuid: msgspec.Struct = empty.goal_id.__class__(uuid=bytes.fromhex(goal_id))
    return uuid
