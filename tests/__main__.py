"""Run the tests in several processes, and those that fail a second time, alone.

A busy machine may starve a browser or a client until its test gives up. A failed test is therefore run again
with nothing beside it. The run fails if a test fails twice, or if many fail at first. Its end lists the tests
that needed a retry, the skipped tests, and what was left to `make test-all`.
"""

from __future__ import annotations

import argparse
import os
import re
import shutil
import signal
import subprocess
import sys
import tempfile
import time
import tomllib
from collections import Counter
from collections.abc import Iterable, Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from importlib.metadata import PackageNotFoundError, version
from itertools import chain
from pathlib import Path
from threading import Lock, Timer
from typing import Final
from xml.etree import ElementTree

from packaging.requirements import Requirement

TESTS: Final = Path(__file__).parent
ROOT: Final = TESTS.parent
BROWSER_TESTS: Final = Path("tests/browser")
LEROBOT_TESTS: Final = ROOT / "rwt-lerobot" / "tests"
MAVLINK_TESTS: Final = ROOT / "rwt-mavlink" / "tests"
RCLPY_TESTS: Final = ROOT / "rwt-rclpy" / "tests"
WEBRTC_TESTS: Final = ROOT / "rwt-webrtc" / "tests"

EXTENDED: Final = {
    "../rwt-rclpy/tests": "the distribution rwt-rclpy",
    "../rwt-webrtc/tests/media/test_gstreamer.py": "needs GStreamer",
    "../rwt-webrtc/tests/transport/test_nat.py": "needs Chromium, root and nft",
    "bench": "tests of the benchmarks",
    "browser": "needs Chromium and Node",
    "clients": "needs Node and the clients of others",
    "docs": "needs Node, takes minutes",
    "examples": "needs PyBullet",
    "faults": "takes minutes",
    "fuzz": "replays the corpus, takes minutes",
    "extensions/zenoh/test_pyzeros.py": "needs a C compiler",
    "extensions/zenoh/test_ros2_sdk.py": "needs zenoh-ros2-sdk",
    "journeys": "needs Node and the clients, takes minutes",
    "release": "builds wheels, needs Node",
    "extensions/ros1/live": "needs Debian's packages of ROS 1 (`make test-ros1`), takes minutes",
    "extensions/mcp/test_inspector.py": "needs Node",
    "tools": "tests of the development tools",
    "extensions/asgi/test_servers.py": "needs ASGI servers and Django",
}
"""Folders and files that `make test` leaves to `make test-all`, each with the reason.

`make test` needs only Python and the dependency group `test`. Single tests of other files are left out by the
marker `extended`.
"""

PROGRAMS: Final = {
    "C compiler": ("cc",),
    "Caddy": ("caddy",),
    "Chromium": ("chromium", "chromium-browser", "google-chrome"),
    "coturn": ("turnserver",),
    "iproute2": ("ip",),
    "nftables": ("nft",),
    "nginx": ("nginx",),
    "Node": ("node",),
    "tmux": ("tmux",),
}
"""Programs that `make test-all` uses, each with the names of its command; `.ci/run` installs them."""

LONG: Final = (
    "faults/attacks",
    "conformance",
    "browser",
    "core/cli",
    "journeys",
    "docs",
    "clients",
    "faults",
    "extensions/ros1/live",
    "extensions/ros2/live",
    "release",
    "core/server",
    "extensions/workers",
    "extensions/recording",
    "extensions/mcp",
    "traces",
    "extensions/zenoh",
    "extensions/testing/pytest_plugin",
    "../rwt-webrtc/tests/media",
    "../rwt-webrtc/tests/transport",
    "core/interfaces",
)
"""Folders whose tests start servers, clients, browsers and compilers, the longest first.

They start before the others, so that no core is idle while the last one runs.
"""

LONG_FILES: Final = 6
"""Files of such a folder per process."""

SHORT_FILES: Final = 18
"""Files of any other folder per process; starting a process takes longer than many of them."""

IDLE_SHARE: Final = 0.25
"""Share of the processors' time that is idle when one process more may start."""

MAX_RETRIES: Final = 25
"""More failures than a busy machine explains."""

PROCESS_TIMEOUT_SECONDS: Final = 1800.0
"""Limit for one process. Each test has a timeout of its own; what surrounds the tests has none."""

NO_TESTS: Final = 5
"""Exit code of pytest if all tests are deselected."""

PROCESSOR_TIMES: Final = Path("/proc/stat")

RETRIED: Final = ROOT / "build" / "retried.txt"
"""The tests of the last run that needed a retry, one a line."""

KNOWN_RETRIED: Final = TESTS / "retried.toml"
"""Tests that are known to need a retry."""


@dataclass(frozen=True)
class Outcome:
    """Result of one process.

    Attributes:
        files: files whose tests it ran.
        output: its output.
        seconds: wall time.
        cpu: CPU seconds, including those of its children.
        tests: number of tests run.
        failed: IDs of the failed tests; the files if the process did not finish.
        skipped: number of skipped tests by reason.
        deselected: number of tests deselected by marker.
    """

    files: tuple[str, ...]
    output: str
    seconds: float
    cpu: float
    tests: int
    failed: tuple[str, ...]
    skipped: Counter[str]
    deselected: int

    @property
    def name(self) -> str:
        """Label in the output."""
        first = self.files[0].partition("::")[0]
        return first if len(self.files) == 1 else f"{first} and {len(self.files) - 1} more"

    def show(self) -> None:
        """Print a summary line, and the output of a process with failures."""
        failed = f", {len(self.failed)} FAILED" if self.failed else ""
        took = f"{self.seconds:6.1f} s {self.cpu:6.1f} s CPU"
        print(f"{took} {self.tests:5} tests  {self.name}{failed}", flush=True)
        if self.failed:
            # The last test that started may be the one that hung; those that passed only hide it.
            lines = self.output.splitlines()
            print("\n".join(line for line in lines if " PASSED " not in line), flush=True)


def is_extended(file: Path) -> bool:
    """True if `make test` leaves the file to `make test-all`."""
    name = Path(os.path.relpath(file, TESTS))
    return any(name.is_relative_to(each) for each in EXTENDED)


def test_files(paths: Iterable[Path]) -> list[Path]:
    """Return the test files in some folders, and the given files."""
    return [file for path in paths for file in (sorted(path.rglob("test_*.py")) if path.is_dir() else [path])]


def batches(files: Iterable[Path]) -> list[tuple[str, ...]]:
    """Return the files of each process, those of the longest folders first."""
    found: list[tuple[int, int, tuple[str, ...]]] = []
    by_folder: dict[Path, list[Path]] = {}
    for file in files:
        by_folder.setdefault(file.parent, []).append(file)
    for folder, here in by_folder.items():
        name = os.path.relpath(folder, TESTS)
        rank, most = (LONG.index(name), LONG_FILES) if name in LONG else (len(LONG), SHORT_FILES)
        for start in range(0, len(here), most):
            chosen = here[start : start + most]
            size = sum(file.stat().st_size for file in chosen)
            found.append((rank, -size, tuple(os.path.relpath(file) for file in chosen)))
    return [names for _, _, names in sorted(found)]


_running: set[int] = set()
"""IDs of the running processes; each leads a process group."""


def _end(number: int, frame: object) -> None:
    """On Ctrl-C and SIGTERM, interrupt the running processes and start no more."""
    for process in tuple(_running):
        os.killpg(process, signal.SIGINT)
    raise SystemExit(128 + number)


def run(files: tuple[str, ...], further: list[str]) -> Outcome:
    """Run some tests in a process of their own."""
    began = time.monotonic()
    with tempfile.TemporaryDirectory() as folder:
        report = Path(folder, "report.xml")
        command = [sys.executable, "-m", "pytest", "-v", f"--junitxml={report}", "-o", "junit_family=xunit1"]
        command += ["-o", f"cache_dir={folder}/cache", *further, *files]
        with subprocess.Popen(
            command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, start_new_session=True
        ) as process:
            ends = Timer(PROCESS_TIMEOUT_SECONDS, os.killpg, (process.pid, signal.SIGKILL))
            ends.start()
            _running.add(process.pid)
            assert process.stdout is not None
            output = process.stdout.read().decode(errors="replace")
            _, status, used = os.wait4(process.pid, 0)
            process.returncode = os.waitstatus_to_exitcode(status)
            _running.discard(process.pid)
            ends.cancel()
        seconds = time.monotonic() - began
        cases = list(ElementTree.parse(report).iter("testcase")) if report.exists() else []
        if process.returncode in (0, NO_TESTS):
            failed: tuple[str, ...] = ()
        elif report.exists() and process.returncode == 1:
            failed = _failed(cases)
        else:
            failed = files
    skipped = Counter(
        each.get("message", "").removeprefix("Skipped: ") for case in cases for each in case.iter("skipped")
    )
    deselected = re.search(r"(\d+) deselected", output.rpartition("\n=")[2])
    return Outcome(
        files,
        output,
        seconds,
        used.ru_utime + used.ru_stime,
        len(cases),
        failed,
        skipped,
        int(deselected[1]) if deselected else 0,
    )


def _failed(cases: Iterable[ElementTree.Element]) -> tuple[str, ...]:
    """Return the IDs of the failed tests of a JUnit report, as pytest accepts them."""
    found: dict[str, None] = {}
    for case in cases:
        if case.find("failure") is not None or case.find("error") is not None:
            file, name, owner = case.get("file", ""), case.get("name", ""), case.get("classname", "")
            stem = file.removesuffix(".py").replace("/", ".")
            within = owner.removeprefix(stem).removeprefix(".").replace(".", "::")
            found["::".join(each for each in (file, within, name) if each)] = None
    return tuple(found)


def missing_packages(group: str) -> list[str]:
    """Return the requirements of a dependency group that are not installed."""
    groups = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["dependency-groups"]
    found: list[str] = []
    for each in groups[group]:
        if isinstance(each, dict):
            found += missing_packages(each["include-group"])
            continue
        requirement = Requirement(each)
        if requirement.marker is None or requirement.marker.evaluate():
            try:
                version(requirement.name)
            except PackageNotFoundError:
                found.append(requirement.name)
    return found


def missing_programs() -> list[str]:
    """Return the names of the programs that are not installed."""
    places = f"{os.environ.get('PATH', '')}:/usr/sbin:/sbin"
    given = {"Chromium": os.environ.get("CHROMIUM")}
    return [
        name
        for name, commands in PROGRAMS.items()
        if not given.get(name) and not any(shutil.which(command, path=places) for command in commands)
    ]


def show_list(heading: str, lines: Iterable[str]) -> None:
    """Print a heading and its lines, if there are any."""
    if listed := list(lines):
        print("\n".join([heading, *(f"  {line}" for line in listed)]), flush=True)


class Room:
    """Limit of processes at a time: some always, and more while processors are idle.

    Many tests wait for other processes and for time to pass, so how many processes use all processors differs
    from folder to folder, and on a machine with other work from minute to minute.

    Args:
        always: number of processes that may run however busy the machine is.
    """

    def __init__(self, always: int) -> None:
        self._always = always
        self._running = 0
        self._counting = Lock()
        self._measuring = Lock()

    @contextmanager
    def taken(self, places: int) -> Iterator[None]:
        """Wait until there is room for a process that counts as `places`; leave when it has ended."""
        while not self._enter(places, self._always):
            with self._measuring:
                if _idle_share() >= IDLE_SHARE and self._enter(places, sys.maxsize):
                    break
        try:
            yield
        finally:
            with self._counting:
                self._running -= places

    def _enter(self, places: int, most: int) -> bool:
        with self._counting:
            if self._running and self._running + places > most:
                return False
            self._running += places
            return True


def _idle_share(seconds: float = 3.0) -> float:
    """Measure which share of the processors' time is idle; 0 where the system does not tell."""
    if not PROCESSOR_TIMES.exists():
        time.sleep(seconds)
        return 0.0
    before = _processor_times()
    time.sleep(seconds)
    idle, whole = (after - first for after, first in zip(_processor_times(), before, strict=True))
    return idle / max(1, whole)


def _processor_times() -> tuple[int, int]:
    """Return the idle and the whole time of all processors, in ticks; proc_stat(5) names the columns."""
    times = [int(each) for each in PROCESSOR_TIMES.read_text().split("\n", 1)[0].split()[1:9]]
    return times[3] + times[4], sum(times)


def run_all(files: Iterable[Path], processes: int, further: list[str]) -> list[Outcome]:
    """Run some files, `processes` at a time, and up to twice as many while processors are idle.

    Chromium draws without a graphics card: several at a time starve each other, and their tests. A process
    that drives a browser therefore counts as two, and there are two of them at most.
    """
    outcomes: list[Outcome] = []
    room = Room(processes)

    def done(batch: tuple[str, ...], places: int = 1) -> None:
        with room.taken(places):
            outcome = run(batch, further)
        outcome.show()
        outcomes.append(outcome)

    waiting = batches(files)
    drawing = [each for each in waiting if Path(each[0]).is_relative_to(BROWSER_TESTS)]
    others = [each for each in waiting if each not in drawing]
    with ThreadPoolExecutor(2) as browsers, ThreadPoolExecutor(2 * processes) as pool:
        list(chain(browsers.map(partial(done, places=2), drawing), pool.map(done, others)))
    return outcomes


def retry(failed: list[str], further: list[str], strict: bool) -> bool:
    """Run failed tests again, one by one; return True if all pass now and no retry is an error."""
    print("asking again, alone:\n" + "\n".join(f"  {test}" for test in failed), flush=True)
    still: list[str] = []
    for test in failed:
        again = run((test,), further)
        again.show()
        still += again.failed
    retried = [test for test in failed if test not in still]
    RETRIED.write_text("".join(f"{test}\n" for test in retried), encoding="utf-8")
    show_list("needed a retry:", retried)
    show_list("FAILED:", still)
    known = tomllib.loads(KNOWN_RETRIED.read_text(encoding="utf-8"))["tests"]
    unlisted = [test for test in retried if test not in known]
    if strict:
        show_list(
            f"FAILED: these tests needed a retry and are not in {os.path.relpath(KNOWN_RETRIED)}:", unlisted
        )
    return not still and not (strict and unlisted)


def _arguments() -> tuple[argparse.Namespace, list[str]]:
    """Return the options, and the arguments for pytest, which follow `--`."""
    parser = argparse.ArgumentParser(
        prog="python -m tests",
        description=__doc__,
        epilog="example: python -m tests --processes 4 tests/core/rosbridge tests/core/access -- -x",
    )
    default = max(3, 2 * (os.cpu_count() or 1))
    parser.add_argument(
        "--processes",
        type=int,
        default=default,
        help=f"processes at a time, more while processors are idle [two per core, {default}]",
    )
    parser.add_argument("--all", action="store_true", help="run all tests, as `make test-all` does")
    parser.add_argument(
        "--strict-retries",
        action="store_true",
        default=os.environ.get("STRICT_RETRIES", "") not in ("", "0"),
        help="fail if a test needs a retry that tests/retried.toml does not list [STRICT_RETRIES=1]",
    )
    parser.add_argument(
        "paths", nargs="*", type=Path, help="files and folders [those of `make test`; with --all, all]"
    )
    given, further = sys.argv[1:], []
    if "--" in given:
        given, further = given[: given.index("--")], given[given.index("--") + 1 :]
    return parser.parse_args(given), further


def main() -> int:
    """Run the tests and return the exit code."""
    options, further = _arguments()
    # A shell's background ignores Ctrl-C, and nohup a hangup; so would all processes that the tests start.
    signal.signal(signal.SIGINT, _end)
    signal.signal(signal.SIGTERM, _end)
    if hasattr(signal, "SIGHUP"):
        signal.signal(signal.SIGHUP, lambda *_: None)
    files = test_files(options.paths or (TESTS, LEROBOT_TESTS, MAVLINK_TESTS, RCLPY_TESTS, WEBRTC_TESTS))
    reduced = not options.paths and not options.all
    if reduced:
        files = [file for file in files if not is_extended(file)]
        further = ["-m", "not extended", *further]
    if gone := [name for name in EXTENDED if not (TESTS / name).exists()]:
        show_list("FAILED: EXTENDED lists what does not exist:", gone)
        return 1
    absent = missing_programs() if options.all else []
    if options.all and (packages := missing_packages("dev")):
        show_list("FAILED: install the dependency group dev; these packages are missing:", packages)
        return 1
    if absent and os.environ.get("CI"):
        show_list("FAILED: these programs are missing, .ci/run installs them:", absent)
        return 1
    RETRIED.parent.mkdir(exist_ok=True)
    RETRIED.write_text("", encoding="utf-8")
    began = time.monotonic()
    outcomes = run_all(files, options.processes, further)
    failed = [test for outcome in outcomes for test in outcome.failed]
    minutes, cpu = (time.monotonic() - began) / 60, sum(outcome.cpu for outcome in outcomes) / 60
    took = f"in {minutes:.1f} minutes, {cpu:.1f} minutes of CPU"
    skipped = sum((outcome.skipped for outcome in outcomes), Counter[str]())
    show_list("skipped:", (f"{count:4} {reason}" for reason, count in sorted(skipped.items())))
    if reduced:
        count = sum(outcome.deselected for outcome in outcomes)
        left = [f"tests/{name}: {reason}" for name, reason in EXTENDED.items()]
        show_list("left to `make test-all`:", [*left, f"{count} tests marked extended"])
    show_list("not tested, for want of these programs:", absent)
    print(f"{sum(outcome.tests for outcome in outcomes)} tests, {len(failed)} failed, {took}")
    if len(failed) > MAX_RETRIES:
        print("too many failures for a retry")
        return 1
    return 0 if not failed or retry(failed, further, options.strict_retries) else 1


if __name__ == "__main__":
    sys.exit(main())
