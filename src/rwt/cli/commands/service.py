"""`rwt service`: list the robot's services and call them."""

from __future__ import annotations

import argparse
from functools import partial
from typing import TYPE_CHECKING, Final

from rwt.cli.commands.topic.echo import add_echo_arguments, echo_messages
from rwt.cli.console.message_argument import type_and_message, with_stamps
from rwt.cli.console.message_format import Formatting, constructor, plain
from rwt.cli.console.output import Output, note
from rwt.cli.console.printing import print_count, print_found, print_names, print_type
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.cli.graph_lookup import absolute_name, ask_rosapi, is_hidden, known_service, same_type
from rwt.cli.parser import Commands
from rwt.cli.verbs import USUAL_TIMEOUT, Arguments, Verb, add_family, gather, hertz

if TYPE_CHECKING:
    from rwt_client import Robot

_EVENTS: Final = "/_service_event"
"""What ROS 2 adds to a service's name for the topic of its introspection."""


def add_service_command(commands: Commands) -> None:
    """Add `service` to the command line."""
    add_family(commands, "service", "The robot's services.", VERBS)


def _list_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-t", "--show-types", action="store_true", help="with each service's type")
    parser.add_argument("-c", "--count-services", action="store_true", help="only how many there are")
    parser.add_argument(
        "--include-hidden-services", action="store_true", help="also those with a part that begins with _"
    )


async def _services(robot: Robot, *, hidden: bool) -> list[str]:
    return sorted(name for name in await ask_rosapi(robot.api.services) if hidden or not is_hidden(name))


async def _with_types(robot: Robot, names: list[str]) -> list[tuple[str, str]]:
    types = await gather([partial(robot.api.service_type, name) for name in names])
    return list(zip(names, types, strict=True))


async def _list(robot: Robot, arguments: Arguments, output: Output) -> None:
    names = await _services(robot, hidden=arguments.include_hidden_services)
    if arguments.count_services:
        print_count(len(names), output)
    elif arguments.show_types or output.json:
        print_names(await _with_types(robot, names), output, types=True)
    else:
        print_names([(name, "") for name in names], output, types=False)


def _service_argument(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("service", metavar="SERVICE", help="for example /add_two_ints")


async def _type(robot: Robot, arguments: Arguments, output: Output) -> None:
    name = absolute_name(arguments.service)
    kind = await known_service(robot, name)
    print_type(name, kind, output)


async def _info(robot: Robot, arguments: Arguments, output: Output) -> None:
    name = absolute_name(arguments.service)
    kind = await known_service(robot, name)
    nodes = await gather([partial(robot.api.node, node) for node in await ask_rosapi(robot.api.nodes)])
    servers = sorted(node.name for node in nodes if name in node.services)
    if output.json:
        output.record({"name": name, "type": kind, "servers": servers})
        return
    output.line(f"Type: {output.styled(kind, 'type')}")
    output.line("Clients count: not known, rosapi does not tell")
    output.line(f"Services count: {len(servers)}")
    for node in servers if arguments.verbose else ():
        output.line(f"    {output.styled(node, 'name')}")


def _info_arguments(parser: argparse.ArgumentParser) -> None:
    _service_argument(parser)
    parser.add_argument("-v", "--verbose", action="store_true", help="with the nodes that offer it")


def _echo_arguments(parser: argparse.ArgumentParser) -> None:
    _service_argument(parser)
    parser.add_argument("type", metavar="TYPE", nargs="?", help="its type, where the robot does not know it")
    add_echo_arguments(parser)


async def _echo(robot: Robot, arguments: Arguments, output: Output) -> None:
    name = absolute_name(arguments.service)
    kind = arguments.type or await known_service(robot, name)
    topic = f"{name}{_EVENTS}"
    if not await ask_rosapi(lambda: robot.api.publishers(topic)):
        note(
            f"rwt: nobody publishes {topic} yet; `rwt serve --introspection` does, a node of ROS 2 if set so"
        )
    await echo_messages(robot, topic, f"{kind}_Event", arguments, output)


def _find_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("type", metavar="TYPE", help="for example example_interfaces/srv/AddTwoInts")
    parser.add_argument("-c", "--count-services", action="store_true", help="only how many there are")
    parser.add_argument(
        "--include-hidden-services", action="store_true", help="also those with a part that begins with _"
    )


async def _find(robot: Robot, arguments: Arguments, output: Output) -> None:
    named = await _with_types(robot, await _services(robot, hidden=arguments.include_hidden_services))
    found = [name for name, kind in named if same_type(kind, arguments.type)]
    print_found(found, output, only_count=arguments.count_services)


def _call_arguments(parser: argparse.ArgumentParser) -> None:
    _service_argument(parser)
    parser.add_argument(
        "request",
        metavar="TYPE REQUEST",
        nargs="*",
        help="type and request in YAML or JSON, - to read it from standard input; what is left out has its"
        " default, and the type may be left out",
    )
    parser.add_argument(
        "-r",
        "--rate",
        type=hertz,
        metavar="HZ",
        help="call again and again, so many times a second, until Ctrl-C",
    )


async def _call(robot: Robot, arguments: Arguments, output: Output) -> None:
    import anyio

    from rwt_participant.messages import to_payload

    name = absolute_name(arguments.service)
    if len(arguments.request) > 2:
        raise CommandError("expected TYPE and REQUEST; the request goes in quotes", CALLED_WRONGLY)
    kind, given = type_and_message(arguments.request)
    service_type = await robot.types.service(kind or await known_service(robot, name))
    request = to_payload(service_type.request, with_stamps(service_type.request, given)).value()
    while True:
        if not output.json:
            output.line(f"requester: making request: {constructor(service_type.request, request)}\n")
        began = anyio.current_time()
        response = await robot.call(
            name, request, service_type.name, timeout=arguments.timeout or USUAL_TIMEOUT
        )
        if output.json:
            output.record(plain(service_type.response, response, Formatting(json=True)))
        else:
            output.line(f"response:\n{constructor(service_type.response, response)}\n")
        if arguments.rate is None:
            return
        await anyio.sleep_until(began + 1 / arguments.rate)


VERBS = (
    Verb(
        "list",
        "list the services",
        _list,
        "rwt service list -t",
        '[{"name": "/add_two_ints", "type": "example_interfaces/srv/AddTwoInts"}, …]; with -c {"count": …}',
        _list_arguments,
    ),
    Verb(
        "type",
        "print a service's type",
        _type,
        "rwt service type /add_two_ints",
        '{"name": "/add_two_ints", "type": "example_interfaces/srv/AddTwoInts"}',
        _service_argument,
    ),
    Verb(
        "find",
        "list the services of a type",
        _find,
        "rwt service find example_interfaces/srv/AddTwoInts",
        '["/add_two_ints"]; with -c {"count": 1}',
        _find_arguments,
    ),
    Verb(
        "info",
        "print a service's type and how many servers it has",
        _info,
        "rwt service info /add_two_ints",
        '{"name": "/add_two_ints", "type": "example_interfaces/srv/AddTwoInts", "servers": ["/demo_robot"]}',
        _info_arguments,
    ),
    Verb(
        "echo",
        "print the requests and responses of a service that publishes them (ROS 2)",
        _echo,
        "rwt service echo /add_two_ints --flow-style",
        'one line for each: {"info": {"event_type": 1, …}, "request": [{"a": 1, "b": 2}], "response": []}',
        _echo_arguments,
        definitions=True,
        lasting=True,
    ),
    Verb(
        "call",
        "call a service",
        _call,
        "rwt service call /add_two_ints example_interfaces/srv/AddTwoInts '{a: 1, b: 2}'\n"
        "rwt service call /add_two_ints '{a: 1, b: 2}'",
        'the response, one line for each call: {"sum": 3}',
        _call_arguments,
    ),
)
