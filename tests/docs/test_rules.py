"""Whatever is cited is there: rules by their number, and documents by their name."""

from __future__ import annotations

import json
import re
import subprocess
from collections.abc import Iterator
from pathlib import Path

from tests.docs.blocks import ROOT

_RULES = set(
    json.loads((ROOT / "conformance" / "rosbridge_conformance" / "rules.json").read_text(encoding="utf-8"))
)
_RULE = re.compile(rf"\b(?:{'|'.join(sorted({rule[:3] for rule in _RULES}))})-\d\d\b|\bX\d\d\b")
_ROW = re.compile(r"^\| (X\d\d) \|", re.MULTILINE)
_NEW = re.compile(r'^ "([A-Z]{3}-\d\d)": \{$', re.MULTILINE)
_DOCUMENT = re.compile(r"(?<![\w/.-])[A-Z][A-Z_]{3,}(?:\.md)?(?=,? (?:section|settled)|\.md)")


def _texts() -> Iterator[tuple[Path, str]]:
    """Every file that people wrote."""
    listed = subprocess.run(["git", "ls-files"], cwd=ROOT, capture_output=True, text=True, check=True)
    for name in listed.stdout.splitlines():
        if name.endswith((".py", ".md", ".json", ".toml", ".mjs", ".js", ".ts")):
            yield Path(name), (ROOT / name).read_text(encoding="utf-8")


def test_every_rule_that_is_cited_is_written_down() -> None:
    page = (ROOT / "docs" / "reference" / "contradictions.md").read_text(encoding="utf-8")
    example = set(_NEW.findall((ROOT / "docs" / "contributing" / "op.md").read_text(encoding="utf-8")))
    assert example and not example & _RULES, "the page adds a rule under a number that is free"
    known = _RULES | set(_ROW.findall(page)) | example
    cited = {(rule, str(path)) for path, text in _texts() for rule in _RULE.findall(text)}
    assert sorted((rule, path) for rule, path in cited if rule not in known) == []


def test_every_document_that_is_named_is_here() -> None:
    here = {path.stem for path, _ in _texts() if path.suffix == ".md"}
    named = {(name, str(path)) for path, text in _texts() for name in _DOCUMENT.findall(text)}
    assert sorted((name, path) for name, path in named if name.removesuffix(".md") not in here) == []
