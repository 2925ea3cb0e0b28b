"""`rwt topic hz`, `bw` and `delay`: rates, sizes and delays of messages, reported once a second."""

from __future__ import annotations

import argparse
import math
from collections import deque
from collections.abc import Awaitable, Callable
from dataclasses import dataclass
from functools import partial
from itertools import pairwise
from typing import TYPE_CHECKING, Any, Final

from rwt.cli.console.output import Output, note
from rwt.cli.entities import TOPIC
from rwt.cli.errors import CommandError
from rwt.cli.graph_lookup import absolute_name
from rwt.cli.verbs import Arguments, Verb, count, seconds
from rwt_interfaces import field_types
from rwt_interfaces.times import NANOSECONDS

if TYPE_CHECKING:
    from rwt_client import RemoteSubscription, Robot

_MANY: Final = 10_000
_FEW: Final = 100


@dataclass(frozen=True, slots=True)
class Spread:
    """Summary of some numbers.

    Attributes:
        mean: arithmetic mean.
        least: minimum.
        most: maximum.
        deviation: standard deviation of the population.
        number: count of the numbers.
    """

    mean: float
    least: float
    most: float
    deviation: float
    number: int


class Window:
    """Newest values of a quantity, each with its time of arrival.

    Args:
        longest: maximum number of values.
    """

    def __init__(self, longest: int) -> None:
        self._seen: deque[tuple[float, float]] = deque(maxlen=longest)

    def __len__(self) -> int:
        return len(self._seen)

    def add(self, time: float, value: float) -> None:
        """Add a value that arrived at `time`, in seconds."""
        self._seen.append((time, value))

    def spread(self) -> Spread | None:
        """Return the summary of the values; None if there are none."""
        return spread([value for _, value in self._seen])

    def intervals(self) -> Spread | None:
        """Return the summary of the intervals in seconds; None with fewer than two values."""
        times = [time for time, _ in self._seen]
        return spread([later - earlier for earlier, later in pairwise(times)])

    def per_second(self, now: float) -> float:
        """Return the sum of the values per second, from the first one until `now`."""
        if not self._seen or now <= self._seen[0][0]:
            return 0.0
        return sum(value for _, value in self._seen) / (now - self._seen[0][0])


def spread(values: list[float]) -> Spread | None:
    """Return the summary of some numbers; None if there are none."""
    if not values:
        return None
    mean = math.fsum(values) / len(values)
    deviation = math.sqrt(math.fsum((value - mean) ** 2 for value in values) / len(values))
    return Spread(mean, min(values), max(values), deviation, len(values))


def in_bytes(number: float) -> str:
    """Format a number of bytes in powers of 1000: ``1.23 MB``."""
    for unit in ("B", "KB", "MB"):
        if number < 1000:
            return f"{number:.0f} {unit}" if unit == "B" else f"{number:.2f} {unit}"
        number /= 1000
    return f"{number:.2f} GB"


@dataclass(frozen=True, slots=True)
class MeasuredTopic:
    """Subscribed topic with a window of its messages."""

    subscription: RemoteSubscription
    window: Window


@dataclass(frozen=True, slots=True)
class Report:
    """Figures of one topic at one time.

    Attributes:
        text: text for people, without the name of the topic.
        record: JSON object for programs.
    """

    text: str
    record: dict[str, object]


Measure = Callable[[MeasuredTopic, float], Report | None]
"""Function that reports a topic at a time in seconds of the event loop; None if there are no figures."""


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
    await _measure(robot, arguments, output, _frequency, lambda measured, message: 0.0)


async def _bw(robot: Robot, arguments: Arguments, output: Output) -> None:
    before: dict[str, int] = {}

    def size(subscription: RemoteSubscription, message: Any) -> float:
        new = subscription.received_bytes - before.get(subscription.name, 0)
        before[subscription.name] = subscription.received_bytes
        return float(new)

    await _measure(robot, arguments, output, _bandwidth, size)


async def _delay(robot: Robot, arguments: Arguments, output: Output) -> None:
    clock = _RobotClock(robot)
    await clock.set()

    def age(subscription: RemoteSubscription, message: Any) -> float:
        return clock.now() - _stamp(message.header.stamp)

    names = [absolute_name(name) for name in arguments.topic]
    for name in names:
        await _check_header(robot, name)
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
    import anyio

    measured = [
        await _listen(robot, absolute_name(name), arguments.window, value)
        for name in dict.fromkeys(arguments.topic)
    ]
    reported = 0
    due = anyio.current_time()
    while arguments.times is None or reported < arguments.times:
        due = max(due + arguments.interval, anyio.current_time())
        await anyio.sleep_until(due)
        _report(measured, anyio.current_time(), measure, output)
        reported += 1
        if between is not None:
            await between()


async def _listen(
    robot: Robot, name: str, window: int, value: Callable[[RemoteSubscription, Any], float]
) -> MeasuredTopic:
    import anyio

    seen = Window(window)
    kind = await TOPIC.known(robot, name)

    def hear(message: Any) -> None:
        seen.add(anyio.current_time(), value(subscription, message))

    subscription = await robot.subscribe(name, hear, kind)
    return MeasuredTopic(subscription, seen)


def _report(measured: list[MeasuredTopic], now: float, measure: Measure, output: Output) -> None:
    shown: list[str] = []
    for each in measured:
        report = measure(each, now)
        name = each.subscription.name
        if output.json:
            output.record({"topic": name, **({"messages": 0} if report is None else report.record)})
            continue
        if len(measured) > 1:
            shown.append(f"topic: {output.styled(name, 'name')}")
        shown += (report.text if report is not None else f"no messages on {name} yet").split("\n")
    if output.people:
        output.live(shown)
    elif not output.json:
        output.text("".join(f"{line}\n" for line in shown))


# -- the figures ------------------------------------------------------------------------------------------


def _frequency(measured: MeasuredTopic, now: float) -> Report | None:
    between = measured.window.intervals()
    if between is None or between.mean <= 0:
        return None
    rate = 1 / between.mean
    record = {"rate": rate, **_fields(between, "s")}
    return Report(
        f"average rate: {rate:.3f}\n{_seconds(between, 1)}", {**record, "window": len(measured.window)}
    )


def _bandwidth(measured: MeasuredTopic, now: float) -> Report | None:
    sizes = measured.window.spread()
    if sizes is None:
        return None
    rate = measured.window.per_second(now)
    mean, least, most = (in_bytes(value) for value in (sizes.mean, sizes.least, sizes.most))
    text = (
        f"{in_bytes(rate)}/s from {sizes.number} messages\n"
        f"\tMessage size mean: {mean} min: {least} max: {most}"
    )
    record = {
        "bytes_per_second": rate,
        "mean_bytes": sizes.mean,
        "min_bytes": sizes.least,
        "max_bytes": sizes.most,
    }
    return Report(text, {**record, "window": sizes.number})


def _lateness(measured: MeasuredTopic, now: float) -> Report | None:
    late = measured.window.spread()
    if late is None:
        return None
    record = {"delay": late.mean, **_fields(late, "s"), "window": late.number}
    return Report(f"average delay: {late.mean:.3f}\n{_seconds(late, 0)}", record)


def _seconds(times: Spread, more: int) -> str:
    return (
        f"\tmin: {times.least:.3f}s max: {times.most:.3f}s std dev: {times.deviation:.5f}s "
        f"window: {times.number + more}"
    )


def _fields(times: Spread, unit: str) -> dict[str, object]:
    return {f"min_{unit}": times.least, f"max_{unit}": times.most, f"std_dev_{unit}": times.deviation}


# -- time --------------------------------------------------------------------------------------------------


class _RobotClock:
    """Clock of the robot; that of this computer if the robot does not report its time."""

    def __init__(self, robot: Robot) -> None:
        self._robot = robot
        self._ahead = 0.0
        self._noted = False

    def now(self) -> float:
        """Return seconds since 1970, or since the start of the simulation."""
        import time

        return time.time() + self._ahead

    async def set(self) -> None:
        """Ask the robot for its time, assuming half of the round trip for the answer."""
        import time

        from rwt_participant.errors import ProviderNotFound, ServiceFailed

        before = time.time()
        try:
            there = await self._robot.time_ns() / NANOSECONDS
        except (ServiceFailed, ProviderNotFound):
            if not self._noted:
                note("rwt: the robot does not report its time: delays are relative to this computer's clock")
                self._noted = True
        else:
            self._ahead = there - (before + time.time()) / 2


def _stamp(time: Any) -> float:
    whole, rest = (getattr(time, name) for name in time.__struct_fields__)
    return float(whole + rest / NANOSECONDS)


async def _check_header(robot: Robot, name: str) -> None:
    kind = await TOPIC.known(robot, name)
    message_type = await robot.types.message(kind)
    for slot in message_type.slots:
        if (
            slot.name == "header"
            and isinstance(slot.type, field_types.Message)
            and slot.type.type.name == "std_msgs/Header"
        ):
            return
    raise CommandError(f"{name}: {kind} has no header, so the delay of its messages is unknown")


VERBS = (
    Verb(
        "hz",
        "measure the rate of topics",
        _hz,
        "rwt topic hz /odom\nrwt topic hz /odom /scan -n 3",
        'one line for each topic and report: {"topic": "/odom", "rate": 20.0, "min_s": 0.049,\n'
        '"max_s": 0.051, "std_dev_s": 0.0004, "window": 21}; {"topic": …, "messages": 0} while there is\n'
        "nothing to print",
        partial(_arguments, window=_MANY),
        definitions=True,
        until_interrupted=True,
    ),
    Verb(
        "bw",
        "measure the bandwidth of topics",
        _bw,
        "rwt topic bw /scan",
        'one line for each topic and report: {"topic": "/scan", "bytes_per_second": 14400.0,\n'
        '"mean_bytes": …, "min_bytes": …, "max_bytes": …, "window": 10}; sizes are\n'
        "those of the messages on the connection",
        partial(_arguments, window=_FEW),
        definitions=True,
        until_interrupted=True,
    ),
    Verb(
        "delay",
        "measure the delay of messages since their header stamps",
        _delay,
        "rwt topic delay /odom",
        'one line for each topic and report: {"topic": "/odom", "delay": 0.002, "min_s": …, "max_s": …,\n'
        '"std_dev_s": …, "window": 20}; against the robot\'s clock, in seconds',
        partial(_arguments, window=_MANY),
        definitions=True,
        until_interrupted=True,
    ),
)
