"""`rwt topic hz`, `bw` and `delay`: rates, sizes and delays of messages, reported once a second."""

from __future__ import annotations

import argparse
import time
from collections import deque
from collections.abc import Awaitable, Callable
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final, NamedTuple

import anyio

from rwt.cli.console.output import Output, note
from rwt.cli.entities import TOPIC, absolute_name
from rwt.cli.errors import CommandError
from rwt.cli.verbs import Arguments, Verb, count, rounds, seconds
from rwt_interfaces import field_types
from rwt_interfaces.times import NANOSECONDS
from rwt_participant.errors import ProviderNotFound, ServiceFailed

if TYPE_CHECKING:
    from rwt_client import RemoteSubscription, Robot

_MANY: Final = 10_000
_FEW: Final = 100


Samples = deque[tuple[float, float]]
"""Newest values of a quantity, each after its time of arrival in seconds."""

Report = tuple[str, dict[str, object]]
"""Figures of one topic: text for people, without the name of the topic, and JSON object for programs."""

Measure = Callable[[Samples, float], Report | None]
"""Function that reports samples at a time in seconds; None if there are no figures."""


class Spread(NamedTuple):
    """Summary of some numbers; the standard deviation is that of the population."""

    mean: float
    least: float
    most: float
    deviation: float
    number: int


def spread(values: list[float]) -> Spread | None:
    """Return the summary of some numbers; None if there are none."""
    import statistics  # slow import that only these verbs need

    if not values:
        return None
    mean = statistics.fmean(values)
    return Spread(mean, min(values), max(values), statistics.pstdev(values, mean), len(values))


def in_bytes(number: float) -> str:
    """Format a number of bytes in powers of 1000: ``1.23 MB``."""
    for unit in ("B", "KB", "MB"):
        if number < 1000:
            return f"{number:.0f} {unit}" if unit == "B" else f"{number:.2f} {unit}"
        number /= 1000
    return f"{number:.2f} GB"


def _arguments(parser: argparse.ArgumentParser, window: int) -> None:
    parser.add_argument("topic", metavar="TOPIC", nargs="+", help="for example /odom; several may be given")
    parser.add_argument(
        "-w",
        "--window",
        type=count,
        default=window,
        metavar="N",
        help=f"window of the newest N messages (default {window})",
    )
    parser.add_argument("-n", "--times", type=count, metavar="N", help="stop after N reports")
    parser.add_argument(
        "--interval", type=seconds, default=1.0, metavar="SECONDS", help="seconds between reports (default 1)"
    )


async def _hz(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Measure the rate of topics.

    example:
      rwt topic hz /odom
      rwt topic hz /odom /scan -n 3

    --json prints:
      one line for each topic and report: {"topic": "/odom", "rate": 20.0, "min_s": 0.049,
      "max_s": 0.051, "std_dev_s": 0.0004, "window": 21}; {"topic": …, "messages": 0} while there is
      nothing to print
    """
    await _measure(robot, arguments, output, _frequency, lambda subscription, message: 0.0)


async def _bw(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Measure the bandwidth of topics.

    example:
      rwt topic bw /scan

    --json prints:
      one line for each topic and report: {"topic": "/scan", "bytes_per_second": 14400.0,
      "mean_bytes": …, "min_bytes": …, "max_bytes": …, "window": 10}; sizes are
      those of the messages on the connection
    """
    before: dict[str, int] = {}

    def size(subscription: RemoteSubscription, message: Any) -> float:
        new = subscription.received_bytes - before.get(subscription.name, 0)
        before[subscription.name] = subscription.received_bytes
        return float(new)

    await _measure(robot, arguments, output, _bandwidth, size)


async def _delay(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Measure the delay of messages since their header stamps.

    example:
      rwt topic delay /odom

    --json prints:
      one line for each topic and report: {"topic": "/odom", "delay": 0.002, "min_s": …, "max_s": …,
      "std_dev_s": …, "window": 20}; against the robot's clock, in seconds
    """
    clock = _RobotClock(robot)
    await clock.set()

    def age(subscription: RemoteSubscription, message: Any) -> float:
        stamp = message.header.stamp
        seconds, nanoseconds = (getattr(stamp, name) for name in stamp.__struct_fields__)
        return float(clock.now() - seconds - nanoseconds / NANOSECONDS)

    for name in arguments.topic:
        await _check_header(robot, absolute_name(name))
    await _measure(robot, arguments, output, _lateness, age, clock.set)


# -- measuring ---------------------------------------------------------------------------------------------


async def _measure(
    robot: Robot,
    arguments: Arguments,
    output: Output,
    measure: Measure,
    value: Callable[[RemoteSubscription, Any], float],
    between: Callable[[], Awaitable[None]] | None = None,
) -> None:
    """Listen to the topics, and report on them at intervals.

    Args:
        measure: makes the report on one topic from its samples.
        value: what is sampled of each message.
        between: called after each report.
    """
    names = [absolute_name(name) for name in dict.fromkeys(arguments.topic)]
    measured = {name: await _listen(robot, name, arguments.window, value) for name in names}
    due = anyio.current_time()
    for _ in rounds(arguments.times):
        due = max(due + arguments.interval, anyio.current_time())
        await anyio.sleep_until(due)
        _report(measured, anyio.current_time(), measure, output)
        if between is not None:
            await between()


async def _listen(
    robot: Robot, name: str, window: int, value: Callable[[RemoteSubscription, Any], float]
) -> Samples:
    samples: Samples = deque(maxlen=window)

    def hear(message: Any) -> None:
        samples.append((anyio.current_time(), value(subscription, message)))

    subscription = await robot.subscribe(name, hear, await TOPIC.known(robot, name))
    return samples


def _report(measured: dict[str, Samples], now: float, measure: Measure, output: Output) -> None:
    shown: list[str] = []
    for name, samples in measured.items():
        text, record = measure(samples, now) or (f"no messages on {name} yet", {"messages": 0})
        if output.json:
            output.record({"topic": name, **record})
            continue
        if len(measured) > 1:
            shown.append(f"topic: {output.styled(name, 'name')}")
        shown += text.split("\n")
    if not output.json:
        output.report(shown)


# -- the figures ------------------------------------------------------------------------------------------


def _frequency(samples: Samples, now: float) -> Report | None:
    between = spread([later - earlier for (earlier, _), (later, _) in pairwise(samples)])
    if between is None or between.mean <= 0:
        return None
    rate = 1 / between.mean
    record = {"rate": rate, **_fields(between), "window": len(samples)}
    return f"average rate: {rate:.3f}\n{_seconds(between, 1)}", record


def _bandwidth(samples: Samples, now: float) -> Report | None:
    sizes = spread([size for _, size in samples])
    if sizes is None:
        return None
    elapsed = now - samples[0][0]
    rate = sum(size for _, size in samples) / elapsed if elapsed > 0 else 0.0
    mean, least, most = (in_bytes(value) for value in (sizes.mean, sizes.least, sizes.most))
    text = (
        f"{in_bytes(rate)}/s from {sizes.number} messages\n"
        f"\tMessage size mean: {mean} min: {least} max: {most}"
    )
    record = {"mean_bytes": sizes.mean, "min_bytes": sizes.least, "max_bytes": sizes.most}
    return text, {"bytes_per_second": rate, **record, "window": sizes.number}


def _lateness(samples: Samples, now: float) -> Report | None:
    late = spread([delay for _, delay in samples])
    if late is None:
        return None
    record = {"delay": late.mean, **_fields(late), "window": late.number}
    return f"average delay: {late.mean:.3f}\n{_seconds(late, 0)}", record


def _seconds(times: Spread, more: int) -> str:
    return (
        f"\tmin: {times.least:.3f}s max: {times.most:.3f}s std dev: {times.deviation:.5f}s "
        f"window: {times.number + more}"
    )


def _fields(times: Spread) -> dict[str, object]:
    return {"min_s": times.least, "max_s": times.most, "std_dev_s": times.deviation}


# -- time --------------------------------------------------------------------------------------------------


class _RobotClock:
    """Clock of the robot; that of this computer if the robot does not report its time."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._ahead = 0.0
        self._noted = False

    def now(self) -> float:
        return time.time() + self._ahead

    async def set(self) -> None:
        # Half of the round trip is taken for the way of the answer.

        before = time.time()
        try:
            there = await self._robot.time_ns() / NANOSECONDS
        except (ServiceFailed, ProviderNotFound):
            if not self._noted:
                note("rwt: the robot does not report its time: delays are relative to this computer's clock")
                self._noted = True
        else:
            self._ahead = there - (before + time.time()) / 2


async def _check_header(robot: Robot, name: str) -> None:
    kind = await TOPIC.known(robot, name)
    message_type = await robot.types.message(kind)
    header = next((slot.type for slot in message_type.slots if slot.name == "header"), None)
    if isinstance(header, field_types.Message) and header.type.name == "std_msgs/Header":
        return
    raise CommandError(f"{name}: {kind} has no header, so the delay of its messages is unknown")


VERBS = (
    Verb("hz", _hz, partial(_arguments, window=_MANY), definitions=True, until_interrupted=True),
    Verb("bw", _bw, partial(_arguments, window=_FEW), definitions=True, until_interrupted=True),
    Verb("delay", _delay, partial(_arguments, window=_MANY), definitions=True, until_interrupted=True),
)
