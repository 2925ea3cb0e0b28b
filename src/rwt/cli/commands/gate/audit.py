"""`rwt audit`: read the audit file of a robot's gate."""

from __future__ import annotations

import argparse
import fnmatch
import re
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Final

from rwt.cli.console.output import Output, standard_output
from rwt.cli.errors import CALLED_WRONGLY, CommandError
from rwt.cli.parser import Commands
from rwt.cli.verbs import epilog

_AGO: Final = re.compile(r"(\d+(?:\.\d+)?)([smhd])")
_UNITS: Final = {"s": "seconds", "m": "minutes", "h": "hours", "d": "days"}


def add_audit_command(commands: Commands) -> None:
    """Add `audit` to the command line."""
    parser = commands.add_parser(
        "audit",
        description="Read the audit log of a robot's gate (gate.audit.file), including its older files.",
        epilog=epilog(
            "rwt audit audit.jsonl\n"
            "rwt audit audit.jsonl --decision refused --since 1h\n"
            "rwt audit audit.jsonl --name '/cmd_*' --role agent",
            '{"time": "…Z", "decision": "refused", "act": "publish", "name": "/cmd_vel", "client": "…", …}',
        ),
    )
    parser.add_argument("file", type=Path, metavar="FILE", help="newest file of the log")
    parser.add_argument(
        "--decision",
        metavar="WORD",
        help="only lines with this decision, for example allowed, refused, 'would refuse', lease or stop",
    )
    parser.add_argument(
        "--act", metavar="WORD", help="only lines of this act, for example publish, call, goal or set_param"
    )
    parser.add_argument(
        "--name", metavar="GLOB", help="only lines about this topic, service, action or parameter"
    )
    parser.add_argument("--client", metavar="NAME", help="only lines of this client, for example rosbridge:3")
    parser.add_argument("--role", metavar="NAME", help="only lines of clients with this role")
    parser.add_argument(
        "--rule", metavar="GLOB", help="only lines decided by this rule, for example gate.rules.drive*"
    )
    parser.add_argument(
        "--since",
        type=_since,
        metavar="WHEN",
        help="only lines since 90s, 10m, 2h or 3d ago, or a time such as 2026-01-31T12:00Z",
    )
    parser.add_argument("--json", action="store_true", help="print the lines as JSON")
    parser.set_defaults(run=_run)


def _since(text: str) -> datetime:
    ago = _AGO.fullmatch(text)
    try:
        if ago:
            return datetime.now(UTC) - timedelta(**{_UNITS[ago[2]]: float(ago[1])})
        moment = datetime.fromisoformat(text)
    except (ValueError, OverflowError):
        raise argparse.ArgumentTypeError(
            f"expected 90s, 10m, 2h, 3d or a time such as 2026-01-31T12:00Z, got {text!r}"
        ) from None
    return moment if moment.tzinfo else moment.astimezone()


def _run(arguments: argparse.Namespace) -> int:
    from rwt.access.gate.audit_file import read_audit  # `--help` does not need it

    output = standard_output(json=arguments.json)
    try:
        for line in _selected(read_audit(arguments.file), arguments):
            _print(line, output)
    except OSError as error:
        raise CommandError(f"{arguments.file}: cannot be read: {error.strerror}", CALLED_WRONGLY) from error
    return 0


def _selected(
    lines: Iterator[Mapping[str, object]], arguments: argparse.Namespace
) -> Iterator[Mapping[str, object]]:
    exact = {
        key: value
        for key in ("decision", "act", "client", "role")
        if (value := getattr(arguments, key)) is not None
    }
    globs = {key: value for key in ("name", "rule") if (value := getattr(arguments, key)) is not None}
    for line in lines:
        if any(line.get(key) != value for key, value in exact.items()):
            continue
        if any(not fnmatch.fnmatchcase(str(line.get(key, "")), glob) for key, glob in globs.items()):
            continue
        if arguments.since is not None and not _is_after(line, arguments.since):
            continue
        yield line


def _is_after(line: Mapping[str, object], since: datetime) -> bool:
    """True if a line has this time or later, or no time."""
    try:
        return datetime.fromisoformat(str(line["time"])) >= since
    except (KeyError, ValueError):
        return True


def _print(line: Mapping[str, object], output: Output) -> None:
    if output.json:
        output.record(line)
        return
    words = [str(line.get(key, "")) for key in ("time", "decision", "act", "name")]
    if "client" in line:
        words.append(f"by {line['client']} (role {line.get('role')}, {line.get('address') or 'no address'})")
    text = " ".join(word for word in words if word)
    output.line(output.escape_terminal(f"{text}: {line['text']}" if "text" in line else text))
