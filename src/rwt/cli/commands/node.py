"""`rwt node`: list the robot's nodes, and what each takes part in."""

from __future__ import annotations

import argparse
from functools import partial
from typing import TYPE_CHECKING

from rwt.cli.commands.action import offers
from rwt.cli.console.output import Output
from rwt.cli.console.printing import print_count, print_names
from rwt.cli.graph_lookup import absolute_name, ask_rosapi, is_hidden, known_node
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, Verb, add_family, gather

if TYPE_CHECKING:
    from rwt_client import Robot


def add_node_command(commands: Commands) -> None:
    """Add `node` to the command line."""
    add_family(commands, "node", "The robot's nodes.", VERBS)


def _list_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-c", "--count-nodes", action="store_true", help="only how many there are")
    parser.add_argument("-a", "--all", action="store_true", help="also those with a part that begins with _")


async def _list(robot: Robot, arguments: Arguments, output: Output) -> None:
    names = sorted(name for name in await ask_rosapi(robot.api.nodes) if arguments.all or not is_hidden(name))
    if arguments.count_nodes:
        print_count(len(names), output)
    elif output.json:
        output.record(names)
    else:
        print_names([(name, "") for name in names], output, types=False)


def _info_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("node", metavar="NODE", help="for example /demo_robot")
    parser.add_argument(
        "--include-hidden", action="store_true", help="also names with a part that begins with _"
    )


async def _info(robot: Robot, arguments: Arguments, output: Output) -> None:
    name = absolute_name(arguments.node)
    await known_node(robot, name)
    found = await robot.api.node(name)
    topics = {topic.name: topic.type for topic in await robot.api.topics()}
    services = sorted(each for each in found.services if arguments.include_hidden or not is_hidden(each))
    kinds = await gather([partial(robot.api.service_type, service) for service in services])
    actions = [
        each for each in await robot.api.action_servers() if offers(each, found.services, found.publishing)
    ]
    action_types = await gather([partial(robot.api.action_type, action) for action in actions])
    sections = {
        "Subscribers": [(topic, topics.get(topic, "")) for topic in sorted(found.subscribing)],
        "Publishers": [(topic, topics.get(topic, "")) for topic in sorted(found.publishing)],
        "Service Servers": list(zip(services, kinds, strict=True)),
        "Action Servers": list(zip(actions, action_types, strict=True)),
    }
    if output.json:
        record = {
            _key(heading): [{"name": n, "type": t} for n, t in each] for heading, each in sections.items()
        }
        output.record({"name": name, **record})
        return
    output.line(output.styled(name, "name"))
    for heading, named in sections.items():
        output.line(f"  {output.styled(heading, 'heading')}:")
        for each, kind in named:
            output.line(f"    {output.styled(each, 'name')}: {output.styled(kind, 'type')}")
        output.line()


def _key(heading: str) -> str:
    return heading.lower().replace(" ", "_")


VERBS = (
    Verb(
        "list",
        "list the nodes",
        _list,
        "rwt node list",
        '["/demo_robot", …]; with -c {"count": …}',
        _list_arguments,
    ),
    Verb(
        "info",
        "print a node's topics, services and actions",
        _info,
        "rwt node info /demo_robot",
        '{"name": "/demo_robot", "subscribers": [{"name": "/cmd_vel", "type": …}, …], "publishers": […],\n'
        '"service_servers": […], "action_servers": […]}; rosapi does not know service clients',
        _info_arguments,
    ),
)
