"""Transcript of one session: a line for each frame, with what varies from run to run replaced."""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Final, NamedTuple

RECORDED: Final = Path(__file__).with_name("recorded")


class Rule(NamedTuple):
    """One thing that varies from run to run.

    Attributes:
        name: what varies.
        sessions: pattern of the sessions that the rule applies to.
        pattern: what is replaced in a line.
        replacement: what stands there instead.
    """

    name: str
    sessions: str
    pattern: str
    replacement: str


RULES: Final = (
    Rule("port", ".*", r"(127\.0\.0\.1|localhost):\d{2,5}\b", r"\1:PORT"),
    Rule(
        "version of this program",
        ".*",
        r'(Robot Web Tools |"version":\s?")\d+\.\d+\.\d+[\w.+-]*',
        r"\1VERSION",
    ),
    Rule("port of a client", ".*", r'("(?:port|client_port)": ?)\d+', r"\1PORT"),
    Rule("port as a parameter", ".*", r'(actual_port","value":|actual_port": )\d+', r"\1PORT"),
    Rule("HTTP date", ".*", r"(?i)^(date|last-modified): .*", r"\1: DATE"),
    Rule("WebSocket key", ".*", r"(?i)^(sec-websocket-accept): .*", r"\1: KEY"),
    Rule(
        "stamp of ROS 2", ".*", r'"sec":\s?\d{9,}((?:\\n)?,\s?)"nanosec":\s?\d+', r'"sec":SEC\1"nanosec":NSEC'
    ),
    Rule("stamp of ROS 1", ".*", r'"secs":\s?\d{9,},(\s?)"nsecs":\s?\d+', r'"secs":SEC,\1"nsecs":NSEC'),
    Rule("stamp in CBOR", "rosbridge.encodings", r"(73656373)1a[0-9a-f]{8}", r"\1 SEC "),
    Rule(
        "nanoseconds in CBOR",
        "rosbridge.encodings",
        r"(6e73656373)(1a[0-9a-f]{8}|19[0-9a-f]{4})",
        r"\1 NSEC ",
    ),
    Rule("stamp of a Foxglove message", "foxglove.*", r"^(\S+< hex 01[0-9a-f]{8})[0-9a-f]{16}", r"\1 TIME "),
    Rule("session of Foxglove", ".*", r'"sessionId":"[^"]*"', '"sessionId":"SESSION"'),
    Rule("stamp of a sample over HTTP", ".*", r"(?i)^(ros-time): [\d.]+", r"\1: TIME"),
    Rule("id of an event", "http", r"^id: \d{15,}", "id: TIME"),
    Rule("ETag, a hash of the body", "http", r'(?i)^(etag): "[^"]*"', r'\1: "ETAG"'),
    Rule("session of MCP", "mcp", r"(?i)^(mcp-session-id): .*", r"\1: SESSION"),
    Rule("work of the server", ".*", r'"work": [\d.]+', '"work": WORK'),
    Rule("age of a credential", "access", r"t is \d+ s off", "t is AGE s off"),
    Rule("random id", ".*", r"[0-9a-f]{8}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{4}-[0-9a-f]{12}", "UUID"),
    Rule("random id without hyphens", "http|mcp", r"\b[0-9a-f]{32}\b", "UUID"),
    Rule("hash of the audit line before", "access", r'"previous":"[0-9a-f]{64}"', '"previous":"HASH"'),
    Rule(
        "interval of repeated events",
        "access",
        r"(repeated \S+(?: times)? in) [\d.]+ s",
        r"\1 SECONDS s",
    ),
    Rule("time of an audit line", "access", r'"(time|at)":\s?("[^"]*"|[\d.]+)', r'"\1":"TIME"'),
    Rule("names of ops", "rosbridge.*", r"(expected one of) \w+(?:, \w+)+", r"\1 NAMES"),
    Rule("names that an agent may use", "mcp", r"(available:) [^,\"]+(?:, [^,\"]+)+", r"\1 NAMES"),
    Rule("temporary folder", ".*", r"/(?:[\w.-]+/)*traces-[\w]+", "FOLDER"),
)
"""All that varies from run to run, and lists of names that grow with other parts."""

FIRST: Final = {"rosbridge.noetic": "rosbridge"}
"""Sessions that are recorded as differences, each with the session that it differs from."""


class Transcript:
    """Lines of one session, in the order in which they came.

    Args:
        name: name of the session, and of its file.
    """

    def __init__(self, name: str) -> None:
        self.name = name
        self._rules = [
            (re.compile(rule.pattern), rule.replacement)
            for rule in RULES
            if re.fullmatch(rule.sessions, name)
        ]
        self._lines: list[str] = []

    def add(self, text: str) -> None:
        """Add the lines of a text."""
        for line in text.split("\n"):
            self._lines.append(self._replaced(line))

    def add_row(self, parts: Iterable[str]) -> None:
        """Add several lines as one, if there are any."""
        if row := " | ".join(map(self._replaced, parts)):
            self._lines.append(row)

    def title(self, text: str) -> None:
        """Begin a chapter."""
        self._lines.append(f"# {text}")

    def _replaced(self, line: str) -> str:
        line = line.replace("\r", "\\r")
        for pattern, replacement in self._rules:
            line = pattern.sub(replacement, line)
        return line

    def __str__(self) -> str:
        return "\n".join(self._lines) + "\n"


Session = Callable[[Transcript], None]
"""One scripted session."""


def frame_text(data: str | bytes) -> str:
    """Return a frame as one line."""
    return data if isinstance(data, str) else f"hex {data.hex()}"


def recording(name: str, played: str) -> str:
    """Return the recording of a session: its transcript, or how this differs from another recording.

    Numbers of lines are left out, so that a change of both sessions changes one recording.
    """
    if name not in FIRST:
        return played
    first = file_of(FIRST[name]).read_text(encoding="utf-8")
    lines = list(difflib.unified_diff(first.splitlines(), played.splitlines(), lineterm="", n=0))[2:]
    return "\n".join("@@" if line.startswith("@@") else line for line in lines) + "\n"


def file_of(name: str) -> Path:
    """Return where a session is recorded."""
    return RECORDED / f"{name}.txt"
