"""`rwt action`: list the robot's actions and send them goals."""

from __future__ import annotations

import textwrap
from functools import partial
from typing import TYPE_CHECKING, Any

import anyio

from rwt.cli.approval import ApprovalProgress
from rwt.cli.console.message_argument import add_message_argument, type_and_message, with_stamps
from rwt.cli.console.message_format import Formatting, plain
from rwt.cli.console.output import Output, Style, note
from rwt.cli.entities import ACTION, absolute_name, all_nodes
from rwt.cli.errors import FAILED, CommandError
from rwt.cli.parser import Commands, add_unavailable
from rwt.cli.verbs import Arguments, Verb, add_family, arguments, flag
from rwt_participant.messages import to_payload

if TYPE_CHECKING:
    from rwt_client import Robot
    from rwt_client.rosapi import NodeDetails
    from rwt_interfaces import Payload
    from rwt_interfaces.structs import ActionType, MessageType
    from rwt_participant.goals import Goal


def add_action_command(commands: Commands) -> None:
    """Add `action` to the command line."""
    verbs = add_family(commands, "action", "The robot's actions.", VERBS)
    add_unavailable(
        verbs,
        "echo",
        "no single topic carries goals and results: use `rwt topic echo ACTION/_action/feedback` and"
        " `rwt service echo ACTION/_action/send_goal`",
    )


async def _ask_info(robot: Robot, name: str, arguments: Arguments) -> dict[str, Any]:
    nodes = await all_nodes(robot)
    feedback = {f"{name}/_action/feedback", f"{name}/feedback"}
    return {
        "clients": sorted(node.name for node in nodes if not feedback.isdisjoint(node.subscribing)),
        "servers": sorted(node.name for node in nodes if offers(name, node)),
    }


def _show_info(info: dict[str, Any], arguments: Arguments, output: Output) -> None:
    output.line(f"Action: {output.styled(info['name'], 'name')}")
    output.line(f"Type: {output.styled(info['type'], 'type')}")
    for role in ("clients", "servers"):
        output.line(f"Action {role}: {len(info[role])}")
        for node in () if arguments.count else info[role]:
            shown = f" [{output.styled(info['type'], 'type')}]" if arguments.show_types else ""
            output.line(f"    {output.styled(node, 'name')}{shown}")


def offers(action: str, node: NodeDetails) -> bool:
    """True if a node is a server of an action.

    rosapi does not list servers: they offer the services (ROS 2) or topics (ROS 1) of the action.
    """
    return f"{action}/_action/cancel_goal" in node.services or f"{action}/feedback" in node.publishing


async def _send_goal(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Send a goal and wait for its result; Ctrl-C cancels it.

    example:
      rwt action send_goal /fibonacci example_interfaces/action/Fibonacci '{order: 5}' --feedback

    --json prints:
      with --feedback a line {"feedback": {…}} for each; then {"status": "SUCCEEDED", "result": {…}}, with a
      "reason" if the server gave one
    """
    name = absolute_name(arguments.action)
    kind, given = type_and_message(arguments.goal, "goal")
    action_type = await robot.types.action_of(name, kind or await ACTION.known(robot, name))
    request = to_payload(action_type.goal, with_stamps(action_type.goal, given))
    printer = _GoalPrinter(action_type, output)
    printer.goal(request)
    on_feedback = printer.feedback if arguments.feedback else lambda message: None
    progress = ApprovalProgress(robot)
    goal = await progress.run(
        lambda: robot.send_goal(name, request, action_type.name, on_feedback=on_feedback)
    )
    try:
        ended = await progress.run(goal.result, arguments.timeout)
    except BaseException as error:
        await _cancel(goal, robot, error)
        raise
    printer.result(ended.status.name, ended.result, goal.reason)
    if not ended.succeeded:
        why = f": {goal.reason}" if goal.reason else ""
        raise CommandError(f"the goal of {name} ended as {ended.status.name}{why}", FAILED)


async def _cancel(goal: Goal, robot: Robot, error: BaseException) -> None:
    if goal.done or not robot.connected:
        return
    if isinstance(error, Exception):
        note("rwt: canceling the goal: it did not end in time")
    goal.cancel()
    with anyio.CancelScope(shield=True), anyio.move_on_after(2):
        await robot.drain()


class _GoalPrinter:
    def __init__(self, action_type: ActionType, output: Output) -> None:
        self._type = action_type
        self._output = output

    def goal(self, request: Payload) -> None:
        if not self._output.json:
            self._print("Sending goal:", self._type.goal, request.value())

    def feedback(self, message: Any) -> None:
        if self._output.json:
            self._output.record({"feedback": plain(self._type.feedback, message, Formatting(json=True))})
        else:
            self._print("Feedback:", self._type.feedback, message)

    def result(self, status: str, message: Any, reason: str) -> None:
        if self._output.json:
            result = plain(self._type.result, message, Formatting(json=True))
            self._output.record({"status": status, "result": result} | ({"reason": reason} if reason else {}))
            return
        self._print("Result:", self._type.result, message)
        style: Style = "good" if status == "SUCCEEDED" else "warning"
        self._output.line(f"Goal finished with status: {self._output.styled(status, style)}")

    def _print(self, heading: str, message_type: MessageType, message: Any) -> None:
        from rwt.cli.console.yaml_text import block

        shown = textwrap.indent(block(plain(message_type, message)), "    ")
        self._output.line(f"{self._output.styled(heading, 'heading')}\n{shown}")


VERBS = (
    ACTION.list_verb(),
    ACTION.info_verb(
        "Print an action's type, clients and servers.",
        _ask_info,
        _show_info,
        '{"name": "/fibonacci", "type": "example_interfaces/action/Fibonacci", "clients": [],\n'
        '"servers": ["/demo_robot"]}; clients are nodes, not rosbridge clients',
        arguments(
            flag("-t", "--show-types", help="show the type beside each node"),
            flag("-c", "--count", help="only print the number of nodes"),
        ),
    ),
    ACTION.find_verb(),
    ACTION.type_verb(),
    Verb(
        "send_goal",
        _send_goal,
        arguments(
            ACTION.add_argument,
            partial(add_message_argument, owner="action", noun="goal"),
            flag("-f", "--feedback", help="also print the feedback"),
        ),
    ),
)
