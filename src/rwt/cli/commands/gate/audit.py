"""`rwt audit`: read and verify the audit files of a robot's gate."""

from __future__ import annotations

import argparse
import fnmatch
import re
from collections.abc import Mapping
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import TYPE_CHECKING, Final

from rwt.cli.console.output import Output, Style
from rwt.cli.errors import FAILED, cannot_read
from rwt.cli.parser import Commands
from rwt.cli.verbs import JSON_OPTION, Arguments, LocalVerb, add_family, argument, arguments

if TYPE_CHECKING:
    from rwt.access.gate.audit.verification import AuditReport, Finding

#: Words that are printed as they are; everything else is quoted.
_WORD: Final = re.compile(r"[\w./:~%+-]+|would refuse|left out", re.ASCII)
_AGO: Final = re.compile(r"(\d+(?:\.\d+)?)([smhd])")
_UNITS: Final = {"s": "seconds", "m": "minutes", "h": "hours", "d": "days"}


def add_audit_command(commands: Commands) -> None:
    """Add `audit` to the command line."""
    add_family(commands, "audit", "Read and verify the audit log of a robot's gate.", VERBS)


def _verify(arguments: Arguments, output: Output) -> int:
    """Check that no line was changed, inserted or removed.

    The hash chain of the log is checked, with its traffic and its older files.
    Exit code 1: a line was changed, inserted or removed.
    Not detected: removal of the newest lines of all files, and of the oldest ones; a chain that was computed
    anew. For these, keep the hash that is printed (or logged by the server) elsewhere, and pass it with
    --hash.

    example:
      rwt audit verify audit.jsonl
      rwt audit verify audit.jsonl --hash 9f86d081…

    --json prints:
      {"ok": false, "lines": 812, "faults": [{"file": "audit.jsonl", "line": 7, "text": "…"}],
      "notes": […], "heads": {"audit.jsonl": {"line": 790, "hash": "…"}, …}}
    """
    from rwt.access.gate.audit.verification import Finding, verify_audit  # `--help` does not need it

    is_intact = True
    for path in arguments.files:
        try:
            report = verify_audit(path, arguments.hash)
        except OSError as error:
            raise cannot_read(path, error) from error
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


def _show(arguments: Arguments, output: Output) -> None:
    """Print the lines of an audit log, including its older files.

    The log is gate.audit.file, with its traffic; the oldest lines come first.

    example:
      rwt audit show audit.jsonl
      rwt audit show audit.jsonl --decision refused --since 1h
      rwt audit show audit.jsonl --name '/cmd_*' --role agent

    --json prints:
      {"sequence": 7, "line": 5, "time": "…Z", "decision": "refused", "act": "publish", …}
    """
    from rwt.access.gate.audit.file import read_audit  # `--help` does not need it

    try:
        for line in read_audit(arguments.file):
            if _is_selected(line, arguments):
                _print(line, output)
    except OSError as error:
        raise cannot_read(arguments.file, error) from error


def _is_selected(line: Mapping[str, object], arguments: Arguments) -> bool:
    if arguments.since is not None and not _is_after(line, arguments.since):
        return False
    given = {key: value for key in _FILTERS if (value := getattr(arguments, key)) is not None}
    return all(
        fnmatch.fnmatchcase(str(line.get(key, "")), value)
        if _FILTERS[key][0] == "GLOB"
        else line.get(key) == value
        for key, value in given.items()
    )


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


_FILTERS: Final = {
    "decision": ("WORD", "with this decision, for example allowed, refused, 'would refuse', lease or stop"),
    "act": ("WORD", "of this act, for example publish, call, goal or set_param"),
    "name": ("GLOB", "about this topic, service, action or parameter"),
    "client": ("NAME", "of this client, for example rosbridge:3"),
    "role": ("NAME", "of clients with this role"),
    "credential": ("NAME", "of clients with this token, by its name"),
    "rule": ("GLOB", "decided by this rule, for example gate.rules.drive*"),
}
"""Options of `rwt audit show` that select lines, by the key of a line: metavar and help."""

VERBS: Final = (
    LocalVerb(
        "show",
        _show,
        arguments(
            argument("file", type=Path, metavar="FILE", help="newest file of the log"),
            *(
                argument(f"--{key}", metavar=metavar, help=f"only lines {which}")
                for key, (metavar, which) in _FILTERS.items()
            ),
            argument(
                "--since",
                type=_since,
                metavar="WHEN",
                help="only lines since 90s, 10m, 2h or 3d ago, or a time such as 2026-01-31T12:00Z",
            ),
            JSON_OPTION,
        ),
    ),
    LocalVerb(
        "verify",
        _verify,
        arguments(
            argument("files", type=Path, nargs="+", metavar="FILE", help="newest file of a log"),
            argument("--hash", default="", metavar="HASH", help="hash of a line that the log has to contain"),
            JSON_OPTION,
        ),
    ),
)
