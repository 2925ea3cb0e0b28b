"""`rwt service`: list the robot's services and call them."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any, Final

import anyio

from rwt.cli.approval import ApprovalProgress
from rwt.cli.commands.topic.echo import add_echo_arguments, echo_messages
from rwt.cli.console.message_argument import add_message_argument, type_and_message, with_stamps
from rwt.cli.console.message_format import Formatting, constructor, plain
from rwt.cli.console.output import Output, note
from rwt.cli.entities import SERVICE, absolute_name, all_nodes, ask_rosapi
from rwt.cli.parser import Commands
from rwt.cli.verbs import USUAL_TIMEOUT, Arguments, Verb, add_family, argument, arguments, flag, hertz
from rwt_participant.messages import to_payload

if TYPE_CHECKING:
    from rwt_client import Robot

_EVENTS: Final = "/_service_event"
"""Suffix of the introspection topic of a service in ROS 2."""


def add_service_command(commands: Commands) -> None:
    """Add `service` to the command line."""
    add_family(commands, "service", "The robot's services.", VERBS)


async def _ask_info(robot: Robot, name: str, arguments: Arguments) -> dict[str, Any]:
    nodes = await all_nodes(robot)
    return {"servers": sorted(node.name for node in nodes if name in node.services)}


def _show_info(info: dict[str, Any], arguments: Arguments, output: Output) -> None:
    output.line(f"Type: {output.styled(info['type'], 'type')}")
    output.line("Clients count: unknown (rosapi does not report it)")
    output.line(f"Services count: {len(info['servers'])}")
    for node in info["servers"] if arguments.verbose else ():
        output.line(f"    {output.styled(node, 'name')}")


async def _echo(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Print the requests and responses of a service that publishes them (ROS 2).

    example:
      rwt service echo /add_two_ints --flow-style

    --json prints:
      one line for each: {"info": {"event_type": 1, …}, "request": [{"a": 1, "b": 2}], "response": []}
    """
    name = absolute_name(arguments.service)
    kind = arguments.type or await SERVICE.known(robot, name)
    topic = f"{name}{_EVENTS}"
    if not await ask_rosapi(lambda: robot.api.publishers(topic)):
        note(
            f"rwt: {topic} has no publisher yet: start `rwt serve` with --introspection, or enable service"
            " introspection in the ROS 2 node"
        )
    await echo_messages(robot, topic, f"{kind}_Event", arguments, output)


async def _call(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Call a service.

    example:
      rwt service call /add_two_ints example_interfaces/srv/AddTwoInts '{a: 1, b: 2}'
      rwt service call /add_two_ints '{a: 1, b: 2}'

    --json prints:
      the response, one line for each call: {"sum": 3}
    """
    name = absolute_name(arguments.service)
    kind, given = type_and_message(arguments.request, "request")
    service_type = await robot.types.service_of(name, kind or await SERVICE.known(robot, name))
    request = to_payload(service_type.request, with_stamps(service_type.request, given)).value()
    while True:
        if not output.json:
            output.line(f"requester: making request: {constructor(service_type.request, request)}\n")
        began = anyio.current_time()
        response = await ApprovalProgress(robot).run(
            lambda: robot.call(name, request, service_type.name, timeout=None),
            arguments.timeout or USUAL_TIMEOUT,
            extends=arguments.timeout is None,
        )
        if output.json:
            output.record(plain(service_type.response, response, Formatting(json=True)))
        else:
            output.line(f"response:\n{constructor(service_type.response, response)}\n")
        if arguments.rate is None:
            return
        await anyio.sleep_until(began + 1 / arguments.rate)


VERBS = (
    SERVICE.list_verb(),
    SERVICE.type_verb(),
    SERVICE.find_verb(),
    SERVICE.info_verb(
        "Print a service's type and servers.",
        _ask_info,
        _show_info,
        '{"name": "/add_two_ints", "type": "example_interfaces/srv/AddTwoInts", "servers": ["/demo_robot"]}',
        flag("-v", "--verbose", help="list the nodes that offer it"),
    ),
    Verb(
        "echo",
        _echo,
        arguments(
            SERVICE.add_argument,
            argument(
                "type", metavar="TYPE", nargs="?", help="type of the service, if the robot does not know it"
            ),
            add_echo_arguments,
        ),
        definitions=True,
        until_interrupted=True,
    ),
    Verb(
        "call",
        _call,
        arguments(
            SERVICE.add_argument,
            partial(add_message_argument, owner="service", noun="request"),
            argument(
                "-r", "--rate", type=hertz, metavar="HZ", help="call repeatedly at this rate until Ctrl-C"
            ),
        ),
    ),
)
