"""`rwt topic echo`: print the messages of a topic."""

from __future__ import annotations

import argparse
from collections import deque
from collections.abc import Callable, Mapping
from types import CodeType
from typing import TYPE_CHECKING, Any, Final

import anyio
import pybase64

from rwt.cli.console.message_format import Formatting, csv_line, field_path, plain, plain_value
from rwt.cli.console.output import Output
from rwt.cli.entities import TOPIC, absolute_name
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.cli.verbs import Arguments, Verb, add_times, count_or_none, hertz, rounds
from rwt_participant.errors import TimedOut

if TYPE_CHECKING:
    from rwt.cli.console.yaml_text import YamlValue
    from rwt_client import Robot
    from rwt_client.endpoints.subscriptions import SubscribeOptions
    from rwt_interfaces.structs import MessageType
    from rwt_participant.messages import RawMessage
    from rwt_protocol.ops import Qos


_USUAL_LENGTH: Final = 128
_MOST_WAITING: Final = 100
"""Maximum queued raw messages; then the oldest are dropped."""


def _arguments(parser: argparse.ArgumentParser) -> None:
    TOPIC.add_argument(parser)
    parser.add_argument(
        "type", metavar="TYPE", nargs="?", help="type of the topic, if the robot does not know it yet"
    )
    shape = add_echo_arguments(parser)
    shape.add_argument("--raw", action="store_true", help="print the serialised messages")
    shape.add_argument(
        "--plot",
        action="store_true",
        help="plot the numbers over the last 60 messages, and lists as they are",
    )
    parser.add_argument(
        "--filter",
        type=expression,
        metavar="EXPR",
        help="only print messages for which this Python expression is true, for example 'm.data > 3'",
    )


def add_echo_arguments(parser: argparse.ArgumentParser) -> argparse._MutuallyExclusiveGroup:
    """Add the options for printing messages, and return the group of the mutually exclusive formats."""
    add_times(parser, "stop after one message", "stop after N messages")
    parser.add_argument(
        "--field", metavar="PATH", help="only print this field, for example pose.pose.position.x"
    )
    shape = parser.add_mutually_exclusive_group()
    shape.add_argument("--flow-style", action="store_true", help="print each message on one line of YAML")
    shape.add_argument("--csv", action="store_true", help="print each message as comma-separated values")
    parser.add_argument("--no-arr", action="store_true", help="print only the length of arrays")
    parser.add_argument("--no-str", action="store_true", help="print only the length of strings")
    parser.add_argument("-f", "--full-length", action="store_true", help="do not truncate arrays and strings")
    parser.add_argument(
        "-l",
        "--truncate-length",
        type=count_or_none,
        default=_USUAL_LENGTH,
        metavar="N",
        help=f"truncate arrays and strings to N items (default {_USUAL_LENGTH}; not with --csv and --json)",
    )
    parser.add_argument(
        "--max-rate", type=hertz, metavar="HZ", help="print at most this many messages per second"
    )
    add_qos_options(parser)
    return shape


def expression(text: str) -> CodeType:
    """Compile a Python expression."""
    try:
        return compile(text, "--filter", "eval")
    except (SyntaxError, ValueError) as error:
        raise argparse.ArgumentTypeError(f"{text!r} is not a Python expression: {error}") from None


async def _echo(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Print the messages of a topic.

    example:
      rwt topic echo /odom --field pose.pose.position --once

    --json prints:
      one line for each message: the message as rosbridge sends it (octets as base64, NaN as null), or the
      value of --field; with --raw its octets in base64
    """
    name = absolute_name(arguments.topic)
    kind = arguments.type or await TOPIC.known(robot, name)
    if arguments.raw:
        await _echo_raw(robot, name, kind, arguments, output)
    else:
        await echo_messages(robot, name, kind, arguments, output, _passes(arguments.filter))


async def echo_messages(
    robot: Robot,
    name: str,
    kind: str,
    arguments: Arguments,
    output: Output,
    passes: Callable[[Any], bool] = lambda _: True,
) -> None:
    """Print the messages of a topic that match the filter, up to the given number.

    Raises:
        TimedOut: `arguments.timeout` passed without a message to print.
    """
    options: SubscribeOptions = {"qos": qos_from(arguments)}
    if arguments.max_rate:
        options["throttle"] = 1 / arguments.max_rate
    message_type = await robot.types.message(kind)
    show = _printer(message_type, arguments, output)
    async with robot.topic(name, kind, **options) as messages:
        for _ in rounds(arguments.times):
            happened = "came"
            with anyio.move_on_after(arguments.timeout) as patience:
                while not passes(message := await messages.get()):
                    happened = "matched --filter"
            if patience.cancelled_caught:
                raise _silence(happened, name, arguments)
            show(message)


def _silence(happened: str, name: str, arguments: Arguments) -> TimedOut:
    return TimedOut(f"no message {happened} on {name} within {arguments.timeout:g} s")


def _passes(code: CodeType | None) -> Callable[[Any], bool]:
    """Return the predicate of ``--filter``, in which a message is `m`."""
    if code is None:
        return lambda _: True

    def passes(message: Any) -> bool:
        try:
            return bool(eval(code, {"m": message}))
        except Exception as error:
            raise CommandError(f"--filter: {type(error).__name__}: {error}", CALLED_WRONGLY) from error

    return passes


async def _echo_raw(robot: Robot, name: str, kind: str, arguments: Arguments, output: Output) -> None:
    refused = next((each for each in ("field", "filter", "max_rate") if getattr(arguments, each)), None)
    if refused is not None:
        raise CommandError(f"--raw cannot be combined with --{refused.replace('_', '-')}", CALLED_WRONGLY)
    arrived: deque[bytes] = deque(maxlen=_MOST_WAITING)
    come = anyio.Event()

    def hear(message: RawMessage) -> None:
        arrived.append(bytes(message.data))
        come.set()

    subscription = await robot.subscribe_raw(name, hear, kind)
    for _ in rounds(arguments.times):
        if not arrived:
            come = anyio.Event()
            with anyio.move_on_after(arguments.timeout) as patience:
                await come.wait()
            if patience.cancelled_caught:
                raise _silence("came", name, arguments)
        data = arrived.popleft()
        if output.json:
            output.record(pybase64.b64encode(data).decode())
        else:
            output.text(f"{data!r}\n{output.styled('---', 'faint')}\n")
    subscription.close()


def _printer(message_type: MessageType, arguments: Arguments, output: Output) -> Callable[[Any], None]:
    from rwt.cli.console.plot import Plot
    from rwt.cli.console.yaml_text import block, flow

    is_plot = getattr(arguments, "plot", False)
    is_whole = arguments.full_length or arguments.csv or output.json or is_plot
    formatting = Formatting(
        arrays=not arguments.no_arr,
        strings=not arguments.no_str,
        longest=None if is_whole else arguments.truncate_length,
        json=output.json,
    )
    path = field_path(message_type, arguments.field) if arguments.field else None

    def value_of(message: Any) -> YamlValue:
        if path is None:
            return plain(message_type, message, formatting)
        return plain_value(path.field_type, path.of(message), formatting)

    plot = Plot() if is_plot and not output.json else None

    def show(message: Any) -> None:
        value = value_of(message)
        if plot is not None:
            output.report([output.escape_terminal(line) for line in plot.lines(value)], "---")
        elif output.json:
            output.record(value)
        elif arguments.csv:
            output.line(output.escape_terminal(csv_line(value)))
        elif arguments.flow_style:
            output.text(f"{flow(value)}\n---\n")
        else:
            output.text(f"{block(value)}{output.styled('---', 'faint')}\n")

    return show


ECHO = Verb("echo", _echo, _arguments, definitions=True, until_interrupted=True)


_POLICIES = {
    "reliability": ("reliable", "best_effort"),
    "durability": ("volatile", "transient_local"),
    "history": ("keep_last", "keep_all"),
}
_RELIABLE: Final = {"reliability": "reliable", "durability": "volatile", "history": "keep_last", "depth": 10}
_PROFILES: Final[Mapping[str, Mapping[str, Any]]] = {
    "default": _RELIABLE,
    "sensor_data": {**_RELIABLE, "reliability": "best_effort", "depth": 5},
    "services_default": _RELIABLE,
    "parameters": {**_RELIABLE, "depth": 1000},
    "parameter_events": {**_RELIABLE, "depth": 1000},
    "action_status_default": {**_RELIABLE, "durability": "transient_local", "depth": 1},
    "best_available": {**_RELIABLE, "reliability": "best_available", "durability": "best_available"},
    "system_default": {},
}
"""ROS 2's profiles by name (rmw/qos_profiles.h)."""


def add_qos_options(parser: argparse.ArgumentParser) -> None:
    """Add ``--qos-…``, which only ROS 2 robots apply."""
    parser.add_argument(
        "--qos-profile",
        choices=_PROFILES,
        default="system_default",
        help="QoS profile (ROS 2); the following options override its policies",
    )
    for policy, words in _POLICIES.items():
        parser.add_argument(f"--qos-{policy}", choices=words, help=f"QoS {policy} (ROS 2)")
    parser.add_argument("--qos-depth", type=count_or_none, metavar="N", help="history depth with keep_last")


def qos_from(arguments: Arguments) -> Qos | None:
    """Return the QoS request of the options; None without any."""
    from rwt_protocol.ops import Qos  # slow import that `--help` does not need

    given = {policy: getattr(arguments, f"qos_{policy}") for policy in (*_POLICIES, "depth")}
    chosen = {policy: value for policy, value in given.items() if value is not None}
    asked = {**_PROFILES[arguments.qos_profile], **chosen}
    return Qos(**asked) if asked else None
