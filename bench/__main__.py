"""`python -m bench`: measure the server and the relay in turns on this machine, and print the ratios."""

from __future__ import annotations

import argparse
import gc
import json
import os
import shlex
import sys
from collections.abc import Iterable, Sequence
from contextlib import ExitStack
from pathlib import Path

from bench.cases import CASES, METRICS
from bench.load import WrongAnswer
from bench.processes import Server, ServerFailed
from bench.report import document, rows, table
from bench.turns import Turns

HERE = Path(__file__).parent
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
    parser.add_argument("--pin", action="store_true", help="servers on the first CPU, the load on the last")
    parser.add_argument(
        "--server",
        metavar="ARGS",
        type=shlex.split,
        default=[str(HERE / "server.py")],
        help="Python arguments of another server, one that prints `listening on ws://HOST:PORT`",
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


def main(argv: Sequence[str] | None = None) -> int:
    options = arguments(argv)
    cases = [case for case in CASES if not options.only or options.only in case.name]
    server_cpus, load_cpus = cpus(options.pin)
    if load_cpus is not None:
        os.sched_setaffinity(0, load_cpus)
    gc.freeze()
    gc.disable()  # the load makes no cycles, and a collection would show up in the latencies
    with ExitStack() as stack:
        servers = []
        for name, args in (("this server", options.server), ("relay", [str(HERE / "relay.py")])):
            servers.append(Server(name, args, server_cpus))
            stack.callback(servers[-1].stop)
        turns = Turns(servers, cases, options.seconds)
        server, relay = turns.take(options.rounds)
    wanted = [m for m in METRICS if m.case in server and (m.relay_case or m.case) in relay]
    found = rows(wanted, server, relay)
    print(table(found))
    if turns.disturbed:
        count = f"{turns.disturbed} of {turns.measured}"
        print(f"\n{count} measurements had to share their CPUs with other programs: trust them less.")
    if options.json:
        text = json.dumps(document(found, cases, server, relay), indent=2, ensure_ascii=False)
        options.json.write_text(text + "\n", encoding="utf-8")
    return int(options.check and any(row.verdict in ("below", "lost") for row in found))


if __name__ == "__main__":
    try:
        sys.exit(main())
    except (ServerFailed, WrongAnswer) as error:
        sys.exit(f"bench: {error}")
    except KeyboardInterrupt:
        sys.exit(130)
