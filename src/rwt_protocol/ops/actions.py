"""Ops about actions of ROS 2: goals, feedback and results, and who offers them."""

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
    ReplyTo,
    RequiredId,
    Text,
    Values,
)
from rwt_protocol.ops.control import refuse_with_status
from rwt_protocol.ops.topics import CompressionOfReply, OptionalCount
from rwt_protocol.payloads import EMPTY

# Numbers of `action_msgs/GoalStatus` (ACT-03); `rwt_participant.goals` has all, but this package
# depends on no other.
_UNKNOWN: Final = 0
_SUCCEEDED: Final = 4
_ABORTED: Final = 6


def _usual_status(known: dict[str, object]) -> int:
    """Return the status of a result that has none (ACT-16)."""
    return _SUCCEEDED if known.get("result") else _ABORTED


class AdvertiseAction(Op):
    """The sender offers an action (ACT-12).

    Attributes:
        type: type of the action, for example `example_interfaces/Fibonacci`.
    """

    op: Literal["advertise_action"] = "advertise_action"
    type: Text
    action: Text


class UnadvertiseAction(Op):
    """The sender withdraws an action that it offers (ACT-18)."""

    op: Literal["unadvertise_action"] = "unadvertise_action"
    action: Text


class SendActionGoal(Op):
    """Asks for one run of an action; to a provider, asks it to run (ACT-01, ACT-12).

    Attributes:
        args: the goal, an object by name or an array by position (ACT-11).
        action_type: a type of action that is known; the server goes by what the action has (ACT-04).
        feedback: whether feedback is wanted (ACT-02).
    """

    op: Literal["send_action_goal"] = "send_action_goal"
    action: Text
    action_type: Text
    args: Arguments = Field(EMPTY, strict=False)
    feedback: Flag = False
    fragment_size: OptionalCount = None
    compression: CompressionOfReply = "none"


class CancelActionGoal(Op):
    """Asks that the goal with this id end early (ACT-07, ACT-13).

    Attributes:
        id: the `id` with which the goal was sent.
    """

    op: Literal["cancel_action_goal"] = "cancel_action_goal"
    id: RequiredId
    action: Text


class ActionFeedback(Op):
    """The progress of a goal (ACT-02, ACT-14).

    Attributes:
        values: the feedback.
    """

    wire_order: ClassVar[tuple[str, ...]] = ("action", "values", "id")

    op: Literal["action_feedback"] = "action_feedback"
    action: Text
    values: Values = Field(EMPTY, strict=False)


class ActionResult(Op):
    """The end of a goal.

    Attributes:
        values: the result; when `result` is false, usually a string that says why (ACT-04).
        result: whether the goal was run at all; its outcome is `status` (ACT-03).
        status: 4 succeeded, 5 canceled, 6 aborted, 0 not run. Left out: 4, or 6 if `result` is false
            (ACT-16).
    """

    wire_order: ClassVar[tuple[str, ...]] = ("action", "values", "status", "result", "id")

    op: Literal["action_result"] = "action_result"
    action: Text
    values: Values = Field(EMPTY, strict=False)
    result: Flag = True
    status: Annotated[int, Field(ge=0, le=6), Expected("a whole number from 0 to 6")] = Field(
        default_factory=_usual_status
    )


def refuse_goal(reply_to: ReplyTo, reason: str, level: Level = "error") -> Op:
    """Who sent a goal waits for its result, so it gets one (ACT-04, ACT-05)."""
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
