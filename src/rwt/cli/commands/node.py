"""`rwt node`: list the robot's nodes, with their topics, services and actions."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rwt.cli.commands.action import offers
from rwt.cli.console.output import Output
from rwt.cli.entities import NODE, is_hidden, names_and_types
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, add_family, flag, gather

if TYPE_CHECKING:
    from rwt_client import Robot


def add_node_command(commands: Commands) -> None:
    """Add `node` to the command line."""
    add_family(commands, "node", "The robot's nodes.", VERBS)


async def _ask_info(robot: Robot, name: str, arguments: Arguments) -> dict[str, Any]:
    found = await robot.api.node(name)
    topics = {topic.name: topic.type for topic in await robot.api.topics()}
    services = sorted(each for each in found.services if arguments.include_hidden or not is_hidden(each))
    kinds = await gather([partial(robot.api.service_type, service) for service in services])
    actions = [each for each in await robot.api.action_servers() if offers(each, found)]
    action_types = await gather([partial(robot.api.action_type, action) for action in actions])
    sections = {
        "subscribers": [(topic, topics.get(topic, "")) for topic in sorted(found.subscribing)],
        "publishers": [(topic, topics.get(topic, "")) for topic in sorted(found.publishing)],
        "service_servers": zip(services, kinds, strict=True),
        "action_servers": zip(actions, action_types, strict=True),
    }
    return {key: names_and_types(named) for key, named in sections.items()}


def _show_info(info: dict[str, Any], arguments: Arguments, output: Output) -> None:
    output.line(output.styled(info.pop("name"), "name"))
    for key, named in info.items():
        output.line(f"  {output.styled(key.replace('_', ' ').title(), 'heading')}:")
        for each in named:
            output.line(f"    {output.styled(each['name'], 'name')}: {output.styled(each['type'], 'type')}")
        output.line()


VERBS = (
    NODE.list_verb(),
    NODE.info_verb(
        "Print a node's topics, services and actions.",
        _ask_info,
        _show_info,
        '{"name": "/demo_robot", "subscribers": [{"name": "/cmd_vel", "type": …}, …], "publishers": […],\n'
        '"service_servers": […], "action_servers": […]}; rosapi does not know service clients',
        flag("--include-hidden", help="include names with a part that begins with `_`"),
    ),
)
