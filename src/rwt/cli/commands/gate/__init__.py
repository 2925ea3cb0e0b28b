"""`rwt stop` and `rwt approve`; `rwt audit` and `rwt gate` in modules of their own."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any, Final

from rwt.cli.console.output import Output
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, Verb, add_verb, argument, arguments, flag, seconds
from rwt_participant.errors import ProviderNotFound

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
    try:
        answer: Any = await robot.call(service, request, type)
    except ProviderNotFound:
        raise _no_gate(service) from None
    if not answer.success:
        raise CommandError(answer.message)
    return str(answer.message)


def _no_gate(name: str) -> CommandError:
    return CommandError(f"this robot has no gate ({name} not found): set gate.rules on its server")


async def _stop(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Press the emergency stop (software: not a safety function).

    example:
      rwt stop --reason 'somebody is in the way'
      rwt stop --release

    --json prints:
      {"stopped": true, "message": "stopped; …"}
    """
    service = "/gate/release_stop" if arguments.release else "/gate/stop"
    said = await _ask_gate(robot, service, "rwt_gate_msgs/Stop", {"reason": arguments.reason})
    output.answer({"stopped": not arguments.release, "message": said}, said)


_STOP: Final = Verb(
    "stop",
    _stop,
    arguments(
        flag("--release", help="release the stop, if the role of the token may do so"),
        argument("--reason", default="", metavar="TEXT", help="reason, for the audit log and other clients"),
    ),
)


async def _approve(robot: Robot, arguments: Arguments, output: Output) -> None:
    """List or answer requests for approval.

    example:
      rwt approve
      rwt approve 7
      rwt approve 7 --for 600
      rwt approve 7 --no

    --json prints:
      [{"id": "7", "act": "call", "name": "/blink", …}], or {"id": "7", "approved": true, "message": "…"}
    """
    if arguments.id is None:
        if arguments.no or arguments.lasts:
            raise CommandError("--no and --for require the ID of a request", CALLED_WRONGLY)
        await _list(robot, output)
        return
    if arguments.no and arguments.lasts:
        raise CommandError("--for cannot be combined with --no", CALLED_WRONGLY)
    request = {"id": arguments.id, "approve": not arguments.no, "seconds": arguments.lasts or 0.0}
    said = await _ask_gate(robot, "/gate/approve", "rwt_gate_msgs/Approve", request)
    output.answer({"id": arguments.id, "approved": not arguments.no, "message": said}, said)


async def _list(robot: Robot, output: Output) -> None:
    if not await robot.api.publishers(_APPROVALS):
        raise _no_gate(_APPROVALS)
    waiting: Any = await robot.once(_APPROVALS, "rwt_gate_msgs/Approvals")
    if output.json:
        names = ("id", "act", "name", "rule", "client", "role", "content", "seconds", "remember_seconds")
        output.record([{name: getattr(each, name) for name in names} for each in waiting.approvals])
        return
    if not waiting.approvals:
        output.line("no pending requests")
    for each in waiting.approvals:
        output.line(
            f"{each.id}  {each.act} {output.styled(output.escape_terminal(each.name), 'name')}"
            f"  by {each.client} (role {each.role}, {each.rule})"
        )
        output.line(f"    {output.escape_terminal(each.content)}")


_APPROVE: Final = Verb(
    "approve",
    _approve,
    arguments(
        argument("id", metavar="ID", nargs="?", help="request to answer (default: list all requests)"),
        flag("--no", help="reject the request"),
        argument(
            "--for",
            dest="lasts",
            type=seconds,
            metavar="SECONDS",
            help="approve the same client and name for this long (default: this request only)",
        ),
    ),
)
