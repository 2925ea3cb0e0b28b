"""`rwt topic`: list, echo, publish and measure the robot's topics."""

from __future__ import annotations

from functools import partial
from typing import TYPE_CHECKING, Any

from rwt.cli.commands.topic import echo as topic_echo
from rwt.cli.commands.topic import pub as topic_pub
from rwt.cli.commands.topic import rates as topic_rates
from rwt.cli.console.output import Output
from rwt.cli.entities import TOPIC, Named
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, add_family, argument, gather

if TYPE_CHECKING:
    from rwt_client import Robot


def add_topic_command(commands: Commands) -> None:
    """Add `topic` to the command line."""
    add_family(commands, "topic", "The robot's topics.", VERBS)


async def _show_verbose_list(robot: Robot, topics: Named, output: Output) -> None:
    publishers = await gather([partial(robot.api.publishers, name) for name, _ in topics])
    subscribers = await gather([partial(robot.api.subscribers, name) for name, _ in topics])
    if output.json:
        rows = zip(topics, publishers, subscribers, strict=True)
        output.record(
            [
                {"name": name, "type": kind, "publishers": len(given), "subscribers": len(taken)}
                for (name, kind), given, taken in rows
            ]
        )
        return
    for heading, role, sides in (
        ("Published", "publisher", publishers),
        ("Subscribed", "subscriber", subscribers),
    ):
        output.line(output.styled(f"{heading} topics:", "heading"))
        for (name, kind), nodes in zip(topics, sides, strict=True):
            if nodes:
                number = f"{len(nodes)} {role}{'' if len(nodes) == 1 else 's'}"
                output.line(f" * {output.styled(name, 'name')} [{output.styled(kind, 'type')}] {number}")
        output.line()


async def _ask_info(robot: Robot, name: str, arguments: Arguments) -> dict[str, Any]:
    questions = [partial(robot.api.publishers, name), partial(robot.api.subscribers, name)]
    return dict(zip(("publishers", "subscribers"), await gather(questions), strict=True))


def _show_info(info: dict[str, Any], arguments: Arguments, output: Output) -> None:
    output.line(f"Type: {output.styled(info['type'], 'type')}")
    for heading, side, nodes in (
        ("Publisher count", "PUBLISHER", info["publishers"]),
        ("Subscription count", "SUBSCRIPTION", info["subscribers"]),
    ):
        output.line(f"{heading}: {len(nodes)}")
        for node in nodes if arguments.verbose else ():
            namespace, _, short = output.escape_terminal(node).rpartition("/")
            output.line(f"\nNode name: {output.styled(short, 'name')}")
            output.line(f"Node namespace: {namespace or '/'}")
            output.line(f"Topic type: {output.escape_terminal(info['type'])}\nEndpoint type: {side}\n")


VERBS = (
    TOPIC.list_verb(_show_verbose_list, ' with -v also the\nnumbers of "publishers" and "subscribers";'),
    TOPIC.info_verb(
        "Print a topic's type, publishers and subscribers.",
        _ask_info,
        _show_info,
        '{"name": "/odom", "type": "nav_msgs/msg/Odometry", "publishers": ["/demo_robot"],\n'
        '"subscribers": []}',
        argument("-v", "--verbose", action="store_true", help="list the publishing and subscribing nodes"),
    ),
    TOPIC.type_verb(),
    TOPIC.find_verb(),
    topic_echo.ECHO,
    topic_pub.PUB,
    *topic_rates.VERBS,
)
