"""`rwt topic pub`: publish on a topic once, a number of times, or at a rate until Ctrl-C."""

from __future__ import annotations

import argparse
from collections.abc import AsyncIterator
from typing import TYPE_CHECKING, Final

import anyio

from rwt.cli.approval import ApprovalProgress
from rwt.cli.commands.topic.echo import add_qos_options, qos_from
from rwt.cli.console.message_argument import add_message_argument, type_and_message, with_stamps
from rwt.cli.console.message_format import Formatting, constructor, plain
from rwt.cli.console.output import Output, note
from rwt.cli.entities import TOPIC, absolute_name, ask_rosapi
from rwt.cli.errors import FAILED, TIMED_OUT, CommandError
from rwt.cli.verbs import Arguments, Verb, count, count_or_none, hertz, rounds, seconds_or_none
from rwt_participant.errors import CallTimeout, RobotError
from rwt_participant.messages import to_payload

if TYPE_CHECKING:
    from rwt_client import RemotePublisher, Robot

_USUAL_RATE: Final = 1.0
_POLL_SECONDS: Final = 0.1
"""Seconds between two polls for subscriptions."""
_MAX_ANSWER_SECONDS: Final = 2.0
"""Maximum seconds until the server has processed all messages."""


def _arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("topic", metavar="TOPIC", help="for example /cmd_vel")
    add_message_argument(parser, "topic", "message")
    how_many = parser.add_mutually_exclusive_group()
    how_many.add_argument(
        "-1", "--once", action="store_const", const=1, dest="times", help="publish one message"
    )
    how_many.add_argument("-t", "-n", "--times", type=count, metavar="N", help="publish N messages")
    parser.add_argument(
        "-r", "--rate", type=hertz, default=_USUAL_RATE, metavar="HZ", help="messages per second (default 1)"
    )
    parser.add_argument(
        "-p", "--print", type=count, default=1, metavar="N", help="only print every N-th message"
    )
    parser.add_argument(
        "-w",
        "--wait",
        "--wait-matching-subscriptions",
        type=count_or_none,
        metavar="N",
        help="wait for N subscriptions (default 1 with --once and --times, else 0)",
    )
    parser.add_argument(
        "--keep-alive",
        type=seconds_or_none,
        default=0.1,
        metavar="SECONDS",
        help="seconds to stay connected after the last message (default 0.1)",
    )
    parser.add_argument("--latch", action="store_true", help="keep the last message for late subscribers")
    add_qos_options(parser)


async def _pub(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Publish on a topic.

    example:
      rwt topic pub --once /cmd_vel geometry_msgs/msg/Twist '{linear: {x: 0.2}}'
      rwt topic pub -r 10 /cmd_vel geometry_msgs/msg/Twist '{angular: {z: 1.0}}'     until Ctrl-C

    --json prints:
      one line for each message: {"topic": "/cmd_vel", "number": 1, "message": {…}}
    """
    from rwt_client import MessageRejected

    name = absolute_name(arguments.topic)
    kind, message = type_and_message(arguments.message, "message")
    with await robot.advertise(
        name, kind or await TOPIC.known(robot, name), latch=arguments.latch, qos=qos_from(arguments)
    ) as publisher:
        given = with_stamps(publisher.type, message)
        to_payload(publisher.type, given)  # Reject invalid messages before the wait.
        await _wait_for_subscribers(robot, publisher, arguments)
        if not output.json:
            output.line("publisher: beginning loop")
        progress = ApprovalProgress(robot)
        rejection: RobotError | None = None

        async def publish() -> None:
            nonlocal rejection
            number = 0
            async for number in _ticks(arguments.rate, arguments.times):
                _publish(publisher, given, number, arguments, output)
                await publisher.drain()
            await anyio.sleep(arguments.keep_alive)
            try:
                await publisher.confirm(timeout=_MAX_ANSWER_SECONDS)
            except CallTimeout:
                note(f"the robot did not confirm the messages within {_MAX_ANSWER_SECONDS:g} s")
            except RobotError as error:
                rejection = error
            await progress.decided()
            if progress.state == "approved":  # The approved message is sent again: the gate keeps none.
                _publish(publisher, given, number, arguments, output)
                await publisher.drain()
                await anyio.sleep(arguments.keep_alive)

        await progress.run(publish)
    if progress.state in ("waiting", "denied"):
        raise CommandError(progress.why or "the message was not approved in time", FAILED)
    if isinstance(rejection, MessageRejected) and progress.state != "approved":
        raise CommandError(f"the robot rejected a message for {name}: {rejection}", FAILED)
    if rejection is not None and progress.state != "approved":
        raise rejection


def _publish(
    publisher: RemotePublisher, given: object, number: int, arguments: Arguments, output: Output
) -> None:
    # Converted for each message: the header gets the time of sending.
    message = to_payload(publisher.type, given).value()
    publisher.publish(message)
    if number % arguments.print:
        return
    if output.json:
        record = plain(publisher.type, message, Formatting(json=True))
        output.record({"topic": publisher.name, "number": number, "message": record})
    else:
        output.line(f"publishing #{number}: {constructor(publisher.type, message)}\n")


async def _ticks(rate: float, times: int | None) -> AsyncIterator[int]:
    due = anyio.current_time()
    for number in rounds(times):
        yield number
        if number != times:
            due = max(due + 1 / rate, anyio.current_time())
            await anyio.sleep_until(due)


async def _wait_for_subscribers(robot: Robot, publisher: RemotePublisher, arguments: Arguments) -> None:
    name = publisher.name
    wanted = arguments.wait if arguments.wait is not None else int(arguments.times is not None)
    noted = False
    with anyio.move_on_after(arguments.timeout):
        while wanted and len(await ask_rosapi(lambda: robot.api.subscribers(name))) < wanted:
            if publisher.error is not None:
                raise publisher.error
            if not noted:
                note(f"Waiting for at least {wanted} matching subscription(s)... (-w 0 does not wait)")
                noted = True
            await anyio.sleep(_POLL_SECONDS)
        return
    raise CommandError(
        f"no subscription to {name} within {arguments.timeout:g} s; -w 0 publishes without waiting", TIMED_OUT
    )


PUB = Verb("pub", _pub, _arguments, definitions=True, until_interrupted=True)
