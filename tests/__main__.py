"""Runs all tests: in several programs beside each other, and those that failed once more, alone.

A machine that does other things at the same time may starve a real browser or a real client until its test
gives up. So whatever failed is asked again with nothing beside it. The run fails with what fails then, or if
much failed at first; its end says what was asked again.
"""

from __future__ import annotations

import argparse
import os
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from pathlib import Path
from threading import Timer
from typing import Final
from xml.etree import ElementTree

TESTS: Final = Path(__file__).parent
RCLPY_TESTS: Final = TESTS.parent / "rwt-rclpy" / "tests"

LONG: Final = (
    "faults/attacks",
    "conformance",
    "browser",
    "rwt/cli",
    "docs",
    "clients",
    "faults",
    "release",
    "rwt",
    "rwt/gateways/mcp",
    "traces",
    "graph/zenoh",
    "rwt/testing/pytest_plugin",
    "rwt/media/webrtc",
)
"""Folders whose tests start servers, clients, browsers and compilers, the longest first: they are begun
before the others, so that no core is idle while the last one runs."""

FILES: Final = 6
"""Files of such a folder in one program."""

SHORT_FILES: Final = 18
"""Files of another folder in one program, whose start takes longer than many a file."""

MANY: Final = 25
"""Failures that no busy machine explains."""

PATIENCE: Final = 1800.0
"""Seconds after which a program hangs; each test has a limit of its own, but what is around them has none."""

NO_TESTS: Final = 5
"""The exit code of pytest where no test is as asked."""


@dataclass(frozen=True)
class Outcome:
    """What became of one program.

    Attributes:
        files: whose tests it ran.
        output: what it printed.
        seconds: how long it took.
        cpu: seconds that processors worked for it and for what it started and waited for.
        tests: how many it ran.
        failed: those of them that failed, as pytest names them; of a program that did not come to its end,
            its files.
    """

    files: tuple[str, ...]
    output: str
    seconds: float
    cpu: float
    tests: int
    failed: tuple[str, ...]

    @property
    def name(self) -> str:
        """What to call it."""
        first = self.files[0].partition("::")[0]
        return first if len(self.files) == 1 else f"{first} and {len(self.files) - 1} more"

    def show(self) -> None:
        """Print how it ended, and of what failed everything."""
        failed = f", {len(self.failed)} FAILED" if self.failed else ""
        took = f"{self.seconds:6.1f} s {self.cpu:6.1f} s CPU"
        print(f"{took} {self.tests:5} tests  {self.name}{failed}", flush=True)
        if self.failed:
            # Those that passed are not worth a line each; the last one that began may be the one that hung.
            lines = self.output.splitlines()
            print("\n".join(line for line in lines if " PASSED " not in line), flush=True)


def programs(paths: Iterable[Path]) -> list[tuple[str, ...]]:
    """The files of each program, those that take longest first."""
    found: list[tuple[int, int, tuple[str, ...]]] = []
    by_folder: dict[Path, list[Path]] = {}
    for path in paths:
        for file in sorted(path.rglob("test_*.py")) if path.is_dir() else [path]:
            by_folder.setdefault(file.parent, []).append(file)
    for folder, files in by_folder.items():
        name = os.path.relpath(folder, TESTS)
        rank, most = (LONG.index(name), FILES) if name in LONG else (len(LONG), SHORT_FILES)
        for start in range(0, len(files), most):
            chosen = files[start : start + most]
            size = sum(file.stat().st_size for file in chosen)
            found.append((rank, -size, tuple(os.path.relpath(file) for file in chosen)))
    return [names for _, _, names in sorted(found)]


_running: set[int] = set()
"""Ids of the programs that run now, each of which leads a group of processes."""


def _end(number: int, frame: object) -> None:
    """Ctrl-C or a supervisor: let the programs end what they have started, and begin no more."""
    for program in tuple(_running):
        os.killpg(program, signal.SIGINT)
    raise SystemExit(128 + number)


def run(files: tuple[str, ...], further: list[str]) -> Outcome:
    """Run some tests in a program of their own."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.xml")
        command = [sys.executable, "-m", "pytest", "-v", f"--junitxml={report}", "-o", "junit_family=xunit1"]
        command += ["-o", f"cache_dir={folder}/cache", *further, *files]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
        ) as program:
            ends = Timer(PATIENCE, os.killpg, (program.pid, signal.SIGKILL))
            ends.start()
            _running.add(program.pid)
            assert program.stdout is not None
            output = program.stdout.read().decode(errors="replace")
            _, status, used = os.wait4(program.pid, 0)
            program.returncode = os.waitstatus_to_exitcode(status)
            _running.discard(program.pid)
            ends.cancel()
        seconds = time.monotonic() - began
        if program.returncode in (0, NO_TESTS):
            failed: tuple[str, ...] = ()
        elif report.exists() and program.returncode == 1:
            failed = _failed(report)
        else:
            failed = files
        tests = len(list(ElementTree.parse(report).iter("testcase"))) if report.exists() else 0
    return Outcome(files, output, seconds, used.ru_utime + used.ru_stime, tests, failed)


def _failed(report: Path) -> tuple[str, ...]:
    """The tests that a report in JUnit's form has as failed, as pytest takes them."""
    found: dict[str, None] = {}
    for case in ElementTree.parse(report).iter("testcase"):
        if case.find("failure") is not None or case.find("error") is not None:
            file, name, owner = case.get("file", ""), case.get("name", ""), case.get("classname", "")
            stem = file.removesuffix(".py").replace("/", ".")
            within = owner.removeprefix(stem).removeprefix(".").replace(".", "::")
            found["::".join(each for each in (file, within, name) if each)] = None
    return tuple(found)


def main() -> int:
    """Run, and return the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tests",
        description=__doc__,
        epilog="example: python -m tests --processes 4 tests/rwt/gateways/rosbridge tests/rwt/access -- -x",
    )
    beside = max(3, 2 * (os.cpu_count() or 1))
    parser.add_argument(
        "--processes",
        type=int,
        default=beside,
        help=f"programs that run beside each other, and wait much of their time [two a core, {beside}]",
    )
    parser.add_argument(
        "paths", nargs="*", type=Path, default=[TESTS, RCLPY_TESTS], help="files and folders [all]"
    )
    given, further = sys.argv[1:], []
    if "--" in given:
        given, further = given[: given.index("--")], given[given.index("--") + 1 :]
    options = parser.parse_args(given)
    # In a shell's background Ctrl-C is ignored, and under nohup a hangup, by all that the tests start, too.
    signal.signal(signal.SIGINT, _end)
    signal.signal(signal.SIGTERM, _end)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, lambda *_: None)
    began = time.monotonic()
    outcomes: list[Outcome] = []

    def done(files: tuple[str, ...]) -> None:
        outcome = run(files, further)
        outcome.show()
        outcomes.append(outcome)

    with ThreadPoolExecutor(options.processes) as pool:
        list(pool.map(done, programs(options.paths)))
    failed = [test for outcome in outcomes for test in outcome.failed]
    minutes, cpu = (time.monotonic() - began) / 60, sum(outcome.cpu for outcome in outcomes) / 60
    took = f"in {minutes:.1f} minutes, {cpu:.1f} minutes of CPU"
    print(f"{sum(outcome.tests for outcome in outcomes)} tests, {len(failed)} failed, {took}")
    if not failed:
        return 0
    if len(failed) > MANY:
        print("so many are not asked again")
        return 1
    print("asking again, alone:\n" + "\n".join(f"  {test}" for test in failed), flush=True)
    still: list[str] = []
    for test in failed:
        again = run((test,), further)
        again.show()
        still += again.failed
    for heading, tests in (
        ("passed when asked again:", [test for test in failed if test not in still]),
        ("FAILED:", still),
    ):
        if tests:
            print("\n".join([heading, *(f"  {test}" for test in tests)]))
    return 1 if still else 0


if __name__ == "__main__":
    sys.exit(main())
