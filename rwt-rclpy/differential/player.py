"""Plays programs with the rclpy of this interpreter, each in a forked process, and writes what they printed.

It runs in the interpreter of ROS as well, and therefore imports nothing of this project but for `--ours`.
"""

from __future__ import annotations

import argparse
import importlib
import json
import os
import signal
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

HERE = Path(__file__).parent
#: Seconds after which a program is ended.
LONGEST_S = 60.0
#: First ROS domain of programs, ROS_DOMAIN_ID or 90, and number of domains: processes that follow each other
#: are in different ones.
_FIRST = int(os.environ.get("ROS_DOMAIN_ID", "90"))
DOMAINS = range(_FIRST, _FIRST + 10)

Program = Callable[[], None]


def areas() -> list[str]:
    """Return the names of all areas."""
    return sorted(each.stem for each in (HERE / "programs").glob("[!_]*.py"))


def programs(area: str) -> dict[str, Program]:
    """Return the programs of an area by name."""
    module = importlib.import_module(f"differential.programs.{area}")
    return {
        f"{area}.{name}": value
        for name, value in vars(module).items()
        if callable(value) and value.__module__ == module.__name__ and not name.startswith("_")
    }


def play(chosen: dict[str, Program], jobs: int, first_domain: int) -> Iterator[tuple[str, int, str]]:
    """Yield the name, the exit status and the output of each program.

    In the process of a program it yields nothing more: that process runs the program and exits.
    """
    waiting = list(chosen)
    running: dict[int, tuple[str, float, Any]] = {}
    number = 0
    while waiting or running:
        while waiting and len(running) < jobs:
            name = waiting.pop(0)
            output = tempfile.TemporaryFile()  # noqa: SIM115 - read and closed after the process has ended
            domain = DOMAINS[(first_domain + number) % len(DOMAINS)]
            number += 1
            pid = os.fork()
            if not pid:
                _become(chosen[name], output.fileno(), domain)
            running[pid] = name, time.monotonic() + LONGEST_S, output
        for pid, (name, end, output) in tuple(running.items()):
            done, status = os.waitpid(pid, os.WNOHANG)
            if not done and time.monotonic() > end:
                os.kill(pid, signal.SIGKILL)
                done, status = os.waitpid(pid, 0)
            if done:
                del running[pid]
                output.seek(0)
                yield name, os.waitstatus_to_exitcode(status), output.read().decode("utf-8", "replace")
        time.sleep(0.002)


def _become(program: Program, output: int, domain: int) -> None:
    """Run a program as the main program of this process."""
    os.dup2(os.open(os.devnull, os.O_RDONLY), 0)
    os.dup2(output, 1)
    os.dup2(output if hasattr(program, "with_logs") else os.open(os.devnull, os.O_WRONLY), 2)
    os.environ["ROS_DOMAIN_ID"] = str(domain)
    sys.argv = ["program"]
    sys.excepthook = _uncaught
    threading.excepthook = lambda thrown: print("a thread ends by", thrown.exc_type.__name__)
    raise _Become(program)


class _Become(BaseException):
    def __init__(self, program: Program) -> None:
        self.program = program


def _uncaught(kind: type[BaseException], error: BaseException, trace: object) -> None:
    print("the program ends by", kind.__name__)


def main() -> Program | None:
    """Play programs; returns one in the process that is to run it."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--ours", action="store_true", help="use this project's rclpy")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--domain", type=int, default=0, help="number of the first domain")
    parser.add_argument("names", nargs="*", help="areas or programs; all by default")
    options = parser.parse_args()
    if options.ours:
        import rwt_rclpy

        rwt_rclpy.install([HERE / "interfaces"])
    sys.stdout.reconfigure(line_buffering=True)  # type: ignore[union-attr]  # a TextIOWrapper in a program
    wanted = options.names or areas()
    chosen: dict[str, Program] = {}
    for name in wanted:
        area, _, one = name.partition(".")
        found = programs(area)
        chosen.update({name: found[name]} if one else found)
    try:
        for name, status, text in play(chosen, options.jobs, options.domain):
            print(json.dumps([name, status, text]))
    except _Become as become:
        return become.program
    return None


if __name__ == "__main__":
    _program = main()
    if _program is not None:
        _program()
