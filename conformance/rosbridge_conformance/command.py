"""Command line of the suite."""

from __future__ import annotations

import argparse
import asyncio
import sys
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path

from rosbridge_conformance import SUITE_VERSION
from rosbridge_conformance.client_runner import run_client_cases
from rosbridge_conformance.program import ProgramError
from rosbridge_conformance.reports import badge, expected, html, json_file, junit, summary, terminal
from rosbridge_conformance.reports.compare import compare_files
from rosbridge_conformance.reports.json_file import ReportError
from rosbridge_conformance.runner import Conditions, Run, run_cases, select
from rosbridge_conformance.suite.case import PROFILES, Case
from rosbridge_conformance.suite.loading import CASES, CLIENT_CASES, CaseError, load_cases
from rosbridge_conformance.suite.rules import load_rules
from rosbridge_conformance.suite.target import (
    SHIPPED,
    Target,
    TargetError,
    check_ids,
    find_client_target,
    find_target,
    shipped,
    shipped_clients,
    with_known,
)
from rosbridge_conformance.wire.dialing import BadAddress, dialer
from rosbridge_conformance.wire.pipes import takes_several_clients
from rosbridge_conformance.wire.wires import WireError, framing_of

ADAPTERS = Path(__file__).parent / "adapters"
"""Programs around client libraries that come with the suite."""

_EXIT_CODES = (
    "exit codes: 0 nothing failed unexpectedly, 1 something did, 2 called wrongly, 3 no connection\n"
)

NAME = "rosbridge-conformance"
"""Name of the installed command."""

_EXAMPLES = f"""\
examples:
  rosbridge-conformance ws://localhost:9090                      any server, CORE only
  rosbridge-conformance ws://localhost:9090 --target my.toml     what it declares
  rosbridge-conformance ws://localhost:9090 --target my.toml --expect known.toml --junit report.xml
  rosbridge-conformance 'stdio:rwt serve stdio: unix://{{socket}}' a program on its pipes
  rosbridge-conformance ws://localhost:9090 --run 'publish/*' --run FRG-01
  rosbridge-conformance client --target roslib-2 -- node roslib.mjs
  rosbridge-conformance diff before.json after.json

`rosbridge-conformance client --help` tells about grading clients.

{_EXIT_CODES}"""

_CLIENT_EXAMPLES = f"""\
The command starts a program around the library, which is told what to do by lines of JSON
(docs/how-to/conformance.md); programs for roslib and roslibpy come with the suite.

examples:
  rosbridge-conformance client --copy-adapters .
  rosbridge-conformance client --target roslib-2 -- node roslib.mjs
  rosbridge-conformance client --target roslibpy --html report.html -- python roslibpy_adapter.py
  rosbridge-conformance client --listen ws://0.0.0.0:9090 --jobs 1 -- ./start-my-client.sh

{_EXIT_CODES}"""

_USAGE = """rosbridge-conformance URL [options]
       rosbridge-conformance client [options] -- COMMAND ...
       rosbridge-conformance diff BEFORE.json AFTER.json"""


def main(argv: Sequence[str] | None = None, *, prog: str = NAME) -> int:
    """Run the command line under the name `prog`, and return the exit code."""
    given = list(sys.argv[1:] if argv is None else argv)
    try:
        if given[:1] == ["diff"]:
            return _diff(given[1:], prog)
        if given[:1] == ["client"]:
            return _run_client(given[1:], prog)
        return _run(given, prog)
    except (CaseError, TargetError, ReportError, ProgramError, BadAddress) as error:
        _complain(prog, str(error))
        return 2
    except WireError as error:
        _complain(prog, str(error))
        return 3


def _complain(prog: str, text: str) -> None:
    sys.stderr.write(f"{prog}: {text}\n")


def _diff(argv: Sequence[str], prog: str) -> int:
    parser = argparse.ArgumentParser(
        prog=f"{prog} diff",
        description="Print the cases whose verdict changed between two runs.",
        epilog="exit codes: 0 no verdict got worse, 1 some did, 2 called wrongly",
    )
    parser.add_argument("before", type=Path, metavar="BEFORE.json", help="what --json wrote")
    parser.add_argument("after", type=Path, metavar="AFTER.json", help="what --json wrote later")
    arguments = parser.parse_args(argv)
    comparison = compare_files(arguments.before, arguments.after)
    sys.stdout.write(comparison.text)
    return 1 if comparison.worse else 0


def _parser(prog: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=prog,
        usage=_USAGE.replace(NAME, prog),
        description="Grade a rosbridge v2 server or client library, this one or any other.",
        epilog=_EXAMPLES.replace(NAME, prog),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("url", nargs="?", help="ws://, wss://, tcp://, unix:// or stdio:COMMAND")
    _add_options(parser, shipped(), CASES, jobs=16)
    return parser


def _client_parser(prog: str) -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog=f"{prog} client",
        usage="%(prog)s [options] -- COMMAND ...",
        description="Grade a rosbridge v2 client library: the suite plays the server.",
        epilog=_CLIENT_EXAMPLES.replace(NAME, prog),
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument(
        "--listen",
        default="ws://127.0.0.1:0",
        metavar="URL",
        help="where to listen; a fixed port needs --jobs 1 (default %(default)s)",
    )
    parser.add_argument(
        "--copy-adapters", type=Path, metavar="DIR", help="copy the programs of the suite, and end"
    )
    _add_options(parser, shipped_clients(), CLIENT_CASES, jobs=4)
    return parser


def _add_options(parser: argparse.ArgumentParser, targets: Sequence[str], cases: Path, *, jobs: int) -> None:
    """Add the options that both runners have."""
    add = parser.add_argument
    add("--target", metavar="FILE", help=f"what is declared: a TOML file, or one of {', '.join(targets)}")
    add(
        "--expect",
        type=Path,
        metavar="FILE",
        help="known failures with their reasons, beside those of the target",
    )
    add("--profile", metavar="P,P", help=f"ask about these only: {', '.join(PROFILES)}")
    add("--run", action="append", default=[], metavar="GLOB", help="only these ids, sections or rules")
    add("--skip", action="append", default=[], metavar="GLOB", help="not these ids, sections or rules")
    add("--cases", type=Path, default=cases, metavar="DIR", help="another folder of cases")
    add("--jobs", type=int, default=jobs, metavar="N", help="cases at once (default %(default)s)")
    add("--strict", action="store_true", help="non-strict is a failure")
    add("--list", action="store_true", help="print the selected cases and end")
    add("--dry-run", action="store_true", help="print what would be asked, and end")
    add("--verbose", "-v", action="store_true", help="the frames of each failure")
    add("--json", type=Path, metavar="FILE", help="all results, for `diff` and programs")
    add("--junit", type=Path, metavar="FILE", help="JUnit XML")
    add("--html", type=Path, metavar="FILE", help="one page: matrix and transcripts")
    add("--badge", type=Path, metavar="FILE", help="an SVG badge")
    add("--summary", type=Path, metavar="FILE", help="append Markdown, as $GITHUB_STEP_SUMMARY")
    add(
        "--write-expected",
        type=Path,
        metavar="FILE",
        help="a target file in which what failed now is expected to fail",
    )
    add("--version", action="version", version=f"conformance suite {SUITE_VERSION}")


def _target(arguments: argparse.Namespace, find: Callable[[str], Target]) -> Target:
    target = find(arguments.target) if arguments.target else Target()
    if arguments.expect is not None:
        target = with_known(target, arguments.expect, SUITE_VERSION)
    if not arguments.profile:
        return target
    profiles = tuple(arguments.profile.upper().split(","))
    unknown = [name for name in profiles if name not in PROFILES]
    if unknown:
        raise TargetError(f"--profile {unknown[0]}: known are {', '.join(PROFILES)}")
    return replace(target, profiles=profiles)


def _selected(arguments: argparse.Namespace, target: Target) -> tuple[Case, ...]:
    if not arguments.cases.is_dir():
        raise CaseError(f"--cases {arguments.cases}: there is no such folder")
    known = load_cases(arguments.cases)
    check_ids(target, [case.id for case in known])
    cases = select(known, target, arguments.run, arguments.skip)
    if arguments.profile:
        cases = tuple(case for case in cases if case.profile in target.profiles)
    if not cases:
        raise CaseError("no case fits --run, --skip and --profile")
    return cases


def _run(argv: Sequence[str], prog: str) -> int:
    parser = _parser(prog)
    arguments = parser.parse_args(argv)
    target = _target(arguments, find_target)
    cases = _selected(arguments, target)
    if arguments.list or arguments.dry_run:
        sys.stdout.write(terminal.listing(cases, target, steps=arguments.dry_run))
        return 0
    if arguments.url is None:
        parser.error("the URL of a server is missing")
    _check_files(arguments)
    run = asyncio.run(_play(cases, target, arguments))
    _report(run, arguments)
    return 0 if run.ok else 1


def _run_client(argv: Sequence[str], prog: str) -> int:
    parser = _client_parser(prog)
    cut = argv.index("--") if "--" in argv else len(argv)
    arguments, command = parser.parse_args(argv[:cut]), argv[cut + 1 :]
    if arguments.copy_adapters is not None:
        return _copy_adapters(arguments.copy_adapters)
    target = _target(arguments, find_client_target)
    cases = _selected(arguments, target)
    if arguments.list or arguments.dry_run:
        sys.stdout.write(terminal.listing(cases, target, steps=arguments.dry_run))
        return 0
    if not command:
        parser.error("the command that starts the client is missing; it stands after --")
    _check_files(arguments)
    run = asyncio.run(_play_client(cases, target, arguments, command))
    _report(run, arguments)
    return 0 if run.ok else 1


def _copy_adapters(folder: Path) -> int:
    folder.mkdir(parents=True, exist_ok=True)
    for path in sorted(ADAPTERS.glob("[a-z]*.*")):
        (folder / path.name).write_bytes(path.read_bytes())
        sys.stdout.write(f"{folder / path.name}\n")
    return 0


async def _play(cases: Sequence[Case], target: Target, arguments: argparse.Namespace) -> Run:
    url = arguments.url
    dial = dialer(url)
    wire = await dial("first")  # Report a wrong address once, not for every case.
    await wire.close()
    conditions = Conditions(
        max(1, arguments.jobs),
        arguments.strict,
        framing_of(url),
        several_clients=takes_several_clients(url),
        outlives=not url.startswith("stdio:"),
    )
    progress = terminal.Progress(sys.stderr, len(cases), load_rules())
    run = await run_cases(cases, target, dial, url, conditions, told=progress)
    progress.end()
    return run


async def _play_client(
    cases: Sequence[Case], target: Target, arguments: argparse.Namespace, command: Sequence[str]
) -> Run:
    conditions = Conditions(max(1, arguments.jobs), arguments.strict)
    progress = terminal.Progress(sys.stderr, len(cases), load_rules())
    run = await run_client_cases(cases, target, command, arguments.listen, conditions, progress)
    progress.end()
    return run


def _check_files(arguments: argparse.Namespace) -> None:
    """Check that the reports can be written, before the cases are played.

    Raises:
        ReportError: a file cannot be written.
    """
    reports = (arguments.json, arguments.junit, arguments.html, arguments.badge, arguments.summary)
    for path in (*reports, arguments.write_expected):
        if path is None:
            continue
        try:
            path.open("a", encoding="utf-8").close()
        except OSError as error:
            raise ReportError(f"{path}: cannot be written: {error.strerror}") from error


def _report(run: Run, arguments: argparse.Namespace) -> None:
    rules = load_rules()
    sys.stdout.write(terminal.report(run, rules, verbose=arguments.verbose))
    files = (
        (arguments.json, json_file.render),
        (arguments.junit, junit.render),
        (arguments.html, html.render),
        (arguments.badge, badge.render),
        (arguments.write_expected, expected.render),
    )
    for path, render in files:
        if path is not None:
            path.write_text(render(run, rules), encoding="utf-8")
    if arguments.summary is not None:
        with arguments.summary.open("a", encoding="utf-8") as file:
            file.write(summary.render(run, rules))


__all__ = ["SHIPPED", "main"]
