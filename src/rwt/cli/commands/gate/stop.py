"""`rwt stop`: press a robot's emergency stop, or release it."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any, Final

from rwt.cli.console.output import Output
from rwt.cli.errors import CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, Verb, add_verb

if TYPE_CHECKING:
    from rwt_client import Robot
    from rwt_participant.messages import MessageLike


def add_stop_command(commands: Commands) -> None:
    """Add `stop` to the command line."""
    add_verb(commands, _STOP)


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--release", action="store_true", help="let it move again, if the token's role may")
    parser.add_argument("--reason", default="", metavar="TEXT", help="why, for the audit and for others")


async def ask_gate(robot: Robot, service: str, type: str, request: MessageLike) -> str:
    """Call a service of the robot's gate; returns what it says.

    Raises:
        CommandError: the robot has no gate, or the gate refuses.
    """
    from rwt_participant.errors import CallFailed

    try:
        answer: Any = await robot.call(service, request, type)
    except CallFailed as failed:
        if f"{service} does not exist" in str(failed):
            raise CommandError(
                f"this robot has no gate: there is no {service}; its server's settings name no gate.rules"
            ) from None
        raise
    if not answer.success:
        raise CommandError(answer.message)
    return str(answer.message)


async def _stop(robot: Robot, arguments: Arguments, output: Output) -> None:
    service = "/gate/release_stop" if arguments.release else "/gate/stop"
    said = await ask_gate(robot, service, "rwt_gate_msgs/Stop", {"reason": arguments.reason})
    if output.json:
        output.record({"stopped": not arguments.release, "message": said})
    else:
        output.line(said)


_STOP: Final = Verb(
    "stop",
    "press the robot's emergency stop, which is software and no safety function",
    _stop,
    "rwt stop --reason 'somebody is in the way'\nrwt stop --release",
    '{"stopped": true, "message": "stopped; …"}',
    _arguments,
)
