"""Tools that send, follow and cancel goals of actions."""

from __future__ import annotations

from typing import Annotated, Final, NotRequired

import anyio
from pydantic import Field

from rwt.extensions.mcp.agent import RESULT_BYTES, Agent
from rwt.extensions.mcp.content.answer import Answer, as_text, bounded
from rwt.extensions.mcp.content.plain import plain
from rwt.extensions.mcp.errors import ToolError
from rwt.extensions.mcp.goals import AgentGoal
from rwt.extensions.mcp.tools.acting import Fields
from rwt.extensions.mcp.tools.tool import Acted, Arguments, MessageValue, Name, Seconds, tool
from rwt_interfaces.structs import ActionType
from rwt_participant.errors import CallTimeout, NotFound
from rwt_participant.messages import Message
from rwt_participant.spelling import did_you_mean

#: Seconds between progress reports.
_REPORT_EVERY: Final = 0.5

#: Seconds to wait for a goal to end after a cancel request.
_CANCEL_SECONDS: Final = 5.0


class SendGoalArguments(Arguments):
    """Arguments of `send_goal`."""

    action: Annotated[Name, Field(description="absolute name, such as /navigate_to_pose")]
    goal: Fields = Field(default_factory=dict)
    timeout: Annotated[
        Seconds, Field(description="seconds to wait for the result; the goal continues after them")
    ] = 30.0


class GoalResult(Acted):
    """Result of the tools for goals."""

    goal_id: str
    action: str
    state: Annotated[str, Field(description="such as `executing`, `succeeded`, `aborted` or `canceled`")]
    reason: NotRequired[str]
    result: NotRequired[MessageValue]
    feedback: NotRequired[MessageValue]


@tool("Send a goal", GoalResult, act="goals")
async def send_goal(agent: Agent, asked: SendGoalArguments) -> Answer:
    """Send a goal to an action, for example to drive to a place, and wait for the result with progress
    reports. If it takes longer than `timeout`, the goal continues and its id is returned. Cancelling the call
    cancels the goal."""
    patience = agent.bounded_seconds(asked.timeout, "timeout")
    type = await _type_of(agent, asked.action)
    await agent.confirm("goals", asked.action, f"send the goal {as_text(asked.goal)} to {asked.action}")
    agent.goals.check_room(agent.owner)
    sent = AgentGoal(agent.owner, type.result.name, type.feedback.name)
    sent.goal = await agent.robot.send_goal(asked.action, asked.goal, on_feedback=sent.take_feedback)
    agent.goals.add(sent.goal.id, sent)
    return await _follow(agent, sent, patience, cancel=True)


async def _type_of(agent: Agent, action: str) -> ActionType:
    rows = await agent.robot.actions()
    name = action if action.startswith("/") else f"/{action}"
    row = next((each for each in rows if each.name == name), None)
    if row is None:
        meant = did_you_mean(name, (each.name for each in rows))
        raise NotFound(f"there is no action {name}{meant}")
    found = await agent.robot.interface(row.type)
    if not isinstance(found, ActionType):
        raise NotFound(f"{name} has the type {row.type}, which is not an action type")
    return found


async def _follow(agent: Agent, sent: AgentGoal, patience: float, *, cancel: bool) -> Answer:
    """Wait `patience` seconds for the end of a goal, and report progress.

    Args:
        cancel: True to cancel the goal if the agent cancels its request.
    """
    goal, robot, told = sent.goal, agent.robot, 0
    began = robot.clock.monotonic()
    try:
        while True:
            left = patience - (robot.clock.monotonic() - began)
            try:
                status, result = await goal.result(max(0.0, min(_REPORT_EVERY, left)))
                break
            except CallTimeout:
                if left <= _REPORT_EVERY:
                    return await _still_running(agent, sent)
                if sent.reports > told:
                    told = sent.reports
                    await agent.report_progress(robot.clock.monotonic() - began, None, _brief(sent.feedback))
    except anyio.get_cancelled_exc_class():
        if cancel:
            # Only the call that sent the goal cancels it; a call that watches it leaves it running.
            robot.cancel_goal(goal.action, goal.id)
        raise
    except BaseException:
        if goal.done:
            agent.goals.forget(goal.id)
        raise
    agent.goals.forget(goal.id)
    answer = await agent.show(result, sent.result_type)
    data: GoalResult = {**_state(sent), "state": status.name.lower(), "result": answer.data["message"]}
    reason = f" ({goal.reason})" if goal.reason else ""
    if goal.reason:
        data["reason"] = goal.reason
    return Answer(data, (f"the goal {status.name.lower()}{reason}; its result:", *answer.shown))


def _state(sent: AgentGoal) -> GoalResult:
    goal = sent.goal
    return {"goal_id": goal.id, "action": goal.action, "state": goal.status.name.lower()}


def _brief(message: Message | None) -> str:
    return "" if message is None else as_text(plain(message))[:500]


async def _still_running(agent: Agent, sent: AgentGoal) -> Answer:
    goal = sent.goal
    how = (
        f"the goal is {goal.status.name.lower()} and continues. goal_id: {goal.id}. Use `check_goal` to wait"
        " for its result, or `cancel_goal` to cancel it."
    )
    if sent.feedback is None:
        return Answer(_state(sent), (how,))
    answer = await agent.show(sent.feedback, sent.feedback_type)
    data: GoalResult = {**_state(sent), "feedback": answer.data["message"]}
    return Answer(data, (how, "last feedback:", *answer.shown))


class CheckGoalArguments(Arguments):
    """Arguments of `check_goal`."""

    goal_id: Annotated[Name, Field(description="id returned by `send_goal`")]
    timeout: Annotated[Seconds, Field(description="seconds to wait for the result")] = 0.0


@tool("Follow a goal", GoalResult, act="goals", only_looks=True)
async def check_goal(agent: Agent, asked: CheckGoalArguments) -> Answer:
    """Report the progress of a goal that `send_goal` left running, and wait for its result. The result is
    returned once."""
    patience = agent.bounded_seconds(asked.timeout, "timeout")
    sent = agent.goals.find(agent.owner, asked.goal_id)
    return await _follow(agent, sent, patience, cancel=False)


class CancelGoalArguments(Arguments):
    """Arguments of `cancel_goal`."""

    goal_id: Annotated[Name, Field(description="id returned by `send_goal`")]


@tool("Cancel a goal", GoalResult, act="goals", can_destroy=False, is_idempotent=True)
async def cancel_goal(agent: Agent, asked: CancelGoalArguments) -> Answer:
    """Cancel a goal that `send_goal` left running, and report how it ended. Needs no approval."""
    # Request cancellation, and wait a few seconds for the goal to end. The goal may succeed meanwhile, or
    # go on: servers of actions may reject the request.
    sent = agent.goals.find(agent.owner, asked.goal_id)
    if not sent.goal.done:
        agent.robot.cancel_goal(sent.goal.action, sent.goal.id)
    try:
        return await _follow(agent, sent, _CANCEL_SECONDS, cancel=False)
    except ToolError as error:
        # The goal has ended, but its result cannot be shown, for example because it is too large.
        return Answer(_state(sent), (bounded(str(error), RESULT_BYTES),))
