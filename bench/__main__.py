"""`python -m bench`: measure the server and its peers in turns on this machine, and print the ratios."""

from __future__ import annotations

import argparse
import gc
import importlib.util
import json
import os
import shlex
import sys
from collections.abc import Iterable, Mapping, Sequence
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from bench.cases import CASES, METRICS, Case, Compared, Metric, Peer
from bench.report import Results, document, rows, table
from bench.traffic.dialects import FOXGLOVE, ROSBRIDGE, WrongAnswer
from bench.traffic.processes import Server, ServerFailed
from bench.turns import Turns
from tools.size.layout import Layout

HERE = Path(__file__).parent
PROGRAMS = {
    Peer.RELAY: (str(HERE / "peers" / "relay.py"),),
    Peer.FOXGLOVE: ("-m", "bench.peers.foxglove_sdk"),
}
FULL = (5, 1.0)
QUICK = (2, 0.5)


def arguments(argv: Sequence[str] | None) -> argparse.Namespace:
    parser = argparse.ArgumentParser(prog="python -m bench", description=__doc__)
    parser.add_argument("--quick", action="store_true", help="under a minute, and less exact")
    parser.add_argument(
        "--rounds", type=int, help=f"turns of each server (default {FULL[0]}, quick {QUICK[0]})"
    )
    parser.add_argument("--seconds", type=float, help=f"per load (default {FULL[1]}, quick {QUICK[1]})")
    parser.add_argument("--only", metavar="TEXT", help="only the cases whose name contains TEXT")
    parser.add_argument("--json", metavar="FILE", type=Path, help="write every measurement to FILE")
    parser.add_argument("--check", action="store_true", help="exit with 1 when a floor is missed")
    parser.add_argument(
        "--growth", action="store_true", help="what more of everything costs; --growth --help has its options"
    )
    parser.add_argument("--pin", action="store_true", help="servers on the first CPU, the load on the last")
    parser.add_argument(
        "--server",
        metavar="ARGS",
        type=shlex.split,
        default=[str(HERE / "peers" / "server.py")],
        help="Python arguments of another server, one that prints `listening on ws://HOST:PORT`",
    )
    parser.add_argument(
        "--against",
        metavar="DIR",
        type=Path,
        help="compare with the server of this checkout of an earlier commit instead of with the peers",
    )
    options = parser.parse_args(argv)
    rounds, seconds = QUICK if options.quick else FULL
    options.rounds = options.rounds or rounds
    options.seconds = options.seconds or seconds
    return options


def cpus(pin: bool) -> tuple[Iterable[int] | None, Iterable[int] | None]:
    """The CPUs of the servers and of the load; None leaves it to the kernel."""
    if not pin:
        return None, None
    usable = sorted(os.sched_getaffinity(0))
    return usable[:1], usable[-1:]


def present(cases: Sequence[Case]) -> list[Peer]:
    """The peers that the cases name, except an SDK that is not installed."""
    installed = importlib.util.find_spec("foxglove") is not None
    named = {peer for case in cases for peer in case.peers}
    return [peer for peer in Peer if peer in named and (installed or peer is not Peer.FOXGLOVE)]


def against_earlier(cases: Iterable[Case], metrics: Iterable[Metric]) -> tuple[list[Case], list[Metric]]:
    """Return cases and metrics in which the only peer is an earlier commit; they have no floors."""
    return (
        [replace(case, peers=(Peer.EARLIER,)) for case in cases],
        [
            replace(metric, peer=Peer.EARLIER, peer_case="", floor=None, compared=Compared.RATIO)
            for metric in metrics
            if metric.peer is Peer.RELAY
        ],
    )


def earlier_server(checkout: Path, server_cpus: Iterable[int] | None) -> Server:
    """Start the benchmark's server of another checkout, on that checkout's packages.

    Raises:
        ServerFailed: the checkout has no such server, or it did not start.
    """
    for program in (checkout / "bench" / "peers" / "server.py", checkout / "bench" / "server.py"):
        if program.exists():
            environment = Layout(checkout).environment()
            return Server(Peer.EARLIER.value, [str(program)], server_cpus, environment=environment)
    raise ServerFailed(f"--against: {checkout} has neither bench/peers/server.py nor bench/server.py")


def _was_measured(metric: Metric, theirs: Mapping[Peer, Results]) -> bool:
    return metric.peer in theirs and (metric.peer_case or metric.case) in theirs[metric.peer]


def main(argv: Sequence[str] | None = None) -> int:
    given = sys.argv[1:] if argv is None else list(argv)
    if "--growth" in given:
        from bench import growth  # it needs Zenoh, which this does not

        given.remove("--growth")
        return growth.main(given)
    options = arguments(given)
    cases = [case for case in CASES if not options.only or options.only in case.name]
    metrics: Sequence[Metric] = METRICS
    if options.against:
        cases, metrics = against_earlier(cases, metrics)
    server_cpus, load_cpus = cpus(options.pin)
    if load_cpus is not None:
        os.sched_setaffinity(0, load_cpus)
    gc.freeze()
    gc.disable()  # the load makes no cycles, and a collection would show up in the latencies
    with ExitStack() as stack:
        server = Server("this server", options.server, server_cpus)
        stack.callback(server.stop)
        peers: dict[Peer, Server] = {}
        for peer in present(cases):
            if peer is Peer.EARLIER:
                peers[peer] = earlier_server(options.against.resolve(), server_cpus)
            else:
                dialect = FOXGLOVE if peer is Peer.FOXGLOVE else ROSBRIDGE
                peers[peer] = Server(peer.value, PROGRAMS[peer], server_cpus, dialect)
            stack.callback(peers[peer].stop)
        turns = Turns(server, peers, cases, options.seconds)
        ours, theirs = turns.take(options.rounds)
    asked = [metric for metric in metrics if metric.case in ours]
    wanted = [metric for metric in asked if _was_measured(metric, theirs)]
    found = rows(wanted, ours, theirs)
    print(table(found))
    unmeasured = [metric for metric in asked if metric.peer not in theirs]
    if unmeasured:
        print(f"\n{len(unmeasured)} rows are left out: foxglove-sdk is not installed (group `bench`).")
    if turns.disturbed:
        count = f"{turns.disturbed} of {turns.measured}"
        print(f"\n{count} measurements had to share their CPUs with other programs: trust them less.")
    if options.json:
        text = json.dumps(document(found, cases, ours, theirs), indent=2, ensure_ascii=False)
        options.json.write_text(text + "\n", encoding="utf-8")
    missed = any(row.verdict in ("below", "lost") for row in found) or bool(unmeasured)
    return int(options.check and missed)


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (ServerFailed, WrongAnswer) as error:
        sys.exit(f"bench: {error}")
    except KeyboardInterrupt:
        sys.exit(130)
