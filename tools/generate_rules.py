"""Write docs/reference/rules.md from the rules of the conformance suite and its cases.

Run it after a rule or a case has come, gone or changed: ``python tools/generate_rules.py``. A test compares.
"""

# ruff: noqa: E501 - lines of Markdown

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path

from rosbridge_conformance.suite.case import Case
from rosbridge_conformance.suite.loading import CASES, CLIENT_CASES, load_cases
from rosbridge_conformance.suite.rules import load_rules

TARGET = Path(__file__).parents[1] / "docs" / "reference" / "rules.md"

_HEAD = """\
# Rules

Every rule of the protocol that the [conformance suite](../how-to/conformance.md) knows, with the cases that check
it, made from the suite by `tools/generate_rules.py`. A report names a rule by its id; `rwt conformance URL --run ID`
asks its cases alone. [What MUST, SHOULD, COMPAT, HARDEN and INFO mean](../how-to/conformance.md#verdicts-and-grades).

In rules, S1 to S3 are the protocol texts (the ros1 and ros2 branches of rosbridge_suite, and 2.0.0), R1 and R2 its servers for
ROS 1 and ROS 2 (R2+: later than 2.1), J roslibjs, P roslibpy, U roslibrust, JB jrosbridge, and W ros2-web-bridge.
"""


def page() -> str:
    """The whole page."""
    return "\n".join(_lines())


def _lines() -> Iterator[str]:
    yield _HEAD
    servers, clients = (_by_rule(load_cases(folder)) for folder in (CASES, CLIENT_CASES))
    for rule in load_rules().values():
        yield f"## {rule.id}\n"
        yield f"{rule.levels}: {_markdown(rule.text)}\n"
        for what, cases in (("servers", servers.get(rule.id)), ("client libraries", clients.get(rule.id))):
            if cases:
                yield f"Cases for {what}: {', '.join(f'`{case}`' for case in cases)}.\n"
        if rule.no_case:
            yield f"No case for servers: {_markdown(rule.no_case)}\n"


def _by_rule(cases: tuple[Case, ...]) -> dict[str, list[str]]:
    found: dict[str, list[str]] = {}
    for case in cases:
        for rule in case.rules:
            found.setdefault(rule, []).append(case.id)
    return found


def _markdown(text: str) -> str:
    """A text with what Markdown would take for its own escaped, but for code."""
    parts = re.split(r"(`[^`]*`)", text)
    return "".join(part if part.startswith("`") else re.sub(r"([*<>\[\]])", r"\\\1", part) for part in parts)


if __name__ == "__main__":
    TARGET.write_text(page(), encoding="utf-8")
