"""Run a suite that others publish against `rwt serve`.

    python -m tools.upstream                             what there is
    python -m tools.upstream roslibpy-ros2 --checkout ../roslibpy
    python -m tools.upstream rclpy --checkout ../rclpy --beside rcl_interfaces=../rcl_interfaces

The exit code is 0 if exactly what is expected to fail fails, 1 if not, and 2 if the suite cannot be run here.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import tempfile
import threading
import time
import xml.etree.ElementTree as ElementTree
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from tools.upstream.results import Result, Verdict, judge, of_go, of_junit
from tools.upstream.suites import HERE, LIST, CannotRun, Suite, check, read_suites

_FILE_SECONDS: Final = 180.0
"""Timeout for one of many files."""
_TELL_SECONDS: Final = 5.0
"""Interval between progress lines."""


def main(arguments: Sequence[str] | None = None, *, suites_file: Path = LIST) -> int:
    """Run what the command line asks for; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.upstream",
        description="Run test suites and programs that others publish for rosbridge against `rwt serve`.",
        epilog="Without NAME: what there is, and what each needs.",
    )
    parser.add_argument("name", nargs="?", metavar="NAME", help="the suite")
    parser.add_argument("--checkout", type=Path, metavar="DIR", help="your checkout of it, made ready")
    parser.add_argument(
        "--beside",
        action="append",
        default=[],
        type=_named_folder,
        metavar="NAME=DIR",
        help="your checkout of something else that the suite needs",
    )
    parser.add_argument("--seconds", type=float, default=900.0, help="how long it may take (default 900)")
    parser.add_argument(
        "--only", metavar="WORD", default="", help="of several files those with it in their names"
    )
    parser.add_argument("--verbose", "-v", action="store_true", help="show what the suite prints")
    options = parser.parse_args(arguments)
    try:
        suites = read_suites(suites_file)
        if options.name is None:
            _list(suites)
            return 0
        if options.name not in suites:
            raise CannotRun(f"no suite {options.name!r}; there are {', '.join(suites)}")
        suite, checkout = suites[options.name], options.checkout
        checkout = None if checkout is None else checkout.resolve()
        beside = dict(options.beside)
        check(options.name, suite, checkout, beside)
        run = _Run(suite, checkout, beside, options.seconds, options.verbose, options.only)
        verdict = run.verdict()
    except CannotRun as error:
        print(f"upstream: {error}", file=sys.stderr)
        return 2
    _report(verdict)
    return 0 if verdict.is_as_expected else 1


def _list(suites: dict[str, Suite]) -> None:
    for name, suite in suites.items():
        print(f"{name:16}{suite.title}")
        print(f"{'':16}{suite.repository}, tried: {suite.tried}")
        print(
            f"{'':16}{'by hand: ' + suite.by_hand if suite.by_hand else 'ready by: ' + (suite.ready or '-')}"
        )


def _named_folder(text: str) -> tuple[str, Path]:
    name, equals, folder = text.partition("=")
    if not name or not equals or not folder:
        raise argparse.ArgumentTypeError(f"{text!r}: expected NAME=DIR")
    return name, Path(folder).resolve()


@dataclass(frozen=True, slots=True)
class _Run:
    """One run of a suite.

    Attributes:
        seconds: how long it may take.
        verbose: whether all that it prints is shown.
        only: of a suite of several files, those with this in their names.
    """

    suite: Suite
    checkout: Path | None
    beside: Mapping[str, Path]
    seconds: float
    verbose: bool
    only: str = ""

    def verdict(self) -> Verdict:
        """Run it, and hold it against its list."""
        suite = self.suite
        with tempfile.TemporaryDirectory() as folder, _served(suite) as url:
            port = urlsplit(url).port or 0
            values = {
                "url": url,
                "http": f"http://127.0.0.1:{port}",
                "port": str(port),
                "python": sys.executable,
                "checkout": str(self.checkout or ""),
                "here": str(HERE),
                "path": os.environ.get("PYTHONPATH", ""),
                **{name: str(path) for name, path in self.beside.items()},
            }
            if suite.each:
                results = tuple(self._each(values, Path(folder)))
            else:
                results = self._once(values, Path(folder), self.seconds)
        verdict = judge(results, {**suite.sometimes, **suite.expected_failures}, suite.apart)
        # What was left out cannot show that an entry of the list is stale.
        stale = () if self.only else (each for each in verdict.stale if each not in suite.sometimes)
        return replace(verdict, stale=tuple(stale))

    def _once(self, values: Mapping[str, str], folder: Path, seconds: float) -> tuple[Result, ...]:
        report = folder / "report.xml"
        values = {**values, "report": str(report)}
        command = [part.format(**values) for part in self.suite.run]
        print(f"running {' '.join(command)}", flush=True)
        environment = {name: value.format(**values) for name, value in self.suite.environment.items()}
        code, output = _finished(command, self.checkout or folder, environment, seconds, self.verbose)
        return _results(self.suite, self.checkout, report, code, output)

    def _each(self, values: Mapping[str, str], folder: Path) -> Iterator[Result]:
        """Run each file in a process of its own, so that none meets what another leaves."""
        checkout = self.checkout or folder
        files = [each for each in sorted(checkout.glob(self.suite.each)) if self.only in each.name]
        if not files:
            raise CannotRun(f"{checkout}: no file {self.suite.each} with {self.only!r} in its name")
        ends = time.monotonic() + self.seconds
        for file in files:
            place = folder / file.name
            place.mkdir()
            try:
                results = self._once(
                    {**values, "file": str(file)}, place, min(_FILE_SECONDS, ends - time.monotonic())
                )
            except CannotRun as error:
                results = (Result(file.name, "failed", str(error).replace("\n", " ")[-300:]),)
            failed = sum(result.outcome == "failed" for result in results)
            print(
                f"  {file.name}: {len(results)} tests" + (f", {failed} failed" if failed else ""), flush=True
            )
            yield from results


def _results(suite: Suite, checkout: Path | None, report: Path, code: int, output: str) -> tuple[Result, ...]:
    if suite.results == "exit":
        last = output.strip().splitlines()[-1:] or [""]
        return (Result("exit code", "failed" if code else "passed", f"{code}: {last[0]}"),)
    if suite.results == "go":
        found = tuple(of_go(output))
    else:
        files = sorted(checkout.glob(suite.reports)) if checkout and suite.reports else [report]
        try:
            found = tuple(of_junit(each for each in files if each.is_file()))
        except ElementTree.ParseError:
            found = ()
    if not found:
        raise CannotRun(f"the suite ran no test; it ended with {code} and said:\n{output[-3000:]}")
    return found


def _finished(
    command: list[str], folder: Path, environment: dict[str, str], seconds: float, verbose: bool
) -> tuple[int, str]:
    """The exit code and the output of a command; of which all is shown, or that and how far it is."""
    lines: list[str] = []
    began = told = time.monotonic()
    try:
        with subprocess.Popen(
            command,
            cwd=folder,
            env={**os.environ, **environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            errors="replace",
        ) as process:
            too_long = threading.Timer(seconds, process.kill)
            too_long.start()
            try:
                assert process.stdout is not None  # It was asked for.
                for line in process.stdout:
                    lines.append(line)
                    now = time.monotonic()
                    if verbose:
                        print(line, end="", flush=True)
                    elif now - told >= _TELL_SECONDS:
                        told = now
                        print(f"  {now - began:.0f} s: {line.strip()[:100]}", flush=True)
            finally:
                too_long.cancel()
    except OSError as error:
        raise CannotRun(f"{command[0]}: cannot be started: {error.strerror}") from error
    if time.monotonic() - began >= seconds:
        raise CannotRun(f"it did not end within {seconds:g} s (--seconds)")
    return process.returncode, "".join(lines)


@contextmanager
def _served(suite: Suite) -> Iterator[str]:
    """A server for the suite, if it wants one; its URL."""
    if suite.serve is None:
        yield ""
        return
    options = [each.format(here=HERE) for each in suite.serve]
    command = [sys.executable, "-m", "rwt.cli", "serve", f"ws://127.0.0.1:{suite.port}", *options]
    environment = {name: value for name, value in os.environ.items() if not name.startswith("RWT_")}
    print(f"serving {' '.join(command[3:])}", flush=True)
    with (
        tempfile.TemporaryFile("w+") as log,
        subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, text=True, env=environment) as server,
    ):
        try:
            assert server.stdout is not None  # It was asked for.
            first = server.stdout.readline()
            if not first.startswith("listening on "):
                server.wait(timeout=10)
                log.seek(0)
                raise CannotRun(f"rwt serve did not start: {log.read().strip()}")
            yield first.removeprefix("listening on ").strip()
        finally:
            server.terminate()


def _report(verdict: Verdict) -> None:
    for reason, count in Counter(reason for _, reason in verdict.apart).items():
        print(f"  apart     {count}: {reason}")
    for result, reason in verdict.expected:
        print(f"  expected  {result.id}: {reason}")
    for result in verdict.unexpected:
        print(f"  FAILED    {result.id}: {result.text}")
    for glob in verdict.stale:
        print(f"  PASSED    {glob}: expected to fail, and did not; take it off the list")
    failed = len(verdict.expected) + len(verdict.unexpected)
    total = verdict.passed + failed
    expected = len(verdict.expected)
    share = f" ({100 * verdict.passed / total:.1f} %)" if total else ""
    print(
        f"{verdict.passed} of {total} passed{share}, {verdict.skipped} skipped, {expected} failed as expected"
    )


if __name__ == "__main__":
    sys.exit(main())
