"""Run a suite that others publish against `rwt serve`.

    python -m tools.upstream                             what there is
    python -m tools.upstream roslibpy-ros2 --checkout ../roslibpy

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
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from tools.upstream.results import Result, Verdict, judge, of_go, of_junit
from tools.upstream.suites import HERE, LIST, CannotRun, Suite, check, read_suites

_TELL_SECONDS: Final = 5.0
"""From one line about how far a suite is to the next."""


def main(arguments: Sequence[str] | None = None, *, suites_file: Path = LIST) -> int:
    """Run what the command line asks for; returns the exit code."""
    parser = argparse.ArgumentParser(
        prog="python -m tools.upstream",
        description="Run test suites and programs that others publish for rosbridge against `rwt serve`.",
        epilog="Without NAME: what there is, and what each needs.",
    )
    parser.add_argument("name", nargs="?", metavar="NAME", help="the suite")
    parser.add_argument("--checkout", type=Path, metavar="DIR", help="your checkout of it, made ready")
    parser.add_argument("--seconds", type=float, default=900.0, help="how long it may take (default 900)")
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
        check(options.name, suite, checkout)
        verdict = _run(suite, checkout, options.seconds, options.verbose)
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


def _run(suite: Suite, checkout: Path | None, seconds: float, verbose: bool) -> Verdict:
    with tempfile.TemporaryDirectory() as folder, _served(suite) as url:
        report = Path(folder) / "report.xml"
        port = urlsplit(url).port or 0
        values = {
            "url": url,
            "http": f"http://127.0.0.1:{port}",
            "port": str(port),
            "report": str(report),
            "python": sys.executable,
            "checkout": str(checkout or ""),
            "here": str(HERE),
        }
        command = [part.format(**values) for part in suite.run]
        print(f"running {' '.join(command)}", flush=True)
        environment = {name: value.format(**values) for name, value in suite.environment.items()}
        code, output = _finished(command, checkout or Path(folder), environment, seconds, verbose)
        return judge(_results(suite, checkout, report, code, output), suite.expected_failures)


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
    command = [sys.executable, "-m", "rwt_cli", "serve", f"ws://127.0.0.1:{suite.port}", *options]
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
    for result, reason in verdict.expected:
        print(f"  expected  {result.id}: {reason}")
    for result in verdict.unexpected:
        print(f"  FAILED    {result.id}: {result.text}")
    for glob in verdict.stale:
        print(f"  PASSED    {glob}: expected to fail, and did not; take it off the list")
    failed = len(verdict.expected) + len(verdict.unexpected)
    total = verdict.passed + failed
    expected = len(verdict.expected)
    print(f"{verdict.passed} of {total} passed, {verdict.skipped} skipped, {expected} failed as expected")


if __name__ == "__main__":
    sys.exit(main())
