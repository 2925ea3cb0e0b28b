"""`rwt stop`, `rwt approve` and, in :mod:`rwt.cli.commands.gate.audit`, `rwt audit`."""

from __future__ import annotations

import argparse
from typing import TYPE_CHECKING, Any, Final

from rwt.cli.console.output import Output
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, Verb, add_verb, seconds

if TYPE_CHECKING:
    from rwt_client import Robot
    from rwt_participant.messages import MessageLike

_APPROVALS: Final = "/gate/approvals"


def add_stop_command(commands: Commands) -> None:
    """Add `stop` to the command line."""
    add_verb(commands, _STOP)


def add_approve_command(commands: Commands) -> None:
    """Add `approve` to the command line."""
    add_verb(commands, _APPROVE)


async def _ask_gate(robot: Robot, service: str, type: str, request: MessageLike) -> str:
    """Call a service of the robot's gate, and return its message.

    Raises:
        CommandError: the robot has no gate, or the gate refuses.
    """
    from rwt_participant.errors import ProviderNotFound

    try:
        answer: Any = await robot.call(service, request, type)
    except ProviderNotFound:
        raise CommandError(
            f"this robot has no gate: there is no {service}; its server's settings name no gate.rules"
        ) from None
    if not answer.success:
        raise CommandError(answer.message)
    return str(answer.message)


def _stop_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--release", action="store_true", help="let it move again, if the token's role may")
    parser.add_argument("--reason", default="", metavar="TEXT", help="why, for the audit and for others")


async def _stop(robot: Robot, arguments: Arguments, output: Output) -> None:
    service = "/gate/release_stop" if arguments.release else "/gate/stop"
    said = await _ask_gate(robot, service, "rwt_gate_msgs/Stop", {"reason": arguments.reason})
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
    _stop_arguments,
)


def _approve_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("id", metavar="ID", nargs="?", help="what to answer; without it what waits is listed")
    parser.add_argument("--no", action="store_true", help="say no")
    parser.add_argument(
        "--for",
        dest="lasts",
        type=seconds,
        metavar="SECONDS",
        help="let the yes hold for so long, for the same client and name (default: for this one act)",
    )


async def _approve(robot: Robot, arguments: Arguments, output: Output) -> None:
    if arguments.id is None:
        if arguments.no or arguments.lasts:
            raise CommandError("--no and --for need the ID of what waits", CALLED_WRONGLY)
        await _list(robot, output)
        return
    if arguments.no and arguments.lasts:
        raise CommandError("--for is how long a yes holds: leave it out with --no", CALLED_WRONGLY)
    request = {"id": arguments.id, "approve": not arguments.no, "seconds": arguments.lasts or 0.0}
    said = await _ask_gate(robot, "/gate/approve", "rwt_gate_msgs/Approve", request)
    if output.json:
        output.record({"id": arguments.id, "approved": not arguments.no, "message": said})
    else:
        output.line(said)


async def _list(robot: Robot, output: Output) -> None:
    if not await robot.api.publishers(_APPROVALS):
        raise CommandError(f"this robot has no gate: nobody publishes {_APPROVALS}")
    waiting: Any = await robot.once(_APPROVALS, "rwt_gate_msgs/Approvals")
    if output.json:
        names = ("id", "act", "name", "rule", "client", "role", "content", "seconds", "remember_seconds")
        output.record([{name: getattr(each, name) for name in names} for each in waiting.approvals])
        return
    if not waiting.approvals:
        output.line("nothing waits")
    for each in waiting.approvals:
        output.line(
            f"{each.id}  {each.act} {output.styled(output.escape_terminal(each.name), 'name')}"
            f"  by {each.client} (role {each.role}, {each.rule})"
        )
        output.line(f"    {output.escape_terminal(each.content)}")


_APPROVE: Final = Verb(
    "approve",
    "list what waits for a person's yes at the robot's gate, or answer",
    _approve,
    "rwt approve\nrwt approve 7\nrwt approve 7 --for 600\nrwt approve 7 --no",
    '[{"id": "7", "act": "call", "name": "/blink", …}], or {"id": "7", "approved": true, "message": "…"}',
    _approve_arguments,
)
