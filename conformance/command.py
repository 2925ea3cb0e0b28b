"""The command line of the suite."""

from __future__ import annotations

import argparse
import asyncio
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

from conformance import SUITE_VERSION
from conformance.case import PROFILES, Case
from conformance.dialing import dialer
from conformance.loading import CASES, CaseError, load_cases
from conformance.pipes import takes_several_clients
from conformance.reports import badge, html, json_file, junit, summary, terminal
from conformance.reports.compare import compare_files
from conformance.reports.json_file import ReportError
from conformance.rules import load_rules
from conformance.runner import Conditions, Run, run_cases, select
from conformance.target import SHIPPED, Target, TargetError, find_target, shipped
from conformance.wires import WireError, framing_of

_EXAMPLES = """\
examples:
  python -m conformance ws://localhost:9090                      any server, CORE only
  python -m conformance ws://localhost:9090 --target my.toml     what it declares
  python -m conformance 'stdio:rwt serve stdio: unix://{socket}'  a program on its pipes
  python -m conformance ws://localhost:9090 --run 'publish/*' --run FRG-01
  python -m conformance diff before.json after.json

exit codes: 0 nothing failed unexpectedly, 1 something did, 2 called wrongly, 3 no connection
"""


def main(argv: Sequence[str] | None = None) -> int:
    """Run the command line; returns the exit code."""
    given = list(sys.argv[1:] if argv is None else argv)
    try:
        if given[:1] == ["diff"]:
            return _diff(given[1:])
        return _run(given)
    except (CaseError, TargetError, ReportError) as error:
        _complain(str(error))
        return 2
    except WireError as error:
        _complain(str(error))
        return 3


def _complain(text: str) -> None:
    sys.stderr.write(f"conformance: {text}\n")


def _diff(argv: Sequence[str]) -> int:
    parser = argparse.ArgumentParser(prog="conformance diff", description="Compare two runs (--json files).")
    parser.add_argument("before", type=Path)
    parser.add_argument("after", type=Path)
    arguments = parser.parse_args(argv)
    comparison = compare_files(arguments.before, arguments.after)
    sys.stdout.write(comparison.text)
    return 1 if comparison.worse else 0


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="conformance",
        description="Grade a rosbridge v2 server.",
        epilog=_EXAMPLES,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("url", nargs="?", help="ws://, wss://, tcp://, unix:// or stdio:COMMAND")
    parser.add_argument(
        "--target",
        metavar="FILE",
        help=f"what the server declares: a TOML file, or one of {', '.join(shipped())}",
    )
    parser.add_argument("--profile", metavar="P,P", help=f"ask about these only: {', '.join(PROFILES)}")
    parser.add_argument("--run", action="append", default=[], metavar="GLOB", help="only these ids or rules")
    parser.add_argument("--skip", action="append", default=[], metavar="GLOB", help="not these ids or rules")
    parser.add_argument("--cases", type=Path, default=CASES, metavar="DIR", help="another folder of cases")
    parser.add_argument("--jobs", type=int, default=8, metavar="N", help="cases at once (default 8)")
    parser.add_argument("--strict", action="store_true", help="non-strict is a failure")
    parser.add_argument("--list", action="store_true", help="print the selected cases and end")
    parser.add_argument("--dry-run", action="store_true", help="print what would be asked, and end")
    parser.add_argument("--verbose", "-v", action="store_true", help="the frames of each failure")
    parser.add_argument("--json", type=Path, metavar="FILE", help="all results, for `diff` and programs")
    parser.add_argument("--junit", type=Path, metavar="FILE", help="JUnit XML")
    parser.add_argument("--html", type=Path, metavar="FILE", help="one page: matrix and transcripts")
    parser.add_argument("--badge", type=Path, metavar="FILE", help="an SVG badge")
    parser.add_argument(
        "--summary", type=Path, metavar="FILE", help="append Markdown, as $GITHUB_STEP_SUMMARY"
    )
    parser.add_argument("--version", action="version", version=f"conformance suite {SUITE_VERSION}")
    return parser


def _target(arguments: argparse.Namespace) -> Target:
    target = find_target(arguments.target) if arguments.target else Target()
    if not arguments.profile:
        return target
    profiles = tuple(arguments.profile.upper().split(","))
    unknown = [name for name in profiles if name not in PROFILES]
    if unknown:
        raise TargetError(f"--profile {unknown[0]}: known are {', '.join(PROFILES)}")
    return replace(target, profiles=profiles)


def _run(argv: Sequence[str]) -> int:
    parser = _parser()
    arguments = parser.parse_args(argv)
    target = _target(arguments)
    cases = select(load_cases(arguments.cases), target, arguments.run, arguments.skip)
    if arguments.profile:
        cases = tuple(case for case in cases if case.profile in target.profiles)
    if arguments.list or arguments.dry_run:
        sys.stdout.write(terminal.listing(cases, target, steps=arguments.dry_run))
        return 0
    if arguments.url is None:
        parser.error("the URL of a server is missing")
    if not cases:
        raise CaseError("no case fits --run, --skip and --profile")
    run = asyncio.run(_play(cases, target, arguments))
    _report(run, arguments)
    return 0 if run.ok else 1


async def _play(cases: Sequence[Case], target: Target, arguments: argparse.Namespace) -> Run:
    url = arguments.url
    dial = dialer(url)
    wire = await dial("first")  # A wrong address is said once, not by every case.
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


def _report(run: Run, arguments: argparse.Namespace) -> None:
    rules = load_rules()
    sys.stdout.write(terminal.report(run, rules, verbose=arguments.verbose))
    files = (
        (arguments.json, json_file.render),
        (arguments.junit, junit.render),
        (arguments.html, html.render),
        (arguments.badge, badge.render),
    )
    for path, render in files:
        if path is not None:
            path.write_text(render(run, rules), encoding="utf-8")
    if arguments.summary is not None:
        with arguments.summary.open("a", encoding="utf-8") as file:
            file.write(summary.render(run, rules))


__all__ = ["SHIPPED", "main"]
