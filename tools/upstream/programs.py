"""Run programs that others publish for ROS 2, unmodified, as nodes of `rwt serve`.

    python -m tools.upstream.programs                                          what there is
    python -m tools.upstream.programs --checkout demos=../demos --checkout examples=../examples

It prints what each came to, and how many ran; the exit code is 1 when one of those whose checkout is named
did not.
"""

from __future__ import annotations

import argparse
import os
import pty
import re
import signal
import subprocess
import sys
import tempfile
import threading
import time
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Final

import msgspec

from tools.upstream.suites import HERE

LIST: Final = HERE / "programs.toml"

#: Of the server and of the programs: the setters of messages check nothing, as in a build of Jazzy.
_SETTINGS: Final = {"PYTHONUNBUFFERED": "1", "ROS_PYTHON_CHECK_FIELDS": "0"}


class Program(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One entry of `programs.toml`, whose head explains the fields."""

    checkout: str
    run: tuple[str, ...]
    says: tuple[str, ...]
    keys: str = ""
    serve: tuple[str, ...] = ()
    robot: str = ""
    interfaces: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of its checkout on the command line."""
        return self.checkout.rpartition("/")[2]


class Running:
    """Process with its output."""

    def __init__(self, command: list[str], folder: Path, graph: str, keys: str) -> None:
        own, other = pty.openpty() if keys else (None, None)
        self.keyboard = own
        self.process = subprocess.Popen(
            command,
            cwd=folder,
            env={**os.environ, **_SETTINGS, "RWT_RCLPY_GRAPH": graph},
            stdin=other if other is not None else subprocess.DEVNULL,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        )
        if other is not None:
            os.close(other)
        self.said = ""
        self.news = threading.Event()
        threading.Thread(target=self._listen, daemon=True).start()

    def _listen(self) -> None:
        assert self.process.stdout is not None  # It was asked for.
        for line in self.process.stdout:
            self.said += line
            self.news.set()
        self.news.set()

    def wait_for(self, pattern: str, seconds: float) -> bool:
        """Wait until the output matches; without a pattern, check that it runs after a while."""
        deadline = time.monotonic() + (seconds if pattern else min(seconds, 5.0))
        while True:
            self.news.clear()
            if pattern and re.search(pattern, self.said):
                return True
            left = deadline - time.monotonic()
            ended = self.process.poll() is not None
            if left <= 0 or ended:
                self.news.wait(0.5)
                fits = bool(pattern) and re.search(pattern, self.said) is not None
                return fits or (not pattern and not self.process.poll())
            self.news.wait(min(left, 0.5))

    def stop(self) -> None:
        """End it as Ctrl-C does, or by force when it does not end."""
        if self.process.poll() is None:
            self.process.send_signal(signal.SIGINT)
            try:
                self.process.wait(timeout=15)
            except subprocess.TimeoutExpired:
                self.process.kill()
        if self.keyboard is not None:
            os.close(self.keyboard)


@contextmanager
def _server(folder: Path, program: Program, interfaces: Sequence[str]) -> Iterator[str]:
    url = f"unix://{folder / 'robot.sock'}"
    if program.robot:
        command = [sys.executable, str(HERE / "robots" / program.robot), url, *interfaces]
    else:
        command = [sys.executable, "-m", "rwt.cli", "serve", url, *program.serve]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL, text=True) as server:
        try:
            assert server.stdout is not None  # It was asked for.
            if not server.stdout.readline().startswith("listening"):
                raise SystemExit("rwt serve did not start")
            yield url
        finally:
            server.terminate()


def outcome(program: Program, checkout: Path, seconds: float) -> str:
    """Empty when everything said what it should; else what did not, and what it said last."""
    interfaces = [each for folder in program.interfaces for each in ("--interfaces", str(checkout / folder))]
    with tempfile.TemporaryDirectory() as folder, _server(Path(folder), program, interfaces) as graph:
        return _problem(program, checkout, graph, interfaces, seconds)


def _problem(program: Program, checkout: Path, graph: str, interfaces: Sequence[str], seconds: float) -> str:
    with ExitStack() as stack:
        running: list[Running] = []
        for number, line in enumerate(program.run):
            command = [sys.executable, "-m", "rwt.cli", "run", "--root", str(checkout), *interfaces]
            keys = program.keys if number == len(program.run) - 1 else ""
            started = Running([*command, *line.split()], checkout, graph, keys)
            stack.callback(started.stop)
            running.append(started)
        for each, pattern in zip(running, program.says, strict=True):
            if not each.wait_for(pattern, seconds):
                last = " | ".join(each.said.strip().splitlines()[-4:])
                return f"did not say {pattern!r}: {last[-300:]}"
        if running[-1].keyboard is not None:
            os.write(running[-1].keyboard, program.keys.encode())
            try:
                running[-1].process.wait(timeout=seconds)
            except subprocess.TimeoutExpired:
                return "did not end at Ctrl-C"
    return ""


def listed() -> dict[str, Program]:
    """Every program by its name."""
    return msgspec.convert(tomllib.loads(LIST.read_text("utf-8")), dict[str, Program])


def _folder(text: str) -> tuple[str, Path]:
    name, equals, folder = text.partition("=")
    if not equals or not Path(folder).is_dir():
        raise argparse.ArgumentTypeError(f"{text!r}: expected NAME=DIR, and the folder to be there")
    return name, Path(folder).resolve()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what checkouts are named for; returns the exit code."""
    parser = argparse.ArgumentParser("python -m tools.upstream.programs", description=__doc__)
    parser.add_argument("--checkout", action="append", default=[], type=_folder, metavar="NAME=DIR")
    parser.add_argument("--only", default="", metavar="WORD", help="those with this in their names")
    parser.add_argument("--seconds", type=float, default=90.0, help="how long each may take (default 90)")
    options = parser.parse_args(arguments)
    programs = listed()
    checkouts: Mapping[str, Path] = dict(options.checkout)
    if not checkouts:
        for name, program in programs.items():
            print(f"{name:28}{program.checkout}: {', '.join(program.run)}")
        return 0
    passed = failed = 0
    for name, program in programs.items():
        if program.name not in checkouts or options.only not in name:
            continue
        problem = outcome(program, checkouts[program.name], options.seconds)
        print(f"  {'FAILED' if problem else 'ran':8}{name}{': ' if problem else ''}{problem}", flush=True)
        passed, failed = passed + (not problem), failed + bool(problem)
    print(f"{passed} of {passed + failed} ran")
    return 1 if failed or not passed else 0


if __name__ == "__main__":
    sys.exit(main())
