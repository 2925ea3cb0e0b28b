"""`rwt top`: topics of a robot with their rates, nodes and clients."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from typing import TYPE_CHECKING, Final, NamedTuple

import anyio

from rwt.cli.commands.topic.rates import in_bytes
from rwt.cli.console.output import Output
from rwt.cli.entities import TOPIC, ask_rosapi
from rwt.cli.parser import Commands
from rwt.cli.verbs import (
    Arguments,
    Verb,
    add_verb,
    argument,
    arguments,
    count,
    rounds,
    seconds,
    tls_of,
    topic_glob,
    url_of,
)
from rwt_participant.errors import UnknownType

if TYPE_CHECKING:
    from rwt.cli.health import Health
    from rwt_client import Robot
    from rwt_participant.handles import Handle
    from rwt_participant.messages import RawMessage

_CLIENTS: Final = "/client_count"
_FRAME_LINES: Final = 4
"""Lines of the screen that are not rows of topics."""


def add_top_command(commands: Commands) -> None:
    """Add `top` to the command line."""
    add_verb(commands, _TOP)


@dataclass(slots=True)
class _Counted:
    """Subscribed topic, with counts since the last update.

    Attributes:
        since_ns: the robot's time of the subscription; older messages were latched, and are not counted.
    """

    type: str
    since_ns: int
    subscription: Handle | None = None
    messages: int = 0
    octets: int = 0

    def hear(self, message: RawMessage) -> None:
        if message.stamp_ns is None or message.stamp_ns >= self.since_ns:
            self.messages += 1
            self.octets += len(message.data)


class _Rate(NamedTuple):
    name: str
    type: str
    messages: float
    octets: float


class _Watch:
    """Subscriptions to all topics of a robot, undecoded, updated as topics come and go."""

    def __init__(self, robot: Robot, globs: list[str]) -> None:
        from rwt_graph.topic_selection import TopicSelection

        self.clients: int | None = None
        self._robot = robot
        self._selection = TopicSelection(tuple(globs), (), True, True)
        self._counted: dict[str, _Counted] = {}

    async def follow(self) -> None:
        topics = dict(await TOPIC.found(self._robot))
        since_ns = await ask_rosapi(self._robot.time_ns)
        for name in self._counted.keys() - topics.keys():
            gone = self._counted.pop(name).subscription
            if gone is not None:
                gone.close()
        for name, kind in topics.items():
            if name in self._counted or name == _CLIENTS or not kind or not self._selection.takes(name):
                continue
            counted = self._counted[name] = _Counted(kind, since_ns)
            try:
                counted.subscription = await self._robot.subscribe_raw(name, counted.hear, kind)
            except UnknownType:
                continue  # Listed without messages.

    def rates(self, elapsed: float) -> list[_Rate]:
        found = []
        for name, counted in self._counted.items():
            found.append(_Rate(name, counted.type, counted.messages / elapsed, counted.octets / elapsed))
            counted.messages = counted.octets = 0
        return sorted(found, key=lambda rate: (-rate.octets, rate.name))


async def _top(robot: Robot, arguments: Arguments, output: Output) -> None:
    """Watch topics with their rates and sizes, nodes and clients; subscribes to every topic.

    example:
      rwt top
      rwt top '/camera/*' --interval 5

    --json prints:
      one line for each update: {"topics": [{"name": "/odom", "type": …, "rate": 20.0,
      "bytes_per_second": …}, …], "nodes": ["/demo_robot", …], "clients": 2, "work": 0.03}; clients and
      work (processor seconds per second) are null if the server does not report them
    """
    from rwt.cli.health import health_of

    look = _Watch(robot, arguments.topics)
    # Servers of this project publish the number of clients.
    if any(name == _CLIENTS for name, _ in await TOPIC.found(robot)):
        await robot.subscribe(_CLIENTS, lambda message: setattr(look, "clients", message.data))
    await look.follow()
    since = anyio.current_time()
    for _ in rounds(arguments.times or (None if output.people else 1)):
        await anyio.sleep_until(since + arguments.interval)
        now = anyio.current_time()
        rates, since = look.rates(now - since), now
        nodes = sorted(await ask_rosapi(robot.api.nodes))
        health = await health_of(url_of(arguments), arguments.interval, tls_of(arguments))
        _print(rates, nodes, look.clients, health, output)
        await look.follow()


def _print(
    rates: list[_Rate], nodes: list[str], clients: int | None, health: Health | None, output: Output
) -> None:
    if output.json:
        topics = [
            {"name": rate.name, "type": rate.type, "rate": rate.messages, "bytes_per_second": rate.octets}
            for rate in rates
        ]
        work = health.work if health is not None and health.version else None
        output.record({"topics": topics, "nodes": nodes, "clients": clients, "work": work})
        return
    total = in_bytes(sum(rate.octets for rate in rates))
    head = f"{len(rates)} topics, {total}/s; {len(nodes)} nodes"
    lines = [head if clients is None else f"{head}; {clients} clients"]
    if health is not None and health.version:
        lines[0] += f", {health.work:.0%} of a processor used for them"
        if health.clients_beyond_rate:
            lines[0] += f", {health.clients_beyond_rate} beyond limits.work_per_second"
    shown = rates[: max(1, shutil.get_terminal_size().lines - _FRAME_LINES)] if output.people else rates
    width = max((len(rate.name) for rate in shown), default=0)
    lines.append(output.styled(f"{'Hz':>8}  {'a second':>10}  {'topic':<{width}}  type", "heading"))
    for rate in shown:
        name = output.styled(rate.name, "name") + " " * (width - len(rate.name))
        figures = f"{rate.messages:>8.1f}  {in_bytes(rate.octets):>10}"
        lines.append(f"{figures}  {name}  {output.styled(rate.type, 'type')}")
    if len(shown) < len(rates):
        lines.append(f"… and {len(rates) - len(shown)} more")
    output.report(lines, f"nodes: {' '.join(nodes)}")


_TOP = Verb(
    "top",
    _top,
    arguments(
        argument(
            "topics",
            metavar="GLOB",
            nargs="*",
            type=topic_glob,
            help="only topics that match, for example '/camera/*'",
        ),
        argument(
            "--interval",
            type=seconds,
            default=1.0,
            metavar="SECONDS",
            help="seconds between updates (default 1)",
        ),
        argument(
            "-n",
            "--times",
            type=count,
            metavar="N",
            help="stop after N updates (default 1 without a terminal)",
        ),
    ),
    definitions=True,
    until_interrupted=True,
)
