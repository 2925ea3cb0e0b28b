"""`python -m bench.fleet.scale`: what a fleet costs on N machines, by constants that were measured.

Prints the tables of docs/explanation/scale.md. The constants are of one machine; measure yours with
`python -m bench.fleet.workers`, `bench.transport.zenoh` and `bench.fleet.load_1000`, and give them as
options.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

MICRO, KILO = 1e-6, 1e3


@dataclass(frozen=True, slots=True)
class Constants:
    """Measured costs.

    Attributes:
        delivery_us: CPU of one small message to one client, written by itself (bench.fleet.workers, one
            process).
        arrival_busy_us: CPU of one small message that comes over Zenoh among many (bench.transport.zenoh,
            a flood).
        arrival_quiet_us: the same when it comes alone, and each wakes four threads (400 a second).
        learned_kb: memory for what is known of a robot: its node and 20 topics.
        learned_ms: CPU to learn of it.
        client_kb: memory of a client with 20 subscriptions.
        idle_mb: memory of a process that serves a graph over Zenoh.
        frame_bytes: of a small message to a client, headers included.
    """

    delivery_us: float = 4.6
    arrival_busy_us: float = 7.0
    arrival_quiet_us: float = 170.0
    learned_kb: float = 233.0
    learned_ms: float = 4.9
    client_kb: float = 56.0
    idle_mb: float = 63.0
    frame_bytes: float = 220.0


@dataclass(frozen=True, slots=True)
class Fleet:
    """Parameters of a fleet.

    Attributes:
        robots: how many.
        topics: of each, of which every viewer of the robot hears all.
        viewers: clients of each robot.
        hertz: messages a second of each topic.
        processes: that serve, on each machine.
    """

    robots: int = 1000
    topics: int = 20
    viewers: int = 10
    hertz: float = 10.0
    processes: int = 4

    @property
    def messages(self) -> float:
        """A second, of all robots."""
        return self.robots * self.topics * self.hertz

    @property
    def deliveries(self) -> float:
        """A second, to all viewers."""
        return self.messages * self.viewers


@dataclass(frozen=True, slots=True)
class Cost:
    """Load of one process.

    Attributes:
        processes: on all machines together.
        clients: of one process.
        arrivals: messages a second that come to it over Zenoh.
        busy, quiet: the part of a core that it needs, at the two costs of an arrival.
        memory_mb: of one process.
        links: Zenoh links of one process, to robots and to the other processes.
    """

    processes: int
    clients: float
    arrivals: float
    busy: float
    quiet: float
    memory_mb: float
    links: float


def copies(processes: int, viewers: int) -> float:
    """Return how many processes receive a message, if the viewers of its robot are at random ones."""
    return processes * (1 - (1 - 1 / processes) ** viewers)


def cost(fleet: Fleet, constants: Constants, machines: int, *, by_robot: bool) -> Cost:
    """Return the load of one process.

    Args:
        by_robot: all viewers of a robot are at one process, and each process is joined with its own robots
            only; otherwise viewers are anywhere, and every process is joined with every robot.
    """
    processes = machines * fleet.processes
    heard = 1.0 if by_robot else copies(processes, fleet.viewers)
    arrivals = fleet.messages * heard / processes
    known = fleet.robots / processes if by_robot else fleet.robots
    clients = fleet.robots * fleet.viewers / processes
    deliveries = fleet.deliveries / processes * constants.delivery_us * MICRO
    return Cost(
        processes,
        clients,
        arrivals,
        deliveries + arrivals * constants.arrival_busy_us * MICRO,
        deliveries + arrivals * constants.arrival_quiet_us * MICRO,
        constants.idle_mb + (known * constants.learned_kb + clients * constants.client_kb) / KILO,
        known if by_robot else known + processes - 1,
    )


def table(fleet: Fleet, constants: Constants, machines: Sequence[int], *, by_robot: bool) -> str:
    lines = [
        "| machines | processes | clients each | arrivals each, /s | cores each | memory each | links each |",
        "|---:|---:|---:|---:|---:|---:|---:|",
    ]
    for count in machines:
        each = cost(fleet, constants, count, by_robot=by_robot)
        lines.append(
            f"| {count} | {each.processes} | {each.clients:,.0f} | {each.arrivals:,.0f} "
            f"| {each.busy:.2f} to {each.quiet:.2f} | {each.memory_mb:,.0f} MB | {each.links:,.0f} |"
        )
    return "\n".join(lines)


def totals(fleet: Fleet, constants: Constants) -> str:
    out = fleet.deliveries * constants.frame_bytes * 8 / 1e9
    return (
        f"{fleet.messages:,.0f} messages a second from the robots, {fleet.deliveries:,.0f} deliveries a "
        f"second to {fleet.robots * fleet.viewers:,} viewers: {out:.1f} Gbit/s, and "
        f"{fleet.deliveries * constants.delivery_us * MICRO:.1f} cores for the deliveries alone."
    )


MACHINES = (1, 2, 3, 5, 10, 25)


def report(fleet: Fleet, constants: Constants) -> str:
    return "\n\n".join(
        (
            totals(fleet, constants),
            table(fleet, constants, MACHINES, by_robot=False),
            table(fleet, constants, MACHINES, by_robot=True),
        )
    )


def main(argv: Sequence[str] | None = None) -> int:
    parser = argparse.ArgumentParser(prog="python -m bench.fleet.scale", description=__doc__)
    fleet, constants = Fleet(), Constants()
    for made in (fleet, constants):
        for each in fields(made):
            value = getattr(made, each.name)
            parser.add_argument(
                f"--{each.name.replace('_', '-')}",
                type=type(value),
                default=value,
                metavar="N",
                help=f"default {value}",
            )
    options = vars(parser.parse_args(argv))
    fleet = replace(fleet, **{each.name: options[each.name] for each in fields(fleet)})
    constants = replace(constants, **{each.name: options[each.name] for each in fields(constants)})
    print(report(fleet, constants))
    return 0


if __name__ == "__main__":
    raise SystemExit(main())
