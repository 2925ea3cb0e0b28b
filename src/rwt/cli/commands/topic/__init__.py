"""`rwt topic`: list the robot's topics, hear them, publish on them, measure them."""

from __future__ import annotations

import argparse
from functools import partial
from typing import TYPE_CHECKING

from rwt.cli.commands.topic import echo as topic_echo
from rwt.cli.commands.topic import pub as topic_pub
from rwt.cli.commands.topic import rates as topic_rates
from rwt.cli.console.output import Output
from rwt.cli.console.printing import print_count, print_found, print_names, print_type
from rwt.cli.graph_lookup import absolute_name, same_type, topic_type, topics_of
from rwt.cli.parser import Commands
from rwt.cli.verbs import Arguments, Verb, add_family, gather

if TYPE_CHECKING:
    from rwt_client import Robot, TopicInfo


def add_topic_command(commands: Commands) -> None:
    """Add `topic` to the command line."""
    add_family(commands, "topic", "The robot's topics.", VERBS)


# -- list --------------------------------------------------------------------------------------------------


def _list_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-t", "--show-types", action="store_true", help="with each topic's type")
    parser.add_argument("-c", "--count-topics", action="store_true", help="only how many there are")
    parser.add_argument("-v", "--verbose", action="store_true", help="with types and how many take part")
    parser.add_argument(
        "--include-hidden-topics", action="store_true", help="also those with a part that begins with _"
    )


async def _list(robot: Robot, arguments: Arguments, output: Output) -> None:
    topics = await topics_of(robot, hidden=arguments.include_hidden_topics)
    if arguments.count_topics:
        print_count(len(topics), output)
    elif arguments.verbose:
        await _list_verbosely(robot, topics, output)
    else:
        print_names([(topic.name, topic.type) for topic in topics], output, types=arguments.show_types)


async def _list_verbosely(robot: Robot, topics: list[TopicInfo], output: Output) -> None:
    publishers = await gather([partial(robot.api.publishers, topic.name) for topic in topics])
    subscribers = await gather([partial(robot.api.subscribers, topic.name) for topic in topics])
    if output.json:
        rows = zip(topics, publishers, subscribers, strict=True)
        output.record(
            [
                {"name": topic.name, "type": topic.type, "publishers": len(given), "subscribers": len(taken)}
                for topic, given, taken in rows
            ]
        )
        return
    for heading, role, sides in (
        ("Published", "publisher", publishers),
        ("Subscribed", "subscriber", subscribers),
    ):
        output.line(output.styled(f"{heading} topics:", "heading"))
        for topic, nodes in zip(topics, sides, strict=True):
            if nodes:
                number = f"{len(nodes)} {role}{'' if len(nodes) == 1 else 's'}"
                shown = output.styled(topic.name, "name")
                output.line(f" * {shown} [{output.styled(topic.type, 'type')}] {number}")
        output.line()


# -- info, type, find --------------------------------------------------------------------------------------


def topic_argument(parser: argparse.ArgumentParser, *, several: bool = False) -> None:
    """The name of a topic."""
    parser.add_argument("topic", metavar="TOPIC", nargs="+" if several else None, help="for example /odom")


def _info_arguments(parser: argparse.ArgumentParser) -> None:
    topic_argument(parser)
    parser.add_argument("-v", "--verbose", action="store_true", help="with the nodes that take part")


async def _info(robot: Robot, arguments: Arguments, output: Output) -> None:
    name = absolute_name(arguments.topic)
    kind = await topic_type(robot, name)
    publishers, subscribers = await gather(
        [partial(robot.api.publishers, name), partial(robot.api.subscribers, name)]
    )
    if output.json:
        output.record({"name": name, "type": kind, "publishers": publishers, "subscribers": subscribers})
        return
    output.line(f"Type: {output.styled(kind, 'type')}")
    for heading, side, nodes in (
        ("Publisher count", "PUBLISHER", publishers),
        ("Subscription count", "SUBSCRIPTION", subscribers),
    ):
        output.line(f"{heading}: {len(nodes)}")
        for node in nodes if arguments.verbose else ():
            namespace, _, short = output.escape_terminal(node).rpartition("/")
            output.line(f"\nNode name: {output.styled(short, 'name')}")
            output.line(f"Node namespace: {namespace or '/'}")
            output.line(f"Topic type: {output.escape_terminal(kind)}\nEndpoint type: {side}\n")


async def _type(robot: Robot, arguments: Arguments, output: Output) -> None:
    name = absolute_name(arguments.topic)
    kind = await topic_type(robot, name)
    print_type(name, kind, output)


def _find_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("type", metavar="TYPE", help="for example nav_msgs/msg/Odometry")
    parser.add_argument("-c", "--count-topics", action="store_true", help="only how many there are")
    parser.add_argument(
        "--include-hidden-topics", action="store_true", help="also those with a part that begins with _"
    )


async def _find(robot: Robot, arguments: Arguments, output: Output) -> None:
    topics = await topics_of(robot, hidden=arguments.include_hidden_topics)
    names = [topic.name for topic in topics if same_type(topic.type, arguments.type)]
    print_found(names, output, only_count=arguments.count_topics)


VERBS = (
    Verb(
        "list",
        "list the topics",
        _list,
        "rwt topic list -t",
        '[{"name": "/odom", "type": "nav_msgs/msg/Odometry"}, …]; with -v also "publishers" and\n'
        '"subscribers", how many; with -c {"count": …}',
        _list_arguments,
    ),
    Verb(
        "info",
        "print a topic's type, publishers and subscribers",
        _info,
        "rwt topic info /odom",
        '{"name": "/odom", "type": "nav_msgs/msg/Odometry", "publishers": ["/demo_robot"],\n'
        '"subscribers": []}',
        _info_arguments,
    ),
    Verb(
        "type",
        "print a topic's type",
        _type,
        "rwt topic type /odom",
        '{"name": "/odom", "type": "nav_msgs/msg/Odometry"}',
        topic_argument,
    ),
    Verb(
        "find",
        "list the topics of a type",
        _find,
        "rwt topic find nav_msgs/msg/Odometry",
        '["/odom"]; with -c {"count": 1}',
        _find_arguments,
    ),
    topic_echo.ECHO,
    topic_pub.PUB,
    *topic_rates.VERBS,
)
