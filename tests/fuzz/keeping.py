"""Which of the inputs that a run found are kept: those that reach a line that no kept input reaches."""

from __future__ import annotations

import hashlib
import sys
from pathlib import Path
from types import FrameType
from typing import Any

from tests.fuzz.targets import CORPUS, TARGETS, Target

Line = tuple[str, int]

FOLLOWED = ("/rwt_", "/rwt/media/", "/rwt/extensions/recording/", "/aiortc/", "/aioice/", "/mcap/")
"""Folders whose lines count."""


def keep(name: str, found: Path) -> int:
    """Add the best of `found` to the kept inputs of a target, the shortest first; how many it were."""
    target = TARGETS[name]
    reached: set[Line] = set()
    for path in (CORPUS / name).iterdir():
        reached |= lines_of(target, path.read_bytes())
    added = 0
    for data in sorted((path.read_bytes() for path in found.iterdir()), key=len):
        lines = lines_of(target, data)
        if not lines <= reached:
            reached |= lines
            added += 1
            write(name, data)
    return added


def write(name: str, data: bytes) -> None:
    """Keep one input of a target."""
    folder = CORPUS / name
    folder.mkdir(parents=True, exist_ok=True)
    (folder / hashlib.sha1(data, usedforsecurity=False).hexdigest()).write_bytes(data)


def lines_of(target: Target, data: bytes) -> set[Line]:
    """Return the lines of this project, and of the parsers behind it, that one input runs."""
    lines: set[Line] = set()

    def trace(frame: FrameType, event: str, _: Any) -> Any:  # as the interpreter calls it
        file = frame.f_code.co_filename
        if not any(name in file for name in FOLLOWED):
            return None
        if event == "line":
            lines.add((file, frame.f_lineno))
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        target(data)
    finally:
        sys.settrace(before)
    return lines
