"""Ops for ROS 2 actions: advertising, goals, feedback and results."""

from __future__ import annotations

from typing import Annotated, ClassVar, Final, Literal

from pydantic import Field

from rwt_protocol.error_text import Expected
from rwt_protocol.errors import Level
from rwt_protocol.ops.base import (
    Arguments,
    Direction,
    Flag,
    Op,
    OpSpec,
    OptionalText,
    ReplyTo,
    RequiredId,
    Text,
    Values,
)
from rwt_protocol.ops.control import refuse_with_status
from rwt_protocol.ops.topics import CompressionOfReply, OptionalCount
from rwt_protocol.payloads import EMPTY

# Values of `action_msgs/GoalStatus` (ACT-03). `rwt_participant.goals` has all of them, but this package
# has no dependencies.
_UNKNOWN: Final = 0
_SUCCEEDED: Final = 4
_ABORTED: Final = 6


def _usual_status(known: dict[str, object]) -> int:
    """Return the default status of a result (ACT-16)."""
    return _SUCCEEDED if known.get("result") else _ABORTED


class AdvertiseAction(Op):
    """Advertises an action of the sender (ACT-12).

    Attributes:
        type: type of the action, for example `example_interfaces/Fibonacci`.
    """

    op: Literal["advertise_action"] = "advertise_action"
    type: Text
    action: Text


class UnadvertiseAction(Op):
    """Withdraws an action of the sender (ACT-18)."""

    op: Literal["unadvertise_action"] = "unadvertise_action"
    action: Text


class SendActionGoal(Op):
    """Sends a goal, from a client to the server or from the server to a provider (ACT-01, ACT-12).

    Attributes:
        args: the goal, an object by name or an array by position (ACT-11).
        action_type: a known action type; the server uses the type that the action has (ACT-04).
        feedback: true to receive feedback (ACT-02).
    """

    op: Literal["send_action_goal"] = "send_action_goal"
    action: Text
    action_type: Text
    args: Arguments = Field(EMPTY, strict=False)
    feedback: Flag = False
    fragment_size: OptionalCount = None
    compression: CompressionOfReply = "none"


class CancelActionGoal(Op):
    """Requests cancellation of the goal with this id (ACT-07, ACT-13).

    Attributes:
        id: `id` of the goal's `send_action_goal`.
    """

    op: Literal["cancel_action_goal"] = "cancel_action_goal"
    id: RequiredId
    action: Text


class ActionFeedback(Op):
    """Progress of a goal (ACT-02, ACT-14).

    Attributes:
        values: the feedback.
    """

    wire_order: ClassVar[tuple[str, ...]] = ("action", "values", "id")

    op: Literal["action_feedback"] = "action_feedback"
    action: Text
    values: Values = Field(EMPTY, strict=False)


class ActionResult(Op):
    """Result of a goal.

    Attributes:
        values: the result; if `result` is false, usually a string with the reason (ACT-04).
        result: true if the goal was executed; its outcome is `status` (ACT-03).
        status: 4 succeeded, 5 canceled, 6 aborted, 0 not executed. Default: 4, or 6 if `result` is false
            (ACT-16).
        reason: why a goal that was executed ended as canceled or aborted, for people; absent without one. A
            member of this project, which other programs ignore.
    """

    wire_order: ClassVar[tuple[str, ...]] = ("action", "values", "status", "result", "reason", "id")

    op: Literal["action_result"] = "action_result"
    action: Text
    values: Values = Field(EMPTY, strict=False)
    result: Flag = True
    status: Annotated[int, Field(ge=0, le=6), Expected("a whole number from 0 to 6")] = Field(
        default_factory=_usual_status
    )
    reason: OptionalText = None


def refuse_goal(reply_to: ReplyTo, reason: str, level: Level = "error") -> Op:
    """Reject a goal with a result, which its sender waits for (ACT-04, ACT-05)."""
    # Neither member could be matched by the sender, so the text goes out as a status.
    if not reply_to.name and reply_to.id is None:
        return refuse_with_status(reply_to, reason, level)
    return ActionResult(action=reply_to.name, values=reason, result=False, status=_UNKNOWN, id=reply_to.id)


SPECS = (
    OpSpec(AdvertiseAction, Direction.TO_SERVER, refuse_with_status),
    OpSpec(UnadvertiseAction, Direction.TO_SERVER, refuse_with_status),
    OpSpec(SendActionGoal, Direction.BOTH, refuse_goal),
    OpSpec(CancelActionGoal, Direction.BOTH, refuse_with_status),
    OpSpec(ActionFeedback, Direction.BOTH, refuse_with_status),
    OpSpec(ActionResult, Direction.BOTH, refuse_with_status),
)
