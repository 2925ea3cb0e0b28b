"""`rwt audit`: read and verify the audit files of a robot's gate."""

from __future__ import annotations

import argparse
import fnmatch
import re
from collections.abc import Iterator, Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rwt.cli.console.output import Output, Style, standard_output
from rwt.cli.errors import CALLED_WRONGLY, FAILED, CommandError
from rwt.cli.parser import Commands, add_commands
from rwt.cli.verbs import epilog

if TYPE_CHECKING:
    from rwt.access.gate.audit.verification import AuditReport, Finding

#: Words that are printed as they are; everything else is quoted.
_WORD: Final = re.compile(r"[\w./:~%+-]+|would refuse|left out", re.ASCII)
_AGO: Final = re.compile(r"(\d+(?:\.\d+)?)([smhd])")
_UNITS: Final = {"s": "seconds", "m": "minutes", "h": "hours", "d": "days"}


def add_audit_command(commands: Commands) -> None:
    """Add `audit` to the command line."""
    parser = commands.add_parser("audit", description="Read and verify the audit log of a robot's gate.")
    verbs = add_commands(parser)
    _add_show(verbs)
    _add_verify(verbs)


def _add_verify(commands: Commands) -> None:
    parser = commands.add_parser(
        "verify",
        help="check that no line was changed, inserted or removed",
        description="Check the hash chain of an audit log, with its traffic and its older files. Exit code 1:"
        " a line was changed, inserted or removed.\nNot detected: removal of the newest lines of all files,"
        " and of the oldest ones; a chain that was computed anew.\nFor these, keep the hash that is printed"
        " (or logged by the server) elsewhere, and pass it with --hash.",
        epilog=epilog(
            "rwt audit verify audit.jsonl\nrwt audit verify audit.jsonl --hash 9f86d081…",
            '{"ok": false, "lines": 812, "faults": [{"file": "audit.jsonl", "line": 7, "text": "…"}],\n'
            '"notes": […], "heads": {"audit.jsonl": {"line": 790, "hash": "…"}, …}}',
        ),
    )
    parser.add_argument("files", type=Path, nargs="+", metavar="FILE", help="newest file of a log")
    parser.add_argument(
        "--hash", default="", metavar="HASH", help="hash of a line that the log has to contain"
    )
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    parser.set_defaults(run=_verify)


def _verify(arguments: argparse.Namespace) -> int:
    from rwt.access.gate.audit.verification import Finding, verify_audit  # `--help` does not need it

    output = standard_output(json=arguments.json)
    is_intact = True
    for path in arguments.files:
        try:
            report = verify_audit(path, arguments.hash)
        except OSError as error:
            raise _unreadable(path, error) from error
        if arguments.hash and not report.has_line:
            report.add_fault(Finding(path, 0, f"no line has the hash {_escaped(arguments.hash[:64])}"))
        is_intact = is_intact and not report.faults
        _print_report(report, output)
    return 0 if is_intact else FAILED


def _print_report(report: AuditReport, output: Output) -> None:
    if output.json:
        found = {
            what: [{"file": str(each.file), "line": each.line, "text": each.text} for each in findings]
            for what, findings in (("faults", report.faults), ("notes", report.notes))
        }
        heads = {str(file): {"line": line, "hash": last} for file, (line, last) in report.heads.items()}
        output.record({"ok": not report.faults, "lines": report.lines, **found, "heads": heads})
        return
    kinds: tuple[tuple[str, Style, list[Finding]], ...] = (
        ("fault", "bad", report.faults),
        ("note", "faint", report.notes),
    )
    for word, style, findings in kinds:
        for each in findings:
            output.line(f"{output.styled(word, style)} {_field(each.file)}:{each.line}: {each.text}")
    for file, (line, last) in report.heads.items():
        output.line(f"{_field(file)} ends with line {line}, hash {last}")
    output.line(f"{report.lines} lines, {len(report.faults)} faults")


def _unreadable(path: Path, error: OSError) -> CommandError:
    return CommandError(f"{path}: cannot be read: {error.strerror}", CALLED_WRONGLY)


def _add_show(commands: Commands) -> None:
    parser = commands.add_parser(
        "show",
        help="print the lines of an audit log, including its older files",
        description="Print the lines of an audit log (gate.audit.file), its traffic and their older files,"
        " oldest first.",
        epilog=epilog(
            "rwt audit show audit.jsonl\n"
            "rwt audit show audit.jsonl --decision refused --since 1h\n"
            "rwt audit show audit.jsonl --name '/cmd_*' --role agent",
            '{"sequence": 7, "line": 5, "time": "…Z", "decision": "refused", "act": "publish", …}',
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
        "--credential", metavar="NAME", help="only lines of clients with this token, by its name"
    )
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
    from rwt.access.gate.audit.file import read_audit  # `--help` does not need it

    output = standard_output(json=arguments.json)
    try:
        for line in _selected(read_audit(arguments.file), arguments):
            _print(line, output)
    except OSError as error:
        raise _unreadable(arguments.file, error) from error
    return 0


def _selected(
    lines: Iterator[Mapping[str, object]], arguments: argparse.Namespace
) -> Iterator[Mapping[str, object]]:
    exact = {
        key: value
        for key in ("decision", "act", "client", "role", "credential")
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
    try:
        return datetime.fromisoformat(str(line["time"])) >= since
    except (KeyError, ValueError):
        return True


def _print(line: Mapping[str, object], output: Output) -> None:
    if output.json:
        output.record(line)
        return
    words = [_field(line.get(key, "")) for key in ("time", "decision", "act", "name")]
    if "client" in line:
        by = [
            f"role {_field(line.get('role'))}",
            _field(line.get("address")) if line.get("address") else "no address",
        ]
        if "credential" in line:
            by.insert(1, f"token {_field(line['credential'])}")
        words.append(f"by {_field(line['client'])} ({', '.join(by)})")
    text = " ".join(word for word in words if word)
    output.line(f"{text}: {_escaped(str(line['text']))}" if "text" in line else text)


def _field(value: object) -> str:
    """Return a value as one word; quoted, if it could be read as several."""
    text = str(value)
    return text if _WORD.fullmatch(text) else f'"{_escaped(text)}"' if text else ""


def _escaped(text: str) -> str:
    """Return a text on one line, without commands for a terminal."""
    return "".join(c if c.isprintable() else c.encode("unicode_escape").decode() for c in text)
