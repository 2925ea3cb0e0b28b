"""Verification of audit files: lines that were changed, inserted or removed."""

from __future__ import annotations

import itertools
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Final

from rwt.access.gate.audit.file import NO_LINE, audit_files, files_of, hash_of, number_in, values_of

#: Maximum number of findings that are kept; more are counted.
_MAX_FINDINGS: Final = 1000


@dataclass(frozen=True, slots=True)
class Finding:
    """Place where an audit is not as it was written.

    Attributes:
        line: number of the line in the file, from 1.
    """

    file: Path
    line: int
    text: str


@dataclass(slots=True)
class AuditReport:
    """Result of a verification.

    Attributes:
        faults: lines that were changed, inserted or removed.
        notes: observations that have an innocent explanation, such as rotation.
        heads: last line of each file: its number in the chain, and its hash.
        has_line: True if one of the lines has the hash that was searched for.
    """

    faults: list[Finding] = field(default_factory=list)
    notes: list[Finding] = field(default_factory=list)
    lines: int = 0
    heads: dict[Path, tuple[int, str]] = field(default_factory=dict)
    has_line: bool = False

    def add_fault(self, finding: Finding) -> None:
        """Add a fault; above the maximum number it is left out."""
        if len(self.faults) < _MAX_FINDINGS:
            self.faults.append(finding)


def verify_audit(path: Path, wanted_hash: str = "") -> AuditReport:
    """Check the chain of an audit file, of its traffic, and of their older files.

    Args:
        path: newest file of security events.
        wanted_hash: hash of a line that has to be there; empty for none.

    Raises:
        OSError: a file cannot be read.
    """
    report = AuditReport()
    streams = [_Stream(each, wanted_hash, report) for each in audit_files(path)]
    for stream in streams:
        stream.check()
    _check_sequence(path, streams, report)
    return report


class _Stream:
    """Chain of one file and its older files.

    Attributes:
        sequences: sequence numbers of the lines.
        is_complete: True if the first line ever written is there.
    """

    def __init__(self, path: Path, wanted_hash: str, report: AuditReport) -> None:
        self._path = path
        self._wanted_hash = wanted_hash
        self._report = report
        self._seen: dict[str, Finding] = {}
        self._before: Finding | None = None  # Place of the line before.
        self._hash = NO_LINE  # Its hash.
        self._number = 0  # Its number in the chain, as far as known.
        self._is_open = False
        self.is_complete = True
        self.sequences: list[int] = []

    def check(self) -> None:
        """Check all lines, the oldest file first."""
        for file in files_of(self._path):
            with file.open("rb") as lines:
                for number, data in enumerate(lines, 1):
                    self._check_line(Finding(file, number, ""), data.removesuffix(b"\n"))
        self._report.heads[self._path] = (self._number, self._hash)

    def _check_line(self, place: Finding, data: bytes) -> None:
        values = values_of(data)
        if values is not None:  # Else it is cut; the next one names its hash like that of any other.
            self._check_chain(place, values)
            self._check_restart(place, values)
            self._number = number_in(values, "line")
            self.sequences.append(number_in(values, "sequence"))
        self._hash = hash_of(data)
        self._seen[self._hash] = place
        self._before = place
        self._report.lines += 1
        self._report.has_line |= self._hash == self._wanted_hash

    def _check_chain(self, place: Finding, values: Mapping[str, object]) -> None:
        report, claimed, number = self._report, values.get("previous"), number_in(values, "line")
        if self._before is None:
            if claimed != NO_LINE:
                text = f"begins with line {number}: older lines were rotated away, or removed"
                report.notes.append(Finding(place.file, place.line, text))
                self.is_complete = False
        elif claimed == self._hash:
            return
        elif isinstance(claimed, str) and claimed in self._seen:
            after = self._seen[claimed]
            text = f"inserted: the next line follows line {after.line} of {after.file.name}"
            report.add_fault(Finding(self._before.file, self._before.line, text))
        elif number > self._number + 1:
            text = f"{number - self._number - 1} lines were removed before this one"
            report.add_fault(Finding(place.file, place.line, text))
        else:
            text = "changed: its hash is not the one that the next line names"
            report.add_fault(Finding(self._before.file, self._before.line, text))

    def _check_restart(self, place: Finding, values: Mapping[str, object]) -> None:
        decision = values.get("decision")
        if decision == "opened" and self._is_open:
            text = "the server started again without having closed the audit: the last lines may be missing"
            self._report.notes.append(Finding(place.file, place.line, text))
        self._is_open = decision != "closed"


def _check_sequence(path: Path, streams: list[_Stream], report: AuditReport) -> None:
    """Look for sequence numbers that neither file has: lines that were removed at the end of one."""
    if len(streams) < 2 or report.faults or not all(each.sequences for each in streams):
        return
    # A file whose older lines are gone says nothing about the time before its first line.
    first = max((stream.sequences[0] for stream in streams if not stream.is_complete), default=1)
    found = sorted({each for stream in streams for each in stream.sequences if each >= first})
    for before, after in itertools.pairwise(found):
        if after > before + 1:
            text = f"lines with the sequence numbers {before + 1} to {after - 1} were removed at an end"
            report.add_fault(Finding(path, 0, text))
