"""Rules that cases test, by id, and reasons for rules without a case."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

_FOLDER = Path(__file__).parents[1]


@dataclass(frozen=True, slots=True)
class Rule:
    """Rule of the protocol as used in the field.

    Attributes:
        levels: requirement levels, such as `MUST` or `MUST/COMPAT`.
        text: text of the rule.
        no_case: reason why no case of the server suite tests it, or "".
    """

    id: str
    levels: str
    text: str
    no_case: str = ""


def load_rules() -> Mapping[str, Rule]:
    """Return all rules of `rules.json`, with the reasons of `coverage.json`."""
    texts = json.loads((_FOLDER / "rules.json").read_text(encoding="utf-8"))
    reasons = json.loads((_FOLDER / "coverage.json").read_text(encoding="utf-8"))["without_case"]
    return {
        key: Rule(key, entry["level"], entry["text"], reasons.get(key, "")) for key, entry in texts.items()
    }
